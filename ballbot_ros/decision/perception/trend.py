# SPDX-License-Identifier: Apache-2.0
"""Trend of the observed face height with distance, and scatter of observations."""
from collections import deque
import math
from statistics import median
from typing import Deque

# Minimum number of observations for estimating the scatter; default noise before.
ENOUGH = 5

# Window of the scatter estimate, and its minimum number of observations.
KEPT, LEAST_KEPT = 25, 10

# Minimum range of distances for a trend [m].
LEAST_BASE = 0.1

# Significance threshold of a trend, in standard deviations.
SIGNIFICANT = 4.0


class Trend:
    """Recursive linear regression of heights on distances."""

    def __init__(self) -> None:
        """Start without a look."""
        self.count = 0
        self._distance = self._height = 0.0
        self._dd = self._dh = self._hh = 0.0

    def add(self, distance: float, height: float) -> None:
        """Add an observation: distance [m] and height [m]."""
        self.count += 1
        far, high = distance - self._distance, height - self._height
        self._distance += far / self.count
        self._height += high / self.count
        # Welford: the second factor is the deviation from the new mean.
        self._dd += far * (distance - self._distance)
        self._dh += far * (height - self._height)
        self._hh += high * (height - self._height)

    @property
    def scatter(self) -> float:
        """Return the standard deviation about the trend [m]; NaN for too few observations."""
        if self.count < ENOUGH:
            return math.nan
        explained = self._dh**2 / self._dd if self._dd > 0.0 else 0.0
        return math.sqrt(max(0.0, self._hh - explained) / (self.count - 2))

    @property
    def growth(self) -> float:
        """
        Return the extrapolated height at distance 0 minus the mean observed height [m].

        0 without a significant trend; negative if the height decreases on approach.
        """
        scatter = self.scatter
        if not (scatter >= 0.0 and self._dd > self.count * LEAST_BASE**2 / 12.0):
            return 0.0
        slope = self._dh / self._dd
        if abs(slope) * math.sqrt(self._dd) <= SIGNIFICANT * scatter:
            return 0.0
        return -slope * self._distance


class Scatter:
    """
    Scatter of repeated observations, from the median of their successive differences.

    The median ignores a single jump.
    """

    def __init__(self) -> None:
        """Start without a look."""
        self._last = math.nan
        self._steps: Deque[float] = deque(maxlen=KEPT)

    def add(self, value: float) -> None:
        """Take a look [m]."""
        if not math.isnan(self._last):
            self._steps.append(abs(value - self._last))
        self._last = value

    @property
    def sd(self) -> float:
        """Return the standard deviation of a look [m]; NaN for too few."""
        if len(self._steps) < LEAST_KEPT:
            return math.nan
        # Of Gaussian values, half of the differences are within 0.6745 sqrt(2) deviations.
        return median(self._steps) / 0.9539
