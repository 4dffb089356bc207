# SPDX-License-Identifier: Apache-2.0
"""Inputs of the controller: set-points and joint readings, validated at construction."""
from dataclasses import dataclass
from enum import Enum
import math

from ballbot_ros.errors import MessageError
from ballbot_ros.physics.model.state import State

# A set-point closer to 0 than this counts as rest [rad, rad/s, m/s].
REST_MAX = 1e-3


class Mode(str, Enum):
    """Control mode of the pendulum motor; messages and files contain the values."""

    IDLE = 'idle'
    HOLD = 'hold'
    DRIVE = 'drive'
    SPEED = 'speed'

    @property
    def law(self) -> str:
        """Return the law of this mode, by its number in the paper, for messages."""
        return {'idle': 'no torque', 'hold': 'law (11)', 'drive': 'law (12)',
                'speed': 'the speed law'}[self.value]


@dataclass(frozen=True)
class SetPoint:
    """
    A set-point of the controller.

    Attributes
    ----------
    mode : Mode
        ``hold``: keep the absolute pendulum angle, eq. (11).  ``drive``: keep the rate of
        the joint, eq. (12).  ``speed``: keep the speed of the ball, `speed_law`.  ``idle``:
        no torque.
    value : float
        Pendulum angle theta1 + theta2 [rad] or joint rate theta2' [rad/s], counter-clockwise
        positive, or speed [m/s].  Positive values drive the ball towards +x.  Angles are
        counted, not wrapped: 2 pi is one turn away from 0.
    stamp : float
        Time at which it was given [s].
    yaw_rate : float
        For mode ``speed``; positive to the left [rad/s].

    Raises
    ------
    MessageError
        With reason ``not_finite`` or ``unknown_mode``.

    """

    mode: Mode
    value: float = 0.0
    stamp: float = 0.0
    yaw_rate: float = 0.0

    def __post_init__(self) -> None:
        """Raise `MessageError` for an invalid set-point."""
        try:
            object.__setattr__(self, 'mode', Mode(self.mode))
        except ValueError as error:
            known = ', '.join(mode.value for mode in Mode)
            raise MessageError(
                f'set-point mode must be one of {known}, got {self.mode!r}',
                'unknown_mode', 'mode') from error
        refuse_not_finite(
            'set-point', value=self.value, stamp=self.stamp, yaw_rate=self.yaw_rate)

    @property
    def is_rest(self) -> bool:
        """Return whether it is rest: idle, a hanging pendulum, or a speed of 0."""
        return self.mode is Mode.IDLE or abs(self.value) < REST_MAX

    @property
    def in_words(self) -> str:
        """Return the set-point as text."""
        return {Mode.IDLE: 'no torque', Mode.HOLD: f'a pendulum angle of {self.value:.3g} rad',
                Mode.DRIVE: f'a joint rate of {self.value:.3g} rad/s',
                Mode.SPEED: f'a speed of {self.value:.3g} m/s'}[self.mode]


@dataclass(frozen=True)
class JointReadings:
    """
    Both joints of the robot at one time; angles are counter-clockwise positive.

    Attributes
    ----------
    stamp : float
        Time of the measurement [s].
    ball_angle, ball_rate : float
        theta1 [rad] and theta1' [rad/s] relative to the world; rolling to +x at v, the rate is
        -v / R.
    joint_angle, joint_rate : float
        theta2 [rad] and theta2' [rad/s], pendulum relative to ball.

    Raises
    ------
    MessageError
        With reason ``not_finite``.

    """

    stamp: float
    ball_angle: float
    joint_angle: float
    ball_rate: float
    joint_rate: float

    def __post_init__(self) -> None:
        """Raise `MessageError` for readings that are not finite."""
        refuse_not_finite('joint reading', **vars(self))

    @classmethod
    def of(cls, state: State) -> 'JointReadings':
        """Return the exact readings of a simulated robot."""
        return cls(state.time, state.ball_angle, state.joint_angle, state.ball_rate,
                   state.joint_rate)

    @property
    def pendulum_angle(self) -> float:
        """Return theta1 + theta2, 0 hanging down [rad]."""
        return self.ball_angle + self.joint_angle

    @property
    def pendulum_rate(self) -> float:
        """Return theta1' + theta2' [rad/s]."""
        return self.ball_rate + self.joint_rate


def refuse_not_finite(what: str, **numbers: float) -> None:
    """Raise `MessageError` for the first number of a message that is not finite."""
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise MessageError(
                f'{what}: {name} must be finite, got {number!r}', 'not_finite', name)
