# SPDX-License-Identifier: Apache-2.0
"""The cubic of section 8: maximum step height over collision speed."""
from bisect import bisect_right
from dataclasses import dataclass, replace
import math
from typing import Any, Callable, List, Mapping, Optional, Tuple

import numpy as np

from ballbot_ros.config.fields import check_value, Checked, count, quantity, section, text
from ballbot_ros.config.files import load_config
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import friction_coefficient


@dataclass(frozen=True)
class Band(Checked):
    """
    Maximum step heights of robots drawn from the ranges of the parameters.

    Attributes
    ----------
    varied : mapping of str to [low, high]
        Fields of the robot, SI; drawn uniformly from their ranges.
    speeds : tuple of float
        Collision speeds, ascending [m/s].
    probabilities : tuple of float
        Probabilities, ascending from 0 to 1.
    heights : tuple of tuple of float
        Row i, column j: the height [m] that a fraction probabilities[j] of the robots does not
        exceed at speeds[i].

    Raises
    ------
    ConfigurationError
        If the table is not a table of ascending numbers.

    """

    samples: int = count('number of robots drawn', minimum=2)
    seed: int = count('seed of the draw')
    varied: Mapping[str, Any] = section('ranges of the parameters drawn')
    speeds: Tuple[float, ...] = section('speeds in m/s, ascending')
    probabilities: Tuple[float, ...] = section('probabilities, ascending from 0 to 1')
    heights: Tuple[Tuple[float, ...], ...] = section('heights in m, one row per speed')

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
                'Band: speeds and probabilities must ascend, the latter from 0 to 1, and heights '
                'must have an ascending row per speed, a column per probability, all finite',
                'inconsistent', 'heights')
        object.__setattr__(self, 'speeds', tuple(speeds.tolist()))
        object.__setattr__(self, 'probabilities', tuple(parts.tolist()))
        object.__setattr__(self, 'heights', tuple(map(tuple, table.tolist())))

    def quantile(self, speed: float, probability: float) -> float:
        """
        Return the height that a fraction of the robots does not exceed at a speed [m].

        Raises
        ------
        ConfigurationError
            If the speed is outside the band, or the probability outside 0 to 1.

        """
        if not 0.0 <= probability <= 1.0:
            raise ConfigurationError(
                f'probability must be at least 0 and at most 1, got {probability!r}',
                'out_of_range', 'probability')
        return float(np.interp(probability, self.probabilities, self._row(speed)))

    def probability_of_passing(self, speed: float, height: float) -> float:
        """
        Return the fraction of the robots that cross a step of some height [m] at a speed.

        Raises
        ------
        ConfigurationError
            If the speed [m/s] is outside the band, or the height is not finite.

        """
        if not math.isfinite(height):
            raise ConfigurationError(f'height must be any finite number m, got {height!r}',
                                     'not_finite', 'height')
        row = self._row(speed)
        if height <= row[0]:
            return 1.0
        # Of equal heights, the last one counts, with the lowest probability.
        after = bisect_right(row, height)
        if after == len(row):
            return 0.0
        low, high = self.probabilities[after - 1:after + 1]
        return 1.0 - low - (high - low) * (height - row[after - 1]) / (row[after] - row[after - 1])

    def _row(self, speed: float) -> List[float]:
        """Return the heights at a speed [m]."""
        if not self.speeds[0] <= speed <= self.speeds[-1]:
            raise ConfigurationError(
                f'the band is valid from {self.speeds[0]:g} to {self.speeds[-1]:g} m/s, not at '
                f'{speed!r} m/s, and is not extrapolated', 'out_of_range', 'speed')
        after = min(max(bisect_right(self.speeds, speed), 1), len(self.speeds) - 1)
        before = self.speeds[after - 1]
        part = (speed - before) / (self.speeds[after] - before)
        return [low + part * (high - low)
                for low, high in zip(self.heights[after - 1], self.heights[after])]


_VARIANT = text('variant of a curve', choices=('fit', 'conservative')).metadata


@dataclass(frozen=True)
class CurveProvenance(Checked):
    """Provenance of a curve; SI."""

    robot_digest: str = text('checksum of the parameters of the robot')
    law: str = text('law of actuation')
    surface_friction: float = friction_coefficient('coefficient of friction of the ground')
    edge_friction: float = friction_coefficient('coefficient of friction of the edge')
    attempts: str = text('attempts that counted', choices=('first', 'any'))
    accuracy: float = quantity('m', 'largest error of a simulated height', above=0.0)
    points: int = count('number of fitted speeds', minimum=4)
    version: str = text('version of the package that made it')
    set_angle: float = quantity('rad', 'angle that law (11) held', default=0.0)
    voltage: float = quantity(
        'V', 'voltage of the motor; 0 for the one that rolls the ball at each speed', default=0.0)
    over: str = text(
        'success criterion of the ball; older files without it use the edge',
        default='edge', choices=('edge', 'clear'))
    clearance: float = quantity(
        '1', 'distance of the centre beyond the edge, over the radius; 0 for the edge',
        default=0.0, minimum=0.0)


@dataclass(frozen=True)
class HeightCurve(Checked):
    """
    Maximum step height as a cubic of the touch speed, with its range of validity.

    The cubic is never evaluated outside its range: beyond it the fit may decrease with the
    speed.

    Attributes
    ----------
    coefficients : tuple of float
        a0 to a3 of height = a0 + a1 v + a2 v^2 + a3 v^3 [m, m/s].
    conservative : tuple of float
        Coefficients of a cubic that is nowhere above the simulation; empty if there is none.
    covariance : tuple of tuple of float
        Covariance of the coefficients, 4 x 4, from the residuals; empty if there is none.
    made : CurveProvenance or None
        Provenance, None for coefficients from another source.
    band : Band or None
        Effect of the uncertain parameters of the robot.

    Raises
    ------
    ConfigurationError
        If a number is not finite, the range is empty, or the curve does not rise throughout
        its range.

    """

    name: str = text('name of the curve')
    robot: str = text('name of the robot it was made for')
    actuation: str = text('actuation of the pendulum')
    source: str = text('origin of the values')
    lowest_speed: float = quantity('m/s', 'slowest speed of the range', minimum=0.0)
    highest_speed: float = quantity('m/s', 'fastest speed of the range', above=0.0)
    residual: float = quantity('m', 'largest error of the fit', minimum=0.0)
    rms: float = quantity('m', 'root mean square of the errors of the fit', default=0.0,
                          minimum=0.0)
    coefficients: Tuple[float, ...] = section('coefficients of the cubic', default=())
    conservative: Tuple[float, ...] = section(
        'coefficients of a cubic below the simulation', default=())
    covariance: Tuple[Tuple[float, ...], ...] = section(
        'covariance of the coefficients', default=())
    made: Optional[CurveProvenance] = section('provenance', cls=CurveProvenance, default=None)
    band: Optional[Band] = section('band of uncertain robots', cls=Band, default=None)

    def __post_init__(self) -> None:
        """Check each value, then their consistency."""
        super().__post_init__()
        for name in ('coefficients', 'conservative'):
            if name == 'coefficients' or self.conservative:
                object.__setattr__(self, name, _four_numbers(name, getattr(self, name)))
        if self.covariance:
            rows = tuple(_four_numbers('covariance', row) for row in self.covariance)
            object.__setattr__(self, 'covariance', rows)
        if not self.lowest_speed < self.highest_speed:
            raise ConfigurationError(
                f'HeightCurve: highest_speed must be more than lowest_speed '
                f'({self.lowest_speed:g} m/s), got {self.highest_speed:g} m/s',
                'inconsistent', 'highest_speed')
        _, a1, a2, a3 = self.coefficients
        speeds = [self.lowest_speed, self.highest_speed]
        if a3 != 0.0 and self.lowest_speed < -a2 / (3.0 * a3) < self.highest_speed:
            speeds.append(-a2 / (3.0 * a3))
        slope, flattest = min((a1 + speed * (2.0 * a2 + speed * 3.0 * a3), speed)
                              for speed in speeds)
        if not slope > 0.0:
            raise ConfigurationError(
                f'HeightCurve: {self.name} must rise from {self.lowest_speed:g} to '
                f'{self.highest_speed:g} m/s, but it falls or is flat at {flattest:.3g} m/s; '
                'narrow the range', 'inconsistent', 'coefficients')

    def height(self, speed: float) -> float:
        """
        Return the highest step [m] that is crossed at a touch speed [m/s] within the range.

        Raises
        ------
        ConfigurationError
            If the speed is outside the range, or not a number.

        """
        if not self.lowest_speed <= speed <= self.highest_speed:
            raise ConfigurationError(
                f'curve {self.name} is valid from {self.lowest_speed:g} to '
                f'{self.highest_speed:g} m/s, not at {speed!r} m/s, and is not extrapolated',
                'out_of_range', 'speed')
        a0, a1, a2, a3 = self.coefficients
        return a0 + speed * (a1 + speed * (a2 + speed * a3))

    def required_speed(self, height: float) -> Optional[float]:
        """
        Return the lowest speed in range at which `height` [m] is crossed [m/s].

        None if no speed of the range is sufficient, or the height is not a number.
        """
        low, high = self.lowest_speed, self.highest_speed
        if not height <= self.height(high):
            return None
        if height <= self.height(low):
            return low
        # To below a picometre per second.
        return bisected(lambda speed: self.height(speed) >= height, low, high, 40)


def bisected(holds: Callable[[float], bool], without: float, value: float, steps: int) -> float:
    """Return a value for which a condition holds, by bisection towards one where it does not."""
    for _ in range(steps):
        middle = 0.5 * (without + value)
        without, value = (without, middle) if holds(middle) else (middle, value)
    return value


def _four_numbers(name: str, values: Any) -> Tuple[float, ...]:
    """Return four coefficients as floats; refuse anything but four finite numbers."""
    good = isinstance(values, (list, tuple)) and len(values) == 4 and all(
        isinstance(value, (int, float)) and not isinstance(value, bool)
        and math.isfinite(value) for value in values)
    if not good:
        raise ConfigurationError(
            f'HeightCurve: {name} must be four finite numbers [a0, a1, a2, a3] '
            f'(m, m/s), got {values!r}', 'wrong_type', name)
    return tuple(float(value) for value in values)


def load_curve(name_or_path: str, variant: str = 'fit') -> HeightCurve:
    """
    Read a curve of the package by name, or a user file by path.

    Parameters
    ----------
    variant : str
        ``fit``, or ``conservative`` for the cubic that is nowhere above the simulation.

    Raises
    ------
    ConfigurationError
        With file, field, value and allowed range.

    """
    curve = load_config(HeightCurve, 'curves', name_or_path)
    if check_value('variant', variant, _VARIANT, 'load_curve') == 'fit':
        return curve
    if not curve.conservative:
        raise ConfigurationError(
            f'curve {curve.name} has no conservative coefficients; fit it again with '
            'ballbot fit-curve', 'missing', 'conservative')
    return replace(curve, coefficients=curve.conservative, residual=0.0)
