# SPDX-License-Identifier: Apache-2.0
"""
Routes on a floor, for a ball that turns only while it rolls and crosses steps with a run-up.

The search is A* on a lattice of poses (`lattice`): its primitives have a curvature that the ball
can drive, forward or backward.  A crossing is an edge of the same graph, from the pose at rest
where its run-up starts to the pose behind the step.  Cost is expected time; the product of the
crossings' probabilities has a lower bound.  The heuristic is the time of a point that turns
in place (Dijkstra's algorithm).
"""
from dataclasses import replace
from itertools import groupby
import math
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import check_decision, Knowledge
from ballbot_ros.decision.planning.ahead import SIGMAS
from ballbot_ros.errors import RefusedError
from ballbot_ros.floors.floor import (
    AREAS, distance_to_segment, Feature, Floor, FREE, Heights, inside, LINES, Point, signed_area,
    UNKNOWN)
from ballbot_ros.floors.profile import area_height, crossings, crossings_between, passed
from ballbot_ros.navigation.capability import (
    Capability, CrossingPlan, ROOM_MAX, RUN_UPS)
from ballbot_ros.navigation.lattice import (
    CELL_SHARE, COUNT, free_steps, HEADINGS, LENGTHS, LEVELS, Moves, primitives, Problem, Tree,
    turning_times, VECTORS)
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.navigation.sensing import FACE_HEIGHT_MIN
from ballbot_ros.navigation.tracking import steered
from ballbot_ros.steering import curvature_limit, height_factor
from ballbot_ros.steering.model import required_steering

# Clearance between the ball and walls, and between it and steps that it does not cross [m].
CLEARANCE = 0.05
# Preferred clearance of a route [m], and the factor on times where the clearance is smaller.
CLEARANCE_PREFERRED, CLOSE_FACTOR = 0.15, 1.3
# Distance between samples along a crossing, and largest distance that is sampled [m].
SAMPLE_DISTANCE, CROSSING_LENGTH_MAX = 0.05, RUN_UPS[-1] + ROOM_MAX
# Largest angle between a crossing and the normal of the step, and between the ball and its first
# state [rad]: half the spacing of headings.
HEADING_DEVIATION_MAX = math.radians(13.5)
# Standard deviation of the heading at the edge of a crossing, measured in random houses [rad].
HEADING_SD = 0.05
# Speeds on arcs and backward [m/s]; largest cell of the lattice [m].
ARC_SPEED, BACKWARD_SPEED, CELL_SIZE_MAX = 0.25, 0.2, 0.12
# Time to stop and change direction, and to align for a crossing and start it [s].
REVERSAL_TIME, ALIGNMENT_TIME = 2.0, 2.0
# Cost of the deviation of the start from its state: sideways [s/m], and in heading [s/rad].
OFFSET_COST, TURN_COST = 10.0, 4.0
# Longest path out of a blocked position [m], and the largest overlap of ball and wall that is
# attributed to the localisation [m].
ESCAPE_DISTANCE_MAX, LOCALIZATION_ERROR_MAX = 1.0, 0.08
# Areas that no route enters, and features whose edges no route crosses.
CLOSED = ('keep_out', 'stairs')
BARRED = ('drop', 'ramp', *CLOSED)
# Features with two faces, a width apart.
BARS = ('threshold', 'cord')
# Kinds of features that routes cross.
CROSSED = tuple(kind for kind in (*LINES, *AREAS) if kind not in ('friction', *BARRED))
# Length of the parts in which the edge of a ramp is checked, and offset to both sides [m].
EDGE_LENGTH, EDGE_OFFSET = 0.05, 0.01
# Upper bound of the standard deviation of a measured height [m].
MEASURED_SD = 0.001
# Length over which uneven ground is averaged [m].
SLOPE_LENGTH = 0.1
# Increase of the probability with which a longer run-up is a separate choice.
PROBABILITY_GAIN_MIN = 0.005
# Largest ratio of the time of a route to that of the fastest: the factor on the heuristic.
HEURISTIC_FACTOR = 1.05


class Segment(NamedTuple):
    """
    A part of a route, driven without a stop.

    Attributes
    ----------
    points : tuple of (float, float)
        Polyline of the centre [m]; start and end of a crossing.
    feature : Feature or None
        The crossed feature; None for free floor.
    crossing : CrossingPlan or None
    time : float
        [s]
    direction : int
        1 forward, -1 backward.
    heading : float
        Heading at the end [rad].
    number, sign : int
        Index of the feature on the floor; 1 towards the left of its line or outline, else -1.

    """

    points: Tuple[Point, ...]
    feature: Optional[Feature]
    crossing: Optional[CrossingPlan]
    time: float
    direction: int = 1
    heading: float = math.nan
    number: int = -1
    sign: int = 0


class Route(NamedTuple):
    """
    A route.

    Attributes
    ----------
    segments : tuple of Segment
    time : float
        Expected time [s].
    probability : float
        Product of the probabilities of the crossings, each with one further attempt.

    """

    segments: Tuple[Segment, ...]
    time: float
    probability: float

    @property
    def points(self) -> Tuple[Point, ...]:
        """Return the polyline of the complete route [m]."""
        return tuple(point for segment in self.segments for point in segment.points)


class _Arc(NamedTuple):
    """A crossing from the state `start` to the state `end`."""

    start: int
    end: int
    segment: Segment


class _Limit(NamedTuple):
    """
    Largest run-up and room that the floor offers to cross an edge in one direction [m].

    `easiest` is the crossing with the shortest run-up there, None if there is none.
    """

    run_up: float
    room: float
    faces: Tuple[Tuple[float, float], ...]
    easiest: Optional[CrossingPlan]


class Boundary(NamedTuple):
    """
    A part of the line or outline of a feature.

    Attributes
    ----------
    line : ((float, float), (float, float))
        [m]
    left, right : float
        Distances that the centre keeps on the left and the right of the line [m].
    polygon : tuple of (float, float)
        Outline to which the line belongs [m]; empty without an area.

    """

    line: Tuple[Point, Point]
    left: float
    right: float
    polygon: Tuple[Point, ...] = ()

    def is_left(self, x: Any, y: Any) -> Any:
        """Return whether positions [m] are on the left of the line; arrays broadcast."""
        if self.polygon:
            # Beside an area, a position outside may be on the inner side of an edge's line.
            return inside(x, y, self.polygon) == (signed_area(self.polygon) > 0.0)
        (x0, y0), (x1, y1) = self.line
        return (x1 - x0) * (y - y0) >= (y1 - y0) * (x - x0)

    def keep(self, x: Any, y: Any) -> Any:
        """Return the distance that the centre keeps at positions [m]; arrays broadcast."""
        return np.where(self.is_left(x, y), self.left, self.right)


class _Passage(NamedTuple):
    """An edge of a feature, and the direction in which the ball crosses it."""

    number: int  # index of the feature on the floor
    edge: Boundary
    sign: int  # 1 towards the left of the edge, else -1


class RoutePlanner:
    """
    Plans routes on one floor for one robot.

    Ramps on which the ball can stand are free floor, except at edges with a face.  Steeper ground
    in the height map is closed like walls.

    Parameters
    ----------
    floor : Floor
    knowledge : Knowledge
        Robot, curve and tuning of the obstacle decision.
    learned : Learned, optional
        Learned data of the floor.
    capability : Capability, optional
        Capability shared between planners.

    Attributes
    ----------
    floor : Floor
    learned : Learned
        Learned data in use, see `learn`.
    features : list of Feature
        Features of the floor with their learned heights.
    boundaries : list of list of Boundary
        Boundaries of each feature, without the parts where a ramp leads to the level behind.
    free : (rows, columns) bool array
        Cells of the floor that are free, and on which the ball can stand.
    ball_radius : float
        [m]
    explores : bool
        Whether the latest route was planned with `explore`, see `route`.
    drop_distance : float
        Distance of the centre from drops: radius plus stopping distance at cruise speed [m].

    Raises
    ------
    ConfigurationError
        If the robot has no steering, or if curve or tuning do not match it, see `check_decision`.

    """

    def __init__(self, floor: Floor, knowledge: Knowledge, learned: Learned = Learned(),
                 capability: Optional[Capability] = None):
        required_steering(knowledge.robot)
        check_decision(knowledge.robot, knowledge.curve, knowledge.tuning)
        self.floor, self._tuning = floor, knowledge.tuning
        self.ball_radius = knowledge.robot.ball_radius
        self.drop_distance = self.ball_radius + knowledge.braking.distance(
            knowledge.tuning.cruise_speed, 0.0)
        self._steepest = knowledge.braking.steepest
        self._ramps = [feature for feature in floor.features
                       if feature.kind == 'ramp' and not self.is_closed(feature)]
        self._parts = [list(self._parts_of(feature)) for feature in floor.features]
        self._capability = capability or Capability(knowledge)
        radius = 1.0 / curvature_limit(knowledge.robot, ARC_SPEED)
        self._size = min(CELL_SIZE_MAX, CELL_SHARE * radius)
        self._rows = primitives(radius / self._size)
        speed = self._tuning.cruise_speed
        self._tree = Tree()
        # For each feature: the data on which its crossings depend, and the crossings.
        self._arcs: Dict[int, Tuple[Tuple[object, ...], List[_Arc]]] = {}
        self._limits: Dict[_Passage, _Limit] = {}
        self._lay_grid()
        self._moves = Moves.of(self._rows, [
            item.length * self._size / min(
                speed, ARC_SPEED if item.curvature else speed,
                BACKWARD_SPEED if item.direction < 0 else speed) for item in self._rows],
            self._map_clear.shape[1])
        # Times of a point that turns in place at the corners of the primitives' polylines, lower
        # bounds of those of the primitives: per length [s/cell], and of a turn [s].
        times, back = self._moves.times, self._moves.backward
        lines = np.array([item.lines for item in self._rows])
        turns = np.array([item.start != item.end for item in self._rows])
        pace = float((times / lines)[~back].min())
        self._turn = float((times - pace * lines)[turns & ~back].min())
        self._paces = pace, float(((times - self._turn * turns) / lines)[back].min())
        self.learn(learned)

    def learn(self, learned: Learned) -> None:
        """Apply learned data of the floor."""
        self.learned = learned = learned.on(self.floor.features)
        measured = dict(learned.heights)
        self.features = [
            replace(feature, height=measured[number],
                    height_sd=min(feature.height_sd, MEASURED_SD))
            if number in measured else feature
            for number, feature in enumerate(self.floor.features)]
        # Obstacles are exact up to the clearance that routes prefer.
        self._clear = self._map_clear.copy()
        for point in learned.obstacles:
            window, away = self._around((point, point), self.ball_radius + CLEARANCE_PREFERRED)
            self._clear[window] = np.minimum(self._clear[window], away)
        self._walls = self._clear < self.ball_radius + CLEARANCE
        self._close = self._clear < self.ball_radius + CLEARANCE_PREFERRED
        self.boundaries = [
            [Boundary(line, *(keeps or self._kept(feature)), feature.polygon)
             for line, keeps in parts]
            for parts, feature in zip(self._parts, self.features)]
        # Cells that the centre must not enter, for each feature.
        self._near: List[NDArray[np.bool_]] = []
        for edges, feature in zip(self.boundaries, self.features):
            near = np.zeros(self._walls.shape, bool)
            for edge in edges:
                window, away = self._around(edge.line, max(edge.left, edge.right))
                near[window] |= away < edge.keep(self._x[:, window[1]], self._y[window[0]])
            if self.is_closed(feature):
                near |= inside(self._x, self._y, feature.polygon)
            self._near.append(near)
        # The capability applies to level floor with a friction within the range of the robot.
        self._unusual = np.logical_or.reduce([np.zeros(self._walls.shape, bool)] + [
            inside(self._x, self._y, feature.polygon) for feature in self.features
            if feature in self._ramps or feature.friction is not None
            and feature.friction < self._capability.least_friction])
        # Cells that no crossing opens.
        self._fixed = np.logical_or.reduce([self._walls] + [
            near for near, feature in zip(self._near, self.features)
            if feature.kind in BARRED])
        self._blocked = np.logical_or.reduce([self._fixed, *self._near])
        self._slowness = np.where(self._blocked, np.inf, np.where(self._close, CLOSE_FACTOR, 1.0))
        self._offer(explore=False)

    def is_closed(self, feature: Feature) -> bool:
        """Return whether routes avoid an area; includes ramps on which the ball cannot stand."""
        return feature.kind in CLOSED or feature.kind == 'ramp' and math.atan2(
            feature.height, math.dist(feature.line[0], feature.line[-1])) > self._steepest

    def _kept(self, feature: Feature, rise: Optional[float] = None) -> Tuple[float, float]:
        """
        Return the distances that the centre keeps on the left and the right of an edge [m].

        `rise` is the rise of the floor towards the left [m], by default that of the feature.
        """
        if feature.kind in ('drop', 'stairs'):
            return self.drop_distance, self.drop_distance
        if feature.kind == 'friction' or rise == 0.0:
            return 0.0, 0.0
        if self.is_closed(feature):
            return CLEARANCE, CLEARANCE
        height = abs(feature.height if rise is None else rise)
        beside = CLEARANCE + max(touch_distance(self.ball_radius, height), 0.5 * feature.width)
        if rise is None:
            rise = feature.rise
        # If no crossing leads down, the upper side is treated as a drop.
        above = self.drop_distance if height > self._tuning.highest_descent else beside
        return above if rise > 0.0 else beside, above if rise < 0.0 else beside

    def _parts_of(self, feature: Feature
                  ) -> Iterator[Tuple[Tuple[Point, Point], Optional[Tuple[float, float]]]]:
        """
        Yield the parts of the edges of a feature that have a face.

        Each comes with the distances that the centre keeps on its left and right [m], None for
        those of the feature.
        """
        for begin, end in feature.segments:
            if feature.kind not in ('step', 'carpet', 'level', 'ramp') or self.is_closed(feature):
                yield (begin, end), None
                continue
            count = max(1, math.ceil(math.dist(begin, end) / EDGE_LENGTH))
            points = [(float(x), float(y)) for x, y in np.linspace(begin, end, count + 1)]
            rises = [self._rise(feature, part) for part in zip(points, points[1:])]
            keeps = [None if rise is None else self._kept(feature, rise) for rise in rises]
            for kept, numbers in groupby(range(count), key=keeps.__getitem__):
                first, *others = numbers
                if kept != (0.0, 0.0):
                    yield (points[first], points[first + len(others) + 1]), kept

    def _rise(self, feature: Feature, line: Tuple[Point, Point]) -> Optional[float]:
        """
        Return the rise of the floor towards the left of a part of an edge [m].

        Return None if it is the rise of the feature; 0 without a face, and along a wall, where
        the ball cannot reach the edge.
        """
        (x0, y0), (x1, y1) = line
        length = math.dist(*line) or 1.0
        right = (y1 - y0) / length, (x0 - x1) / length
        one, two = ((0.5 * (x0 + x1) + way * right[0], 0.5 * (y0 + y1) + way * right[1])
                    for way in (EDGE_OFFSET, -EDGE_OFFSET))
        for point in (one, two):
            away, (x, y) = self.floor.nearest_wall(point)
            if away < CLEARANCE and abs(x * right[0] + y * right[1]) >= abs(
                    x * right[1] - y * right[0]):
                return 0.0
        if not any(inside(*point, ramp.polygon) for ramp in self._ramps for point in (one, two)):
            return None
        rise = area_height(self.floor, two) - area_height(self.floor, one) \
            + passed(self.floor, one, two)
        if abs(rise) < FACE_HEIGHT_MIN:
            return 0.0
        return rise if feature.kind == 'ramp' else None

    def _offer(self, explore: bool) -> None:
        """Compute the crossings of all features whose data or surroundings have changed."""
        self.explores, measured = explore, dict(self.learned.heights)
        # Features with the heights for which crossings are planned.
        self._assumed = [
            replace(feature, height=math.copysign(FACE_HEIGHT_MIN, feature.height))
            if explore and feature.height_sd > 0.0 and number not in measured
            and abs(feature.height) - SIGMAS * feature.height_sd
            <= self._tuning.highest_descent else feature
            for number, feature in enumerate(self.features)]
        for number, feature in enumerate(self._assumed):
            basis = (feature, self.learned.heights, self.learned.outcomes, *(
                self._clear[self._reach(line)].tobytes() for line in feature.segments))
            if number not in self._arcs or self._arcs[number][0] != basis:
                self._limits = {passage: limit for passage, limit in self._limits.items()
                                if passage.number != number}
                self._arcs[number] = basis, self._crossings(number)
        self._capability.keep()
        self._offered = sorted((arc for _, arcs in self._arcs.values() for arc in arcs),
                               key=lambda arc: arc.start)
        limit = -math.log(self._tuning.required_probability)
        starts, ends = (np.array([arc[side] for arc in self._offered], np.int64)
                        for side in (0, 1))
        times = np.array([arc.segment.time for arc in self._offered], float)
        risks = -np.log([_probability([arc.segment]) for arc in self._offered])
        self._arc_arrays = (
            starts, ends, times, np.ceil(risks / limit * LEVELS - 1e-9).astype(np.int64))

    def _lay_grid(self) -> None:
        """Create the grid, with the distance of each cell from walls and steep ground."""
        from scipy import ndimage
        floor, size = self.floor, self._size
        left, right, bottom, top = floor.extent
        self._origin = (left, bottom)
        rows, columns = (max(1, round(length / size)) for length in (top - bottom, right - left))
        self._x = left + (np.arange(columns)[None, :] + 0.5) * size
        self._y = bottom + (np.arange(rows)[:, None] + 0.5) * size
        self.free = floor.cells == FREE
        if floor.heights is not None:
            self.free &= self._inclination(floor.heights) <= self._steepest
        clear: NDArray[np.float64] = ndimage.distance_transform_edt(np.pad(self.free, 1))
        # The edge of an occupied cell is half a cell before its centre.
        clear = (clear[1:-1, 1:-1] - 0.5) * floor.resolution
        at = (np.clip(((self._y - bottom) / floor.resolution).astype(int), 0, clear.shape[0] - 1),
              np.clip(((self._x - left) / floor.resolution).astype(int), 0, clear.shape[1] - 1))
        self._map_clear = clear[at]
        # No motion leaves the grid.
        self._map_clear[[0, -1]] = self._map_clear[:, [0, -1]] = 0.0

    def _inclination(self, heights: Heights) -> NDArray[np.float64]:
        """Return the mean slope of the ground around each cell of the floor [rad]."""
        (x, y), beside = self.floor.centers, 0.5 * SLOPE_LENGTH
        found: NDArray[np.float64] = np.arctan(np.hypot(
            heights.at(x + beside, y) - heights.at(x - beside, y),
            heights.at(x, y + beside) - heights.at(x, y - beside)) / SLOPE_LENGTH)
        return found

    def _far(self, last: int, heading: int, slowness: NDArray[np.float64],
             states: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return lower bounds of the times from all states to a cell [s], for given starts."""
        return turning_times(
            last * COUNT + np.arange(COUNT)[heading if heading >= 0 else slice(None)].ravel(),
            states, slowness, self._paces, self._turn, self._arc_arrays[:3])

    def _around(self, line: Tuple[Point, Point], margin: float
                ) -> Tuple[Tuple[slice, slice], NDArray[np.float64]]:
        """Return the cells of a box around a segment, and their distances to it [m]."""
        rows, columns = self._box(line, margin)
        away: NDArray[np.float64] = distance_to_segment(
            self._x[:, columns], self._y[rows], *line)
        return (rows, columns), away

    def _reach(self, line: Tuple[Point, Point]) -> Tuple[slice, slice]:
        """Return the rows and columns of a box around all crossings of a segment."""
        (x0, y0), (x1, y1) = line
        normal = math.atan2(x1 - x0, y0 - y1)
        return self._box(
            [(x + way * math.cos(normal), y + way * math.sin(normal))
             for x, y in line for way in (CROSSING_LENGTH_MAX, -CROSSING_LENGTH_MAX)],
            CROSSING_LENGTH_MAX * math.sin(HEADING_DEVIATION_MAX))

    def _box(self, points: Sequence[Point], margin: float) -> Tuple[slice, slice]:
        """Return the rows and columns of a box around points."""
        columns, rows = (slice(
            max(0, math.floor((min(ends) - margin - origin) / self._size)),
            max(0, math.ceil((max(ends) + margin - origin) / self._size)))
            for ends, origin in zip(zip(*points), self._origin))
        return rows, columns

    def _node(self, point: Sequence[float]) -> int:
        rows, columns = self._walls.shape
        row = min(max(math.floor((point[1] - self._origin[1]) / self._size), 0), rows - 1)
        column = min(max(math.floor((point[0] - self._origin[0]) / self._size), 0), columns - 1)
        return int(row * columns + column)

    def _state(self, pose: Sequence[float]) -> int:
        """Return the state nearest to a pose."""
        return self._node(pose) * COUNT + min(range(COUNT), key=lambda item: abs(
            math.remainder(HEADINGS[item] - pose[2], 2.0 * math.pi)))

    def _point(self, node: int) -> Point:
        row, column = divmod(node, self._walls.shape[1])
        return float(self._x[0, column]), float(self._y[row, 0])

    def _crossings(self, number: int) -> List[_Arc]:
        """Return the crossings of a feature, in both directions."""
        feature = self.features[number]
        if feature.kind not in CROSSED:
            return []
        found = []
        for edge in self.boundaries[number]:
            line = (x0, y0), (x1, y1) = edge.line
            if math.dist(*line) < 1e-6:
                continue
            normal = math.atan2(x1 - x0, y0 - y1)
            barriers = self._barriers(number, edge) | self._walls
            for heading in range(COUNT):
                for sign, way in ((1, normal), (-1, normal + math.pi)):
                    angle = math.remainder(HEADINGS[heading] - way, 2.0 * math.pi)
                    if abs(angle) <= HEADING_DEVIATION_MAX:
                        found += self._along(
                            number, edge, heading, sign, angle, barriers)
        return found

    def _barriers(self, number: int, edge: Boundary) -> NDArray[np.bool_]:
        """Return the cells at features that limit run-up and room of a crossing of an edge."""
        # The other edges of the feature are limits, like other features.
        near = [self._unusual, *self._near]
        margin = max(edge.left, edge.right) + self._size
        window, away = self._around(edge.line, margin)
        near[number + 1] = near[number + 1].copy()
        near[number + 1][window] &= away >= margin
        found: NDArray[np.bool_] = np.logical_or.reduce(near)
        return found

    def reached(self, pose: Sequence[float], segment: Segment
                ) -> Optional[Tuple[float, float, float]]:
        """
        Return the pose at the end of a crossing that starts at another pose than planned.

        Parameters
        ----------
        pose : (float, float, float)
            Position [m] and heading [rad].
        segment : Segment
            Segment of the crossing.

        Returns
        -------
        (float, float, float) or None
            Position [m] and heading [rad] of the ball, steered on the run-up and going straight
            from there.  None if the floor is not free on that path, or if the capability contains
            no crossing at its angle to the edge.  A ball that is closer to a wall than the
            clearance must not get closer.

        """
        assert segment.crossing is not None
        (x, y), distance = segment.points[0], math.dist(*segment.points)
        course, run_up = segment.heading, segment.crossing.run_up
        driven, left, turned = steered(
            (pose[1] - y) * math.cos(course) - (pose[0] - x) * math.sin(course),
            math.remainder(pose[2] - course, 2.0 * math.pi), run_up, segment.crossing.speed)
        x += driven * math.cos(course) - left * math.sin(course)
        y += driven * math.sin(course) + left * math.cos(course)
        way = math.cos(course + turned), math.sin(course + turned)
        close = self._closer((x, y), CLEARANCE)
        feature = self._assumed[segment.number]
        for edge in self.boundaries[segment.number]:
            for at, sign, angle in crossings((edge.line,), (x, y), way):
                if not 0.0 < at < distance - driven or not height_factor(angle):
                    continue
                faces = self._faces(feature, sign, angle)
                free = self._free((x, y), way, close | self._barriers(segment.number, edge))
                if free > distance - driven - SAMPLE_DISTANCE and any(self._capability.crossing(
                        faces, feature.height_sd, item, free - at - 0.5 * faces[-1][0])
                        for item in RUN_UPS if item <= run_up):
                    rest = distance - driven
                    return x + rest * way[0], y + rest * way[1], course + turned
        return None

    def _along(self, number: int, edge: Boundary, heading: int, sign: int,
               angle: float, barriers: NDArray[np.bool_]) -> List[_Arc]:
        """Return the crossings of an edge of a feature along a heading."""
        faces = self._faces(self._assumed[number], sign, abs(angle) + HEADING_SD)
        half = 0.5 * faces[-1][0]
        touch = touch_distance(self.ball_radius, max(faces[0][1], 0.0)) + half
        (x0, y0), (x1, y1) = edge.line
        across, up = VECTORS[heading]
        step_x, step_y = across * self._size, up * self._size
        spacing = math.hypot(step_x, step_y)
        way = step_x / spacing, step_y / spacing
        # The last cell before the segment on each line of cells: fraction of a vector to the
        # segment, and fraction along the segment.
        turn = step_x * (y1 - y0) - step_y * (x1 - x0)
        (rows, columns), _ = self._around(edge.line, spacing)
        x, y = self._x[:, columns], self._y[rows]
        ahead = ((x0 - x) * (y1 - y0) - (y0 - y) * (x1 - x0)) / turn
        along = ((x0 - x) * step_y - (y0 - y) * step_x) / turn
        found, passage = [], _Passage(number, edge, sign)
        limits = [self._limits[passage]] if passage in self._limits else []
        for item in np.argwhere((ahead >= 0.0) & (ahead < 1.0) & (along >= 0.0) & (along <= 1.0)):
            share = float(ahead[tuple(item)])
            row, column = int(item[0]) + rows.start, int(item[1]) + columns.start
            middle = (float(self._x[0, column]) + share * step_x,
                      float(self._y[row, 0]) + share * step_y)
            run_up = self._free(middle, (-way[0], -way[1]), barriers) - touch
            room = self._free(middle, way, barriers) - half
            on = max(half + min(room, self.ball_radius + CLEARANCE + 0.2),
                     (edge.left if sign > 0 else edge.right) / math.cos(angle))
            after = max(1, math.ceil(on / spacing + share))
            stand = row + after * up, column + after * across
            choices = list(self._choices(number, sign, faces, run_up, room)) \
                if after - share <= room / spacing and self._inside(*stand) else []
            limits.append(_Limit(
                max(run_up, 0.0), max(room, 0.0), faces, next(iter(choices), None)))
            for crossing in choices:
                before = touch + crossing.run_up
                back = math.ceil(before / spacing - share - 1e-9)
                short = (back + share) * spacing > touch + run_up + 1e-9
                begin = row - (back - short) * up, column - (back - short) * across
                if not self._inside(*begin):
                    continue
                one, two = (int(np.ravel_multi_index(cell, self._walls.shape))
                            for cell in (begin, stand))
                at, time = self._point(one), ALIGNMENT_TIME + crossing.time
                if short:
                    # No state is free there: the ball backs off from the previous one.
                    at = middle[0] - before * way[0], middle[1] - before * way[1]
                    time += REVERSAL_TIME + spacing / BACKWARD_SPEED
                if self._free(at, way, self._close) < math.dist(at, self._point(two)):
                    time *= CLOSE_FACTOR
                # A failed attempt costs the return to its start and another attempt.
                time += (1.0 / crossing.probability - 1.0) * (
                    time + 2.0 * REVERSAL_TIME + crossing.run_up / BACKWARD_SPEED)
                found.append(_Arc(one * COUNT + heading, two * COUNT + heading, Segment(
                    (at, self._point(two)), self.floor.features[number], crossing, time, 1,
                    HEADINGS[heading], number, sign)))
        if limits:
            self._limits[passage] = max(limits, key=lambda limit: (
                limit.easiest is not None, limit.run_up * limit.room))
        return found

    def _choices(self, number: int, sign: int, faces: Tuple[Tuple[float, float], ...],
                 run_up: float, room: float) -> Iterator[CrossingPlan]:
        """Yield crossings by increasing run-up, each more probable than those before."""
        least = self._tuning.required_probability
        for item in RUN_UPS:
            # A prediction of 1 gives the upper bound of the probability after the outcomes.
            if item > run_up or self.learned.probability(number, sign, item, 1.0) < least:
                continue
            crossing = self._capability.crossing(
                faces, self._assumed[number].height_sd, item, room)
            if crossing is None:
                continue
            probability = self.learned.probability(number, sign, item, crossing.probability)
            if probability >= least:
                yield crossing._replace(probability=probability)
                least = probability + PROBABILITY_GAIN_MIN

    def clearance(self, place: Sequence[float]) -> float:
        """Return the distance of the ball from the nearest wall, obstacle or feature [m]."""
        found = [self.floor.nearest_wall((place[0], place[1]))[0] - self.ball_radius, *(
            math.dist(place[:2], point) - self.ball_radius for point in self.learned.obstacles)]
        for edges, feature in zip(self.boundaries, self.features):
            gaps = [(float(distance_to_segment(place[0], place[1], *edge.line)),
                     float(edge.keep(place[0], place[1]))) for edge in edges]
            if self.is_closed(feature) and inside(place[0], place[1], feature.polygon):
                gaps = [(-away, keep) for away, keep in [min(gaps)]]
            found += [away + CLEARANCE - keep for away, keep in gaps]
        return min(found)

    def leaving(self, pose: Sequence[float]) -> Tuple[int, ...]:
        """
        Return the directions, 1 forward and -1 backward, in which a ball at rest may drive.

        A ball closer to a wall, obstacle or feature than the clearance must not get closer.
        """
        if len(pose) < 3:
            return 1, -1
        least = min(self.clearance(pose), CLEARANCE)
        return tuple(way for way in (1, -1) if self.clearance(
            (pose[0] + way * self._size * math.cos(pose[2]),
             pose[1] + way * self._size * math.sin(pose[2]))) >= least)

    def room_before(self, crossing: Segment) -> float:
        """Return the distance that the centre may back off along the line of a crossing [m]."""
        return self._free(crossing.points[0], (-math.cos(crossing.heading),
                                               -math.sin(crossing.heading)), self._blocked)

    def room_ahead(self, pose: Sequence[float]) -> float:
        """
        Return the free distance of the centre along its heading to a wall or obstacle [m].

        A ball that is already closer than half the clearance must not get closer.
        """
        return self._free((pose[0], pose[1]), (math.cos(pose[2]), math.sin(pose[2])),
                          self._closer(pose, 0.5 * CLEARANCE))

    def _closer(self, place: Sequence[float], clearance: float) -> NDArray[np.bool_]:
        """Return the cells closer to walls and obstacles than a clearance [m] and a position."""
        found: NDArray[np.bool_] = self._clear < min(
            self.ball_radius + clearance, self._clear.flat[self._node(place)])
        return found

    def _inside(self, row: int, column: int) -> bool:
        """Return whether a cell exists and the centre may be there."""
        rows, columns = self._walls.shape
        return 0 <= row < rows and 0 <= column < columns and not self._blocked[row, column]

    @staticmethod
    def _faces(feature: Feature, sign: int, angle: float) -> Tuple[Tuple[float, float], ...]:
        """Return the faces of a feature for a crossing in a direction at an angle [rad]."""
        if feature.kind in BARS:
            return ((0.0, feature.height / height_factor(angle)),
                    (feature.width / math.cos(angle), -feature.height))
        rise = sign * feature.rise
        return ((0.0, rise / height_factor(angle) if rise > 0.0 else rise),)

    def _free(self, place: Point, way: Point, barriers: NDArray[np.bool_]) -> float:
        """Return the free distance of the centre from a position in a direction [m]."""
        (column, across), (row, up) = (
            ((at - origin) / self._size, SAMPLE_DISTANCE * step / self._size)
            for at, step, origin in zip(place, way, self._origin))
        return SAMPLE_DISTANCE * free_steps(
            barriers, row, column, up, across, round(CROSSING_LENGTH_MAX / SAMPLE_DISTANCE))

    def check_goal(self, point: Sequence[float]) -> None:
        """
        Check that the centre of the ball may be at a goal.

        Raises
        ------
        RefusedError
            With the reason ``'off_map'``, ``'unknown'``, ``'wall'``, ``'feature'``,
            ``'obstacle'`` or ``'not_finite'``.

        """
        self._check_walls(point, 'goal', self.ball_radius + CLEARANCE)
        where, node = f'goal ({point[0]:g}, {point[1]:g}) m', self._node(point)
        for near, feature in zip(self._near, self.features):
            if near.flat[node]:
                raise RefusedError(f'{where} is too close to the {feature.label}; choose a '
                                   'position farther from it', 'feature', 'goal')
        if self._blocked.flat[node]:
            raise RefusedError(
                f'{where} is at an obstacle that the robot has observed and that is not on the '
                'map; choose another position, or clear the obstacle', 'obstacle', 'goal')

    def _check_walls(self, point: Sequence[float], what: str, clear: float) -> None:
        if not all(math.isfinite(item) for item in point[:2]):
            raise RefusedError(f'{what} {tuple(point)} is not finite', 'not_finite', what)
        where = f'{what} ({point[0]:g}, {point[1]:g}) m'
        if not self.floor.contains(point):
            raise RefusedError(
                f'{where} is off the map, which covers x {self.floor.extent[0]:g} to '
                f'{self.floor.extent[1]:g} m, y {self.floor.extent[2]:g} to '
                f'{self.floor.extent[3]:g} m; is the unit metres?', 'off_map', what)
        if self.floor.cells[self.floor.cell_of(point)] == UNKNOWN:
            raise RefusedError(f'{where} is in unknown space', 'unknown', what)
        if self._map_clear.flat[self._node(point)] < clear:
            raise RefusedError(
                f'{where} is closer than {clear:.2f} m to a wall, to unknown space or to ground '
                'that is too steep; the ball does not fit there', 'wall', what)

    def route(self, start: Sequence[float], goal: Sequence[float], explore: bool = False
              ) -> Route:
        """
        Return a route whose expected time is at most 5 % above the minimum.

        Parameters
        ----------
        start, goal : (float, float) or (float, float, float)
            Position [m] and heading [rad]; any heading if it is omitted.
        explore : bool
            Plan crossings of uncertain steps that are not measured yet as if they had the lowest
            detectable height, so that routes lead to positions where the sensors measure them.
            Steps that are certainly drops from their upper side are excluded.

        Raises
        ------
        RefusedError
            If start or goal is refused, see `check_goal`.  With the reason ``'no_route'`` if no
            route exists; the message lists the crossings on the shortest path that are excluded,
            and what each lacks, or all of them if the ball cannot turn between them.  With
            ``'improbable'`` if only the product of the probabilities of the crossings is below
            the required one.

        """
        self.check_goal(goal)
        if explore != self.explores:
            self._offer(explore)
        ways = self.leaving(start) or (1, -1)
        states, costs, slowness = self._starts(start, ways)
        last = self._node(goal)
        heading = -1 if len(goal) < 3 else self._state(goal) % COUNT
        far = self._far(last, heading, slowness, states)
        ends = self._arc_arrays[1].copy()
        for item in np.flatnonzero(np.isin(self._arc_arrays[0], states)
                                   if len(start) > 2 else []):
            end = self.reached(start, self._offered[item].segment)
            ends[item] = -1 if end is None else self._state(end)
        leaving = np.array([1 in ways, -1 in ways])
        time, path = self._find(states, costs, last, heading, slowness, far, ends, leaving)
        if not math.isfinite(time):
            # Each offered crossing has the required probability, but their product may not.
            time, path = self._find(
                states, costs, last, heading, slowness, far, ends, leaving, LEVELS**2)
            if not math.isfinite(time):
                self._refuse(*self._shortest(start, last),
                             bool(np.isfinite(far[states]).any()))
            taken = [item for item in self._segments(path, slowness) if item.crossing]
            raise RefusedError(
                'no route reaches the required probability of '
                f'{self._tuning.required_probability:g}: the fastest one crosses '
                + ', '.join(self._described(segment.number) for segment in taken)
                + ', with a product of probabilities of '
                f'{_probability(taken):.2f}',
                'improbable', 'goal')
        segments = self._segments(path, slowness)
        return Route(segments, sum(segment.time for segment in segments), _probability(segments))

    def explain(self, route: Route, start: Sequence[float], goal: Sequence[float]) -> str:
        """
        Return why a route is not the shortest one, and the run-up of each crossing.

        The shortest path crosses each step and is driven at cruise speed.
        """
        shortest, passed = self._shortest(start, self._node(goal))
        taken = [segment for segment in route.segments if segment.crossing]
        numbers = {segment.number for segment in taken}
        avoided = [passage for passage in passed if passage.number not in numbers]
        why = [self._lack(passage) for passage in avoided if not self._is_crossable(passage)]
        why += dict.fromkeys(
            f'the fastest route avoids {self._described(passage.number)}'
            for passage in avoided if self._is_crossable(passage))
        why += [f'{self._described(segment.number)} is crossed with '
                f'{segment.crossing.run_up:.2f} m of run-up, '
                'from ({:.2f}, {:.2f}) m'.format(*segment.points[0])
                for segment in taken if segment.crossing]
        longer = route.time - shortest / self._tuning.cruise_speed
        if why and longer > 1.0:
            why.insert(0, f'{longer:.0f} s longer than the shortest path at cruise speed')
        return '; '.join(why)

    def warm_up(self) -> None:
        """Compile the search, or load its compiled code."""
        state = np.zeros(1, np.int64)
        self._find(state, np.zeros(1), 0, -1, self._slowness,
                   self._far(0, -1, self._slowness, state),
                   self._arc_arrays[1], np.ones(2, bool))

    def _find(self, states: NDArray[np.int64], costs: NDArray[np.float64], last: int, heading: int,
              slowness: NDArray[np.float64], far: NDArray[np.float64],
              ends: NDArray[np.int64], leaving: NDArray[np.bool_], most_level: int = LEVELS
              ) -> Tuple[float, List[Tuple[int, int]]]:
        """
        Search from states with their costs to a cell.

        `far` contains lower bounds of the times to the cell, see `_far`.  From the start,
        crossings lead to the states `ends` or, if these are negative, are excluded, as are
        motions in directions that are not `leaving`.
        """
        return self._tree.find(Problem(
            states, costs, last, heading, slowness.ravel(), HEURISTIC_FACTOR * far, self._moves,
            REVERSAL_TIME, *self._arc_arrays, ends, leaving, most_level))

    def _refuse(self, shortest: float, passed: List[_Passage], point_gets_there: bool) -> None:
        if not math.isfinite(shortest):
            # Both grids round the position of the passage.
            width = 2.0 * (self.ball_radius + CLEARANCE) + self._size + self.floor.resolution
            raise RefusedError(
                f'no route: walls, passages narrower than {width:.2f} m, obstacles, drops, '
                'stairs, keep-out areas, edges of ramps, or ramps steeper than '
                f'{math.degrees(self._steepest):.1f} degrees separate start and goal',
                'no_route', 'goal')
        lacks = [self._lack(item) for item in passed if not self._is_crossable(item)]
        if point_gets_there or not lacks:
            places = ', '.join(dict.fromkeys(
                ['start', *(self._described(item.number) for item in passed)]))
            raise RefusedError('; '.join([
                f'no route: the ball cannot turn in the space between {places} and goal',
                *lacks]), 'no_route', 'goal')
        lacks += [
            f'the {feature.label} is steeper than {math.degrees(self._steepest):.1f} degrees'
            for feature in self.features if feature.kind == 'ramp' and self.is_closed(feature)]
        raise RefusedError(
            'no route reaches the required probability of '
            f'{self._tuning.required_probability:g}. On the shortest path, {"; ".join(lacks)}',
            'no_route', 'goal')

    def _starts(self, start: Sequence[float], ways: Sequence[int]
                ) -> Tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """
        Return the possible start states, the cost of reaching them [s], and `_opened`.

        `ways` are the directions in which the first motion may lead.
        """
        self._check_walls(start, 'start', self.ball_radius - LOCALIZATION_ERROR_MAX)
        for edges, feature in zip(self.boundaries, self.features):
            on = self.ball_radius if feature.kind in ('drop', 'stairs') else 0.0 \
                if feature.kind in ('friction', *BARRED) else touch_distance(
                    self.ball_radius, abs(feature.height)) - LOCALIZATION_ERROR_MAX
            beside = 0.5 * feature.width if feature.kind in BARS else 0.0
            away = min((float(distance_to_segment(start[0], start[1], *edge.line))
                        for edge in edges), default=math.inf)
            if max(away - beside, 0.0) < on or self.is_closed(feature) \
                    and inside(start[0], start[1], feature.polygon):
                raise RefusedError(
                    f'start ({start[0]:g}, {start[1]:g}) m is on the {feature.label}; move the '
                    'ball to level floor', 'feature', 'start')
        slowness, nodes = self._opened(start), [self._node(start)]
        if self._blocked.flat[nodes[0]]:
            # Closed cells are not possible as start states.
            nodes = [node for node in self._beside(nodes[0])
                     if slowness.flat[node] < math.inf] or nodes
        states, costs = [], []
        for node in nodes:
            dx, dy = np.array(self._point(node)) - start[:2]
            for heading, angle in enumerate(HEADINGS):
                turned = 0.0 if len(start) < 3 else abs(
                    math.remainder(angle - start[2], 2.0 * math.pi))
                # The ball reaches the cell along its heading, not sideways.
                aside = abs(-math.sin(angle) * dx + math.cos(angle) * dy)
                ahead = math.cos(angle) * dx + math.sin(angle) * dy
                if turned <= HEADING_DEVIATION_MAX and aside <= 1.01 * self._size \
                        and any(way * ahead > -0.75 * self._size for way in ways):
                    states.append(node * COUNT + heading)
                    costs.append(OFFSET_COST * aside + TURN_COST * turned
                                 + math.hypot(dx, dy) / BACKWARD_SPEED)
        return np.array(states, np.int64), np.array(costs), slowness

    def _beside(self, node: int) -> List[int]:
        """Return a cell and its neighbours."""
        rows, columns = self._walls.shape
        row, column = divmod(node, columns)
        return [r * columns + c for r in range(max(row - 1, 0), min(row + 2, rows))
                for c in range(max(column - 1, 0), min(column + 2, columns))]

    def _opened(self, start: Sequence[float]) -> NDArray[np.float64]:
        """
        Return the slowness with a path out of a blocked position.

        The required distance grows linearly from walls, quadratically from edges (as on an arc).
        """
        if not self._blocked.flat[self._node(start)]:
            return self._slowness
        slowness, at = self._slowness.copy(), (float(start[0]), float(start[1]))
        window, away = self._around((at, at), ESCAPE_DISTANCE_MAX)
        x, y, share = self._x[:, window[1]], self._y[window[0]], away / ESCAPE_DISTANCE_MAX

        def leaves(distance: Any, first: float, keep: Any, gained: Any) -> Any:
            return distance >= np.minimum(keep, first + (keep - first) * gained)
        free = leaves(self._clear[window], min(
            self.floor.nearest_wall(at)[0] - 0.5 * self.floor.resolution,
            *(math.dist(at, point) for point in self.learned.obstacles), math.inf),
            self.ball_radius + CLEARANCE, share)
        for edges, feature in zip(self.boundaries, self.features):
            for edge in edges:
                distance, keep = distance_to_segment(x, y, *edge.line), edge.keep(x, y)
                free &= (distance >= keep) | (edge.is_left(x, y) == edge.is_left(*at)) & leaves(
                    distance, float(distance_to_segment(*at, *edge.line)), keep, share**2)
            if self.is_closed(feature):
                free &= ~inside(x, y, feature.polygon)
        free &= share <= 1.0
        slowness[window] = np.where(
            free, np.minimum(slowness[window], CLOSE_FACTOR), slowness[window])
        return slowness

    def _segments(self, path: List[Tuple[int, int]], slowness: NDArray[np.float64]
                  ) -> Tuple[Segment, ...]:
        """Return the segments of a path of states."""
        segments: List[Segment] = []
        points: List[Point] = [self._point(path[0][0] // COUNT)]
        direction, time = 0, 0.0

        def end(heading: float) -> None:
            if direction:
                segments.append(Segment(tuple(points), None, None, time, direction, heading))
        for (before, _), (state, move) in zip(path, path[1:]):
            at = self._point(before // COUNT)
            if move <= -2:
                end(HEADINGS[before % COUNT])
                crossing = self._offered[-2 - move].segment
                if crossing.points[0] != at:
                    segments.append(Segment(
                        (at, crossing.points[0]), None, None, 0.0, -1, crossing.heading))
                segments.append(crossing)
                points, direction = [self._point(state // COUNT)], 0
                continue
            item = self._rows[move]
            if item.direction != direction:
                end(HEADINGS[before % COUNT])
                time = REVERSAL_TIME if direction and item.direction != direction else 0.0
                points, direction = [at], item.direction
            points += [(at[0] + self._size * x, at[1] + self._size * y)
                       for x, y in item.points.tolist()]
            time += float(self._moves.times[move] * slowness.flat[
                before // COUNT + self._moves.cells[move]].max())
        end(HEADINGS[path[-1][0] % COUNT])
        return tuple(segments)

    def _shortest(self, start: Sequence[float], last: int) -> Tuple[float, List[_Passage]]:
        """Return the shortest path's length if each step could be crossed, and its crossings."""
        first, columns = self._node(start), self._walls.shape[1]
        closed = self._fixed & np.isinf(self._opened(start))
        far = turning_times(np.array([last * COUNT]), np.array([first * COUNT]),
                            np.where(closed, np.inf, 1.0), (1.0, 1.0), 0.0)[::COUNT]
        if not math.isfinite(far[first]):
            # Like the search, the path starts beside a cell that the centre must not enter.
            first = min(self._beside(first), key=far.__getitem__)
        if not math.isfinite(far[first]):
            return math.inf, []
        nodes, steps = [first], np.array(VECTORS) @ (1, columns)
        while nodes[-1] != last:
            around = nodes[-1] + steps
            nodes.append(int(around[np.argmin(LENGTHS + far.take(around, mode='clip'))]))
        points = [self._point(node) for node in nodes]
        found = dict.fromkeys(
            _Passage(number, edge, sign) for one, two in zip(points, points[1:])
            for number, (edges, feature) in enumerate(zip(self.boundaries, self.features))
            if feature.kind in CROSSED for edge in edges
            for _, sign, _ in crossings_between((edge.line,), one, two))
        return float(far[first] * self._size), list(found)

    def _is_crossable(self, passage: _Passage) -> bool:
        """Return whether the floor offers a crossing of an edge in a direction."""
        return passage in self._limits and self._limits[passage].easiest is not None

    def _lack(self, passage: _Passage) -> str:
        """Return what a crossing of an edge requires but the floor lacks: run-up or room."""
        limit, label = self._limits.get(passage), self._described(passage.number)
        easiest = None if limit is None else limit.easiest or next(self._choices(
            passage.number, passage.sign, limit.faces, CROSSING_LENGTH_MAX, CROSSING_LENGTH_MAX),
            None)
        if limit is None or easiest is None:
            return f'{label} cannot be crossed with the required probability'
        lacks = [f'{taken:.2f} m of {what}, but {given:.2f} m is available'
                 for what, taken, given in (('run-up', easiest.run_up, limit.run_up),
                                            ('room behind it', easiest.room, limit.room))
                 if given < taken]
        return f'crossing {label} takes ' + ' and '.join(
            lacks or ['a free position to stop behind it'])

    def _described(self, number: int) -> str:
        """Return the name of a feature with its height."""
        feature = self.features[number]
        return f'the {feature.label} of {1e3 * feature.height:.0f} mm' if feature.name \
            else f'the {feature.label}'


def _probability(taken: Sequence[Segment]) -> float:
    """Return the product of the probabilities of crossings, each with one further attempt."""
    return math.prod(segment.crossing.eventual for segment in taken if segment.crossing)
