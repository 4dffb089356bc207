# SPDX-License-Identifier: Apache-2.0
"""State between decisions: failed plans, an obstruction, and the free ground behind the ball."""
from collections import deque
import math
from typing import Deque, Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.learning.outcomes import Outcome, Result
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    Decision, Face, Failure, Kind, Motion, Obstruction, Profile, Reason)

FAILURES_MAX = 20
# A ball that rolls back keeps this distance from a face that it has passed [m].
EDGE_CLEARANCE = 0.05
# The ball is stuck with less progress than this [m] within this time [s], at `emergency_lean` or
# in a crossing.
PROGRESS_MIN, PROGRESS_TIMEOUT = 0.05, 2.5
# The slope is too steep if the ball, commanded forward, rolls back at this speed [m/s] for this
# time [s] and distance [m]; the slope estimate alone is too slow.
BACKWARD_SPEED_MIN, BACKWARD_TIME_MIN, BACKWARD_DISTANCE_MIN = 0.05, 1.0, 0.15
# An obstruction is dropped once the ball has passed it by this distance [m].
PASSED_DISTANCE_MIN = 0.1
# A ball that failed may have spun at the foot of the step: odometry is ahead by up to this [m].
SLIP_MAX = 0.1


class Memory:
    """Failures, an obstruction and free ground, which persist between decisions."""

    def __init__(self, tuning: DecisionTuning, ball_radius: float):
        self._room_behind, self._radius = tuning.room_behind, ball_radius
        self.reset()

    def reset(self) -> None:
        """Discard everything, after a jump in time or position."""
        self.failures: Deque[Failure] = deque(maxlen=FAILURES_MAX)
        self._free_from, self._edge_behind = math.inf, -math.inf
        self._ahead: Tuple[Face, ...] = ()
        self.obstruction: Optional[Obstruction] = None  # until the ball has passed it
        self._rest()

    def _rest(self) -> None:
        """Reset the progress check."""
        self._best: Optional[Tuple[float, float]] = None  # position [m] and time [s]
        self._back_since: Optional[float] = None

    @property
    def free_from(self) -> float:
        """Return the farthest position behind to which the ball may roll back [m]."""
        return max(self._free_from, self._edge_behind)

    def move(self, motion: Motion, profile: Profile) -> None:
        """Update the position and the free ground behind the ball."""
        if not motion.is_plausible:
            return
        if not math.isfinite(self._free_from):
            # The ground may end behind that room.
            self._free_from = motion.position - max(self._room_behind - EDGE_CLEARANCE, 0.0)
        self._free_from = min(self._free_from, motion.position)
        if motion.position < self._edge_behind - EDGE_CLEARANCE - self._radius:
            self._edge_behind = -math.inf  # the ball has rolled back over it
        ahead = self._ahead
        if profile.rejection is None:
            ahead = tuple(face for face in profile.faces if face.position > motion.position)
        for face in self._ahead:
            # The estimate of a face may move from before the ball to behind it.
            moved = face.position <= motion.position + EDGE_CLEARANCE and all(
                face.number != other.number for other in ahead)
            if face.position <= motion.position or moved:
                # After a step down, the way back is a step up, which the ball touches earlier.
                self._edge_behind = face.position + EDGE_CLEARANCE + touch_distance(
                    self._radius, -face.height)
        self._ahead = ahead
        blocked = self.obstruction
        if blocked is not None and motion.position > blocked.position + PASSED_DISTANCE_MIN:
            self.obstruction = None

    def take(self, outcome: Outcome) -> None:
        """Add the outcome of an attempt."""
        failure = outcome.failure
        if outcome.result == Result.OVER.value:
            kept = [one for one in self.failures if not one.is_at(failure.position)]
            self.failures = deque(kept, maxlen=FAILURES_MAX)
        else:
            self.failures.append(failure)
            self._free_from += SLIP_MAX

    def watch(self, motion: Motion, decision: Decision, at_emergency_lean: bool) -> None:
        """
        Detect missing progress under the executed decision.

        An undetected step, or a slope that is too steep, sets `obstruction` for the next decision.
        `at_emergency_lean`: see `Pilot`.
        """
        if not decision.forward_speed > 0.0 \
                or decision.contact_since is not None or not motion.is_plausible:
            self._rest()
            return
        now, position = motion.stamp, motion.position
        if self._best is None or position > self._best[0] + PROGRESS_MIN or now < self._best[1]:
            self._best = position, now
        self._back_since = None if motion.speed > -BACKWARD_SPEED_MIN else (
            now if self._back_since is None else self._back_since)
        if self._back_since is not None and now - self._back_since >= BACKWARD_TIME_MIN \
                and position < self._best[0] - BACKWARD_DISTANCE_MIN:
            # After a bounce the ball rolls back, too, but not for this long.
            self._obstruct(self._best[0], Reason.STEEP)
        # A ball that crosses never rests; the slope is not estimated during a swing.
        elif (at_emergency_lean or decision.kind is Kind.CROSS) \
                and now - self._best[1] >= PROGRESS_TIMEOUT:
            self._obstruct(self._best[0], Reason.STUCK)

    def _obstruct(self, position: float, reason: Reason) -> None:
        self.obstruction = Obstruction(position, reason)
        self._rest()
