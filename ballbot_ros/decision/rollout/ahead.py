# SPDX-License-Identifier: Apache-2.0
"""What lies ahead, from a profile: the shape that rollouts move about, and where plans end."""
from dataclasses import dataclass
import math
from typing import List, Sequence, Tuple

import numpy as np

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.profile import Face, Profile
from ballbot_ros.decision.rollout.layout import FACES
from ballbot_ros.physics.model.terrain import Array

# Down by less than this is an uneven floor, more is a drop [m].
SMALLEST_DROP = 0.005
# Faces that are farther apart than this are taken one by one [m].
TOGETHER = 1.0
# A bend of the ground between faces by less than this is none [m].
UNEVEN = 0.004
# Ground is drawn this far behind the ball, and this far behind the last that is known [m].
BEYOND = 4.0
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

    """

    faces: int
    vertex: int
    position: float


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
        Ground is known, or taken for granted, until there [m].

    """

    shape: Array
    faces: Tuple[Face, ...]
    ends: Tuple[End, ...]
    deviations: Array
    slope: float
    slope_sd: float
    touch: float
    room_to: float


def faces_ahead(profile: Profile, position: float) -> Tuple[Face, ...]:
    """Return the faces whose end is ahead of a position, unevenness left out."""
    return tuple(face for face in profile.faces
                 if face.position + face.run > position
                 and not -SMALLEST_DROP <= face.height <= 0.0)[:FACES]


def look_ahead(profile: Profile, faces: Sequence[Face], position: float, slope: float,
               slope_sd: float, radius: float, unseen_room: float) -> Ahead:
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

    """
    rows: List[Tuple[float, float, int, float, float]] = [
        (position - BEYOND, -BEYOND * math.tan(slope), -1, 0.0, 0.0)]
    here, level, ends = position, 0.0, []
    climbed, last = 0.0, -math.inf
    for index, face in enumerate(faces):
        for x, z in _between(profile, here, face.position, slope):
            rows.append((x, level + z, index - 1, 1.0, 1.0))
        level = rows[-1][1] if len(rows) > 1 else 0.0
        # The foot, after the ground that leads to it.
        foot = max(face.position, here)
        level += _rise(profile, rows[-1][0] if len(rows) > 1 else here, foot, slope)
        rows.append((foot, level, index, 0.0, 1.0))
        level += face.height
        here = foot + max(face.run, 0.0)
        rows.append((here, level, index, 1.0, 1.0))
        climbed += face.height
        if index > 0 and foot - last > TOGETHER:
            break
        last = here
        # Down again is fine as far as it went up before.
        if climbed >= -SMALLEST_DROP:
            ends.append(End(index + 1, len(rows) - 1, here))
    seen_to = max(profile.seen_to if profile.points else here, here + unseen_room)
    far = max(seen_to, here) + BEYOND
    rest = list(_between(profile, here, max(seen_to, here), slope))
    for x, z in rest:
        rows.append((x, level + z, len(faces) - 1, 1.0, 1.0))
    level = rows[-1][1]
    rows.append((far, level + _last_slope(profile, rows[-1][0], slope) * (far - rows[-1][0]),
                 len(faces) - 1, 1.0, 1.0))
    deviations = np.zeros((2, FACES))
    for index, face in enumerate(faces[:FACES]):
        deviations[:, index] = max(face.height_sd, 0.0), max(face.position_sd, 0.0)
    first = faces[0]
    return Ahead(
        np.array(rows), tuple(faces), tuple(ends), deviations, slope, slope_sd,
        first.position - touch_distance(radius, first.height), max(seen_to, here))


def _rise(profile: Profile, begin: float, end: float, slope: float) -> float:
    """Return by how much the ground rises between two positions without a face between [m]."""
    if end <= begin:
        return 0.0
    seen = _seen(profile, begin, end)
    if len(seen) < 2:
        return math.tan(slope) * (end - begin)
    (x, z), (later_x, later_z) = seen[0], seen[-1]
    return (later_z - z) / (later_x - x) * (end - begin) if later_x - x > 1e-3 else 0.0


def _last_slope(profile: Profile, begin: float, slope: float) -> float:
    """Return the rise over run of the ground behind the last that is known."""
    return 0.0 if profile.points else math.tan(slope)


def _seen(profile: Profile, begin: float, end: float) -> List[Tuple[float, float]]:
    """Return the points of the profile strictly between two positions."""
    return [point for point in profile.points if begin + 1e-6 < point[0] < end - 1e-6]


def _between(profile: Profile, begin: float, end: float,
             slope: float) -> List[Tuple[float, float]]:
    """Return where the ground bends between two positions, above that at the first [m]."""
    seen = _seen(profile, begin, end)
    if len(seen) < 3:
        return []
    bends = _simplified(seen, UNEVEN)[1:-1]
    if len(bends) > BENDS:
        return []
    return [(x, z - seen[0][1]) for x, z in bends]


def _simplified(points: Sequence[Tuple[float, float]],
                error: float) -> List[Tuple[float, float]]:
    """Return the points that a polyline needs to stay within an error (Douglas, Peucker)."""
    (x, z), (end_x, end_z) = points[0], points[-1]
    run = max(end_x - x, 1e-9)
    away = [abs(point[1] - z - (end_z - z) * (point[0] - x) / run) for point in points]
    worst = max(range(len(points)), key=away.__getitem__)
    if away[worst] <= error or len(points) < 3:
        return [points[0], points[-1]]
    return [*_simplified(points[:worst + 1], error)[:-1], *_simplified(points[worst:], error)]
