# SPDX-License-Identifier: Apache-2.0
"""
Detect attempts at a step, and their outcomes, from motion and observations.

Odometry slips: if the ball spins at the foot of a step, its odometry passes the step.  An attempt
therefore succeeds only when a later observation confirms it: the map of edges no longer has the
face ahead of the ball.  Without an observation there is no outcome.
"""
from collections import deque
from dataclasses import dataclass, replace
import math
from typing import Deque, Optional, Tuple

from ballbot_ros.decision.learning.outcomes import Outcome, Result
from ballbot_ros.decision.planning.situation import Situation
from ballbot_ros.decision.values import (
    Decision, Face, Kind, Motion, Profile, REST_SPEED_MAX, UNSEEN)
from ballbot_ros.physics.model.robot import Robot

# A slower touch is not an attempt; a faster one is recorded with the second speed [m/s].
TOUCH_SPEED_MIN, TOUCH_SPEED_MAX = 0.05, 10.0
# The touch speed is that at this distance plus two standard deviations before the touch, but at
# most at the second distance [m].
TOUCH_MARGIN_MIN, TOUCH_MARGIN_MAX = 0.005, 0.04
# The ball is stuck if it rolls back this far from the touch [m], or makes less progress than this
# [m] within this time [s], which is also the timeout for the observation behind the face.
RETREAT_MIN, PROGRESS_MIN, ATTEMPT_TIMEOUT = 0.03, 0.005, 1.5
# Minimum distance past the face for a success [m].
PASSED_DISTANCE_MIN = 0.1
# Terrain behind the face that is lower than before by more than this is a fall [m].
FALL_HEIGHT_MIN = 0.03
# A drop this near behind an edge is measured from the ground before the edge [m]; a ball that does
# not rest before the drop has succeeded after this time [s].
LANDING_LENGTH, LANDING_TIME_MAX = 1.0, 5.0
# Odometry restarts after a longer gap between messages [s], or a position jump that exceeds the
# integrated speed by this [m].
ODOMETRY_GAP_MAX, ODOMETRY_JUMP_MAX = 0.5, 0.06
# Maximum age of the terrain estimate [s].
PROFILE_AGE_MAX = 1.0
# The pendulum angle is averaged over this time from the touch [s].
ANGLE_TIME = 0.3
MOTIONS_MAX = 200


@dataclass(frozen=True)
class Attempt:
    """An attempt that has not ended."""

    face: Face  # estimate at the touch; later observations update its position
    outcome: Outcome  # with the data known at the touch
    touched: float  # time of the touch [s]
    touch: float  # position of the centre at the touch relative to the face [m]
    best: float  # maximum of the relative position so far [m]
    best_at: float  # time of that maximum [s]
    passed: Optional[float] = None  # time at which the ball passed the face [s]
    passed_speed: Optional[float] = None  # speed at that time [m/s]
    lean: float = 0.0  # sum of the pendulum angles in contact [rad]
    leans: int = 0  # number of them


class AttemptWatch:
    """Detects attempts and their outcomes at each decision."""

    def __init__(self, robot: Robot):
        self._radius = robot.ball_radius
        self._digest = robot.digest
        self.reset()

    def reset(self) -> None:
        """Discard the attempt, after a jump in time or position."""
        self._motions: Deque[Motion] = deque(maxlen=MOTIONS_MAX)
        self.attempt: Optional[Attempt] = None
        self._left = True  # whether the ball has left the face at which it was stuck
        self._ahead: Optional[Face] = None  # next face, before it is touched
        self._run_up = math.nan  # distance to its touch [m]
        self._rested = math.nan  # position where the ball was last at rest [m]
        self._drop: Optional[Face] = None
        self._risen: Optional[Face] = None  # last crossed face
        self._profile = UNSEEN

    def update(self, motion: Motion, profile: Profile, decision: Decision) -> Optional[Outcome]:
        """
        Update the attempt under the executed decision; return its outcome if it has just ended.

        Sensor data never raise an exception.
        """
        if not motion.is_plausible:
            return None
        if self._motions and self._jumped(motion):
            self.reset()
        if not self._motions or abs(motion.speed) < REST_SPEED_MAX:
            self._rested = motion.position
        self._motions.append(motion)
        if profile.rejection is None and profile.is_plausible:
            self._profile = profile
        age = abs(motion.stamp - self._profile.stamp)
        seen = self._profile if age <= PROFILE_AGE_MAX else UNSEEN
        if self.attempt is None:
            fall = self._fallen(motion, seen, decision)
            if fall is None:
                self._approach(motion, seen, decision)
            return fall
        return self._go_on(self.attempt, motion, seen)

    def _jumped(self, motion: Motion) -> bool:
        """Return whether this motion is inconsistent with the last one."""
        last = self._motions[-1]
        passed = motion.stamp - last.stamp
        moved = motion.position - last.position
        fastest = max(abs(motion.speed), abs(last.speed))
        return not 0.0 <= passed <= ODOMETRY_GAP_MAX \
            or abs(moved) > fastest * passed + ODOMETRY_JUMP_MAX

    def _approach(self, motion: Motion, seen: Profile, decision: Decision) -> None:
        """Track the next face, and start an attempt when the ball touches it."""
        if seen is not UNSEEN:
            self._ahead = next((face for face in seen.faces if face.height > 0.0
                                and face.position > motion.position), None)
        face = self._ahead
        if face is None:
            self._run_up = math.nan
            return
        before, self._run_up = self._run_up, face.touch(self._radius) - motion.position
        self._left = self._left or self._run_up > RETREAT_MIN
        # A face that appears at the present position of the ball was not approached.
        if self._left and before > 0.0 >= self._run_up:
            speed, angle = self._before_touch(face)
            if speed >= TOUCH_SPEED_MIN:
                self.attempt = self._started(face, motion, seen, decision, speed, angle)

    def _before_touch(self, face: Face) -> Tuple[float, float]:
        """Return speed and pendulum angle just before the touch."""
        before = face.touch(self._radius) - min(
            TOUCH_MARGIN_MIN + 2.0 * face.position_sd, TOUCH_MARGIN_MAX)
        for motion in reversed(self._motions):
            if motion.position <= before:
                return motion.speed, motion.pendulum_angle
        return self._motions[0].speed, self._motions[0].pendulum_angle

    def _started(self, face: Face, motion: Motion, seen: Profile, decision: Decision,
                 speed: float, angle: float) -> Attempt:
        """Return an attempt that starts with a touch."""
        plan, probability = None, None
        if decision.kind is Kind.CROSS:
            plan = decision.plan
            if 0.0 <= decision.outlook.probability <= 1.0:
                probability = decision.outlook.probability
        outcome = Outcome(
            stamp=max(0.0, motion.stamp), result=Result.STUCK.value, face=max(0, face.number),
            position=face.position, height=face.height, height_sd=min(face.height_sd, 0.2),
            touch_speed=min(max(0.0, speed), TOUCH_SPEED_MAX),
            touch_angle=_wrapped(angle), held_angle=_wrapped(angle),
            slope=max(-1.0, min(1.0, Situation(motion, seen).slope)),
            distance=min(max(0.0, motion.position - self._rested), 1000.0),
            probability=probability, robot=self._digest, plan=plan)
        along = motion.position - face.position
        return Attempt(face, outcome, motion.stamp, along, along, motion.stamp)

    def _go_on(self, attempt: Attempt, motion: Motion, seen: Profile) -> Optional[Outcome]:
        """Update an attempt; return its outcome once it has ended."""
        attempt = self.attempt = self._followed(attempt, motion, seen)
        along, now = motion.position - attempt.face.position, motion.stamp
        if along < attempt.touch - RETREAT_MIN:
            return self._end(attempt, Result.STUCK, motion)
        if attempt.passed is None:
            late = now - attempt.best_at > ATTEMPT_TIMEOUT
            return self._end(attempt, Result.STUCK, motion) if late else None
        drop = self._next_drop(motion, seen, attempt.face)
        if drop is not None and motion.position > drop.position + 2.0 * drop.position_sd:
            return self._end(attempt, Result.FELL, motion) \
                if self._agrees(drop, motion, seen) else None
        if along < PASSED_DISTANCE_MIN or seen.stamp < attempt.passed:
            if now - attempt.passed > ATTEMPT_TIMEOUT:
                self.attempt = None  # no observation of the outcome
            return None
        resting = abs(motion.speed) < REST_SPEED_MAX or now - attempt.passed > LANDING_TIME_MAX
        return self._end(attempt, Result.OVER, motion) if drop is None or resting else None

    def _followed(self, attempt: Attempt, motion: Motion, seen: Profile) -> Attempt:
        """Return an attempt updated by motion and observation."""
        for face in seen.faces:
            if face.number == attempt.face.number and face.position > motion.position:
                attempt = replace(attempt, face=face, passed=None)
        along, now = motion.position - attempt.face.position, motion.stamp
        if along > attempt.best + PROGRESS_MIN:
            attempt = replace(attempt, best=along, best_at=now)
        if attempt.passed is None and along > 0.0:
            attempt = replace(attempt, passed=now,
                              passed_speed=min(max(0.0, motion.speed), TOUCH_SPEED_MAX))
        if now - attempt.touched <= ANGLE_TIME:
            attempt = replace(attempt, lean=attempt.lean + motion.pendulum_angle,
                              leans=attempt.leans + 1)
        return attempt

    def _next_drop(self, motion: Motion, seen: Profile, crossed: Optional[Face]
                   ) -> Optional[Face]:
        """Return the next face, or the last one observed, if it is a drop."""
        ahead = next((face for face in seen.faces if face.position > motion.position), None)
        if ahead is not None:
            level = ahead.height
            if crossed is not None and 0.0 < ahead.position - crossed.position < LANDING_LENGTH:
                level += crossed.height
            self._drop = ahead if level < -FALL_HEIGHT_MIN else None
        return self._drop

    def _fallen(self, motion: Motion, seen: Profile, decision: Decision) -> Optional[Outcome]:
        """Return the outcome of a ball that passed a drop without a step before it."""
        drop = self._next_drop(motion, seen, self._risen)
        if drop is None or motion.position < drop.position + 2.0 * drop.position_sd \
                or not self._agrees(drop, motion, seen):
            return None
        return self._end(self._started(drop, motion, seen, decision, motion.speed,
                                       motion.pendulum_angle), Result.FELL, motion)

    def _agrees(self, face: Face, motion: Motion, seen: Profile) -> bool:
        """Return whether observations since the ball passed a face show it behind the ball."""
        passed = next((item.stamp for item in self._motions if item.position > face.position),
                      math.inf)
        return seen.stamp >= passed and not any(
            item.position > motion.position and item.number == face.number
            for item in seen.faces)

    def _end(self, attempt: Attempt, result: Result, motion: Motion) -> Outcome:
        """End the attempt and return its outcome."""
        self.attempt, self._drop = None, None
        self._left = result is not Result.STUCK
        self._risen = attempt.face if result is Result.OVER else None
        self._run_up = math.nan
        held = attempt.lean / attempt.leans if attempt.leans else attempt.outcome.touch_angle
        return replace(attempt.outcome, stamp=max(0.0, motion.stamp), result=result.value,
                       position=attempt.face.position, held_angle=_wrapped(held),
                       passed_speed=None if result is Result.STUCK else attempt.passed_speed)


def _wrapped(angle: float) -> float:
    """Return an angle between -pi and pi [rad]."""
    return math.atan2(math.sin(angle), math.cos(angle))
