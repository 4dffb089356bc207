# SPDX-License-Identifier: Apache-2.0
"""A serial line: bytes take their transmission time, and may be lost or corrupted."""
from collections import deque
from dataclasses import dataclass
import random
from typing import Deque

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.drives.contract import BITS_PER_BYTE

# Model of the bytes received at a wrong baud rate: neither text nor packets.
WRONG_BAUD = bytes((byte * 167 + 13) % 256 | 0x80 for byte in range(256))


@dataclass(frozen=True)
class LineFaults(Checked):
    """Faults of the bytes on a line; the fractions are probabilities of each byte."""

    drop: float = quantity('1', 'fraction of the bytes that are lost', default=0.0, minimum=0.0,
                           maximum=1.0)
    corrupt: float = quantity('1', 'fraction of the bytes that are corrupted', default=0.0,
                              minimum=0.0, maximum=1.0)
    duplicate: float = quantity('1', 'fraction of the bytes that are repeated', default=0.0,
                                minimum=0.0, maximum=1.0)
    delay: float = quantity('s', 'additional delay of every byte', default=0.0, minimum=0.0,
                            maximum=10.0)
    garbage: float = quantity('1/s', 'rate of inserted random bytes', default=0.0,
                              minimum=0.0, maximum=1e6)

    def damage(self, data: bytes, rng: random.Random) -> bytes:
        """Return the bytes after the faults."""
        if not (self.drop or self.corrupt or self.duplicate):
            return data
        result = bytearray()
        for byte in data:
            if rng.random() < self.drop:
                continue
            if rng.random() < self.corrupt:
                byte ^= rng.randrange(1, 256)
            result.append(byte)
            if rng.random() < self.duplicate:
                result.append(byte)
        return bytes(result)


class Direction:
    """One direction of a line, which delivers one byte after the other at a baud rate [bit/s]."""

    def __init__(self, baud: float, rng: random.Random):
        self.faults = LineFaults()
        self.garbled = False  # the two ends have different baud rates
        self._byte_time = BITS_PER_BYTE / baud
        self._rng = rng
        self._free_at = 0.0
        self._garbage_at = 0.0
        self._in_transit: Deque[tuple[float, int]] = deque()  # arrival time [s], byte

    def put(self, data: bytes, now: float) -> None:
        """Send bytes at `now` [s]."""
        if self.garbled:
            data = data.translate(WRONG_BAUD)
        self._transmit(self.faults.damage(data, self._rng), now)

    def take(self, now: float) -> bytes:
        """Return the bytes that have arrived by `now` [s]."""
        self._make_garbage(now)
        arrived = bytearray()
        while self._in_transit and self._in_transit[0][0] <= now:
            arrived.append(self._in_transit.popleft()[1])
        return bytes(arrived)

    def next_at(self) -> float:
        """Return when the next byte arrives [s], infinite for an idle line."""
        return self._in_transit[0][0] if self._in_transit else float('inf')

    def clear(self) -> None:
        """Drop the data in transit."""
        self._in_transit.clear()
        self._free_at = 0.0

    def _transmit(self, data: bytes, start: float) -> None:
        for byte in data:
            self._free_at = max(self._free_at, start) + self._byte_time
            self._in_transit.append((self._free_at + self.faults.delay, byte))

    def _make_garbage(self, now: float) -> None:
        """Transmit the random bytes for the time since the last call, while the line was idle."""
        if self.faults.garbage:
            start = max(self._garbage_at, now - 0.1)
            number = int(min(self.faults.garbage * (now - start),
                             (now - max(self._free_at, start)) / self._byte_time))
            if number > 0:
                self._garbage_at = now
                self._transmit(self._rng.randbytes(number), start)
        else:
            self._garbage_at = now
