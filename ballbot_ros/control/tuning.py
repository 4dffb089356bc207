# SPDX-License-Identifier: Apache-2.0
"""Gains of the pendulum controller: descriptions, ranges, and reading from YAML."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, flag, quantity
from ballbot_ros.config.files import load_config


@dataclass(frozen=True)
class ControlTuning(Checked):
    """
    Gains of laws (11) and (12), of the speed law over law (11), and the torque limit.

    The defaults are the paper's gains: below a rate of about 550 Hz, with one sample of delay,
    the loop diverges.  See `ballbot_ros.control.check_loop`.

    Raises
    ------
    ConfigurationError
        If a value is out of range.

    """

    position_kp: float = quantity(
        'N m/rad', 'proportional gain of the position law (11)', minimum=0.0,
        maximum=1000.0, default=40.0)
    position_kd: float = quantity(
        'N m s/rad', 'derivative gain of the position law (11)', minimum=0.0,
        maximum=200.0, default=10.0)
    velocity_kp: float = quantity(
        'N m s/rad', 'proportional gain of the velocity law (12)', minimum=0.0,
        maximum=200.0, default=10.0)
    velocity_ki: float = quantity(
        'N m/rad', 'integral gain of the velocity law (12)', minimum=0.0,
        maximum=1000.0, default=0.0)
    gravity_compensation: bool = flag(
        'add M2 g e sin(theta1 + theta2), as the paper does', default=True)
    torque_limit: float = quantity(
        'N m', 'largest requested torque', above=0.0, maximum=1e6, default=4.0)
    speed_gain: float = quantity(
        '1/s', 'desired acceleration of the speed law per speed error', above=0.0, maximum=100.0,
        default=2.0)
    swing_time: float = quantity(
        's', 'response time of the pendulum to the desired angle of the speed law', above=0.0,
        maximum=10.0, default=0.15)
    observer_rate: float = quantity(
        '1/s', 'convergence rate of the resistance estimate of the speed law', above=0.0,
        maximum=100.0, default=6.0)
    largest_lean: float = quantity(
        'rad', 'largest desired pendulum angle of the speed law', above=0.0, maximum=1.5,
        default=1.2)
    blend_time: float = quantity(
        's', 'time in which the torque of a new law is blended in; 0 for none',
        minimum=0.0, maximum=10.0, default=0.0)


def load_tuning(name_or_path: str) -> ControlTuning:
    """
    Read a tuning of the package by name, or a file by path.

    >>> load_tuning('published').position_kp  # doctest: +SKIP
    40.0

    Raises
    ------
    ConfigurationError
        Naming file, field, value and allowed range.

    """
    return load_config(ControlTuning, 'tunings', name_or_path)
