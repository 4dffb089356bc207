# SPDX-License-Identifier: Apache-2.0
"""Faults of a simulated sensor, in addition to its reported noise."""
from collections import deque
from dataclasses import dataclass
from typing import Deque, Generic, List, Tuple, TypeVar

from ballbot_ros.config.fields import Checked, quantity

T = TypeVar('T')


@dataclass(frozen=True)
class SensorFaults(Checked):
    """Faults of a sensor that observes the ground ahead; none by default."""

    reported_sd: float = quantity(
        '1', 'ratio of reported to true standard deviations; 0 to report none',
        default=1.0, minimum=0.0, maximum=10.0)
    bias: float = quantity(
        'm', 'constant error of the height of every face', default=0.0, minimum=-0.1, maximum=0.1)
    scale: float = quantity(
        '1', 'relative error of all heights', default=0.0, minimum=-0.9, maximum=1.0)
    growth: float = quantity(
        '1/m', 'fraction of a height that is not detected, per distance', default=0.0, minimum=0.0,
        maximum=10.0)
    dropout: float = quantity(
        '1', 'probability that an observation is dropped', default=0.0, minimum=0.0, maximum=1.0)
    latency: float = quantity(
        's', 'delay from a measurement to its message', default=0.0, minimum=0.0, maximum=10.0)
    holes: float = quantity(
        '1', 'probability that a point of the terrain is missing', default=0.0, minimum=0.0,
        maximum=1.0)
    offset: float = quantity(
        'm', 'constant height error of the entire terrain', default=0.0, minimum=-1.0,
        maximum=1.0)
    tilt: float = quantity(
        'rad', 'slope error of the entire terrain, positive uphill', default=0.0,
        minimum=-0.5, maximum=0.5)


class Latency(Generic[T]):
    """Delays measurements by `seconds`, which may be changed [s]."""

    def __init__(self, seconds: float):
        self.seconds = seconds
        self.clear()

    def clear(self) -> None:
        """Discard delayed measurements."""
        self._held: Deque[Tuple[float, T]] = deque()

    def put(self, made: float, item: T) -> None:
        """Add an item made at a time [s], which must not be before that of the last one."""
        self._held.append((made, item))

    def due(self, now: float) -> List[T]:
        """Return and remove the measurements that are due, in order."""
        found = []
        # Times are sums of periods: rounding must not delay a measurement.
        while self._held and self._held[0][0] + self.seconds <= now + 1e-9:
            found.append(self._held.popleft()[1])
        return found
