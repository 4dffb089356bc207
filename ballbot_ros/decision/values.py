# SPDX-License-Identifier: Apache-2.0
"""Values that the decision takes and gives."""
from dataclasses import dataclass
from enum import Enum
import math
from typing import Optional, Tuple

from ballbot_ros.decision.plan import Plan


class Kind(str, Enum):
    """What to do."""

    CLEAR = 'clear'
    CROSS = 'cross'
    STOP = 'stop'
    GO_ROUND = 'go_round'
    BACK_OFF = 'back_off'


class Reason(str, Enum):
    """Why."""

    NOTHING_AHEAD = 'nothing_ahead'
    WITHIN_CURVE = 'within_curve'
    COMMITTED = 'committed'
    TOO_HIGH = 'too_high'
    NO_ROOM = 'no_room'
    TOO_FAST = 'too_fast'
    DROP = 'drop'
    BAD_OBSERVATION = 'bad_observation'
    STALE = 'stale'
    CONTRADICTORY = 'contradictory'
    NOT_LIKELY = 'not_likely'
    LANDING = 'landing'
    STEEP = 'steep'
    FAILED_BEFORE = 'failed_before'
    RUN_UP = 'run_up'
    STUCK = 'stuck'
    WALL = 'wall'
    LIKELY = 'likely'
    GOAL = 'goal'


# Farther [m] or faster [m/s] than this no ball rolls: odometry is broken.
FARTHEST, FASTEST = 1e6, 30.0


@dataclass(frozen=True)
class Motion:
    """
    Where the ball is and how fast, by odometry.

    Attributes
    ----------
    stamp : float
        Now, on the clock of the observations [s].
    position, speed : float
        Of the ball's centre along its axis of travel [m], [m/s].
    pendulum_angle, pendulum_rate : float
        Absolute, as the model says after the set angles given [rad], [rad/s].
    slope : float
        Of the ground below the ball as its speed tells, positive uphill [rad].

    """

    stamp: float
    position: float
    speed: float
    pendulum_angle: float = 0.0
    pendulum_rate: float = 0.0
    slope: float = 0.0

    @property
    def sane(self) -> bool:
        """Return whether all is finite, and no ball could be elsewhere or faster."""
        return (math.isfinite(self.stamp) and abs(self.position) < FARTHEST
                and abs(self.speed) < FASTEST and math.isfinite(self.slope)
                and math.isfinite(self.pendulum_angle) and math.isfinite(self.pendulum_rate))


@dataclass(frozen=True)
class Outlook:
    """
    What is expected of a plan, from attempts on many robots and grounds.

    Attributes
    ----------
    probability : float
        That the ball gets over and stays where it may be.
    stuck, falls : float
        Probabilities of the other ends.
    required : float
        Probability that a crossing must have.
    touch_speed : float
        Expected at the first touch [m/s].
    height_limit : float
        Highest step that this very plan crosses as surely as required [m].
    braking_room : float
        To the last point where braking still works [m]; negative: passed.
    attempts : int
        That stand behind it.
    others : tuple of str
        Other plans, each with why it lost.

    """

    probability: float = math.nan
    stuck: float = math.nan
    falls: float = math.nan
    required: float = math.nan
    touch_speed: float = math.nan
    height_limit: float = math.nan
    braking_room: float = math.nan
    attempts: int = 0
    others: Tuple[str, ...] = ()


@dataclass(frozen=True)
class Decision:
    """
    What to do, why, and with which numbers; NaN where there is no such number.

    Attributes
    ----------
    kind : Kind
    reason : Reason
    set_speed : float
        Speed to drive at [m/s].  With ``GO_ROUND`` only as far as there is room to stop.
    explanation : str
        One sentence for people.
    required_speed : float
        At touch, margins included [m/s].
    reachable_speed : float
        At touch, from here and within all limits [m/s].
    height : float
        Of the step [m].
    height_margin : float
        What could be added to the height, margins included, before the answer is no [m];
        negative by how much it is too high already.
    distance : float
        Ball's centre to the face [m].
    step : int
        Number of the step, 0 for none.
    contact_since : float or None
        When the ball touched the step that it is crossing [s].
    start_distance, swing_distance : float
        From the centre back to where the plan begins, and on to where the pendulum swings [m].
    plan : Plan or None
        None from a planner that makes none.
    outlook : Outlook or None
        What is expected of the plan.

    """

    kind: Kind
    reason: Reason
    set_speed: float
    explanation: str
    required_speed: float = math.nan
    reachable_speed: float = math.nan
    height: float = math.nan
    height_margin: float = math.nan
    distance: float = math.nan
    step: int = 0
    contact_since: Optional[float] = None
    start_distance: float = math.nan
    swing_distance: float = math.nan
    plan: Optional[Plan] = None
    outlook: Optional[Outlook] = None
