# SPDX-License-Identifier: Apache-2.0
r"""
Thermal derating of the torque, before the drive shuts it off.

A winding warms with the square of its current and cools with a time constant.  Its warmth h, 1 at
the continuous rating, follows the torque::

    h' = ((torque / continuous torque)^2 - h) / time constant

Under a constant torque the solution is an exponential, exact for any step.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.errors import ConfigurationError

# Warmth at which derating starts; it reaches the continuous torque at 1.
WARM = 0.8


@dataclass(frozen=True)
class Thermal(Checked):
    """Thermal limits of power stage and motor; a limit that is not given is not monitored."""

    drive_warn_at: Optional[float] = quantity(
        'degC', 'temperature of the power stage above which the torque is reduced',
        minimum=0.0, maximum=200.0, optional=True)
    drive_zero_at: Optional[float] = quantity(
        'degC', 'temperature of the power stage at which the torque is zero; set it below the one '
        'at which the drive cuts the torque', minimum=0.0,
        maximum=200.0, optional=True)
    motor_warn_at: Optional[float] = quantity(
        'degC', 'temperature of the motor above which the torque is reduced', minimum=0.0,
        maximum=300.0, optional=True)
    motor_zero_at: Optional[float] = quantity(
        'degC', 'temperature of the motor at which the torque is zero', minimum=0.0, maximum=300.0,
        optional=True)
    continuous_torque: Optional[float] = quantity(
        'N m', 'continuous torque rating of the motor, at the pendulum', above=0.0,
        maximum=1000.0, optional=True)
    time_constant: float = quantity(
        's', 'time constant with which the winding warms', default=30.0, above=0.0, maximum=1e4)

    def __post_init__(self) -> None:
        super().__post_init__()
        for part, warn_at, zero_at in (
                ('drive', self.drive_warn_at, self.drive_zero_at),
                ('motor', self.motor_warn_at, self.motor_zero_at)):
            if (warn_at is None) != (zero_at is None):
                raise ConfigurationError(
                    f'Thermal: {part}_warn_at and {part}_zero_at belong together, got {warn_at} '
                    f'and {zero_at} degC; give both or neither', 'missing', f'{part}_warn_at')
            if warn_at is not None and zero_at is not None and not warn_at < zero_at:
                raise ConfigurationError(
                    f'Thermal: {part}_warn_at must be below {part}_zero_at, got {warn_at:g} and '
                    f'{zero_at:g} degC', 'inconsistent', f'{part}_warn_at')


class Derating(NamedTuple):
    """Fraction of the torque limit after thermal derating, and the warnings."""

    part: float = 1.0  # of torque_limit
    warnings: Tuple[str, ...] = ()


def left_at(temperature: Optional[float], warn_at: Optional[float],
            zero_at: Optional[float]) -> float:
    """
    Return the fraction of the torque at a temperature: 1 up to `warn_at`, 0 from `zero_at`.

    All in degrees Celsius; 1 for a temperature that is unknown or not monitored.
    """
    if temperature is None or warn_at is None or zero_at is None \
            or not math.isfinite(temperature):
        return 1.0
    return min(max((zero_at - temperature) / (zero_at - warn_at), 0.0), 1.0)


def warmed(warmth: float, load: float, seconds: float, time_constant: float) -> float:
    """
    Return the warmth of a winding after `seconds` under a constant load.

    Parameters
    ----------
    warmth : float
        At the start; 1 is the continuous rating of the winding.
    load : float
        Torque over continuous torque.
    seconds, time_constant : float
        [s]

    """
    return load**2 + (warmth - load**2) * math.exp(-max(seconds, 0.0) / time_constant)


def left_by(warmth: float, continuous: float) -> float:
    """
    Return the fraction of the torque at a warmth.

    Parameters
    ----------
    warmth : float
    continuous : float
        Continuous fraction of the torque, which remains at a warmth of 1.

    """
    if warmth <= WARM or continuous >= 1.0:
        return 1.0
    return 1.0 - (1.0 - continuous) * min((warmth - WARM) / (1.0 - WARM), 1.0)


def derating(thermal: Thermal, temperature: Optional[float], motor_temperature: Optional[float],
             warmth: float, torque_limit: float) -> Derating:
    """
    Return the derating by heat.

    Parameters
    ----------
    thermal : Thermal
    temperature, motor_temperature : float, optional
        Of the power stage and the motor [degC].
    warmth : float
        See `warmed`.
    torque_limit : float
        Torque limit to derate [N m].

    """
    parts = {
        'drive_hot': left_at(temperature, thermal.drive_warn_at, thermal.drive_zero_at),
        'motor_hot': left_at(motor_temperature, thermal.motor_warn_at, thermal.motor_zero_at),
        'motor_i2t': 1.0 if thermal.continuous_torque is None else left_by(
            warmth, thermal.continuous_torque / torque_limit)}
    return Derating(min(parts.values()), tuple(
        name for name, part in parts.items() if part < 1.0))
