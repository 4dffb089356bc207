# SPDX-License-Identifier: Apache-2.0
"""How the height of a face changes with the distance from which it is seen, and scatters."""
from collections import deque
import math
from statistics import median
from typing import Deque

# So many looks tell how they scatter; before, a sensor that tells nothing counts as bad.
ENOUGH = 5

# So many looks back counts how they scatter, and so many there must be.
KEPT, LEAST_KEPT = 25, 10

# Looks from so different distances tell a trend [m].
LEAST_BASE = 0.1

# A trend is one beyond so many of its standard deviations.
SIGNIFICANT = 4.0


class Trend:
    """Regression of heights on distances, look by look."""

    def __init__(self) -> None:
        """Start without a look."""
        self.count = 0
        self._distance = self._height = 0.0
        self._dd = self._dh = self._hh = 0.0

    def add(self, distance: float, height: float) -> None:
        """Take a look: from how far [m], and what height was seen [m]."""
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
        """Return the standard deviation of one look about the trend [m]; NaN for too few."""
        if self.count < ENOUGH:
            return math.nan
        explained = self._dh**2 / self._dd if self._dd > 0.0 else 0.0
        return math.sqrt(max(0.0, self._hh - explained) / (self.count - 2))

    @property
    def growth(self) -> float:
        """
        Return how much higher the face would look from its foot than it has looked on average [m].

        0 where nothing is significant; negative for a face that shrinks on approach.
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
    How much looks at one thing scatter, by the differences from each to the next.

    One jump among them is no scatter: of the differences the median counts.
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
