# SPDX-License-Identifier: Apache-2.0
"""Match observations and odometry that arrive at different times, late, or not at all."""
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass, replace
import math
from typing import Deque, Dict, Optional, Tuple, Union

import numpy as np

from ballbot_ros.decision.perception.edge_map import EdgeMap
from ballbot_ros.decision.perception.step_tracker import StepTracker
from ballbot_ros.decision.perception.terrain_tracker import TerrainTracker
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    Motion, Profile, Reason, StepObservation, TerrainObservation)
from ballbot_ros.physics.model.robot import Robot

Observation = Union[StepObservation, TerrainObservation]

# A sensor whose last message is older than that of the other by this much is ignored [s].
SENSOR_TIMEOUT = 1.0


class ProfileTracker:
    """Estimates the ground ahead from a step sensor, a terrain sensor in a `frame`, or both."""

    def __init__(self, robot: Robot, tuning: DecisionTuning, frame: str = 'base_link'):
        self._edges = EdgeMap(tuning.contradiction_sigma)
        self._steps = StepTracker(robot.ball_radius, tuning, self._edges)
        self._terrain = TerrainTracker(robot.ball_radius, tuning, self._edges, frame)
        self.reset()

    def follow(self, tuning: DecisionTuning, steepest: float) -> None:
        """
        Replace the tuning, and the steepest slope on which the ball can be held [rad].

        Only the parameters of the tuning that are not fixed may differ.
        """
        self._steps.tuning, self._terrain.steepest = tuning, steepest

    def reset(self) -> None:
        """Discard all estimates, after a jump in time or position; edge numbers continue."""
        self._edges.clear()
        self._steps.reset()
        self._terrain.reset()
        self._newest: Dict[type, Tuple[float, Optional[Reason], str]] = {}

    def update(self, observation: Observation, position: float) -> Profile:
        """
        Fuse one observation, made at a position of the ball's centre [m]; return the profile.

        A rejected observation sets its reason in the profile; no sensor data raise an exception.
        """
        kind, stamp = type(observation), observation.stamp
        reason, why = self._terrain.update(observation, position) if isinstance(
            observation, TerrainObservation) else self._steps.update(observation, position)
        self._newest[kind] = stamp, reason, why
        # A sensor without recent messages is ignored.
        newest = {one: last for one, last in self._newest.items()
                  if one is kind or abs(last[0] - stamp) <= SENSOR_TIMEOUT}
        ground = self._terrain.profile if TerrainObservation in newest else None
        if ground is None:
            ground = Profile(stamp, seen_to=-math.inf if kind is TerrainObservation
                             else self._steps.seen_to)
        if reason is None:
            reason, why = next((last[1:] for last in newest.values() if last[1]), (None, ''))
        faces = tuple(face for face in self._edges.faces
                      if not ground.points or face.position + face.run > position)
        return replace(ground, stamp=max(last[0] for last in newest.values()), faces=faces,
                       rejection=reason, explanation=why)


# Odometry history: duration [s] and number of messages.  Older observations are rejected.
ODOMETRY_DURATION, ODOMETRY_COUNT_MAX = 1.5, 5000
# An observation further ahead of odometry has another clock [s]; length of the queue of others.
CLOCK_OFFSET_MAX, PENDING_COUNT_MAX = 0.5, 200
# Growth of a face's uncertainty since the last scan: position with distance travelled [1] and
# with time [m/s], height with time [m/s].
POSITION_SD_PER_DISTANCE, POSITION_SD_RATE, HEIGHT_SD_RATE = 0.03, 0.01, 0.002
# A sensor is frozen if its data repeat while the ball rolls this far [m].
FROZEN_DISTANCE = 0.02
# A polyline this straight may repeat without a frozen sensor [m].
STRAIGHTNESS_MAX = 1e-9
# Consecutive rejected observations that stop the ball.
REJECTED_MAX = 3


def unchanged_distance(observation: Observation) -> float:
    """Return the longest plausible distance without a change of the sensor data [m]."""
    if isinstance(observation, StepObservation):
        return FROZEN_DISTANCE if observation.detected else math.inf
    x, z = np.array(observation.x), np.array(observation.z)
    if len(x) < 3 or len(x) != len(z) or not x[-1] > x[0]:
        return math.inf
    straight = z[0] + (z[-1] - z[0]) * (x - x[0]) / (x[-1] - x[0])
    if np.abs(z - straight).max() <= STRAIGHTNESS_MAX:
        return math.inf
    # The detected position of a face between two points changes when one of them reaches it.
    face = int(np.argmax(np.abs(np.diff(z))))
    return FROZEN_DISTANCE + float(np.median(np.diff(x)[max(face - 3, 0):face + 4]))


@dataclass
class _Unchanged:
    """Repeated data: position of the ball at their first occurrence, and the profile then."""

    data: Observation
    position: float
    profile: Optional[Profile] = None
    frozen: bool = False


class GroundFusion:
    """
    Fuses each observation at the ball position at its stamp; polylines must be in a `frame`.

    The result depends on stamps alone, not on arrival times.
    """

    def __init__(self, robot: Robot, tuning: DecisionTuning, frame: str = 'base_link'):
        self._tracker = ProfileTracker(robot, tuning, frame)
        self.follow = self._tracker.follow
        self.reset()

    def reset(self) -> None:
        """Discard the state, after a jump in time or position."""
        self._tracker.reset()
        self._stamps: Deque[float] = deque(maxlen=ODOMETRY_COUNT_MAX)
        self._positions: Deque[float] = deque(maxlen=ODOMETRY_COUNT_MAX)
        self._pending: Deque[Observation] = deque(maxlen=PENDING_COUNT_MAX)
        self._unchanged: Dict[type, _Unchanged] = {}
        self._newest: Dict[type, float] = {}
        self._rejected = 0
        self.profile: Optional[Profile] = None  # after the newest observation

    def observe(self, observation: Observation) -> None:
        """Queue an observation; it is fused once there is odometry that is not older."""
        self._pending.append(observation)

    def move(self, motion: Motion) -> None:
        """Add odometry, not older than the last; non-finite values are ignored."""
        if not (math.isfinite(motion.stamp) and math.isfinite(motion.position)):
            return
        self._stamps.append(motion.stamp)
        self._positions.append(motion.position)
        while self._stamps[0] < motion.stamp - ODOMETRY_DURATION:
            self._stamps.popleft()
            self._positions.popleft()

    def fuse(self) -> None:
        """Fuse the observations for which there is odometry that is not older."""
        if not self._stamps:
            return
        waiting: Deque[Observation] = deque(maxlen=PENDING_COUNT_MAX)
        for observation in self._pending:
            age = self._stamps[-1] - observation.stamp
            if -CLOCK_OFFSET_MAX <= age < 0.0:
                waiting.append(observation)
            else:
                self.profile = self._fused(observation, age)
        self._pending = waiting

    def _fused(self, observation: Observation, age: float) -> Profile:
        """Return the profile after an observation of some age [s]."""
        kind, reason, why = type(observation), None, ''
        if age < -CLOCK_OFFSET_MAX:
            reason, why = Reason.BAD_OBSERVATION, f'it is {-age:.2f} s ahead of the odometry'
        elif age > ODOMETRY_DURATION:
            reason, why = Reason.STALE, (
                f'it arrived {age:.2f} s late; odometry is kept for {ODOMETRY_DURATION:g} s')
        if reason is not None or observation.stamp <= self._newest.get(kind, -math.inf):
            # Rejected without effect: `observation_timeout` limits the age of the profile.
            return self.profile or Profile(observation.stamp, rejection=reason, explanation=why)
        self._newest[kind] = max(self._newest.get(kind, -math.inf), observation.stamp)
        position = self._position_at(observation.stamp)
        if self._is_frozen(observation, position):
            # All repetitions of the data are invalid, the earlier ones too.
            self.profile = self._unchanged[kind].profile or self.profile
            return self._refused(Profile(
                observation.stamp, rejection=Reason.BAD_OBSERVATION,
                explanation='the sensor is frozen: the ball rolls and its data do not change'))
        # The tracker rejects an age of NaN.
        found = self._tracker.update(observation, position)
        if found.rejection is not None:
            return self._refused(found)
        self._rejected = 0
        return found

    def _is_frozen(self, observation: Observation, position: float) -> bool:
        """Return whether the data are the same although the ball has rolled."""
        kind, data = type(observation), replace(observation, stamp=0.0)
        last = self._unchanged.get(kind)
        if last is None or last.data != data:
            if last is not None and last.frozen:
                self._tracker.reset()
            self._unchanged[kind] = _Unchanged(data, position)
            return False
        last.profile = last.profile or self.profile
        last.frozen |= abs(position - last.position) > unchanged_distance(observation)
        return last.frozen

    def _refused(self, found: Profile) -> Profile:
        """Return the profile after a rejection; `REJECTED_MAX` in succession reject it, too."""
        self._rejected += 1
        if self.profile is None:
            return found
        if self._rejected < REJECTED_MAX:
            return self.profile
        return replace(self.profile, rejection=found.rejection, explanation=found.explanation)

    def at(self, motion: Motion) -> Optional[Profile]:
        """
        Return the profile propagated to a later motion.

        The position uncertainty grows with the distance and time since the last observation.
        Faces that the centre has passed are left out where the terrain is observed.
        """
        profile = self.profile
        if profile is None or not profile.faces or not math.isfinite(motion.position):
            return profile
        age = max(0.0, motion.stamp - profile.stamp) if math.isfinite(profile.stamp) else 0.0
        travelled = abs(motion.position - self._position_at(profile.stamp))
        position_sd = POSITION_SD_PER_DISTANCE * travelled + POSITION_SD_RATE * age
        height_sd = HEIGHT_SD_RATE * age
        return replace(profile, faces=tuple(
            replace(face, position_sd=math.hypot(face.position_sd, position_sd),
                    height_sd=math.hypot(face.height_sd, height_sd))
            for face in profile.faces
            if not profile.points or face.position + face.run > motion.position))

    def _position_at(self, stamp: float) -> float:
        """Return the position interpolated at a time, or that at the nearest stamp [m]."""
        stamps, positions = self._stamps, self._positions
        after = bisect_left(stamps, stamp)
        if after == 0:
            return positions[0]
        if after == len(stamps):
            return positions[-1]
        early, late = stamps[after - 1], stamps[after]
        part = (stamp - early) / (late - early)
        return positions[after - 1] + part * (positions[after] - positions[after - 1])
