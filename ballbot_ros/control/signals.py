# SPDX-License-Identifier: Apache-2.0
"""What goes into the controller: set-points and joint readings, checked when made."""
from dataclasses import dataclass
from enum import Enum
import math

from ballbot_ros.errors import MessageError

# Set-points closer to 0 than this ask for rest [rad, rad/s, m/s].
STANDING = 1e-3


class Mode(str, Enum):
    """What the pendulum motor does; the values stand in messages and files."""

    IDLE = 'idle'
    HOLD = 'hold'
    DRIVE = 'drive'
    SPEED = 'speed'

    @property
    def law(self) -> str:
        """Return the law behind this mode, by its number in the paper, for messages to people."""
        return {'idle': 'no torque', 'hold': 'law (11)', 'drive': 'law (12)',
                'speed': 'the speed law'}[self.value]


@dataclass(frozen=True)
class SetPoint:
    """
    What the controller is asked to do.

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
        When it was given [s].

    Raises
    ------
    MessageError
        With reason ``not_finite`` or ``unknown_mode``.

    """

    mode: Mode
    value: float = 0.0
    stamp: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no controller can follow."""
        try:
            object.__setattr__(self, 'mode', Mode(self.mode))
        except ValueError as error:
            known = ', '.join(mode.value for mode in Mode)
            raise MessageError(
                'unknown_mode',
                f'set-point mode must be one of {known}, got {self.mode!r}') from error
        refuse_not_finite('set-point', value=self.value, stamp=self.stamp)

    @property
    def is_rest(self) -> bool:
        """Return whether it asks for no motion: nothing, a hanging pendulum, a speed of 0."""
        return self.mode is Mode.IDLE or abs(self.value) < STANDING

    @property
    def in_words(self) -> str:
        """Return what it asks for, as people write it."""
        return {Mode.IDLE: 'no torque', Mode.HOLD: f'a pendulum angle of {self.value:.3g} rad',
                Mode.DRIVE: f'a joint rate of {self.value:.3g} rad/s',
                Mode.SPEED: f'a speed of {self.value:.3g} m/s'}[self.mode]


@dataclass(frozen=True)
class JointReadings:
    """
    Both joints of the robot at one moment; angles are counter-clockwise positive.

    Attributes
    ----------
    stamp : float
        When they were measured [s].
    ball_angle, ball_rate : float
        theta1 [rad] and theta1' [rad/s] against the world; rolling to +x at v, the rate is
        -v / R.
    joint_angle, joint_rate : float
        theta2 [rad] and theta2' [rad/s], pendulum relative to ball.

    Raises
    ------
    MessageError
        With reason ``not_finite``: torque from a guess is worse than none.

    """

    stamp: float
    ball_angle: float
    joint_angle: float
    ball_rate: float
    joint_rate: float

    def __post_init__(self) -> None:
        """Refuse readings that are not finite."""
        # One sum is quick, and not finite if a term is not; which one is looked up only then.
        if not math.isfinite(self.stamp + self.ball_angle + self.joint_angle + self.ball_rate
                             + self.joint_rate):
            refuse_not_finite('joint reading', **vars(self))

    @property
    def pendulum_angle(self) -> float:
        """Return theta1 + theta2, 0 hanging down [rad]."""
        return self.ball_angle + self.joint_angle

    @property
    def pendulum_rate(self) -> float:
        """Return theta1' + theta2' [rad/s]."""
        return self.ball_rate + self.joint_rate


def refuse_not_finite(what: str, **numbers: float) -> None:
    """
    Check that all numbers of a message are finite.

    Raises
    ------
    MessageError
        With reason ``not_finite``, naming the first that is not.

    """
    for name, number in numbers.items():
        if not math.isfinite(number):
            raise MessageError(
                'not_finite', f'{what} refused: {name} must be finite, got {number!r}')
