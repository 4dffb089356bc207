# SPDX-License-Identifier: Apache-2.0
"""Outcome of an attempt at a step."""
from dataclasses import dataclass, field
from enum import Enum
import math
from typing import Optional

from ballbot_ros.config.fields import Checked, count, quantity, text
from ballbot_ros.decision.values import Failure, Plan, Strategy


class Result(str, Enum):
    """Result of an attempt."""

    OVER = 'over'
    STUCK = 'stuck'
    FELL = 'fell'


@dataclass(frozen=True)
class Outcome(Checked):
    """
    Outcome of an attempt at a step; every value is checked.

    Attributes
    ----------
    plan : Plan or None
        Executed plan; None if the decision was not to cross.

    Raises
    ------
    ConfigurationError
        If a value is not a number, or out of range.

    """

    stamp: float = quantity('s', 'end of the attempt', minimum=0.0)
    result: str = text('result of the attempt', choices=tuple(item.value for item in Result))
    face: int = count('number of the face')
    position: float = quantity('m', 'position of the face along the odometry axis')
    height: float = quantity(
        'm', 'estimated height of the face', minimum=-10.0, maximum=10.0)
    height_sd: float = quantity(
        'm', 'standard deviation of the height', minimum=0.0, maximum=0.2)
    touch_speed: float = quantity(
        'm/s', 'speed of the ball at the touch', minimum=0.0, maximum=10.0)
    touch_angle: float = quantity(
        'rad', 'pendulum angle at the touch', minimum=-math.pi, maximum=math.pi)
    held_angle: float = quantity(
        'rad', 'mean pendulum angle from the touch on', minimum=-math.pi, maximum=math.pi)
    passed_speed: Optional[float] = quantity(
        'm/s', 'speed of the ball, from its rotation, when its centre passed the face',
        minimum=0.0, maximum=10.0, optional=True)
    slope: float = quantity(
        'rad', 'slope of the ground before the face, positive uphill', minimum=-1.0, maximum=1.0,
        default=0.0)
    distance: float = quantity(
        'm', 'distance rolled from rest to the touch',
        minimum=0.0, maximum=1000.0, default=0.0)
    probability: Optional[float] = quantity(
        '1', 'predicted success probability', minimum=0.0, maximum=1.0, optional=True)
    robot: str = text('digest of the parameters of the robot', default='')
    plan: Optional[Plan] = field(default=None)

    @property
    def crossed(self) -> bool:
        """Return whether the ball crossed the face, also if it stopped or fell behind it."""
        return self.result == Result.OVER.value or (
            self.result == Result.FELL.value and self.height > 0.0)

    @property
    def failure(self) -> Failure:
        """Return the failure of an attempt, for later plans."""
        return Failure(self.position, self.plan or Plan(Strategy.STOP), self.touch_speed,
                       self.distance)
