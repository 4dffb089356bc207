# SPDX-License-Identifier: Apache-2.0
"""State between decisions: failed plans, obstructions, and the free distance behind the ball."""
from collections import deque
from dataclasses import replace
import math
from typing import Deque, List, Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.execution.attempts import alike
from ballbot_ros.decision.learning.outcomes import Outcome, Result
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    Decision, Face, Failure, Kind, Motion, Obstruction, Profile, Reason)

# Maximum distance between a face and the same face at an earlier failure [m].
SAME_PLACE = 0.15
# More failures than this are not kept.
KEPT = 20
# A face that was passed is a drop for a ball that rolls back; so is a lower one [m].
UNEVEN, KEPT_OFF = 0.005, 0.05
# The ball is stuck with less progress than this [m] within this time [s], at a commanded speed of
# at least the third value [m/s].
PROGRESS, PROGRESS_TIMEOUT, COMMANDED = 0.05, 2.5, 0.1
# The slope is too steep if the ball, commanded forward, rolls back at this speed [m/s] for this
# time [s] and distance [m]; the slope estimate alone is too slow.
BACKWARDS, LASTING, LOST = 0.05, 1.0, 0.15
# An obstruction is dropped once the ball has passed it by this distance [m].
PASSED = 0.1
# A ball that fails may have spun at the foot of the step: odometry is behind by up to this [m].
SLIPPED = 0.1
# An estimated slope counts as terrain, not as a step, once it lasts this long [s]; the estimate is
# ignored for the same time after a touch.
FELT = 1.0


class Memory:
    """
    Failures, obstructions and slope that persist between decisions.

    Parameters
    ----------
    tuning : DecisionTuning
    ball_radius : float
        [m].

    """

    def __init__(self, tuning: DecisionTuning, ball_radius: float):
        self._room_behind, self._radius = tuning.room_behind, ball_radius
        self.reset()

    def reset(self) -> None:
        """Discard everything, after a jump in time or position."""
        self._failures: Deque[Failure] = deque(maxlen=KEPT)
        self._free_from, self._edge_behind = math.inf, -math.inf
        self._ahead: Tuple[Face, ...] = ()
        self._obstruction: Optional[Obstruction] = None
        self._slope, self._felt, self._touched = 0.0, math.nan, -math.inf
        self._rest()

    def _rest(self) -> None:
        """Reset the progress check."""
        self._best: Optional[Tuple[float, float]] = None  # position [m] and when [s]
        self._back_since: Optional[float] = None

    @property
    def free_from(self) -> float:
        """Return the farthest position behind to which the ball may roll back [m]."""
        return max(self._free_from, self._edge_behind)

    @property
    def obstruction(self) -> Optional[Obstruction]:
        """Return the obstruction, None once the ball has passed it."""
        return self._obstruction

    def failures(self, profile: Optional[Profile]) -> Tuple[Failure, ...]:
        """Return the failures at faces ahead, with the present face numbers."""
        found: List[Failure] = []
        for face in profile.faces if profile is not None else ():
            found += [replace(failure, face=face.number) for failure in self._failures
                      if _is_at(failure, face)]
        return tuple(found)

    @property
    def slope(self) -> float:
        """Return the slope estimate from the motion, without steps [rad]."""
        return self._slope

    def move(self, motion: Motion, profile: Optional[Profile], touching: bool) -> None:
        """
        Update position, free distance behind the ball and slope.

        Parameters
        ----------
        motion : Motion
        profile : Profile or None
        touching : bool
            Whether the ball touches a step.

        """
        if not motion.sane:
            return
        if touching:
            self._touched = motion.stamp
        passed = motion.stamp - self._felt
        if motion.stamp - self._touched > FELT and passed > 0.0:
            self._slope += (motion.slope - self._slope) * min(1.0, passed / FELT)
        self._felt = motion.stamp
        if not math.isfinite(self._free_from):
            self._free_from = motion.position - self._room_behind
        self._free_from = min(self._free_from, motion.position)
        if motion.position < self._edge_behind - KEPT_OFF - self._radius:
            self._edge_behind = -math.inf  # the ball has rolled back over it
        ahead = self._ahead
        if profile is not None and profile.rejection is None:
            ahead = tuple(face for face in profile.faces if face.position > motion.position)
        for face in self._ahead:
            # The estimate of a face may move from before the ball to behind it.
            moved = face.position <= motion.position + KEPT_OFF and all(
                face.number != other.number for other in ahead)
            if abs(face.height) > UNEVEN and (face.position <= motion.position or moved):
                # After a step down, the way back is a step up, which the ball touches earlier.
                self._edge_behind = face.position + KEPT_OFF + touch_distance(
                    self._radius, -face.height)
        self._ahead = ahead
        blocked = self._obstruction
        if blocked is not None and motion.position > blocked.position + PASSED:
            self._obstruction = None

    def take(self, outcome: Outcome) -> None:
        """Add the outcome of an attempt."""
        failure = outcome.failure
        if outcome.result == Result.OVER.value:
            there = Face(failure.face, failure.position, failure.height, 0.0, 0.0)
            kept = [one for one in self._failures if not _is_at(one, there)]
            self._failures = deque(kept, maxlen=KEPT)
        else:
            self._failures.append(failure)
            self._free_from += SLIPPED

    def watch(self, motion: Motion, decision: Decision) -> None:
        """
        Detect missing progress under the executed decision.

        An undetected step, or a slope that is too steep, sets `obstruction` for the next decision.
        """
        wants = decision.kind in (Kind.CLEAR, Kind.CROSS) and decision.set_speed >= COMMANDED
        if not wants or decision.contact_since is not None \
                or not motion.sane:
            self._rest()
            return
        now, position = motion.stamp, motion.position
        if self._best is None or position > self._best[0] + PROGRESS or now < self._best[1]:
            self._best = position, now
        self._back_since = None if motion.speed > -BACKWARDS else (
            now if self._back_since is None else self._back_since)
        if self._back_since is not None and now - self._back_since >= LASTING \
                and position < self._best[0] - LOST:
            # After a bounce the ball rolls back, too, but not for this long.
            self._obstruct(self._best[0], Reason.STEEP)
        elif now - self._best[1] >= PROGRESS_TIMEOUT:
            self._obstruct(self._best[0], Reason.STUCK)

    def _obstruct(self, position: float, reason: Reason) -> None:
        self._obstruction = Obstruction(position, reason)
        self._rest()


def _is_at(failure: Failure, face: Face) -> bool:
    """Return whether a failure was at a face."""
    there = replace(face, height=failure.height)
    return failure.face == face.number or (
        abs(failure.position - face.position) < SAME_PLACE and alike(face, there))
