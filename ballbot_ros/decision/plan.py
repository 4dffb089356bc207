# SPDX-License-Identifier: Apache-2.0
"""What a planner has in mind: where to start, how fast, when to swing, what comes after."""
from dataclasses import dataclass
from enum import Enum
import math


class Strategy(str, Enum):
    """How a face is taken, or not."""

    CRUISE = 'cruise'          # at the speed that the ball has
    ACCELERATE = 'accelerate'  # with as much speed as allowed
    SWING = 'swing'            # with the pendulum swung forward before the touch
    CARRY = 'carry'            # through two edges without a stop between them
    BACK_OFF = 'back_off'      # from farther back
    STOP = 'stop'
    GO_ROUND = 'go_round'


class After(str, Enum):
    """What comes when the edge is passed."""

    CRUISE = 'cruise'
    STOP = 'stop'
    NEXT = 'next'  # the next edge, with the same plan


@dataclass(frozen=True)
class Plan:
    """
    A way over the faces ahead, or to a stop before them.

    All positions along the odometry axis.

    Attributes
    ----------
    strategy : Strategy
    start : float
        Where the approach begins [m]; a ball that is farther on backs off to there first.
    speed : float
        Set speed of the approach [m/s]; never exceeded on purpose.
    swing_position : float
        Where the pendulum swings [m]; infinite for never.
    swing_angle : float
        Set angle from there until the last edge is passed [rad].
    edge : float
        The last edge that the plan takes [m]; behind it, `after` holds.
    after : After
    stop_position : float
        Where the centre is to stand [m]; infinite where it is not to stop.

    """

    strategy: Strategy
    start: float = -math.inf
    speed: float = 0.0
    swing_position: float = math.inf
    swing_angle: float = 0.0
    edge: float = math.inf
    after: After = After.CRUISE
    stop_position: float = math.inf
