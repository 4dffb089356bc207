# SPDX-License-Identifier: Apache-2.0
"""Inputs and results of the decision."""
from dataclasses import dataclass
from enum import Enum
import math
from typing import Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance


class Kind(str, Enum):
    """Action of a decision."""

    CLEAR = 'clear'
    CROSS = 'cross'
    STOP = 'stop'
    GO_ROUND = 'go_round'
    BACK_OFF = 'back_off'


class Reason(str, Enum):
    """Reason for a decision."""

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
    EVALUATING = 'evaluating'


# Positions [m], speeds [m/s] and heights of faces [m] beyond these are invalid.
POSITION_MAX, SPEED_MAX, HEIGHT_MAX = 1e6, 30.0, 10.0
# A ball is at rest below this speed [m/s].
REST_SPEED_MAX = 0.03
# A face is that of an earlier failure within this distance [m]: numbers and heights may change.
FAILURE_DISTANCE_MAX = 0.15
# Standard deviation of a slope estimated from several seconds of motion [rad].
SLOPE_SD = 0.01


@dataclass(frozen=True)
class Motion:
    """
    Ball state from odometry.

    Attributes
    ----------
    stamp : float
        Time of the state, on the clock of the observations [s].
    position, speed : float
        Position and speed of the ball's centre along its axis of travel [m], [m/s].
    pendulum_angle, pendulum_rate : float
        Absolute angle and rate, modelled from the commanded set angles [rad], [rad/s].
    slope, slope_sd : float
        Slope of the ground below the ball, estimated from its speed, positive uphill [rad].

    """

    stamp: float
    position: float
    speed: float
    pendulum_angle: float = 0.0
    pendulum_rate: float = 0.0
    slope: float = 0.0
    slope_sd: float = SLOPE_SD

    @property
    def is_plausible(self) -> bool:
        """Return whether all values are finite and within plausible limits."""
        return (math.isfinite(self.stamp) and abs(self.position) < POSITION_MAX
                and abs(self.speed) < SPEED_MAX and math.isfinite(self.slope)
                and math.isfinite(self.pendulum_angle) and math.isfinite(self.pendulum_rate))


class Strategy(str, Enum):
    """Strategy at a face."""

    CRUISE = 'cruise'          # at the present speed
    ACCELERATE = 'accelerate'  # after acceleration within the allowed speed
    SWING = 'swing'            # with the pendulum swung forward before the touch
    CARRY = 'carry'            # over two edges without a stop between them
    BACK_OFF = 'back_off'      # with a longer run-up
    STOP = 'stop'
    GO_ROUND = 'go_round'


class After(str, Enum):
    """Action behind the edge."""

    CRUISE = 'cruise'
    STOP = 'stop'


@dataclass(frozen=True)
class Plan:
    """
    A plan that crosses the faces ahead, or stops before them.

    All positions are along the odometry axis.

    Attributes
    ----------
    strategy : Strategy
    start : float
        Start of the approach [m]; a ball beyond it backs off to it first.
    speed : float
        Set speed of the approach [m/s].
    swing_position : float
        Start of the swing [m]; infinite without a swing.
    swing_angle : float
        Set angle from there until the last edge is passed [rad].
    edge : float
        The last edge that the plan crosses [m]; `after` applies behind it.
    after : After
    stop_position : float
        Stop position of the centre [m]; infinite without a stop.

    """

    strategy: Strategy
    start: float = -math.inf
    speed: float = 0.0
    swing_position: float = math.inf
    swing_angle: float = 0.0
    edge: float = math.inf
    after: After = After.CRUISE
    stop_position: float = math.inf


@dataclass(frozen=True)
class Outlook:
    """
    Predicted outcome of a plan, from rollouts on many robots and grounds.

    Attributes
    ----------
    probability : float
        Probability that the ball crosses and stops within the permitted range.
    stuck, falls : float
        Probabilities of the other outcomes: no crossing, and no stop in time behind the edge.
    required : float
        Required probability of a crossing.
    touch_speed : float
        Expected speed at the first touch [m/s].
    height_limit : float
        Maximum step height of this plan at the required probability [m]; without a selected plan,
        that of the plan that crosses the highest step.
    braking_room : float
        Distance to the last braking point [m]; negative beyond it.
    attempts : int
        Number of rollouts.
    others : tuple of str
        Other plans, each with the reason of its rejection.

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
    Action, reason and values; NaN for values that do not apply.

    Attributes
    ----------
    kind : Kind
    reason : Reason
    set_speed : float
        Speed to drive at [m/s]; with ``GO_ROUND``, limited so that the ball can stop in time.
    explanation : str
        One sentence for the user.
    required_speed : float
        Touch speed that the step requires, margins included [m/s].
    reachable_speed : float
        Touch speed that is reachable from here within all limits [m/s].
    height : float
        Height of the step [m].
    distance : float
        Distance from the ball's centre to the face [m].
    step : int
        Number of the step, 0 for none.
    contact_since : float or None
        Time of the first contact with the step that is being crossed [s].
    plan : Plan
        By default, the stop as soon as possible.
    outlook : Outlook
        Predicted outcome of the plan.

    """

    kind: Kind
    reason: Reason
    set_speed: float
    explanation: str
    required_speed: float = math.nan
    reachable_speed: float = math.nan
    height: float = math.nan
    distance: float = math.nan
    step: int = 0
    contact_since: Optional[float] = None
    plan: Plan = Plan(Strategy.STOP)
    outlook: Outlook = Outlook()

    def last_edge(self, position: float) -> float:
        """Return the position of the last edge of a crossing [m]; the ball is at `position`."""
        return self.plan.edge if math.isfinite(self.plan.edge) else position + self.distance

    @property
    def height_margin(self) -> float:
        """
        Return the height limit of the outlook minus the height of the step [m].

        Negative if the step is too high; NaN without a predicted limit.
        """
        return self.outlook.height_limit - self.height

    @property
    def forward_speed(self) -> float:
        """Return the commanded forward speed, 0 while the ball backs off [m/s]."""
        return 0.0 if self.kind is Kind.BACK_OFF else self.set_speed

    @property
    def committed(self) -> bool:
        """Return whether the decision crosses a step past its last braking point."""
        return self.kind is Kind.CROSS and self.reason is Reason.COMMITTED

    @property
    def refuses(self) -> bool:
        """Return whether the decision is not to continue; False while plans are evaluated."""
        return self.kind in (Kind.STOP, Kind.GO_ROUND) and self.reason is not Reason.EVALUATING


@dataclass(frozen=True)
class Face:
    """
    A rise or drop of the ground that is too steep to roll along.

    Attributes
    ----------
    number : int
        Number of the face, counted from 1.
    position : float
        Position of the foot, or of the upper edge of a drop, along the odometry axis [m].
    height : float
        Height [m], negative for a drop.
    position_sd, height_sd : float
        Standard deviations [m].
    run : float
        Horizontal extent [m]: 0 for a vertical face, more for a bevel or a steep ramp.

    """

    number: int
    position: float
    height: float
    position_sd: float
    height_sd: float
    run: float = 0.0

    def touch(self, radius: float, slope: float = 0.0) -> float:
        """
        Return the position of the centre of a ball that touches the face, or is above a drop [m].

        The slope of the ground before the face is positive uphill [rad].
        """
        if self.height <= 0.0:
            return self.position - touch_distance(radius, 0.0, slope=slope)
        run = max(self.run, 0.0)
        along = radius * math.tan(0.5 * (math.atan2(self.height, run) - slope))
        if along < math.hypot(run, self.height):  # the ball touches the incline, not its edge
            return self.position - along * math.cos(slope) - radius * math.sin(slope)
        return self.position + run - touch_distance(
            radius, self.height - run * math.tan(slope), slope=slope)


@dataclass(frozen=True)
class Profile:
    """
    The ground ahead, in odometry coordinates.

    Attributes
    ----------
    stamp : float
        Time of the latest observation [s].
    faces : tuple of Face
        Faces ahead of the ball or below it, from near to far.
    points : tuple of (float, float)
        Polyline of the ground: position [m], height above the floor below the ball [m]; empty
        for a sensor that detects the next face only.
    seen_from, seen_to : float
        Positions between which the ground is known [m].
    slope, slope_sd : float
        Slope of the ground below the ball, positive uphill [rad]; NaN if not observed.
    points_sd : tuple of float
        Standard deviations of the heights of the points [m].
    steep : tuple of (float, float)
        Stretches that are too steep to stand on: start [m] and slope [rad].
    rejection : Reason or None
        ``BAD_OBSERVATION`` or ``CONTRADICTORY``: do not act on it.
    explanation : str
        Explanation of the rejection.

    """

    stamp: float
    faces: Tuple[Face, ...] = ()
    points: Tuple[Tuple[float, float], ...] = ()
    seen_from: float = float('-inf')
    seen_to: float = float('inf')
    slope: float = float('nan')
    slope_sd: float = float('nan')
    rejection: Optional[Reason] = None
    explanation: str = ''
    points_sd: Tuple[float, ...] = ()
    steep: Tuple[Tuple[float, float], ...] = ()

    @property
    def is_plausible(self) -> bool:
        """Return whether all values of the faces are finite and plausible."""
        return all(
            abs(face.position) < POSITION_MAX and abs(face.height) < HEIGHT_MAX
            and 0.0 <= face.position_sd < POSITION_MAX and 0.0 <= face.height_sd < HEIGHT_MAX
            and abs(face.run) < POSITION_MAX for face in self.faces)

    @property
    def face(self) -> Optional[Face]:
        """Return the next face."""
        return self.faces[0] if self.faces else None


# The profile before the first observation.
UNSEEN = Profile(-math.inf)


@dataclass(frozen=True)
class Failure:
    """
    A plan that failed.

    Attributes
    ----------
    position : float
        Position of the face [m].
    plan : Plan
    touch_speed : float
        Speed at the touch [m/s].
    run_up : float
        Distance rolled from rest to the touch [m].

    """

    position: float
    plan: Plan
    touch_speed: float
    run_up: float = 0.0

    def is_at(self, position: float) -> bool:
        """Return whether the plan failed at the face at a position [m]."""
        return abs(self.position - position) < FAILURE_DISTANCE_MAX


@dataclass(frozen=True)
class Obstruction:
    """A position at which the ball made no progress, without an observed cause."""

    position: float  # of the centre of the ball [m]
    reason: Reason  # ``STUCK`` or ``STEEP``


@dataclass(frozen=True)
class StepObservation:
    """
    One observation of the floor ahead by a sensor that detects the next step only.

    Attributes
    ----------
    stamp : float
        Time of the measurement [s].
    detected : bool
        Whether there is a step; if not, distance and height are 0.
    distance : float
        Horizontal distance from the ball's centre to the face of the step [m].
    height : float
        Height of the step [m], negative for a drop.
    distance_sd, height_sd : float
        Standard deviations [m], 0 if unknown.

    """

    stamp: float
    detected: bool
    distance: float = 0.0
    height: float = 0.0
    distance_sd: float = 0.0
    height_sd: float = 0.0


@dataclass(frozen=True)
class TerrainObservation:
    """
    One observation of the ground ahead by a depth camera or a scanning range sensor.

    Coordinates are in the level, non-rolling frame at the centre of the ball.

    Attributes
    ----------
    stamp : float
        Time of the measurement [s].
    x, z : tuple of float
        Points of the polyline [m], x ascending; a vertical face has two points of the same x.
        The floor below the ball is at z = -radius.
    z_sd : tuple of float
        Standard deviations of z [m], 0 if unknown; empty if all are unknown.
    x_min, x_max : float
        Observed range [m].
    frame : str
        Frame of the message.

    """

    stamp: float
    x: Tuple[float, ...]
    z: Tuple[float, ...]
    z_sd: Tuple[float, ...] = ()
    x_min: float = 0.0
    x_max: float = 0.0
    frame: str = 'base_link'
