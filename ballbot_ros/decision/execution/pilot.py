# SPDX-License-Identifier: Apache-2.0
"""Execute decisions: the pendulum set angle at each odometry message."""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.control.speed_law import (
    braking_distance, estimated_slope, speed_law_start, SpeedLaw, SpeedState, steepest_slope)
from ballbot_ros.decision.execution.pilot_law import EASING_SPEED, Order, pilot_step
from ballbot_ros.decision.planning.situation import Knowledge
from ballbot_ros.decision.values import (
    After, Decision, Kind, Motion, Plan, REST_SPEED_MAX, SLOPE_SD, Strategy)

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
        self._slope, self._estimated, self._touched = 0.0, math.nan, -math.inf
        # Before the first motion, all slopes on which the ball can be held are equally probable.
        self._slope_error = steepest_slope(
            self._tuning.largest_lean, self._law) / math.sqrt(3.0)

    def estimate(self, motion: Motion, touching: bool) -> Motion:
        """
        Return a motion with the modelled pendulum state and the estimated slope of the ground.

        A step that the ball is `touching` is not a slope.
        """
        if self._state is not None:
            motion = replace(
                motion, pendulum_angle=self._state.predicted,
                pendulum_rate=(self._angle - self._state.predicted) / SpeedLaw(*self._law).lag,
                slope=estimated_slope(self._state, self._law))
        if motion.is_plausible:
            if touching:
                self._touched = motion.stamp
            passed = motion.stamp - self._estimated
            if motion.stamp - self._touched > SLOPE_TIME_CONSTANT and passed > 0.0:
                weight = min(1.0, passed / SLOPE_TIME_CONSTANT)
                self._slope += (motion.slope - self._slope) * weight
                self._slope_error -= self._slope_error * weight
            self._estimated = motion.stamp
        return replace(motion, slope=self._slope, slope_sd=math.hypot(
            SLOPE_SD, self._slope_error))

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
        order = self._order(decision, motion)
        self._stamp = motion.stamp
        self._state, self._angle = pilot_step(
            self._state, motion.position, motion.speed, order[:], period, self._law)
        return self._angle

    def _order(self, decision: Decision, motion: Motion) -> Order:
        """Return the order that executes a decision."""
        plan, tuning = decision.plan or Plan(Strategy.STOP), self._tuning
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
        if decision.kind is Kind.CROSS and decision.plan is not None:
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
        given = math.inf if decision.plan is None else decision.plan.stop_position
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
