# SPDX-License-Identifier: Apache-2.0
"""A WitMotion sensor in software: it talks by itself, and takes what is written to it."""
import struct
from typing import Tuple

from ballbot_ros.imus.witmotion import (
    BAUD, BAUDS, CONTENT, FACTORY_BAUD, FORCE, FORCE_COUNT, KEY, LARGEST, packet, RATE, RATE_COUNT,
    RATES, TURN_RATE, UNLOCK, Vector)

ANGLES = 0x53
# Content of the packets, by the bit that asks for them: time, force, turn rate, angles.
PACKETS = {0x0002: FORCE, 0x0004: TURN_RATE, 0x0008: ANGLES}
COMMAND = 5


class EmulatedWitMotion:
    """
    The firmware of a sensor: time in, bytes out.

    It leaves the factory with force, turn rate and angles ten times a second at 9600 baud.  What
    is written to a register counts after the key alone, as in the maker's protocol.

    Attributes
    ----------
    baud : int
        At which it talks and listens; whoever carries the bytes looks at it.
    turn_rate, force : (float, float, float)
        What it measures, in its own axes [rad/s], [m/s2].

    """

    def __init__(self) -> None:
        """Boot with the settings of the factory."""
        self.turn_rate: Vector = (0.0, 0.0, 0.0)
        self.force: Vector = (0.0, 0.0, 9.81)
        self.boot()

    def boot(self) -> None:
        """Forget what was not saved, which is all of it."""
        self.registers = {CONTENT: 0x000E, RATE: RATES[10], BAUD: BAUDS[FACTORY_BAUD]}
        self._unlocked = False
        self._received = b''
        self._next = 0.0

    @property
    def baud(self) -> int:
        """Return the baud rate that its register says."""
        return {code: baud for baud, code in BAUDS.items()}.get(
            self.registers[BAUD], FACTORY_BAUD)

    @property
    def period(self) -> float:
        """Return the time between two readings [s]."""
        return 1.0 / {code: rate for rate, code in RATES.items()}.get(self.registers[RATE], 10)

    def receive(self, data: bytes) -> None:
        """Take commands."""
        self._received += data
        while len(self._received) >= COMMAND:
            head, address, value = struct.unpack('>H', self._received[:2])[0], \
                self._received[2], struct.unpack('<H', self._received[3:COMMAND])[0]
            if head != 0xFFAA:
                self._received = self._received[1:]
                continue
            self._received = self._received[COMMAND:]
            if address == KEY:
                self._unlocked = value == UNLOCK
            elif self._unlocked:
                self.registers[address] = value

    def tick(self, now: float) -> bytes:
        """Return what it sends at a time [s]: nothing, or the packets of one reading."""
        if now < self._next:
            return b''
        self._next = max(self._next + self.period, now)
        content, data = self.registers[CONTENT], b''
        for bit, kind in PACKETS.items():
            if content & bit:
                data += packet(kind, self._counts(kind), 2500)
        return data

    def _counts(self, kind: int) -> Tuple[int, int, int]:
        """Return what a packet says, no more than the largest there is."""
        if kind == ANGLES:
            return 0, 0, 0
        values, size = (self.force, FORCE_COUNT) if kind == FORCE else (
            self.turn_rate, RATE_COUNT)
        x, y, z = (min(max(round(value / size), -LARGEST - 1), LARGEST) for value in values)
        return x, y, z
