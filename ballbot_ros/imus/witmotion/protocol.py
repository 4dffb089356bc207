# SPDX-License-Identifier: Apache-2.0
r"""
The serial protocol of WitMotion's inertial sensors: WT901, WT901C, JY901, HWT905 and others.

The sensor sends unrequested packets at a configured rate.  Each packet has eleven bytes::

    55 KIND  x_low x_high  y_low y_high  z_low z_high  t_low t_high  SUM

KIND 51 is the specific force, in 16 g / 32768, and 52 the turn rate, in 2000 deg/s / 32768; SUM is
that of the ten bytes before it, modulo 256.  A packet of the force precedes that of the turn rate
at the same time.  A register is written with ``FF AA ADDRESS LOW HIGH``, after the key
``FF AA 69 88 B5``; unsaved settings are lost without power.

Sources: the maker's data sheets of the WT901 (v20-0702) and the "WIT standard communication
protocol"; for the numbers of rates and bandwidths, the maker's REG.h.
"""
from collections import Counter
import math
import struct
from typing import List, Optional, Tuple

from ballbot_ros.drives.contract import BITS_PER_BYTE
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.imus.contract import InertialReading, InertialSensor

HEADER, SIZE = 0x55, 11
FORCE, TURN_RATE = 0x51, 0x52
KINDS = range(0x50, 0x60)  # time, force, turn rate, angles, ... and answers
# Scale of a count, and the largest count, at which a reading is saturated.
STANDARD_GRAVITY = 9.80665
FORCE_COUNT = 16.0 * STANDARD_GRAVITY / 32768  # [m/s2]
RATE_COUNT = math.radians(2000.0) / 32768  # [rad/s]
LARGEST = 32767

KEY, CONTENT, RATE, BAUD, BANDWIDTH = 0x69, 0x02, 0x03, 0x04, 0x1F
UNLOCK = 0xB588
FORCE_AND_RATE = 0x0006
# Values of the registers [Hz], [bit/s], [Hz].
RATES = {10: 0x06, 20: 0x07, 50: 0x08, 100: 0x09, 200: 0x0B}
BAUDS = {4800: 1, 9600: 2, 19200: 3, 38400: 4, 57600: 5, 115200: 6, 230400: 7}
BANDWIDTHS = {256: 0, 188: 1, 98: 2, 42: 3, 20: 4, 10: 5, 5: 6}
# Factory default.
FACTORY_BAUD = 9600


def packet(kind: int, counts: Tuple[int, int, int], last: int = 0) -> bytes:
    """Return a packet as the sensor sends it."""
    body = struct.pack('<BB4h', HEADER, kind, *counts, last)
    return body + bytes((sum(body) % 256,))


def write_register(address: int, value: int) -> bytes:
    """Return the command that sets a register; it takes effect after `UNLOCK` in `KEY`."""
    return struct.pack('<BBBH', 0xFF, 0xAA, address, value)


class WitMotion(InertialSensor):
    """See `InertialSensor`; each command must be sent separately."""

    factory_baud = FACTORY_BAUD
    reading_bits = 2 * SIZE * BITS_PER_BYTE

    def __init__(self, baud: int, rate: int, bandwidth: int):
        for name, value, known, unit in (
                ('baud', baud, BAUDS, 'bit/s'), ('rate', rate, RATES, 'Hz'),
                ('bandwidth', bandwidth, BANDWIDTHS, 'Hz')):
            if value not in known:
                raise ConfigurationError(
                    f'{name} of a WitMotion sensor must be one of '
                    f'{", ".join(map(str, sorted(known)))} {unit}, got {value!r}',
                    'not_a_choice', name)
        if rate * self.reading_bits > baud:
            raise ConfigurationError(
                f'{rate} readings per second need {rate * self.reading_bits} bit/s, got a baud '
                f'rate of {baud}: raise baud or lower rate', 'inconsistent', 'baud')
        super().__init__(baud, rate, bandwidth)

    def configure(self, baud: int) -> List[bytes]:
        rate = self.rate if baud == self.baud else min(RATES)
        return [write_register(KEY, UNLOCK), write_register(CONTENT, FORCE_AND_RATE),
                write_register(RATE, RATES[rate]),
                write_register(BANDWIDTH, BANDWIDTHS[self.bandwidth])]

    def change_baud(self) -> List[bytes]:
        return [write_register(KEY, UNLOCK), write_register(BAUD, BAUDS[self.baud])]

    def parser(self) -> 'PacketParser':
        return PacketParser()


class PacketParser:
    """
    See `InertialSensor.parser`.

    An 8-bit sum accepts one wrong packet in 256.  So after bytes that belong to no packet the
    first packet is dropped, and only those that follow it without a gap are used.
    """

    def __init__(self) -> None:
        self.counts = Counter(readings=0, refused=0, skipped=0, unpaired=0)
        self._buffer = bytearray()
        self._in_step = False  # the byte before the buffer is the last of a packet
        self._force: Optional[Tuple[int, int, int]] = None

    def feed(self, data: bytes) -> List[InertialReading]:
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
