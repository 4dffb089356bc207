# SPDX-License-Identifier: Apache-2.0
"""
The exact ground profile along a straight line over a floor, as a `Terrain`.

The height of the ground at a position is the sum of areas (carpets, levels, ramps, bars, stairs),
which depend on the position only, and of the steps and drops that were passed on the way there.
"""
from dataclasses import dataclass
import math
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.floors.floor import Feature, Floor, Heights, inside, LINES, Point
from ballbot_ros.physics.model.terrain import Array, Terrain

WALL_HEIGHT = 1.0  # [m]
# Depth of stairs and of drops whose height is not given [m].
UNKNOWN_DEPTH = 0.5
# Positions on a line that are closer together count as one [m].
LENGTH_TOLERANCE = 1e-9
# Length over which the ground descends from a crest to its exact height, see `cut` [m].
CREST_LENGTH = 0.1
# Signs of the corners of a rectangle, (4, 1, 2): a factor of the halves of several.
CORNERS = np.array([[(1, 1)], [(1, -1)], [(-1, 1)], [(-1, -1)]])
# Highest crest [m]: a face parallel to the path acts on the ball like a wall.
HIGHEST_CREST = 0.3


class Edge(NamedTuple):
    """A face of the ground on a line."""

    distance: float  # ahead, negative behind [m]
    height: float  # rise in the direction of the line, negative for a drop [m]
    angle: float  # of the line to the normal of the edge, positive if the normal is right of it


@dataclass(frozen=True)
class Cut:
    """The ground along a line."""

    vertices: Array  # (n, 2): distance ahead and height [m]
    friction: Array  # (n - 1,): surface friction of each segment, NaN for that of the robot
    edges: Tuple[Edge, ...]  # all faces except walls, sorted by distance
    walls: Tuple[float, float]  # distance of the walls behind and ahead, infinite for none [m]

    def terrain(self, offset: float = 0.0) -> Terrain:
        """Return the terrain, with x = `offset` at the position of the cut [m]."""
        return Terrain(self.vertices + (offset, 0.0), self.friction)


class _Part(NamedTuple):
    """Height added by a feature between two positions on the line."""

    begin: float
    end: float
    at_begin: float
    at_end: float


def cut(floor: Floor, place: Point, heading: float, level: float = 0.0, radius: float = 0.0,
        factor: Optional[Callable[[float], float]] = None) -> Cut:
    """
    Return the ground along a line from a position [m] in the direction of a heading [rad].

    `level` is the height of the ground at the position due to steps and drops [m], see `passed`.
    With the `radius` of a ball on the line [m], a wall is located where the ball first touches it.
    `factor` maps the angle to the normal of an edge [rad] to the fraction of the head-on height
    that a ball climbs at this angle.  With it, an edge that rises away from the position has a
    crest: climbing the crest head-on is equivalent to climbing the edge at its angle.  Behind the
    crest, the ground descends to the exact height.  Without `factor`, heights are exact.
    """
    along = (math.cos(heading), math.sin(heading))
    parts: List[_Part] = []
    edges: List[Edge] = []
    slips: List[Tuple[float, float, float]] = []
    for feature in floor.features:
        if feature.kind in ('step', 'drop'):
            for at, side, angle in crossings(feature.segments, place, along):
                rise = side * depth(feature)
                # Heights are relative to the position of the cut, in both directions.
                parts.append(_Part(at, math.inf, rise, rise) if at > 0.0
                             else _Part(-math.inf, at, -rise, -rise))
                edges.append(Edge(at, rise, angle))
        elif feature.kind == 'friction':
            slips += [(begin[0], end[0], float(feature.friction or 0.0)) for begin, end in
                      _intervals(feature.polygon, place, along)]
        elif feature.kind != 'keep_out':
            for begin, end in _areas(feature, place, along):
                low, high = (added_height(feature, place[0] + at * along[0],
                                          place[1] + at * along[1]) for at, _ in (begin, end))
                parts.append(_Part(begin[0], end[0], low, high))
                edges += [Edge(begin[0], low, begin[1]), Edge(end[0], -high, end[1])]
    edges = _faces(edges)
    if factor is not None:
        parts += _crests(edges, factor)
    breaks = {at for part in parts for at in part[:2]} | {at for slip in slips for at in slip[:2]}
    grid = _grid_lines(floor.heights, place, along) if floor.heights is not None else np.zeros(0)
    breaks.update(grid.tolist())
    ahead, behind = (sign * _wall(floor, place, (sign * along[0], sign * along[1]), radius)
                     for sign in (1.0, -1.0))
    inner = sorted([at for at in breaks
                    if behind + LENGTH_TOLERANCE < at < ahead - LENGTH_TOLERANCE]
                   + [at for at in (behind, ahead) if math.isfinite(at)])
    inner = [at for number, at in enumerate(inner)
             if not number or at - inner[number - 1] > LENGTH_TOLERANCE] or [0.0]
    xs = np.array([inner[0] - 1.0, *inner, inner[-1] + 1.0])
    middle = 0.5 * (xs[:-1] + xs[1:])
    left, right = (np.full(len(middle), level) for _ in range(2))
    friction = np.full(len(middle), np.nan)
    for part in parts:
        within = (part.begin < middle) & (middle < part.end)
        if part.at_begin == part.at_end:
            left[within] += part.at_begin
            right[within] += part.at_begin
        else:
            slope = (part.at_end - part.at_begin) / (part.end - part.begin)
            left[within] += part.at_begin + slope * (xs[:-1][within] - part.begin)
            right[within] += part.at_begin + slope * (xs[1:][within] - part.begin)
    if floor.heights is not None and len(grid):
        uneven = floor.heights.at(place[0] + grid * along[0], place[1] + grid * along[1])
        left += np.interp(xs[:-1], grid, uneven)
        right += np.interp(xs[1:], grid, uneven)
    for slip in slips:
        friction[(slip[0] < middle) & (middle < slip[1])] = slip[2]
    if math.isfinite(behind):
        left[0] = right[0] = left[1] + WALL_HEIGHT
    if math.isfinite(ahead):
        left[-1] = right[-1] = right[-2] + WALL_HEIGHT
    return Cut(*_joined(xs, left, right, friction), tuple(edges), (behind, ahead))


def crossings(segments: Sequence[Tuple[Point, Point]], place: Point, along: Point
              ) -> List[Tuple[float, int, float]]:
    """
    Return the crossings of a line with segments.

    The line starts at `place` [m], with the unit vector `along`.  A crossing consists of its
    distance ahead [m]; 1 if the line leads to the left of the segment, -1 if to the right; and
    the angle from the normal of the segment to the line [rad].
    """
    found = []
    for begin, end in segments:
        length = math.dist(begin, end)
        if not length:
            continue
        # Unit normal to the left of the segment.
        normal = (-(end[1] - begin[1]) / length, (end[0] - begin[0]) / length)
        towards = normal[0] * along[0] + normal[1] * along[1]
        sides = [along[0] * (point[1] - place[1]) - along[1] * (point[0] - place[0])
                 for point in (begin, end)]
        # A point on the line counts as left of it, so a vertex of a polyline is crossed once.
        if towards == 0.0 or (sides[0] >= 0.0) == (sides[1] >= 0.0):
            continue
        at = (normal[0] * (begin[0] - place[0]) + normal[1] * (begin[1] - place[1])) / towards
        side = 1 if towards > 0.0 else -1
        across = side * (normal[0] * along[1] - normal[1] * along[0])
        found.append((at, side, math.atan2(across, abs(towards))))
    return found


def crossings_between(segments: Sequence[Tuple[Point, Point]], begin: Point, end: Point
                      ) -> List[Tuple[float, int, float]]:
    """Return the crossings of the line from one position to another; see `crossings`."""
    length = math.dist(begin, end)
    if not length:
        return []
    along = ((end[0] - begin[0]) / length, (end[1] - begin[1]) / length)
    return [found for found in crossings(segments, begin, along) if 0.0 < found[0] <= length]


def crossed(floor: Floor, begin: Point, end: Point, kinds: Sequence[str] = LINES
            ) -> List[Tuple[Feature, int]]:
    """Return the features crossed between two positions, and 1 if to the left, else -1."""
    found = [(at, feature, side) for feature in floor.features if feature.kind in kinds
             for at, side, _ in crossings_between(feature.segments, begin, end)]
    return [(feature, side) for _, feature, side in sorted(found, key=lambda one: one[0])]


def passed(floor: Floor, begin: Point, end: Point) -> float:
    """Return the rise of the ground due to steps and drops between two positions [m]."""
    return sum(side * depth(feature)
               for feature, side in crossed(floor, begin, end, ('step', 'drop')))


def area_height(floor: Floor, place: Point) -> float:
    """Return the height of the ground at a position due to areas and the height map [m]."""
    uneven = float(floor.heights.at(*place)) if floor.heights is not None else 0.0
    return uneven + sum(
        added_height(feature, *place) for feature in floor.features
        if feature.kind not in ('step', 'drop', 'friction', 'keep_out')
        and any(inside(*place, polygon) for polygon in polygons(feature)))


def ranges(floor: Floor, place: Point, headings: Sequence[float], limit: float) -> Array:
    """Return the distance to the first wall in each direction, inf beyond `limit` [m]."""
    angles, walls = np.asarray(headings, float)[:, None], floor.walls
    found: Array = np.maximum(0.0, _touched(
        walls[:, :2] - place, walls[:, 2:], (np.cos(angles), np.sin(angles))
    ).min(axis=1, initial=np.inf))
    found[found > limit] = np.inf
    return found


def depth(feature: Feature) -> float:
    """Return the height of a feature, `UNKNOWN_DEPTH` if that of a drop or stairs is 0 [m]."""
    unknown = feature.kind in ('drop', 'stairs') and feature.height == 0.0
    return UNKNOWN_DEPTH if unknown else feature.height


def added_height(feature: Feature, x: float, y: float) -> float:
    """Return the height that an area adds to the ground at a position within it [m]."""
    if feature.kind == 'stairs':
        return -depth(feature)
    if feature.kind != 'ramp':
        return feature.height
    foot, top = feature.line[0], feature.line[-1]
    way = (top[0] - foot[0], top[1] - foot[1])
    return float(feature.height * ((x - foot[0]) * way[0] + (y - foot[1]) * way[1])
                 / (way[0]**2 + way[1]**2))


def polygons(feature: Feature) -> List[Tuple[Point, ...]]:
    """Return the areas of a feature; for a threshold or cord, one rectangle for each segment."""
    if feature.kind in ('step', 'drop'):
        return []
    if feature.polygon:
        return [feature.polygon]
    found: List[Tuple[Point, ...]] = []
    for (x0, y0), (x1, y1) in feature.segments:
        length = math.hypot(x1 - x0, y1 - y0) or 1.0
        right = (0.5 * feature.width * (y1 - y0) / length,
                 -0.5 * feature.width * (x1 - x0) / length)
        found.append(((x0 + right[0], y0 + right[1]), (x1 + right[0], y1 + right[1]),
                      (x1 - right[0], y1 - right[1]), (x0 - right[0], y0 - right[1])))
    return found


def _areas(feature: Feature, place: Point, along: Point
           ) -> List[Tuple[Tuple[float, float], Tuple[float, float]]]:
    """Return the intervals of the line on a feature; overlapping ones are merged."""
    found = sorted(interval for polygon in polygons(feature)
                   for interval in _intervals(polygon, place, along))
    merged = found[:1]
    for begin, end in found[1:]:
        if begin[0] <= merged[-1][1][0]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], end))
        else:
            merged.append((begin, end))
    return merged


def _intervals(polygon: Sequence[Point], place: Point, along: Point
               ) -> List[Tuple[Tuple[float, float], Tuple[float, float]]]:
    """Return the intervals of a line in a polygon: distance and angle at both ends."""
    ends = sorted((at, angle) for at, _, angle in crossings(
        tuple(zip(polygon, (*polygon[1:], polygon[0]))), place, along))
    return [(begin, end) for begin, end in zip(ends[::2], ends[1::2])
            if end[0] - begin[0] > LENGTH_TOLERANCE]


def _faces(edges: Sequence[Edge]) -> List[Edge]:
    """Return the edges sorted by distance; merge edges at one position, omit those of height 0."""
    found: List[Edge] = []
    for edge in sorted(edges):
        if found and edge.distance - found[-1].distance <= LENGTH_TOLERANCE:
            last = found.pop()
            edge = last._replace(height=last.height + edge.height)
        found.append(edge)
    return [edge for edge in found if abs(edge.height) > LENGTH_TOLERANCE]


def _crests(edges: Sequence[Edge], factor: Callable[[float], float]) -> List[_Part]:
    """Return the crests of the edges that rise away from the position of the cut."""
    found = []
    for number, edge in enumerate(edges):
        if edge.distance * edge.height <= 0.0:
            continue
        share = factor(edge.angle)
        extra = abs(edge.height) * (1.0 / share - 1.0) if share > 0.0 else HIGHEST_CREST
        extra = min(extra, max(0.0, HIGHEST_CREST - abs(edge.height)))
        if extra <= LENGTH_TOLERANCE:
            continue
        rises = edge.height > 0.0
        next_ = number + (1 if rises else -1)
        room = abs(edges[next_].distance - edge.distance) \
            if 0 <= next_ < len(edges) else math.inf
        length, left = min(CREST_LENGTH, room), extra * max(0.0, 1.0 - room / CREST_LENGTH)
        found.append(_Part(edge.distance, edge.distance + length, extra, left) if rises
                     else _Part(edge.distance - length, edge.distance, left, extra))
    return found


def _grid_lines(heights: Heights, place: Point, along: Point) -> Array:
    """Return where a line crosses the rows and columns of the height grid [m]."""
    found = []
    for axis in (0, 1):
        if abs(along[axis]) < LENGTH_TOLERANCE:
            continue
        count = heights.values.shape[1 - axis]
        centres = heights.origin[axis] + (np.arange(count) + 0.5) * heights.resolution
        at = (centres - place[axis]) / along[axis]
        other = place[1 - axis] + at * along[1 - axis]
        low = heights.origin[1 - axis]
        size = heights.values.shape[axis] * heights.resolution
        found.append(at[(low <= other) & (other <= low + size)])
    places: Array = np.unique(np.concatenate(found))
    return places


def _wall(floor: Floor, place: Point, along: Point, radius: float) -> float:
    """Return the distance to the face of the first wall for a ball on a line [m]."""
    centres, halves = floor.walls[:, :2] - place, floor.walls[:, 2:]
    # A wall that the ball touches does not stop it, unless the ball moves towards the wall.
    away = centres - np.clip(centres, -halves, halves)
    near = away[:, 0] * along[0] + away[:, 1] * along[1] > 0.0
    if not near.any():
        return math.inf
    centres, halves, away = centres[near], halves[near], away[near]
    if not radius:
        return float(np.maximum(_touched(centres, halves, along), 0.0).min())
    sides = _touched(centres, halves + np.array([[(radius, 0.0)], [(0.0, radius)]]), along)
    corners = centres + halves * CORNERS
    ahead = corners[..., 0] * along[0] + corners[..., 1] * along[1]
    across = corners[..., 0] * along[1] - corners[..., 1] * along[0]
    chord = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    rounded = np.where((np.abs(across) <= radius) & (ahead + chord >= 0.0), ahead - chord, np.inf)
    # If a ball rolls along a wall and turns towards it, the touch is far behind: its distance
    # is limited to the component of the penetration along the line.
    nearest = np.maximum(np.hypot(*away.T), LENGTH_TOLERANCE)
    share = np.clip(away @ along / nearest, 0.0, 1.0)
    entries = np.concatenate([sides, rounded])
    return float(np.min(np.maximum(entries, -np.maximum(radius - nearest, 0.0) * share))) + radius


def _touched(centres: Array, halves: Array, along: Tuple[Any, Any]) -> Array:
    """
    Return the distance at which a point from the origin touches each rectangle, inf for none [m].

    It is negative for a rectangle around the origin.  The last axis of centres and halves is x and
    y; directions may be columns.
    """
    low, far = np.full(1, -np.inf), np.full(1, np.inf)
    for axis in (0, 1):
        parallel = np.abs(along[axis]) < LENGTH_TOLERANCE
        rate = np.where(parallel, 1.0, along[axis])
        one, two = ((centres[..., axis] + side * halves[..., axis]) / rate for side in (-1.0, 1.0))
        between = np.abs(centres[..., axis]) <= halves[..., axis]
        low = np.maximum(low, np.where(parallel, -np.inf, np.minimum(one, two)))
        far = np.minimum(far, np.where(parallel, np.where(between, np.inf, -np.inf),
                                       np.maximum(one, two)))
    return np.where((low <= far) & (far >= 0.0), low, np.inf)


def _joined(xs: Array, left: Array, right: Array, friction: Array) -> Tuple[Array, Array]:
    """Return the vertices and the friction of the segments, without redundant vertices."""
    points = [(float(xs[0]), float(left[0]))]
    slips: List[float] = []
    for number in range(len(left)):
        begin = (float(xs[number]), float(left[number]))
        if begin != points[-1]:
            points.append(begin)
            slips.append(float(friction[number]))
        elif len(points) > 1 and begin[1] == points[-2][1] == right[number] \
                and points[-2][0] < begin[0] \
                and np.array_equal(slips[-1], friction[number], equal_nan=True):
            points.pop()  # both segments are level
            slips.pop()
        points.append((float(xs[number + 1]), float(right[number])))
        slips.append(float(friction[number]))
    return np.array(points), np.array(slips)
