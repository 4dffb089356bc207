# SPDX-License-Identifier: Apache-2.0
"""
Execute decisions: the pendulum set angle at each odometry message.

The `Pilot` runs `pilot_step` on the robot, and a rollout runs it in its kernel, so that a plan is
executed as simulated.
"""
from dataclasses import replace
import math
from typing import NamedTuple, Optional

from ballbot_ros.control.speed_law import (
    braking_distance, estimated_slope, FURTHEST, holding_angle, Numbers, place_law_step,
    speed_law_start, speed_law_step, SpeedLaw, SpeedState, steepest_slope, stopping_speed)
from ballbot_ros.decision.planning.situation import Knowledge
from ballbot_ros.decision.values import (
    After, Decision, Kind, Motion, REST_SPEED_MAX, SLOPE_SD)
from ballbot_ros.jit import compiled

# The fields of an `Order`.
PlainOrder = tuple[float, float, float, float, float, float, float, float, float, float]

# Lean in addition to the lean that holds the ball on a slope, to move it there [rad].
EXCESS_LEAN = 0.3
# Braking uses the full lean if the speed exceeds the stopping speed by more than this [m/s].
SPEED_EXCESS_MAX = 0.03
# Braking with full lean ends below this speed [m/s].
EASING_SPEED = 0.3


class Order(NamedTuple):
    """Order for the pilot, until the next one; positions along the odometry axis."""

    lean: float  # largest lean [rad]
    emergency_lean: float  # for braking and holding on slopes [rad]
    reaction: float  # delay of a set angle [s]
    forward: float = 0.0  # fastest forward [m/s]
    backward: float = 0.0  # fastest backward to `stop` [m/s]
    # Stop position [m]; infinite for none, -infinite for as soon as possible.
    stop: float = math.inf
    swing: float = math.inf  # start of the swing, from which the speed is not controlled [m]
    swing_angle: float = 0.0  # set angle there [rad]
    edge: float = -math.inf  # end of the swing [m]
    after: float = 0.0  # speed behind the edge [m/s]


@compiled
def enough_lean(position: float, speed: float, slope: float, order: Order,
                law: Numbers) -> float:
    """Return the largest lean for a slope, or for a stop too near for the usual lean [rad]."""
    holding = holding_angle(slope, law)
    if math.isnan(holding):
        return order.emergency_lean
    gap = order.stop - position
    if math.isfinite(gap):
        # In the direction of motion.
        towards = stopping_speed(gap, slope, order.lean, order.reaction, law) if speed > 0.0 \
            else stopping_speed(-gap, -slope, order.lean, order.reaction, law)
        if abs(speed) > towards + SPEED_EXCESS_MAX:
            return order.emergency_lean
    return min(max(order.lean, abs(holding) + EXCESS_LEAN), order.emergency_lean)


@compiled
def pilot_step(state: SpeedState, position: float, speed: float, order: PlainOrder,
               period: float, law: Numbers) -> tuple[SpeedState, float]:
    """
    Return the next state, and the set angle for law (11) [rad]; no pendulum angle is measured.

    Parameters
    ----------
    state : SpeedState
        State of the speed law; see `speed_law_start`.
    position, speed : float
        Position and speed of the centre of the ball [m], [m/s].
    order : PlainOrder
        See `Order`.
    period : float
        Time since the last step [s].
    law : Numbers
        Fields of a `SpeedLaw`.

    """
    own = Order(*order)
    lean = enough_lean(position, speed, estimated_slope(state, law), own, law)
    if own.stop == -math.inf:
        later, set_angle = speed_law_step(
            state, speed, math.nan, 0.0, own.emergency_lean, period, law)
        if abs(speed) > EASING_SPEED:
            # Full lean, without the estimated slope: at an edge the estimate is wrong.
            braking, numbers = -math.copysign(own.emergency_lean, speed), SpeedLaw(*law)
            lead = max(numbers.lag / numbers.swing_time - 1.0, 0.0)
            set_angle = braking + lead * (braking - later.angle) + later.shortfall
            set_angle = min(max(set_angle, -FURTHEST), FURTHEST)
            later = SpeedState(later.speed, later.resistance, later.angle, later.predicted,
                               later.shortfall, set_angle)
    elif math.isfinite(own.stop):
        gap = own.stop - position
        later, set_angle = place_law_step(
            state, speed, math.nan, gap, own.forward if gap > 0.0 else own.backward, lean,
            period, law)
    else:
        set_speed = own.after if -math.inf < own.edge <= position else own.forward
        later, set_angle = speed_law_step(
            state, speed, math.nan, set_speed, lean, period, law)
    if own.swing <= position < own.edge:
        # On the step, its face supports the ball: the estimated slope must not change.
        set_angle = own.swing_angle
        later = SpeedState(speed, state.resistance, later.angle, later.predicted,
                           state.shortfall, set_angle)
    return later, set_angle


# Speed at which the ball rolls back to its stop position, or to the start of a plan [m/s].
CREEP_SPEED, BACK_OFF_SPEED = 0.1, 0.3
# Maximum distance to the stop if the decision has no stop position [m].
STOP_DISTANCE_MAX = 1.0
# Step between odometry messages, also after a longer gap [s].
PERIOD_MIN, PERIOD_MAX = 1e-3, 0.1
# An estimated slope counts as terrain, not as a step, once it lasts this long [s]; the estimate is
# ignored for the same time after a touch.
SLOPE_TIME_CONSTANT = 1.0


class Pilot:
    """Turns decisions and motion into set angles for law (11)."""

    def __init__(self, knowledge: Knowledge):
        """Start with the pendulum hanging down."""
        self.follow(knowledge)
        self.reset()

    def follow(self, knowledge: Knowledge) -> None:
        """Change tuning or controller; keep the state estimate."""
        self._tuning = knowledge.tuning
        self._law = SpeedLaw.tuned(knowledge.robot, knowledge.control)[:]

    def reset(self) -> None:
        """Discard the state estimates."""
        self._state: Optional[SpeedState] = None
        self._stamp = 0.0
        self._angle = 0.0
        self._stand, self._back = math.inf, -math.inf
        self._slope, self._estimated = 0.0, math.nan
        self._touched, self._step = -math.inf, -math.inf  # time [s] and position [m] of the step
        # Before the first motion, all slopes on which the ball can be held are equally probable.
        self._slope_error = steepest_slope(
            self._tuning.largest_lean, self._law) / math.sqrt(3.0)

    def estimate(self, motion: Motion, step: Optional[float]) -> Motion:
        """
        Return a motion with the modelled pendulum state and the estimated slope of the ground.

        The step at the position `step` [m] that the ball touches, if any, is not a slope.
        """
        if self._state is not None:
            motion = replace(
                motion, pendulum_angle=self._state.predicted,
                pendulum_rate=(self._angle - self._state.predicted) / SpeedLaw(*self._law).lag,
                slope=estimated_slope(self._state, self._law))
        if motion.is_plausible:
            if step is not None:
                self._touched, self._step = motion.stamp, step
            passed = motion.stamp - self._estimated
            if not self._has_touched(motion) and passed > 0.0:
                weight = min(1.0, passed / SLOPE_TIME_CONSTANT)
                self._slope += (motion.slope - self._slope) * weight
                self._slope_error -= self._slope_error * weight
            self._estimated = motion.stamp
        return replace(motion, slope=self._slope, slope_sd=math.hypot(
            SLOPE_SD, self._slope_error))

    @property
    def at_emergency_lean(self) -> bool:
        """
        Return whether the ball needs `emergency_lean` to move forward or to hold its position.

        The estimated slope is then the steepest one that this lean can hold, within `SLOPE_SD`.
        """
        return self._slope > steepest_slope(self._tuning.emergency_lean, self._law) - SLOPE_SD

    def _has_touched(self, motion: Motion) -> bool:
        """Return whether the ball touches a step, or did so a short time ago."""
        return motion.stamp - self._touched <= SLOPE_TIME_CONSTANT

    def angle(self, decision: Decision, motion: Motion) -> float:
        """
        Return the set angle of the pendulum [rad].

        It is absolute, positive to accelerate; 0 for a motion that is not plausible.  A repeated
        stamp returns the same angle.  The slope of the first motion initializes the observer of
        the law.
        """
        if not motion.is_plausible:
            self._state, self._angle, self._stand = None, 0.0, math.inf
            self._back = -math.inf
            return 0.0
        if self._state is None:
            self._state = speed_law_start(
                motion.speed, motion.pendulum_angle, motion.slope, self._law)
            period = PERIOD_MIN
        elif motion.stamp <= self._stamp:
            return self._angle
        else:
            period = min(max(motion.stamp - self._stamp, PERIOD_MIN), PERIOD_MAX)
        if decision.kind is not Kind.CROSS and self._has_touched(motion) \
                and motion.position < self._step:
            # The force of the step on the ball is not the resistance of a slope.
            self._state = self._state._replace(
                resistance=SpeedLaw(*self._law).weight_torque * math.sin(motion.slope))
        order = self._order(decision, motion)
        self._stamp = motion.stamp
        self._state, self._angle = pilot_step(
            self._state, motion.position, motion.speed, order[:], period, self._law)
        return self._angle

    def _order(self, decision: Decision, motion: Motion) -> Order:
        """Return the order that executes a decision."""
        plan, tuning = decision.plan, self._tuning
        stand = self._standing(decision, motion)
        self._back = plan.start if decision.kind is Kind.BACK_OFF else -math.inf
        common = Order(tuning.largest_lean, tuning.emergency_lean, tuning.dead_time)
        if decision.kind is Kind.BACK_OFF:
            return common._replace(forward=CREEP_SPEED, backward=BACK_OFF_SPEED, stop=plan.start)
        if decision.kind in (Kind.STOP, Kind.GO_ROUND):
            now = decision.set_speed == 0.0 and not math.isfinite(plan.stop_position)
            return common._replace(
                forward=decision.set_speed, backward=CREEP_SPEED,
                stop=-math.inf if now and abs(motion.speed) > EASING_SPEED else stand)
        if decision.kind is Kind.CROSS:
            after = 0.0 if plan.after is After.STOP else min(plan.speed, tuning.cruise_speed)
            return common._replace(forward=plan.speed, swing=plan.swing_position,
                                   swing_angle=plan.swing_angle, edge=plan.edge, after=after)
        return common._replace(forward=decision.set_speed)

    def _standing(self, decision: Decision, motion: Motion) -> float:
        """
        Return the stop position [m]; until the ball is at rest, it only moves closer.

        At an edge, the reason to stop may change: the measured slope is inaccurate there, and
        faces appear and disappear.
        """
        if decision.kind not in (Kind.STOP, Kind.GO_ROUND):
            self._stand = math.inf
            return math.inf
        given = decision.plan.stop_position
        planned, moves = math.isfinite(given), abs(motion.speed) > REST_SPEED_MAX
        if not planned:
            if not moves and math.isfinite(self._stand):
                return self._stand
            slope = 0.0 if self._state is None else estimated_slope(self._state, self._law)
            ahead = braking_distance(
                abs(motion.speed), slope if motion.speed > 0.0 else -slope,
                self._tuning.emergency_lean, self._tuning.dead_time, self._law)
            # A ball that cannot brake in time stops as soon as possible.
            given = motion.position + math.copysign(min(ahead, STOP_DISTANCE_MAX), motion.speed)
            # The ground behind the start of a plan may not be free.
            given = max(given, self._back)
        closer = min if planned or motion.speed > 0.0 else max
        self._stand = closer(self._stand, given) if moves and math.isfinite(self._stand) else given
        return self._stand
