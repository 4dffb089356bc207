# SPDX-License-Identifier: Apache-2.0
"""
Routes on a floor, where crossing a step takes a run-up before it and room behind it.

Free floor is a grid, on which `scipy.sparse.csgraph` finds shortest ways.  A crossing is an edge
from where its run-up begins to where the ball stands behind it, perpendicular to the step.  A
route is a sequence of ways and crossings: of those whose probability is at least the required one,
that of least expected time.
"""
import heapq
import math
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import Knowledge
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.errors import RefusedError
from ballbot_ros.floors.floor import (
    distance_to_segment, Feature, Floor, FREE, inside, Point, UNKNOWN)
from ballbot_ros.navigation.capability import Capability, CrossingPlan

# Size of a cell of the search; maps with finer cells are sampled [m].
GRID = 0.1
# Clearance between the ball and walls, and between it and steps that it does not cross [m].
CLEARANCE = 0.05
# Distance between crossings of one feature along its line, and between samples along a run-up [m].
SPACING, SAMPLE = 0.2, 0.05
# Longest run-up, and longest room behind an edge, that are looked for [m].
LONGEST = 3.0
# Time to align with a crossing from rest, and to set out [s].
ALIGNMENT = 2.0


class Segment(NamedTuple):
    """
    A part of a route.

    Attributes
    ----------
    points : tuple of (float, float)
        Polyline of the centre [m]; of a crossing, its start and its end.
    feature : Feature or None
        What it crosses; None for free floor.
    crossing : CrossingPlan or None
    time : float
        [s]

    """

    points: Tuple[Point, ...]
    feature: Optional[Feature]
    crossing: Optional[CrossingPlan]
    time: float


class Route(NamedTuple):
    """
    A route.

    Attributes
    ----------
    segments : tuple of Segment
    time : float
        Expected [s].
    probability : float
        Product of the probabilities of its crossings.
    explanation : str
        Why it does not go the shortest way, and the run-up of each crossing.

    """

    segments: Tuple[Segment, ...]
    time: float
    probability: float
    explanation: str

    @property
    def points(self) -> Tuple[Point, ...]:
        """Return the polyline of the whole route [m]."""
        return tuple(point for segment in self.segments for point in segment.points)


class _Arc(NamedTuple):
    """A crossing at a place."""

    start: Point
    end: Point
    feature: Feature
    crossing: CrossingPlan


class _Limit(NamedTuple):
    """The best that the floor offers for crossing a feature in one direction [m]."""

    run_up: float
    room: float
    needed: Optional[float]


class RoutePlanner:
    """
    Plans routes on one floor for one robot.

    Parameters
    ----------
    floor : Floor
    knowledge : Knowledge
        Robot, curve and tuning of the obstacle decision.

    Attributes
    ----------
    floor : Floor
    ball_radius : float
        [m]
    drop_distance : float
        That the centre keeps from drops: a radius and the stopping distance at cruise speed [m].

    """

    def __init__(self, floor: Floor, knowledge: Knowledge):
        """Compute crossings and the ways between them."""
        self.floor, self._tuning = floor, knowledge.tuning
        self.ball_radius = knowledge.robot.ball_radius
        self.drop_distance = self.ball_radius + Braking(
            knowledge.robot, knowledge.tuning, knowledge.control).distance(
                knowledge.tuning.cruise_speed, 0.0)
        self._capability = Capability(knowledge)
        self._lay_grid()
        self._limits: Dict[Tuple[int, int], _Limit] = {}
        self._arcs = [arc for number, feature in enumerate(floor.features)
                      for arc in self._crossings(number, feature)]
        ends = sorted({self._node(arc.end) for arc in self._arcs})
        self._rows = {node: row for row, node in enumerate(ends)}
        self._far = csgraph.dijkstra(self._graph, directed=False, indices=ends) if ends \
            else np.zeros((0, self._blocked.size))

    def _lay_grid(self) -> None:
        """Mark the cells that the centre may reach without a crossing."""
        floor = self.floor
        left, right, bottom, top = floor.extent
        size = max(GRID, floor.resolution)
        self._size, self._origin = size, (left, bottom)
        rows, columns = (max(1, round(length / size)) for length in (top - bottom, right - left))
        self._x = left + (np.arange(columns)[None, :] + 0.5) * size
        self._y = bottom + (np.arange(rows)[:, None] + 0.5) * size
        clear: NDArray[np.float64] = ndimage.distance_transform_edt(np.pad(floor.cells == FREE, 1))
        clear = clear[1:-1, 1:-1] * floor.resolution
        at = (np.clip(((self._y - bottom) / floor.resolution).astype(int), 0, clear.shape[0] - 1),
              np.clip(((self._x - left) / floor.resolution).astype(int), 0, clear.shape[1] - 1))
        self._walls = clear[at] < self.ball_radius + CLEARANCE
        # Per feature: distance that the centre keeps [m], and cells that it must not enter.
        self._keep: List[float] = []
        self._near: List[NDArray[np.bool_]] = []
        for feature in floor.features:
            keep = CLEARANCE
            if feature.kind in ('drop', 'stairs'):
                keep = self.drop_distance
            elif feature.kind != 'keep_out':
                keep += max(touch_distance(self.ball_radius, feature.height), 0.5 * feature.width)
            near = np.zeros((rows, columns), bool)
            for begin, end in feature.segments:
                near |= distance_to_segment(self._x, self._y, begin, end) < keep
            if feature.kind in ('keep_out', 'stairs'):
                near |= inside(self._x, self._y, feature.polygon)
            self._keep.append(keep)
            self._near.append(near)
        self._blocked = np.logical_or.reduce([self._walls, *self._near])
        self._graph, self._open = _grid_graph(self._blocked, size), _grid_graph(
            np.logical_or.reduce([self._walls] + [
                near for near, feature in zip(self._near, floor.features)
                if feature.kind in ('drop', 'stairs', 'keep_out')]), size)

    def _node(self, point: Sequence[float]) -> int:
        rows, columns = self._walls.shape
        row = min(max(int((point[1] - self._origin[1]) / self._size), 0), rows - 1)
        column = min(max(int((point[0] - self._origin[0]) / self._size), 0), columns - 1)
        return int(row * columns + column)

    def _point(self, node: int) -> Point:
        row, column = divmod(node, self._blocked.shape[1])
        return float(self._x[0, column]), float(self._y[row, 0])

    def _crossings(self, number: int, feature: Feature) -> List[_Arc]:
        """Return the crossings of a feature, in both directions."""
        if feature.kind in ('drop', 'stairs', 'keep_out'):
            return []
        others = np.logical_or.reduce([self._walls] + [
            near for other, near in enumerate(self._near) if other != number])
        found = []
        for begin, end in feature.segments:
            length = math.dist(begin, end)
            along = ((end[0] - begin[0]) / length, (end[1] - begin[1]) / length) if length else (
                1.0, 0.0)
            left = (-along[1], along[0])
            # The other edges of the feature end run-up and room as other features do.
            elsewhere = self._near[number] & (distance_to_segment(
                self._x, self._y, begin, end) >= self._keep[number] + self._size)
            for index in range(max(1, math.floor(length / SPACING))):
                share = (index + 0.5) / max(1, math.floor(length / SPACING)) * length
                middle = (begin[0] + share * along[0], begin[1] + share * along[1])
                for sign in (1, -1):
                    found += self._crossings_at(number, feature, middle,
                                                (sign * left[0], sign * left[1]), sign,
                                                others | elsewhere)
        return found

    def _crossings_at(self, number: int, feature: Feature, middle: Point, way: Point, sign: int,
                      others: NDArray[np.bool_]) -> List[_Arc]:
        """Return the crossings at a place in a direction."""
        faces = self._faces(feature, middle, way, sign)
        half = 0.5 * faces[-1][0]
        touch = touch_distance(self.ball_radius, max(faces[0][1], 0.0)) + half
        run_up = self._free(middle, (-way[0], -way[1]), others) - touch
        room = self._free(middle, way, others) - half
        known = self._limits.get((number, sign))
        if known is None or run_up > known.run_up:
            easiest = self._capability.choices(faces, feature.height_sd, LONGEST, LONGEST)
            self._limits[number, sign] = _Limit(
                max(run_up, 0.0), max(room, 0.0), easiest[0].run_up if easiest else None)
        on = half + min(room, self.ball_radius + CLEARANCE + 0.2)
        stand = (middle[0] + on * way[0], middle[1] + on * way[1])
        arcs = []
        for crossing in self._capability.choices(faces, feature.height_sd, run_up, room):
            back = touch + crossing.run_up
            start = (middle[0] - back * way[0], middle[1] - back * way[1])
            if not self._blocked.flat[self._node(start)] \
                    and not self._blocked.flat[self._node(stand)]:
                arcs.append(_Arc(start, stand, feature, crossing))
        return arcs

    @staticmethod
    def _faces(feature: Feature, middle: Point, way: Point, sign: int
               ) -> Tuple[Tuple[float, float], ...]:
        """Return the faces that a ball meets that crosses a feature in a direction."""
        if feature.kind in ('threshold', 'cord'):
            return (0.0, feature.height), (feature.width, -feature.height)
        rises = sign > 0
        if feature.kind == 'carpet':
            beyond = (middle[0] + 0.01 * way[0], middle[1] + 0.01 * way[1])
            rises = bool(inside(*beyond, feature.polygon))
        return ((0.0, feature.height if rises else -feature.height),)

    def _free(self, middle: Point, way: Point, others: NDArray[np.bool_]) -> float:
        """Return how far the centre may go from a place in a direction [m]."""
        for index in range(1, round(LONGEST / SAMPLE) + 1):
            at = (middle[0] + index * SAMPLE * way[0], middle[1] + index * SAMPLE * way[1])
            if not self.floor.contains(at) or others.flat[self._node(at)]:
                return (index - 1) * SAMPLE
        return LONGEST

    def check_place(self, point: Sequence[float], what: str) -> None:
        """
        Check that the centre of the ball may be at a place.

        Raises
        ------
        RefusedError
            With the reason ``'off_map'``, ``'unknown'``, ``'wall'``, ``'feature'`` or
            ``'not_finite'``.

        """
        if not all(math.isfinite(item) for item in point):
            raise RefusedError(f'{what} {tuple(point)} is not finite', 'not_finite', what)
        where = f'{what} ({point[0]:g}, {point[1]:g}) m'
        if not self.floor.contains(point):
            raise RefusedError(
                f'{where} is off the map, which is x {self.floor.extent[0]:g} to '
                f'{self.floor.extent[1]:g} m, y {self.floor.extent[2]:g} to '
                f'{self.floor.extent[3]:g} m; are these metres?', 'off_map', what)
        if self.floor.cells[self.floor.cell_of(point)] == UNKNOWN:
            raise RefusedError(f'{where} is in unknown space', 'unknown', what)
        node = self._node(point)
        if self._walls.flat[node]:
            raise RefusedError(
                f'{where} is nearer than {self.ball_radius + CLEARANCE:.2f} m to a wall or to '
                'unknown space; the ball does not fit there', 'wall', what)
        for near, feature in zip(self._near, self.floor.features):
            if near.flat[node]:
                raise RefusedError(f'{where} is too close to the {feature.label}; choose a place '
                                   'farther from it', 'feature', what)

    def route(self, start: Sequence[float], goal: Sequence[float]) -> Route:
        """
        Return the route of least expected time.

        Parameters
        ----------
        start, goal : (float, float)
            [m]

        Raises
        ------
        RefusedError
            If start or goal is refused, see `check_place`, or, with the reason ``'no_route'``, if
            no route has the required probability; the message names the crossings on the shortest
            way, and what they lack.

        """
        self.check_place(start, 'start')
        self.check_place(goal, 'goal')
        first, last = self._node(start), self._node(goal)
        shortest, passed = self._shortest(first, last)
        found = self._search(first, last)
        if found is None:
            if not math.isfinite(shortest):
                raise RefusedError('no route: walls, drops or keep-out areas separate start and '
                                   'goal', 'no_route', 'goal')
            raise RefusedError(
                'no route reaches the required probability of '
                f'{self._tuning.required_probability:g}. On the shortest way, ' + '; '.join(
                    self._lack(number, sign) for number, sign in passed), 'no_route', 'goal')
        time, risk, arcs = found
        segments, at, node = [], tuple(map(float, start)), first
        for arc in arcs:
            segments.append(self._way(at, node, arc.start, self._node(arc.start)))
            segments.append(Segment((arc.start, arc.end), arc.feature, arc.crossing,
                                    arc.crossing.time + ALIGNMENT))
            at, node = arc.end, self._node(arc.end)
        segments.append(self._way(at, node, tuple(map(float, goal)), last))
        crossed = {id(arc.feature) for arc in arcs}
        why = [self._lack(number, sign) for number, sign in passed
               if id(self.floor.features[number]) not in crossed]
        why += [f'{self._described(arc.feature)} needs {arc.crossing.run_up:.2f} m of run-up, '
                f'from ({arc.start[0]:.2f}, {arc.start[1]:.2f}) m' for arc in arcs]
        longer = sum(segment.time for segment in segments if segment.feature is None) \
            - shortest / self._tuning.cruise_speed
        if why and longer > 1.0:
            why.insert(0, f'{longer:.0f} s longer than the shortest way')
        return Route(tuple(segments), sum(segment.time for segment in segments),
                     math.exp(-risk), '; '.join(why))

    def _shortest(self, first: int, last: int) -> Tuple[float, List[Tuple[int, int]]]:
        """Return the shortest way as if each step could be crossed, and what it crosses."""
        far, before = csgraph.dijkstra(
            self._open, directed=False, indices=first, return_predecessors=True)
        if not math.isfinite(far[last]):
            return math.inf, []
        points = [self._point(node) for node in _chain(before, last)]
        passed: List[Tuple[int, int]] = []
        for one, two in zip(points, points[1:]):
            for number, feature in enumerate(self.floor.features):
                for begin, end in feature.segments:
                    sign = _side(one, two, begin, end)
                    if sign and (number, sign) not in passed:
                        passed.append((number, sign))
        return float(far[last]), passed

    def _lack(self, number: int, sign: int) -> str:
        """Return why a feature is not crossed in a direction."""
        limit, label = self._limits.get((number, sign)), self._described(
            self.floor.features[number])
        if limit is None or limit.needed is None:
            return f'{label} cannot be crossed with the required probability'
        if limit.run_up < limit.needed:
            return (f'{label} needs {limit.needed:.2f} m of run-up, {limit.run_up:.2f} m are '
                    'available')
        return (f'{label} can be crossed with {limit.needed:.2f} m of run-up; '
                f'{limit.run_up:.2f} m before it and {limit.room:.2f} m behind it are free')

    @staticmethod
    def _described(feature: Feature) -> str:
        """Return the name of a feature with its height."""
        return f'the {feature.label} of {1e3 * feature.height:.0f} mm' if feature.name \
            else f'the {feature.label}'

    def _search(self, first: int, last: int) -> Optional[Tuple[float, float, List[_Arc]]]:
        """Return time, risk and crossings of the best route, None if there is none."""
        from_start, from_goal = csgraph.dijkstra(self._graph, directed=False,
                                                 indices=[first, last])
        speed, limit = self._tuning.cruise_speed, -math.log(self._tuning.required_probability)
        starts = [self._node(arc.start) for arc in self._arcs]
        # A label: time and risk at the end of the crossings so far; -1 is the start, -2 the goal.
        queue: List[Tuple[float, float, int, Tuple[int, ...]]] = [(0.0, 0.0, -1, ())]
        settled: Dict[int, List[float]] = {}
        while queue:
            time, risk, place, taken = heapq.heappop(queue)
            if place == -2:
                return time, risk, [self._arcs[index] for index in taken]
            if any(other <= risk + 1e-12 for other in settled.get(place, ())):
                continue
            settled.setdefault(place, []).append(risk)
            node = first if place == -1 else self._node(self._arcs[place].end)
            far = from_start if place == -1 else self._far[self._rows[node]]
            if math.isfinite(from_goal[node]):
                heapq.heappush(queue, (time + from_goal[node] / speed, risk, -2, taken))
            for index, arc in enumerate(self._arcs):
                more = risk - math.log(arc.crossing.probability)
                if more <= limit + 1e-12 and math.isfinite(far[starts[index]]) \
                        and index not in taken:
                    heapq.heappush(queue, (
                        time + far[starts[index]] / speed + arc.crossing.time + ALIGNMENT, more,
                        index, (*taken, index)))
        return None

    def _way(self, start: Sequence[float], first: int, end: Sequence[float],
             last: int) -> Segment:
        """Return a way over free floor, shortened where the ball can go straight."""
        far, before = csgraph.dijkstra(
            self._graph, directed=False, indices=first, return_predecessors=True,
            limit=10.0 * sum(self._blocked.shape) * self._size)
        points: List[Point] = [(start[0], start[1]),
                  *(self._point(node) for node in _chain(before, last))][:-1] + [(end[0], end[1])]
        kept, index = [points[0]], 0
        while index < len(points) - 1:
            farthest = index + 1
            for other in range(len(points) - 1, index + 1, -1):
                if self._is_free(points[index], points[other]):
                    farthest = other
                    break
            kept.append(points[farthest])
            index = farthest
        length = sum(math.dist(one, two) for one, two in zip(kept, kept[1:]))
        return Segment(tuple(kept), None, None, length / self._tuning.cruise_speed)

    def _is_free(self, one: Point, two: Point) -> bool:
        count = max(2, math.ceil(math.dist(one, two) / SAMPLE))
        return not any(self._blocked.flat[self._node(
            (one[0] + (two[0] - one[0]) * index / count,
             one[1] + (two[1] - one[1]) * index / count))] for index in range(1, count))


def _grid_graph(blocked: NDArray[np.bool_], size: float) -> 'sparse.csr_matrix':
    """Return the graph of free cells with their eight neighbours; weights are distances [m]."""
    numbers = np.arange(blocked.size).reshape(blocked.shape)
    begins, ends, weights = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = (slice(0, blocked.shape[0] - down),
               slice(max(0, -right), blocked.shape[1] - max(0, right)))
        two = (slice(down, blocked.shape[0]),
               slice(max(0, right), blocked.shape[1] + min(0, right)))
        free = ~(blocked[one] | blocked[two])
        begins.append(numbers[one][free])
        ends.append(numbers[two][free])
        weights.append(np.full(begins[-1].size, size * math.hypot(down, right)))
    return sparse.csr_matrix(
        (np.concatenate(weights), (np.concatenate(begins), np.concatenate(ends))),
        shape=(blocked.size, blocked.size))


def _chain(before: NDArray[np.int32], last: int) -> List[int]:
    """Return the nodes from the start of a search to a node."""
    nodes = [last]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return nodes[::-1]


def _side(one: Point, two: Point, begin: Point, end: Point) -> int:
    """Return 1 if a move crosses a segment to its left, -1 to its right, 0 if it does not."""
    def turn(a: Point, b: Point, c: Point) -> float:
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    before, after = turn(begin, end, one), turn(begin, end, two)
    if (before > 0.0) == (after > 0.0) or \
            (turn(one, two, begin) > 0.0) == (turn(one, two, end) > 0.0):
        return 0
    return 1 if after > 0.0 else -1
