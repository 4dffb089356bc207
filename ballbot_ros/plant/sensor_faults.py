# SPDX-License-Identifier: Apache-2.0
"""Faults of a simulated sensor, besides its reported noise."""
from collections import deque
from dataclasses import dataclass
from typing import Deque, Generic, List, Tuple, TypeVar

from ballbot_ros.config.fields import Checked, quantity

T = TypeVar('T')


@dataclass(frozen=True)
class SensorFaults(Checked):
    """Faults of a sensor that looks at the ground ahead; none by default."""

    reported_sd: float = quantity(
        '1', 'part of its true standard deviations that the sensor reports; 0 for none',
        default=1.0, minimum=0.0, maximum=10.0)
    bias: float = quantity(
        'm', 'constant error of the height of every face', default=0.0, minimum=-0.1, maximum=0.1)
    scale: float = quantity(
        '1', 'relative error of all heights', default=0.0, minimum=-0.9, maximum=1.0)
    growth: float = quantity(
        '1/m', 'part of a height that is not seen yet, per distance', default=0.0, minimum=0.0,
        maximum=10.0)
    dropout: float = quantity(
        '1', 'probability that a look is lost', default=0.0, minimum=0.0, maximum=1.0)
    latency: float = quantity(
        's', 'delay from a measurement to its message', default=0.0, minimum=0.0, maximum=10.0)
    holes: float = quantity(
        '1', 'probability that a point of the terrain is lost', default=0.0, minimum=0.0,
        maximum=1.0)
    offset: float = quantity(
        'm', 'height by which the whole terrain is seen too high', default=0.0, minimum=-1.0,
        maximum=1.0)
    tilt: float = quantity(
        'rad', 'slope by which the whole terrain is seen rising too much', default=0.0,
        minimum=-0.5, maximum=0.5)


class Latency(Generic[T]):
    """Delays measurements by a latency, `seconds`, which may be changed [s]."""

    def __init__(self, seconds: float):
        self.seconds = seconds
        self.clear()

    def clear(self) -> None:
        """Discard delayed measurements."""
        self._held: Deque[Tuple[float, T]] = deque()

    def put(self, made: float, item: T) -> None:
        """Take an item that was made at a time, not before the last one [s]."""
        self._held.append((made, item))

    def due(self, now: float) -> List[T]:
        """Return and remove the measurements that are due, in order."""
        ripe = []
        # Times are sums of periods: rounding must not delay a measurement.
        while self._held and self._held[0][0] + self.seconds <= now + 1e-9:
            ripe.append(self._held.popleft()[1])
        return ripe
