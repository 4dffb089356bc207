# SPDX-License-Identifier: Apache-2.0
"""How sure a height curve is, where numbers of the robot are only known to a range."""
from bisect import bisect_right
from dataclasses import dataclass
import math
from typing import Any, List, Mapping, Tuple

import numpy as np

from ballbot_ros.config.fields import Checked, count, section
from ballbot_ros.errors import ConfigurationError


@dataclass(frozen=True)
class Band(Checked):
    """
    Highest steps of many robots that may all be the one at hand.

    Attributes
    ----------
    varied : mapping of str to [low, high]
        Fields of the robot, SI; drawn evenly from their ranges.
    speeds : tuple of float
        Rising [m/s].
    probabilities : tuple of float
        Rising from 0 to 1.
    heights : tuple of tuple of float
        Row i, column j: the height [m] that a part probabilities[j] of the robots does not
        exceed at speeds[i].

    Raises
    ------
    ConfigurationError
        If the table is not a table of rising numbers.

    """

    samples: int = count('robots that were drawn', minimum=2)
    seed: int = count('seed of the draw')
    varied: Mapping[str, Any] = section('ranges of the numbers that were drawn')
    speeds: Tuple[float, ...] = section('m/s, rising')
    probabilities: Tuple[float, ...] = section('rising from 0 to 1')
    heights: Tuple[Tuple[float, ...], ...] = section('m, a row for each speed')

    def __post_init__(self) -> None:
        """Check each value, then the table."""
        super().__post_init__()
        try:
            speeds, parts, table = (np.array(values, dtype=float) for values in (
                self.speeds, self.probabilities, self.heights))
        except (TypeError, ValueError) as error:
            raise ConfigurationError(f'Band: speeds, probabilities and heights must be numbers, '
                                     f'a row of heights per speed: {error}',
                                     'wrong_type', 'heights') from error
        good = (speeds.ndim == parts.ndim == 1 and table.shape == (len(speeds), len(parts))
                and len(speeds) > 1 and len(parts) > 1
                and all(np.isfinite(values).all() for values in (speeds, parts, table))
                and (np.diff(speeds) > 0.0).all() and (np.diff(parts) > 0.0).all()
                and (np.diff(table) >= 0.0).all() and parts[0] == 0.0 and parts[-1] == 1.0)
        if not good:
            raise ConfigurationError(
                'Band: speeds and probabilities must rise, the latter from 0 to 1, and heights '
                'must have a rising row per speed, a column per probability, all finite',
                'inconsistent', 'heights')
        object.__setattr__(self, 'speeds', tuple(speeds.tolist()))
        object.__setattr__(self, 'probabilities', tuple(parts.tolist()))
        object.__setattr__(self, 'heights', tuple(map(tuple, table.tolist())))

    def quantile(self, speed: float, probability: float) -> float:
        """
        Return the height that a part of the robots does not exceed at a speed [m].

        Raises
        ------
        ConfigurationError
            Outside the speeds, or for a probability that is none.

        """
        if not 0.0 <= probability <= 1.0:
            raise ConfigurationError(
                f'probability must be at least 0 and at most 1, got {probability!r}',
                'out_of_range', 'probability')
        return float(np.interp(probability, self.probabilities, self._row(speed)))

    def probability_of_passing(self, speed: float, height: float) -> float:
        """
        Return the part of the robots that get over a step of some height [m] at a speed.

        Raises
        ------
        ConfigurationError
            Outside the speeds [m/s], or for a height that is not a number.

        """
        if not math.isfinite(height):
            raise ConfigurationError(f'height must be any finite number m, got {height!r}',
                                     'not_finite', 'height')
        row = self._row(speed)
        if height <= row[0]:
            return 1.0
        # Where heights are the same, the last of them counts: fewest robots pass.
        after = bisect_right(row, height)
        if after == len(row):
            return 0.0
        low, high = self.probabilities[after - 1:after + 1]
        return 1.0 - low - (high - low) * (height - row[after - 1]) / (row[after] - row[after - 1])

    def _row(self, speed: float) -> List[float]:
        """Return the heights at a speed [m]."""
        if not self.speeds[0] <= speed <= self.speeds[-1]:
            raise ConfigurationError(
                f'the band holds from {self.speeds[0]:g} to {self.speeds[-1]:g} m/s, not at '
                f'{speed!r} m/s, and is not extrapolated', 'out_of_range', 'speed')
        after = min(max(bisect_right(self.speeds, speed), 1), len(self.speeds) - 1)
        before = self.speeds[after - 1]
        part = (speed - before) / (self.speeds[after] - before)
        return [low + part * (high - low)
                for low, high in zip(self.heights[after - 1], self.heights[after])]
