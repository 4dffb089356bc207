# SPDX-License-Identifier: Apache-2.0
"""
Weighted particles: samples of the robot parameters and of the sensor bias.

The prior has the ranges of the derived parameters of the robot file, friction in a range
around its coefficients, since published values are for one floor (unless the file has a range),
and a constant error of the measured heights.  The motor has the values of the robot file: its
ranges span different motors, and the data sheet of the motor gives the actual values.  Outcomes of
attempts change the weights (`learning`).
"""
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Mapping, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot_ros.crossing.rules import table
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import ContactOptions, Parameters, Robot
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.model.uncertainty import (
    changed, independent, ranges, spread_points, uncertain)

# Columns present in every particle set, independent of the ranges in the robot file.
SURFACE_FRICTION, EDGE_FRICTION, HEIGHT_BIAS = 'surface_friction', 'edge_friction', 'height_bias'
GROUND = (SURFACE_FRICTION, EDGE_FRICTION)
# Resample below this effective sample size, as a fraction of the particles.
SAMPLE_SIZE_FRACTION_MIN = 1.0 / 3.0
# Kernel width of the resampling (Liu and West), as a fraction of the particles' spread.
KERNEL_WIDTH_FRACTION = 0.25
# Fraction redrawn from the prior at resampling: floors change, sensors get displaced.
REDRAWN_FRACTION = 0.1
# Assumed friction of a floor, relative to that of the robot file.
FRICTION_RANGE = (0.6, 1.3)
# Assumed fraction of sensors that are bent, or calibrated for another mounting, and standard
# deviation of the constant error of their heights [m].
MISCALIBRATED_FRACTION, MISCALIBRATION_SD = 0.2, 0.004
# The height bias is truncated at this many standard deviations of the worse sensors.
BIAS_SIGMAS_MAX = 3.0


@dataclass(frozen=True, eq=False)
class Particles:
    """
    Samples of the robot parameters; create them with `Particles.of`.

    Attributes
    ----------
    robot : Robot
        Nominal robot of the robot file.
    names : tuple of str
        Column names: fields of the robot, and ``height_bias``: measured minus true height [m].
    values : (N, k) array
        SI.
    weights : (N,) array
        Weights with sum 1.
    lows, highs : (k,) arrays
        Bounds of the values.
    first : (N, k) array
        Values of the prior.
    rows : (N, 17) array
        `Parameters` of each robot.
    outcomes : int
        Number of outcomes in the weights.

    """

    robot: Robot
    names: Tuple[str, ...]
    values: Array
    weights: Array
    lows: Array
    highs: Array
    first: Array
    rows: Array
    outcomes: int = 0

    @classmethod
    def of(cls, robot: Robot, height_bias_sd: float, number: int = 256,
           seed: int = 0) -> 'Particles':
        """
        Draw a number of robots of equal weight; the same seed draws the same robots.

        `height_bias_sd` is that of most sensors, see `DecisionTuning` [m].

        Raises
        ------
        ConfigurationError
            If an end of a range is inconsistent with other parameters of the robot.

        """
        known = ranges(robot)
        drawn = {**independent(uncertain(robot)), **{
            name: known.get(name, tuple(part * getattr(robot, name) for part in FRICTION_RANGE))
            for name in GROUND}}
        for name, ends in drawn.items():
            for end in ends:
                changed(robot, {name: end})  # refuses inconsistent values
        reach = BIAS_SIGMAS_MAX * max(MISCALIBRATION_SD, height_bias_sd)
        lows = np.array([low for low, _ in drawn.values()] + [-reach])
        highs = np.array([high for _, high in drawn.values()] + [reach])
        points = spread_points(len(lows), number, seed)
        # Shuffled: every n-th point of the sequence would not be an even sample.
        points = points[np.random.default_rng(seed).permutation(number)]
        values = lows + points * (highs - lows)
        # Quantiles of a mixture of two normal distributions.
        part = points[:, -1]
        off = part < MISCALIBRATED_FRACTION
        quantiles = np.where(off, part / MISCALIBRATED_FRACTION,
                             (part - MISCALIBRATED_FRACTION) / (1.0 - MISCALIBRATED_FRACTION))
        values[:, -1] = np.clip(np.where(off, MISCALIBRATION_SD, height_bias_sd) * np.array([
            NormalDist().inv_cdf(one) for one in np.clip(quantiles, 1e-9, 1.0 - 1e-9)]),
            -reach, reach)
        names = (*drawn, HEIGHT_BIAS)
        return cls(robot, names, _fixed(values), _fixed(np.full(number, 1.0 / number)),
                   _fixed(lows), _fixed(highs), _fixed(values),
                   _rows(robot, names, values))

    def __len__(self) -> int:
        """Return the number of particles."""
        return len(self.weights)

    def column(self, name: str) -> Array:
        """Return a parameter of each particle, (N,), SI; that of the robot if it has no range."""
        if name in self.names:
            column: Array = self.values[:, self.names.index(name)]
            return column
        return np.full(len(self), getattr(self.robot, name))

    def one(self, index: int) -> Robot:
        """Return a particle as a robot."""
        values = dict(zip(self.names, self.values[index].tolist()))
        values.pop(HEIGHT_BIAS)
        return changed(self.robot, values)

    @property
    def effective_size(self) -> float:
        """Return the effective sample size 1 / sum(w^2)."""
        return float(1.0 / np.sum(self.weights**2))

    def mean(self, name: str) -> float:
        """Return the weighted mean of a column."""
        return float(self.weights @ self.column(name))

    def deviation(self, name: str) -> float:
        """Return the weighted standard deviation of a column."""
        deviations = self.column(name) - self.mean(name)
        return float(np.sqrt(self.weights @ deviations**2))

    def draw(self, number: int, seed: int = 0) -> NDArray[np.int64]:
        """
        Return `number` indices of particles, by weight; systematic resampling.

        A particle of weight w is drawn floor(w number) to ceil(w number) times.
        """
        start = np.random.default_rng(seed).random()
        steps = (start + np.arange(number)) / number
        # The sum of all weights may differ from 1 by rounding.
        found = np.searchsorted(np.cumsum(self.weights), steps, side='right')
        return np.minimum(found, len(self) - 1)

    def reweighted(self, log_likelihood: ArrayLike) -> 'Particles':
        """
        Return the particles after an outcome.

        A low effective sample size triggers resampling with the same mean and covariance (Liu
        and West 2001, Combined parameter and state estimation).

        Parameters
        ----------
        log_likelihood : (N,) array_like
            Log likelihood of the outcome under each particle.

        Raises
        ------
        ConfigurationError
            If the shape is not (N,) or a value is not finite.

        """
        given = np.asarray(log_likelihood, dtype=float)
        if given.shape != self.weights.shape or not np.isfinite(given).all():
            raise ConfigurationError(
                f'log_likelihood must be {len(self)} finite numbers, got shape {given.shape}',
                'wrong_type', 'log_likelihood')
        weights = self.weights * np.exp(given - given.max())
        after = replace(self, weights=_fixed(weights / weights.sum()),
                        outcomes=self.outcomes + 1)
        if after.effective_size >= SAMPLE_SIZE_FRACTION_MIN * len(self):
            return after
        return after._resampled()

    def _resampled(self) -> 'Particles':
        """Return equally weighted particles with the same mean and covariance."""
        mean = self.weights @ self.values
        deviations = self.values - mean
        covariance = (self.weights[:, None] * deviations).T @ deviations
        # Fixed parameters have eigenvalue 0, up to rounding.
        sizes, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(sizes, 0.0))
        random = np.random.default_rng(self.outcomes)
        chosen = self.values[self.draw(len(self), self.outcomes)]
        values = (mean + np.sqrt(1.0 - KERNEL_WIDTH_FRACTION**2) * (chosen - mean)
                  + KERNEL_WIDTH_FRACTION * random.standard_normal(chosen.shape) @ root.T)
        # Reflect at the bounds.
        values = np.where(values > self.highs, 2.0 * self.highs - values, values)
        values = np.where(values < self.lows, 2.0 * self.lows - values, values)
        values = np.clip(values, self.lows, self.highs)
        redrawn = random.permutation(len(self))[:round(REDRAWN_FRACTION * len(self))]
        values[redrawn] = self.first[redrawn]
        return replace(self, values=_fixed(values), rows=_rows(self.robot, self.names, values),
                       weights=_fixed(np.full(len(self), 1.0 / len(self))))


def _rows(robot: Robot, names: Tuple[str, ...], values: Array) -> Array:
    columns: Mapping[str, Array] = {
        name: column for name, column in zip(names, values.T) if name != HEIGHT_BIAS}
    return _fixed(table(Parameters.of(changed(robot, columns), ContactOptions()), len(values)))


def _fixed(array: Array) -> Array:
    array.setflags(write=False)
    return array
