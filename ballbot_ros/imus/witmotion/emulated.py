# SPDX-License-Identifier: Apache-2.0
"""Emulated WitMotion sensor: it sends unrequested readings and executes register writes."""
import struct
from typing import Tuple

from ballbot_ros.imus.contract import EmulatedSensor
from ballbot_ros.imus.witmotion.protocol import (
    BAUD, BAUDS, CONTENT, FACTORY_BAUD, FORCE, FORCE_COUNT, KEY, LARGEST, packet, RATE, RATE_COUNT,
    RATES, TURN_RATE, UNLOCK)

ANGLES = 0x53
# Bit of the register `CONTENT` -> kind of the packets that it enables.
PACKETS = {0x0002: FORCE, 0x0004: TURN_RATE, 0x0008: ANGLES}
COMMAND = 5


class EmulatedWitMotion(EmulatedSensor):
    """
    See `EmulatedSensor`.

    By default it sends force, turn rate and angles ten times per second at 9600 baud.  A
    register accepts a value only after the key, as in the maker's protocol.
    """

    def __init__(self) -> None:
        self.boot()

    def boot(self) -> None:
        """Restart with the factory defaults: no setting is saved."""
        self.registers = {CONTENT: 0x000E, RATE: RATES[10], BAUD: BAUDS[FACTORY_BAUD]}
        self._unlocked = False
        self._received = b''
        self._next = 0.0

    @property
    def baud(self) -> int:
        return {code: baud for baud, code in BAUDS.items()}.get(
            self.registers[BAUD], FACTORY_BAUD)

    @property
    def period(self) -> float:
        """Return the time between two readings [s]."""
        return 1.0 / {code: rate for rate, code in RATES.items()}.get(self.registers[RATE], 10)

    def receive(self, data: bytes) -> None:
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
        if now < self._next:
            return b''
        self._next = max(self._next + self.period, now)
        content, data = self.registers[CONTENT], b''
        for bit, kind in PACKETS.items():
            if content & bit:
                data += packet(kind, self._counts(kind), 2500)
        return data

    def _counts(self, kind: int) -> Tuple[int, int, int]:
        """Return the counts of a packet, within their range."""
        if kind == ANGLES:
            return 0, 0, 0
        values, size = (self.force, FORCE_COUNT) if kind == FORCE else (
            self.turn_rate, RATE_COUNT)
        x, y, z = (min(max(round(value / size), -LARGEST - 1), LARGEST) for value in values)
        return x, y, z
