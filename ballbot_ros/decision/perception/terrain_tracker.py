# SPDX-License-Identifier: Apache-2.0
"""Fuse polylines of the ground with odometry into a profile, or reject them."""
from collections import deque
from dataclasses import dataclass, replace
import math
from typing import Deque, List, Optional

import numpy as np

from ballbot_ros.decision.perception.edge_map import (
    EdgeEstimate, EdgeMap, Existence, Rejection)
from ballbot_ros.decision.perception.elevation import (
    CELL, ElevationMap, Flags, medians, middle, resample, SLOPE_MAX)
from ballbot_ros.decision.perception.ground import FACE_SIGMAS, ground_of
from ballbot_ros.decision.perception.ground_profile import (
    SLOPE_HYSTERESIS, SLOPE_LENGTH, steep_stretches)
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import POSITION_MAX, Profile, Reason, TerrainObservation
from ballbot_ros.physics.model.terrain import Array

# Maximum number of points, more than the pixels in a row of any camera.
POINTS_MAX = 5000
# A sensor with more than this range behind, and a smaller one ahead, is mounted backwards [m].
BACKWARD_RANGE_MIN = 0.6
# Up to this offset from the bottom of the ball, ground is the floor below the ball, and the offset
# is subtracted as a mounting error [m].
FLOOR_OFFSET_MAX = 0.03
# Largest height of a ball over an edge, or in the air, above previously observed ground [m].
LIFT_MAX = 0.3


def fault(x: Array, z: Array, z_sd: Array, observation: TerrainObservation, frame: str) -> str:
    """
    Return the reason why an observation is invalid, or an empty string.

    x, z and z_sd are the unchecked (n,) arrays of the observation [m], which must be in `frame`.
    """
    if observation.frame != frame:
        return f'it is in frame {observation.frame[:40]!r}, not in {frame!r}'
    if not len(x) == len(z) == len(z_sd):
        return f'{len(x)} x have {len(z)} z and {len(z_sd)} standard deviations'
    if not 2 <= len(x) <= POINTS_MAX:
        return f'it has {len(x)} points, but 2 to {POINTS_MAX} are allowed'
    others = np.array((observation.stamp, observation.x_min, observation.x_max))
    largest = [float(np.abs(numbers).max()) for numbers in (x, z, z_sd, others)]
    if not np.isfinite(largest).all():
        return 'it contains a value that is not finite'
    if max(largest[:3]) > POSITION_MAX or np.abs(others[1:]).max() > POSITION_MAX:
        return f'ground {max(largest[:3]):g} m away is out of range'
    if z_sd.min() < 0.0:
        return f'a standard deviation is negative ({z_sd.min():g} m)'
    steps = np.diff(x)
    if steps.min() < 0.0:
        where = int(np.argmin(steps >= 0.0))
        return f'x decreases from {x[where]:g} to {x[where + 1]:g} m at point {where + 1}'
    if not x[0] < x[-1]:
        return 'all its points have the same x'
    low, high = max(x[0], others[1]), min(x[-1], others[2])
    if not low < high:
        return (f'its range is x_min {others[1]:g} to x_max {others[2]:g} m, but its points are '
                f'from {x[0]:g} to {x[-1]:g} m')
    if high < -low and low < -BACKWARD_RANGE_MIN:
        return (f'it covers {-low:.2f} m behind the ball and {high:.2f} m ahead: is the sensor '
                'mounted backwards?')
    return ''


def misplaced(x: Array, z: Array, radius: float, known: bool) -> str:
    """
    Return the reason why the ground is not below the ball, or an empty string.

    x and z, (n,) arrays, are the ground near the ball, relative to its centre [m].  Above ground
    that is `known` from earlier observations the ball may be in the air.
    """
    nearest = int(np.argmin(np.abs(x)))
    if abs(x[nearest]) > radius:
        return ''  # no ground observed within reach
    below = float(z[nearest])
    if below > 0.0:
        return (f'the ground is {1e3 * below:.0f} mm above the centre of the ball: is the '
                'sensor upside down, or z not upwards?')
    clearance = float(np.hypot(x, z).min()) - radius
    highest = LIFT_MAX if known else FLOOR_OFFSET_MAX
    if x[0] > 0.0:
        highest += float(x[0])  # the touch position is not observed
    if not -FLOOR_OFFSET_MAX <= clearance <= highest:
        return (f'the ground is {1e3 * clearance:.0f} mm from the ball that rests on it, but '
                f'{-1e3 * FLOOR_OFFSET_MAX:.0f} to {1e3 * highest:.0f} mm are possible: is the '
                'mounting of the sensor consistent with its frame?')
    return ''


# Maximum slip of the odometry: a constant [m] plus a fraction of the distance rolled [1].
SLIP_MAX, SLIP_FRACTION = 0.3, 0.1
# A point is an outlier if it deviates from the median of its neighbourhood by more than this [m]
# and than these multiples of the median deviation of all points and of its neighbourhood, unless
# half of the last `OUTLIER_MEMORY` observations show it at the same position and height [m].
OUTLIER_HEIGHT, OUTLIER_SPREAD, OUTLIER_LOCAL_SPREAD = 0.003, 8.0, 3.0
OUTLIER_MEMORY, SAME_HEIGHT = 10, 0.015


@dataclass
class _Steep:
    """A stretch that is too steep to stand on."""

    begin: float
    slope: float
    exists: Existence


class TerrainTracker:
    """Fuses the polylines of a terrain sensor, in a `frame`, into an elevation and an edge map."""

    def __init__(self, radius: float, tuning: DecisionTuning, edges: EdgeMap, frame: str):
        self._radius, self._tuning, self._edges, self._frame = radius, tuning, edges, frame
        self._map = ElevationMap(tuning)
        self.steepest = math.inf  # slope on which the ball can be held [rad]
        self.reset()

    def reset(self) -> None:
        """Discard all estimates, after a jump in time or position."""
        self._map.clear()
        self._steep: List[_Steep] = []
        self.profile: Optional[Profile] = None
        self._strikes = 0
        self._slipped = self._rolled_to = self._position = 0.0
        self._seen_to = math.inf
        self._outliers: Deque[Array] = deque(maxlen=OUTLIER_MEMORY)

    def update(self, observation: TerrainObservation, position: float) -> Rejection:
        """
        Fuse one observation, made at a position of the ball's centre [m].

        Sensor data never raise an exception.
        """
        x, z = np.array(observation.x, dtype=float), np.array(observation.z, dtype=float)
        # Unknown deviations are 0.
        z_sd = np.array(observation.z_sd or (0.0,) * len(x), dtype=float)
        wrong = fault(x, z, z_sd, observation, self._frame)
        if not wrong and not abs(position) < POSITION_MAX:
            wrong = f'the odometry is at {position:g} m'
        if wrong:
            return Reason.BAD_OBSERVATION, wrong
        inside = (x >= observation.x_min - 1e-9) & (x <= observation.x_max + 1e-9)
        x, z, z_sd = x[inside], z[inside], z_sd[inside]
        scan = resample(x, z, z_sd, self._without_outliers(x, z, position), position) \
            if len(x) > 1 else None
        if scan is None:
            return Reason.BAD_OBSERVATION, 'it does not show the ground around the ball'
        seen, places = np.isfinite(scan.z), scan.places
        near = seen & (np.abs(places - position) <= 2.0 * self._radius)
        if near.any():
            wrong = misplaced(places[near] - position, scan.z[near], self._radius,
                              self._map.scans > 0)
            if wrong:
                return Reason.BAD_OBSERVATION, wrong
        contradiction = self._map.add(scan, position)
        if contradiction:
            slipped = self._map.slip(scan)
            rolled, self._rolled_to = abs(position - self._rolled_to), position
            self._slipped = max(0.0, self._slipped - SLIP_FRACTION * rolled) + CELL * abs(slipped)
            if self._slipped > SLIP_MAX:
                return Reason.CONTRADICTORY, (
                    f'the terrain moves along with the ball, by {self._slipped:.2f} m')
            if slipped:
                self._map.first += slipped
                self._edges.move(slipped * CELL)
                for stretch in self._steep:
                    stretch.begin += slipped * CELL
                contradiction = self._map.add(scan, position)
        if contradiction:
            self._strikes += 1
            if self._strikes < self._tuning.forget_after:
                return Reason.CONTRADICTORY, contradiction
            self._map.clear()
            self._map.add(scan, position)
        self._strikes = 0
        ground = ground_of(self._map, observation.stamp, position, self._radius,
                           [edge.ground.mean for edge in self._edges.edges
                            if edge.ground is not None and edge.exists.confirmed])
        if not ground.points:
            self.profile = ground
            return None, ''
        drift = self._detect(ground, position, float(places[seen][0]))
        if drift > SLIP_MAX:
            return Reason.CONTRADICTORY, f'an edge has moved along with the ball, by {drift:.2f} m'
        # Newly observed ground may have edges that only a second observation confirms.
        seen_to, self._seen_to = min(ground.seen_to, self._seen_to), ground.seen_to
        self.profile = self._with_steep(
            replace(ground, faces=self._edges.faces, seen_to=seen_to))
        return None, ''

    def _without_outliers(self, x: Array, z: Array, position: float) -> Flags:
        """Return which points to keep: all but outliers that earlier observations do not show."""
        slopes = np.diff(z) / np.maximum(np.diff(x), 1e-9)
        level = z - x * middle(np.clip(slopes, -SLOPE_MAX, SLOPE_MAX))  # most may lie on a wall
        # Hampel filter: on a face, the deviations of the neighbourhood are large.
        middles, spread = medians(level)
        off = level - middles
        # The median is weighted by the length of ground: a wall has many points.
        order = np.argsort(np.abs(off))
        length = np.cumsum(np.minimum(np.diff(x, prepend=x[0])[order], CELL))
        usual = abs(float(off[order[int(np.searchsorted(length, 0.5 * length[-1]))]]))
        least = max(OUTLIER_HEIGHT, OUTLIER_SPREAD * usual)
        lone: Flags = np.abs(off) > np.maximum(least, OUTLIER_LOCAL_SPREAD * spread)
        if not lone.any():
            return ~lone
        places, heights = x[lone, None] + position, off[lone, None]
        same = np.minimum(0.5 * np.abs(heights), SAME_HEIGHT)
        times = sum(((np.abs(places - seen[0]) < 1.5 * CELL) & (np.abs(heights - seen[1]) < same)
                     ).any(axis=1) for seen in self._outliers)
        self._outliers.append(np.stack((places[:, 0], heights[:, 0])))
        kept: Flags = ~lone
        kept[lone] = 2 * times >= OUTLIER_MEMORY
        return kept

    def _with_steep(self, profile: Profile) -> Profile:
        """Return a profile with the stretches that are too steep, tracked like faces."""
        found = steep_stretches(profile, SLOPE_HYSTERESIS * self.steepest)
        for known in self._steep:
            same = [one for one in found if abs(one[0] - known.begin) < SLOPE_LENGTH]
            if same:
                known.begin, known.slope = min(same)
                found = [one for one in found if one not in same]
            known.exists.add(bool(same))
        self._steep = [known for known in self._steep if known.exists.log_odds > 0.0
                       and profile.seen_from <= known.begin <= profile.seen_to]
        for begin, slope in found:
            if abs(slope) > self.steepest and all(
                    abs(begin - known.begin) >= SLOPE_LENGTH for known in self._steep):
                self._steep.append(_Steep(begin, slope, Existence(self._map.scans == 1)))
        self._steep.sort(key=lambda known: known.begin)
        return replace(profile, steep=tuple(
            (known.begin, known.slope) for known in self._steep if known.exists.confirmed))

    def _detect(self, ground: Profile, position: float, observed_from: float) -> float:
        """
        Update the edges from the map; return the largest drift of one with the ball [m].

        The ground before `observed_from` is from earlier scans, which are already counted.
        """
        forward, self._position = math.copysign(1.0, position - self._position), position
        bias = self._tuning.height_bias(self._map.reports_sd)
        known = self._edges.associate(ground.faces, self._edges.edges)
        missed = [edge for edge in self._edges.edges
                  if edge.ground is not None and edge not in known.values()]
        for index, face in enumerate(ground.faces):
            edge = known.get(index)
            if edge is None:
                # A single scan confirms only an edge whose height is far above its noise.
                edge = self._edges.start(self._map.scans == 1 and abs(face.height)
                                         > 2.0 * FACE_SIGMAS * face.height_sd)
            elif face.position >= observed_from:
                edge.exists.add(True)
            if edge.ground is None:
                edge.ground = EdgeEstimate(face, bias)
            else:
                edge.drift += forward * (face.position - edge.ground.mean.position)
                edge.ground.mean = face
            if face.position > position:
                edge.ground.trend.add(face.position - position, face.height)
        for edge in missed:
            edge.exists.add(False)
            # A miss of an edge behind the ball does not count.
            if edge.ground is not None and not \
                    ground.seen_from <= edge.ground.mean.position <= ground.seen_to:
                edge.ground = None
        self._edges.update()
        return max((edge.drift for edge in self._edges.edges), default=0.0)
