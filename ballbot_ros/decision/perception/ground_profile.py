# SPDX-License-Identifier: Apache-2.0
"""The ground between faces, from the polyline of a profile."""
from bisect import bisect_left, bisect_right
import math
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.decision.perception.kernels import simplify
from ballbot_ros.decision.values import Profile

# Least deviation of a bend of the ground between faces [m].
BEND_HEIGHT_MIN = 0.004
# Distance from a face at which the ground is read [m]: its own points are not floor.
FACE_CLEARANCE = 1e-4
# Bends that are kept between two faces.
BENDS_MAX = 4
# Least length of the end of the polyline for a slope [m].
END_LENGTH_MIN = 0.1


class GroundProfile:
    """
    The ground between faces.

    Parameters
    ----------
    points : sequence of (float, float)
        Polyline of the ground, faces included; may be empty.
    slope : float
        Of the ground where there are no points [rad].

    """

    def __init__(self, points: Sequence[Tuple[float, float]], slope: float):
        """Store them."""
        self._points, self._slope = points, math.tan(slope)
        self._places = [x for x, _ in points]
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
        count = simplify(x, z, np.full(len(x), BEND_HEIGHT_MIN), keep, np.zeros((len(x), 2)))
        bends = np.flatnonzero(keep)[1:-1]
        return list(zip(x[bends].tolist(), (z[bends] - z[0]).tolist())) \
            if count <= BENDS_MAX + 2 else []

    def rise(self, begin: float, end: float) -> float:
        """Return how much higher the ground is at a second place, faces at both left out [m]."""
        inner = self._inner(begin, end)
        return inner[-1][1] - inner[0][1] if inner else 0.0

    def _inner(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return the points from behind the first to before the second of two places."""
        if end - begin < 2.0 * FACE_CLEARANCE:
            return []
        begin, end = begin + FACE_CLEARANCE, end - FACE_CLEARANCE
        inner = self._points[bisect_right(self._places, begin):bisect_left(self._places, end)]
        return [(begin, self._height(begin)), *inner, (end, self._height(end))]

    def _height(self, x: float) -> float:
        """Return the height of the ground at a place without a face [m]."""
        if not self._points:
            return self._slope * x
        after = bisect_right(self._places, x)
        if after == 0:
            return self._points[0][1] + self._slope * (x - self._places[0])
        if after == len(self._points):
            return self._points[-1][1] + self._end_slope * (x - self._places[-1])
        (left, low), (right, high) = self._points[after - 1], self._points[after]
        return low + (high - low) * (x - left) / max(right - left, 1e-9)


# Slopes are those over such a length, or down to the shortest where a face ends the stretch [m].
SLOPE_LENGTH, SLOPE_LENGTH_MIN = 0.2, 0.08
# A steeper segment is a face, not a slope [rad].
FACE_SLOPE = 0.35
# A stretch that is too steep remains so until its slope is less by this part.
SLOPE_HYSTERESIS = 0.9


def steep_stretches(profile: Profile, steepest: float) -> List[Tuple[float, float]]:
    """
    Return the positions of stretches that are too steep to hold, and their slopes [m], [rad].

    A slope of `steepest` can be held [rad].
    """
    points, found = profile.points, []
    floor, aside = GroundProfile(points, 0.0), 2e-3
    for (x, _), sd in zip(points, profile.points_sd or (0.0,) * len(points)):
        begin = x + aside
        if any(face.position - aside < begin < face.position + face.run
               for face in profile.faces):
            continue
        end = min([begin + SLOPE_LENGTH, points[-1][0]] + [
            face.position - aside for face in profile.faces if face.position > begin])
        if end - begin < SLOPE_LENGTH_MIN:
            continue
        angle = math.atan(floor.rise(begin, end) / (end - begin))
        if steepest + 2.0 * sd / (end - begin) < abs(angle) < FACE_SLOPE:
            found.append((x, angle))
    return found
