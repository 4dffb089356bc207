# SPDX-License-Identifier: Apache-2.0
"""What lies ahead, from a profile: the shape that rollouts move about, and where plans end."""
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
import math
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.decision.planning.beyond import SMALLEST_DROP
from ballbot_ros.decision.planning.rollout.layout import FACES
from ballbot_ros.decision.values import Face, Profile
from ballbot_ros.physics.model.terrain import Array

# Up by less than this is an uneven floor, as down by SMALLEST_DROP: any speed takes it [m].
SMALLEST_RISE = 0.0045
# Noise of less is no news [m].
NOISE = 0.003
# Faces that are farther apart than this are taken one by one [m].
TOGETHER = 1.0
# A bend of the ground between faces by less than this is none [m].
UNEVEN = 0.004
# Ground is drawn this far behind the ball, and this far behind the last that is known [m].
BEYOND = 4.0
# The ground is read so far from a face: its own points are no floor [m].
ASIDE = 1e-4
# Bends that are kept between two faces.
BENDS = 4


@dataclass(frozen=True)
class End:
    """
    Where a plan may end: behind a face.

    Attributes
    ----------
    faces : int
        How many it takes.
    vertex : int
        The last of its face in the shape.
    position : float
        Of that vertex [m].
    following : int
        The foot of the next face; the last vertex of all for none.

    """

    faces: int
    vertex: int
    position: float
    following: int = 0


@dataclass(frozen=True, eq=False)
class Ahead:
    """
    The ground ahead.

    Attributes
    ----------
    shape : (n, 5) array
        See `ground`.
    faces : tuple of Face
        At most `FACES`.
    ends : tuple of End
        From near to far; none if the first face is a drop that is not made up for.
    deviations : (2, FACES) array
        Standard deviations of height and place of each face [m].
    slope, slope_sd : float
        Below the ball, positive uphill [rad].
    touch : float
        Where the centre is when the ball touches the first face [m].
    room_to : float
        The centre may stand before this: as far as ground is known, or taken for granted [m].
    known : bool
        Whether it is known.

    """

    shape: Array
    faces: Tuple[Face, ...]
    ends: Tuple[End, ...]
    deviations: Array
    slope: float
    slope_sd: float
    touch: float
    room_to: float
    known: bool


def faces_ahead(profile: Profile, position: float, known: int = 0) -> Tuple[Face, ...]:
    """
    Return the faces whose end is ahead of a position, unevenness left out.

    The face with the number `known` was one before, and stays one for a little less.
    """
    found = []
    for face in profile.faces:
        less = NOISE if face.number == known else 0.0
        if face.position + face.run > position and not (
                less - SMALLEST_DROP <= face.height <= SMALLEST_RISE - less):
            found.append(face)
    return tuple(found[:FACES])


def look_ahead(profile: Profile, faces: Sequence[Face], position: float, slope: float,
               slope_sd: float, radius: float, unseen_room: float,
               climbed: float = 0.0) -> Ahead:
    """
    Return what lies ahead of a ball.

    Parameters
    ----------
    profile : Profile
        With finite numbers.
    faces : sequence of Face
        See `faces_ahead`; at least one.
    position : float
        Of the centre [m].
    slope, slope_sd : float
        Of the ground below the ball [rad].
    radius : float
        Of the ball [m].
    unseen_room : float
        Floor taken for granted behind an edge [m].
    climbed : float
        What the ball has climbed just before [m]: so much it may go down again.

    """
    floor = Floor(profile.points, slope)
    rows: List[Tuple[float, float, int, float, float]] = [
        (position - BEYOND, -BEYOND * math.tan(slope), -1, 0.0, 0.0)]
    here, level = position, 0.0
    ends: List[End] = []
    feet: List[int] = []
    last = -math.inf
    for index, face in enumerate(faces):
        foot = max(face.position, here)
        for x, rise in floor.bends(here, foot):
            rows.append((x, level + rise, index - 1, 1.0, 1.0))
        level += floor.rise(here, foot)
        feet.append(len(rows))
        rows.append((foot, level, index, 0.0, 1.0))
        level += face.height
        here = foot + max(face.run, 0.0)
        rows.append((here, level, index, 1.0, 1.0))
        climbed += face.height
        if index > 0 and foot - last > TOGETHER:
            continue
        last = here
        # Down again is fine as far as it went up before.
        if climbed >= -SMALLEST_DROP:
            ends.append(End(index + 1, len(rows) - 1, here))
    known = bool(profile.points) and profile.seen_to > here + radius
    seen_to = profile.seen_to if known else here + unseen_room
    for x, rise in floor.bends(here, seen_to):
        rows.append((x, level + rise, len(faces) - 1, 1.0, 1.0))
    level += floor.rise(here, seen_to)
    rows.append((seen_to + BEYOND, level + floor.rise(seen_to, seen_to + BEYOND),
                 len(faces) - 1, 1.0, 1.0))
    deviations = np.zeros((2, FACES))
    for index, face in enumerate(faces[:FACES]):
        deviations[:, index] = max(face.height_sd, 0.0), max(face.position_sd, 0.0)
    first = faces[0]
    return Ahead(
        np.array(rows), tuple(faces), tuple(
            replace(end, following=feet[end.faces] if end.faces < len(feet) else len(rows) - 1)
            for end in ends), deviations, slope, slope_sd,
        first.position - touch_distance_on(slope, radius, first.height),
        seen_to - radius if known else seen_to, known)


def touch_distance_on(slope: float, radius: float, height: float) -> float:
    """
    Return how far before a face the centre is when the ball touches it [m].

    The x of a centre that is a radius away from the slope and from the edge; see
    `rules.touch_distance` for a level floor.
    """
    steep, above = math.tan(slope), radius / math.cos(slope) - min(max(height, 0.0), radius)
    root = radius**2 * (1.0 + steep**2) - above**2
    return (steep * above + math.sqrt(max(root, 0.0))) / (1.0 + steep**2)


class Floor:
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
        """Keep them."""
        self._points, self._slope = points, math.tan(slope)
        self._places = [x for x, _ in points]

    def bends(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return where the ground bends between two places, and how much higher it is [m]."""
        inner = self._inner(begin, end)
        if len(inner) < 3:
            return []
        found = simplified(inner, UNEVEN)[1:-1]
        return [(x, z - inner[0][1]) for x, z in found] if len(found) <= BENDS else []

    def rise(self, begin: float, end: float) -> float:
        """Return how much higher the ground is at a second place, faces at both left out [m]."""
        inner = self._inner(begin, end)
        return inner[-1][1] - inner[0][1] if inner else 0.0

    def _inner(self, begin: float, end: float) -> List[Tuple[float, float]]:
        """Return the points from behind the first to before the second of two places."""
        if end - begin < 2.0 * ASIDE:
            return []
        begin, end = begin + ASIDE, end - ASIDE
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
            return self._points[-1][1]
        (left, low), (right, high) = self._points[after - 1], self._points[after]
        return low + (high - low) * (x - left) / max(right - left, 1e-9)


def simplified(points: Sequence[Tuple[float, float]], error: float) -> List[Tuple[float, float]]:
    """Return the points that a polyline needs to stay within an error (Douglas, Peucker)."""
    (x, z), (end_x, end_z) = points[0], points[-1]
    if len(points) < 3 or end_x - x < ASIDE:
        return [points[0], points[-1]]
    steep = (end_z - z) / (end_x - x)
    away = [abs(point[1] - z - steep * (point[0] - x)) for point in points[1:-1]]
    worst = max(range(len(away)), key=away.__getitem__) + 1
    if away[worst - 1] <= error:
        return [points[0], points[-1]]
    return [*simplified(points[:worst + 1], error)[:-1], *simplified(points[worst:], error)]
