# SPDX-License-Identifier: Apache-2.0
"""The cubic of section 8: which step height is crossed at which speed."""
from dataclasses import dataclass, replace
import math
from typing import Any, Optional, Tuple

from ballbot_ros.config.fields import check_value, Checked, count, quantity, section, text
from ballbot_ros.config.files import load_config
from ballbot_ros.decision.planning.band import Band
from ballbot_ros.errors import ConfigurationError

_VARIANT = text('of a curve', choices=('fit', 'conservative')).metadata


@dataclass(frozen=True)
class CurveProvenance(Checked):
    """How a curve was made; SI."""

    robot_digest: str = text('checksum of the numbers of the robot')
    law: str = text('law of actuation')
    surface_friction: float = quantity('1', 'coefficient of friction of the ground', minimum=0.0)
    edge_friction: float = quantity('1', 'coefficient of friction of the edge', minimum=0.0)
    attempts: str = text('attempts that counted', choices=('first', 'any'))
    accuracy: float = quantity('m', 'largest error of a simulated height', above=0.0)
    points: int = count('speeds that were fitted', minimum=4)
    version: str = text('version of the package that made it')
    set_angle: float = quantity('rad', 'angle that law (11) held', default=0.0)
    voltage: float = quantity(
        'V', 'voltage on the motor; 0 for that which rolls the ball at each speed', default=0.0)
    over: str = text(
        'where the ball was over; files that do not say it are older, and went by the edge',
        default='edge', choices=('edge', 'clear'))
    clearance: float = quantity(
        '1', 'how far beyond the edge the centre got, over the radius; 0 by the edge',
        default=0.0, minimum=0.0)


@dataclass(frozen=True)
class HeightCurve(Checked):
    """
    Highest crossable step as a cubic of the speed at touch, and where that holds.

    The cubic is never evaluated outside its range: beyond it the fit turns over, and a
    faster ball would be said to climb less.

    Attributes
    ----------
    coefficients : tuple of float
        a0 to a3 of height = a0 + a1 v + a2 v^2 + a3 v^3 [m, m/s].
    conservative : tuple of float
        The same of a curve that is nowhere above the simulation; empty if there is none.
    covariance : tuple of tuple of float
        Of the coefficients, 4 x 4; from the residuals, empty if there is none.
    made : CurveProvenance or None
        Provenance, None for numbers from elsewhere.
    band : Band or None
        What the uncertain numbers of the robot make of it.

    Raises
    ------
    ConfigurationError
        If a number is not finite, the range is empty, or the curve does not rise all over
        its range.

    """

    name: str = text('name of the curve')
    robot: str = text('name of the robot it was made for')
    actuation: str = text('what the pendulum did')
    source: str = text('where the numbers come from')
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
    band: Optional[Band] = section('of uncertain robots', cls=Band, default=None)

    def __post_init__(self) -> None:
        """Check each value, then that together they make a usable curve."""
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
        speed = _flattest(self)
        if not _slope(self, speed) > 0.0:
            raise ConfigurationError(
                f'HeightCurve: {self.name} must rise from {self.lowest_speed:g} to '
                f'{self.highest_speed:g} m/s, but it falls or is flat at {speed:.3g} m/s; '
                'narrow the range', 'inconsistent', 'coefficients')

    def height(self, speed: float) -> float:
        """
        Return the highest step that is crossed at `speed` [m].

        Parameters
        ----------
        speed : float
            At touch [m/s], within the range.

        Raises
        ------
        ConfigurationError
            Outside the range, and for a speed that is not a number.

        """
        if not self.lowest_speed <= speed <= self.highest_speed:
            raise ConfigurationError(
                f'curve {self.name} holds from {self.lowest_speed:g} to '
                f'{self.highest_speed:g} m/s, not at {speed!r} m/s, and is not extrapolated',
                'out_of_range', 'speed')
        a0, a1, a2, a3 = self.coefficients
        return a0 + speed * (a1 + speed * (a2 + speed * a3))

    def required_speed(self, height: float) -> Optional[float]:
        """
        Return the lowest speed in range at which `height` [m] is crossed [m/s].

        Parameters
        ----------
        height : float
            Below what the lowest speed crosses already, the lowest speed is the answer.

        Returns
        -------
        float or None
            None if no speed of the range is enough, or the height is not a number.

        """
        low, high = self.lowest_speed, self.highest_speed
        if not height <= self.height(high):
            return None
        if height <= self.height(low):
            return low
        # The curve rises, so halving finds the one place; 40 halvings of a metre per second
        # are below a picometre per second.
        for _ in range(40):
            middle = 0.5 * (low + high)
            if self.height(middle) >= height:
                high = middle
            else:
                low = middle
        return high


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


def _slope(curve: HeightCurve, speed: float) -> float:
    """Return d(height)/d(speed) [s]."""
    _, a1, a2, a3 = curve.coefficients
    return a1 + speed * (2.0 * a2 + speed * 3.0 * a3)


def _flattest(curve: HeightCurve) -> float:
    """Return the speed in range at which the curve rises least [m/s]."""
    candidates = [curve.lowest_speed, curve.highest_speed]
    _, _, a2, a3 = curve.coefficients
    if a3 != 0.0 and curve.lowest_speed < -a2 / (3.0 * a3) < curve.highest_speed:
        candidates.append(-a2 / (3.0 * a3))
    return min(candidates, key=lambda speed: _slope(curve, speed))


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
            f'curve {curve.name} has no conservative coefficients; make it again with '
            'ballbot fit-curve', 'missing', 'conservative')
    return replace(curve, coefficients=curve.conservative, residual=0.0)
