# SPDX-License-Identifier: Apache-2.0
"""The ground between faces, from the polyline of a profile."""
from bisect import bisect_left, bisect_right
import math
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.decision.values import Profile
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import Array

# Minimum deviation of a bend of the ground between faces [m].
BEND_HEIGHT_MIN = 0.004
# Distance from a face at which the ground is evaluated [m]: the points of the face are not floor.
FACE_CLEARANCE = 1e-4
# Maximum number of bends between two faces; more are all ignored.
BENDS_MAX = 4
# Minimum length of the last segment of the polyline for a slope [m].
END_LENGTH_MIN = 0.1


@compiled
def simplify(x: Array, z: Array, tolerance: Array, keep: Array, stack: Array) -> None:
    """
    Mark the points that keep a polyline within its tolerance.

    The Douglas-Peucker algorithm, with a tolerance at each point.

    Parameters
    ----------
    x, z, tolerance : (n,) arrays
        Coordinates, x ascending, and tolerances of z [m].
    keep : (n,) array
        Set to 1 where a point is kept, to 0 elsewhere.
    stack : (n, 2) array
        Work array.

    """
    last = len(x) - 1
    for index in range(len(x)):
        keep[index] = 0.0
    keep[0] = keep[last] = 1.0
    depth = 1
    stack[0, 0], stack[0, 1] = 0.0, last
    while depth > 0:
        depth -= 1
        begin, end = int(stack[depth, 0]), int(stack[depth, 1])
        grade = (z[end] - z[begin]) / max(x[end] - x[begin], 1e-9)
        worst, where = 1.0, -1
        for index in range(begin + 1, end):
            off = abs(z[index] - z[begin] - grade * (x[index] - x[begin])) / tolerance[index]
            if off > worst:
                worst, where = off, index
        if where >= 0:
            keep[where] = 1.0
            stack[depth, 0], stack[depth, 1] = begin, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, end
            depth += 2


class GroundProfile:
    """
    The ground between faces.

    Parameters
    ----------
    points : sequence of (float, float)
        Polyline of the ground, faces included; may be empty.
    slope : float
        Slope of the ground without points, or before the first one [rad].

    """

    def __init__(self, points: Sequence[Tuple[float, float]], slope: float):
        self._points, self._slope = points, math.tan(slope)
        self._positions = [x for x, _ in points]
        self._end_slope = self._slope
        if len(points) > 1 and points[-1][0] - points[-2][0] > END_LENGTH_MIN:
            self._end_slope = (points[-1][1] - points[-2][1]) / (points[-1][0] - points[-2][0])

    def bends(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return the positions of bends between two positions, and their height changes [m]."""
        inner = self._inner(begin, end)
        if len(inner) < 3:
            return []
        x, z = np.array(inner).T
        keep = np.zeros(len(x))
        simplify(x, z, np.full(len(x), BEND_HEIGHT_MIN), keep, np.zeros((len(x), 2)))
        bends = np.flatnonzero(keep)[1:-1]
        return list(zip(x[bends].tolist(), (z[bends] - z[0]).tolist())) \
            if len(bends) <= BENDS_MAX else []

    def rise(self, begin: float, end: float) -> float:
        """Return the rise of the ground between two positions, without faces at them [m]."""
        inner = self._inner(begin, end)
        return inner[-1][1] - inner[0][1] if inner else 0.0

    def _inner(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return the ground just inside two positions, and the points in between."""
        if end - begin < 2.0 * FACE_CLEARANCE:
            return []
        begin, end = begin + FACE_CLEARANCE, end - FACE_CLEARANCE
        inner = self._points[
            bisect_right(self._positions, begin):bisect_left(self._positions, end)]
        return [(begin, self._height(begin)), *inner, (end, self._height(end))]

    def _height(self, x: float) -> float:
        """Return the height of the ground at a position without a face [m]."""
        if not self._points:
            return self._slope * x
        after = bisect_right(self._positions, x)
        if after == 0:
            return self._points[0][1] + self._slope * (x - self._positions[0])
        if after == len(self._points):
            return self._points[-1][1] + self._end_slope * (x - self._positions[-1])
        (left, low), (right, high) = self._points[after - 1], self._points[after]
        return low + (high - low) * (x - left) / max(right - left, 1e-9)


# Slopes are measured over this length, or down to the minimum where a face ends a stretch [m].
SLOPE_LENGTH, SLOPE_LENGTH_MIN = 0.2, 0.08
# A steeper segment is a face, not a slope [rad].
FACE_SLOPE = 0.35
# A stretch remains too steep until its slope is below this fraction of the limit.
SLOPE_HYSTERESIS = 0.9


def steep_stretches(profile: Profile, steepest: float) -> List[Tuple[float, float]]:
    """
    Return the positions of stretches that are too steep to hold, and their slopes [m], [rad].

    `steepest` is the steepest slope that can be held [rad].
    """
    points, found = profile.points, []
    floor, margin = GroundProfile(points, 0.0), 2e-3
    for (x, _), sd in zip(points, profile.points_sd or (0.0,) * len(points)):
        begin = x + margin
        if any(face.position - margin < begin < face.position + face.run
               for face in profile.faces):
            continue
        end = min([begin + SLOPE_LENGTH, points[-1][0]] + [
            face.position - margin for face in profile.faces if face.position > begin])
        if end - begin < SLOPE_LENGTH_MIN:
            continue
        angle = math.atan(floor.rise(begin, end) / (end - begin))
        if steepest + 2.0 * sd / (end - begin) < abs(angle) < FACE_SLOPE:
            found.append((x, angle))
    return found
