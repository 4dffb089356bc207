# SPDX-License-Identifier: Apache-2.0
r"""
The serial protocol of WitMotion's inertial sensors: WT901, WT901C, JY901, HWT905 and others.

The sensor talks by itself, at a rate that it is told.  Each packet has eleven bytes::

    55 KIND  x_low x_high  y_low y_high  z_low z_high  t_low t_high  SUM

KIND 51 is the specific force, in 16 g / 32768, and 52 the turn rate, in 2000 deg/s / 32768; SUM is
that of the ten bytes before it, modulo 256.  A packet of force is followed by the one of the turn
rate of the same moment.  A register is written with ``FF AA ADDRESS LOW HIGH``, after the key
``FF AA 69 88 B5``; what is not saved is forgotten without power.

From the maker's data sheets of the WT901 (v20-0702) and the "WIT standard communication protocol";
the numbers of rates and bandwidths from the maker's REG.h.
"""
from collections import Counter
import math
import struct
from typing import List, NamedTuple, Optional, Tuple

from ballbot_ros.errors import ConfigurationError

HEADER, SIZE = 0x55, 11
FORCE, TURN_RATE = 0x51, 0x52
KINDS = range(0x50, 0x60)  # time, force, turn rate, angles, ... and answers
# What a count is, and the largest there is: one that shows more shows this.
STANDARD_GRAVITY = 9.80665
FORCE_COUNT = 16.0 * STANDARD_GRAVITY / 32768  # [m/s2]
RATE_COUNT = math.radians(2000.0) / 32768  # [rad/s]
LARGEST = 32767

KEY, CONTENT, RATE, BAUD, BANDWIDTH = 0x69, 0x02, 0x03, 0x04, 0x1F
UNLOCK = 0xB588
FORCE_AND_RATE = 0x0006
# What the registers are set to [Hz], [bit/s], [Hz].
RATES = {10: 0x06, 20: 0x07, 50: 0x08, 100: 0x09, 200: 0x0B}
BAUDS = {4800: 1, 9600: 2, 19200: 3, 38400: 4, 57600: 5, 115200: 6, 230400: 7}
BANDWIDTHS = {256: 0, 188: 1, 98: 2, 42: 3, 20: 4, 10: 5, 5: 6}
# As sensors leave the factory.
FACTORY_BAUD = 9600

Vector = Tuple[float, float, float]


class InertialReading(NamedTuple):
    """What a sensor measured at one moment, in its own axes."""

    turn_rate: Vector  # [rad/s]
    force: Vector  # specific force: at rest g upwards [m/s2]
    saturated: bool  # one of them is the largest there is


def packet(kind: int, counts: Tuple[int, int, int], last: int = 0) -> bytes:
    """Return a packet as the sensor sends it."""
    body = struct.pack('<BB4h', HEADER, kind, *counts, last)
    return body + bytes((sum(body) % 256,))


def write_register(address: int, value: int) -> bytes:
    """Return the command that sets a register; it takes effect after `UNLOCK` in `KEY`."""
    return struct.pack('<BBBH', 0xFF, 0xAA, address, value)


def settings(rate: int, bandwidth: int) -> List[bytes]:
    """
    Return the commands that make a sensor send forces and turn rates, each to be sent alone.

    Parameters
    ----------
    rate : int
        [Hz], of `RATES`.
    bandwidth : int
        Of its filters [Hz], of `BANDWIDTHS`.

    Raises
    ------
    ConfigurationError
        If there is no such rate or bandwidth.

    """
    for what, value, known in (('rate', rate, RATES), ('bandwidth', bandwidth, BANDWIDTHS)):
        if value not in known:
            raise ConfigurationError(
                f'{what} of a WitMotion sensor must be one of '
                f'{", ".join(map(str, sorted(known)))} Hz, got {value!r}')
    return [write_register(KEY, UNLOCK), write_register(CONTENT, FORCE_AND_RATE),
            write_register(RATE, RATES[rate]), write_register(BANDWIDTH, BANDWIDTHS[bandwidth])]


def change_baud(baud: int) -> List[bytes]:
    """
    Return the commands that change the baud rate, each to be sent alone.

    Raises
    ------
    ConfigurationError
        If there is no such baud rate.

    """
    if baud not in BAUDS:
        raise ConfigurationError(
            f'baud rate of a WitMotion sensor must be one of '
            f'{", ".join(map(str, sorted(BAUDS)))}, got {baud!r}')
    return [write_register(KEY, UNLOCK), write_register(BAUD, BAUDS[baud])]


def least_baud(rate: int) -> float:
    """Return the bits per second that two packets at a rate take, start and stop bits too."""
    return 2.0 * SIZE * 10.0 * rate


class ReadingParser:
    """
    Finds readings in what a sensor sends.

    A sum of eight bits lets one wrong packet in 256 pass.  So after bytes that belong to no packet
    one packet is only looked at, and what follows it without a gap is believed.

    Attributes
    ----------
    counts : Counter
        ``readings``; ``refused`` packets with a wrong sum, ``skipped`` bytes that belong to no
        packet, ``unpaired`` forces or turn rates without the other.

    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self.counts = Counter(readings=0, refused=0, skipped=0, unpaired=0)
        self._buffer = bytearray()
        self._in_step = False  # the byte before the buffer is the last of a packet
        self._force: Optional[Tuple[int, int, int]] = None

    def feed(self, data: bytes) -> List[InertialReading]:
        """Take bytes and return the readings that they complete."""
        self._buffer += data
        found = []
        while len(self._buffer) >= SIZE:
            body = bytes(self._buffer[:SIZE])
            if body[0] != HEADER or body[1] not in KINDS:
                self._skip()
            elif sum(body[:-1]) % 256 != body[-1]:
                self.counts['refused'] += 1
                self._skip()
            else:
                del self._buffer[:SIZE]
                if self._in_step:
                    reading = self._take(body)
                    if reading is not None:
                        found.append(reading)
                self._in_step = True
        return found

    def _skip(self) -> None:
        """Look for a packet a byte later."""
        del self._buffer[0]
        self.counts['skipped'] += 1
        self._in_step, self._force = False, None

    def _take(self, body: bytes) -> Optional[InertialReading]:
        kind = body[1]
        x, y, z, _ = struct.unpack('<4h', body[2:-1])
        if kind == FORCE:
            self.counts['unpaired'] += self._force is not None
            self._force = x, y, z
        elif kind == TURN_RATE:
            force, self._force = self._force, None
            if force is None:
                self.counts['unpaired'] += 1
                return None
            self.counts['readings'] += 1
            return InertialReading(
                (x * RATE_COUNT, y * RATE_COUNT, z * RATE_COUNT),
                (force[0] * FORCE_COUNT, force[1] * FORCE_COUNT, force[2] * FORCE_COUNT),
                max(map(abs, (x, y, z, *force))) >= LARGEST)
        return None
