# SPDX-License-Identifier: Apache-2.0
"""
Execution of a route: path following, crossings, replanning, and the stop at the goal.

A `Navigator` stores only data computed from floor and robot: `advance` takes a `NavigationState`
and a `Percept`, and returns the next state and a `Command`.  The obstacle decision executes
crossings: while the command crosses, the caller applies its set-points, and reports the outcome
in the percept (see `crossing.CrossingDriver`).
"""
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.decision import Knowledge
from ballbot_ros.decision.values import REST_SPEED_MAX
from ballbot_ros.errors import RefusedError
from ballbot_ros.floors.floor import distance_to_segment, Floor, Point
from ballbot_ros.floors.profile import crossings_between
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.navigation.route import (
    BACKWARD_SPEED, CLEARANCE, Route, RoutePlanner, Segment)
from ballbot_ros.navigation.tracking import (
    EDGE_DISTANCE, EDGE_TIME, Path, SETTLING_DISTANCE, Tracker)

# The ball rests after this time below `REST_SPEED_MAX` [s].
REST_TIME_MIN = 0.4
# Distances at which the end of a segment and the goal count as reached [m].
SEGMENT_TOLERANCE, GOAL_TOLERANCE = 0.03, 0.15
# Deviation from the heading of a path that triggers a replan [rad].
HEADING_ERROR_MAX = math.radians(45.0)
# Alignments before a crossing starts regardless, and the distance that the ball backs off for one:
# the errors decay twice, backward and forward [m].
ALIGNMENTS_MAX, ALIGNING_DISTANCE = 2, 2.0 * SETTLING_DISTANCE
# Localisation jump: motion between percepts in excess of the ball's own [m], and turn [rad].
JUMP_DISTANCE, JUMP_ANGLE = 0.25, 0.5
# Longest interval between percepts over which jumps are detectable [s].
PERCEPT_GAP_MAX = 1.0
# Length of the path that is checked for obstacles [m], samples on it, and the number of
# consecutive measurements that must agree.
LOOK_AHEAD, SAMPLES, AGREEING_MIN = 1.5, 16, 3
# Distance within which walls of the map explain observed points [m].
EXPLAINED_DISTANCE = 0.2
# Deviation at which a measured height differs from the mapped one [m].
HEIGHT_ERROR_MAX = 0.004
# The ball is stuck if it progresses by less than this distance [m] in this time [s].
PROGRESS_MIN, PROGRESS_TIMEOUT = 0.03, 8.0
REPLANS_MAX = 12
CROSSING_TIMEOUT = 90.0


class NavStatus(str, Enum):
    """Status of the navigator."""

    IDLE = 'idle'
    DRIVING = 'driving'
    CROSSING = 'crossing'
    STOPPING = 'stopping'
    SUCCEEDED = 'succeeded'
    FAILED = 'failed'
    CANCELED = 'canceled'

    @property
    def ended(self) -> bool:
        """Return whether no goal is active."""
        return self in (NavStatus.IDLE, NavStatus.SUCCEEDED, NavStatus.FAILED, NavStatus.CANCELED)


class CrossingReport(NamedTuple):
    """
    Outcome of a crossing.

    Attributes
    ----------
    crossed : bool
    message : str
    height : float
        Observed height of the step, NaN if it was not observed [m].
    touched : bool
        Whether the ball touched the step.

    """

    crossed: bool
    message: str
    height: float = math.nan
    touched: bool = False


class Percept(NamedTuple):
    """
    Localisation and measurements at one time.

    Attributes
    ----------
    stamp : float
        [s]
    x, y, heading : float
        Pose on the map [m], [rad].
    speed : float
        Speed along the heading [m/s].
    points : tuple of (float, float) or None
        Observed obstacles on the map, e.g. from a laser scan [m]; None without a new scan.
    faces : tuple of (float, float) or None
        Distance ahead of the centre and height of observed faces [m]; None without new data.
    crossing : CrossingReport or None
        Given once, when the crossing has ended.

    """

    stamp: float
    x: float
    y: float
    heading: float
    speed: float
    points: Optional[Tuple[Point, ...]] = None
    faces: Optional[Tuple[Tuple[float, float], ...]] = None
    crossing: Optional[CrossingReport] = None


class Command(NamedTuple):
    """
    Command that holds until the next percept.

    Attributes
    ----------
    speed : float
        Speed along the heading, without effect in a crossing [m/s].
    yaw_rate : float
        [rad/s]
    crosses : bool
        Whether the obstacle decision drives; a change to False ends its goal.

    """

    speed: float = 0.0
    yaw_rate: float = 0.0
    crosses: bool = False


REST = Command()


@dataclass(frozen=True)
class NavigationState:
    """
    State of a navigation.

    Attributes
    ----------
    status : NavStatus
    reason, message : str
        Reason for the end or for the latest change.
    goal : tuple of float or None
        Position [m], and heading [rad] if one is required.
    route : Route or None
    index : int
        Index of the current segment.
    along, aside : float
        Progress on the segment, and cross-track distance of the ball at its start [m].
    learned : Learned
    replans : int
    recoveries : int
        Number of replans after failures, obstacles and jumps.

    """

    status: NavStatus = NavStatus.IDLE
    reason: str = ''
    message: str = ''
    goal: Optional[Tuple[float, ...]] = None
    route: Optional[Route] = None
    index: int = 0
    along: float = 0.0
    aside: float = 0.0
    path: Optional[Path] = None
    learned: Learned = Learned()
    replans: int = 0
    recoveries: int = 0
    alignments: int = 0
    moving: float = -math.inf  # time of the latest percept of a moving ball [s]
    anchor: Tuple[float, float] = (0.0, -math.inf)  # latest progress [m], and its time [s]
    crossing_start: float = 0.0  # [s]
    agreeing: Tuple[int, ...] = (0, 0)  # consecutive scans and faces with an obstacle on the path
    last: Optional[Percept] = None
    next: Optional[NavStatus] = None  # after a stop: CANCELED, FAILED, or DRIVING with a new route

    @property
    def segment(self) -> Optional[Segment]:
        """Return the current segment."""
        return self.route.segments[self.index] \
            if self.route is not None and self.index < len(self.route.segments) else None

    @property
    def remaining(self) -> float:
        """Return the expected time to the goal [s]."""
        if self.route is None or self.status.ended:
            return 0.0
        time = sum(segment.time for segment in self.route.segments[self.index + 1:])
        segment = self.segment
        if segment is not None:
            done = self.along / self.path.length if self.path is not None else 0.0
            time += segment.time * min(max(1.0 - done, 0.0), 1.0)
        return time


class Navigator:
    """
    Executes the routes of a planner.

    Parameters
    ----------
    planner : RoutePlanner
    knowledge : Knowledge
        Robot, curve and tuning of the obstacle decision.

    """

    def __init__(self, planner: RoutePlanner, knowledge: Knowledge):
        self.planner, self._knowledge, self._tuning = planner, knowledge, knowledge.tuning
        self._tracker = Tracker(knowledge.robot, knowledge.tuning.cruise_speed)
        self._radius, self._braking = knowledge.robot.ball_radius, knowledge.braking

    def begin(self, state: NavigationState, goal: Tuple[float, ...], percept: Percept
              ) -> NavigationState:
        """
        Return the state with a new goal, which replaces an active one.

        A moving ball is stopped first.

        Raises
        ------
        RefusedError
            If the goal or the pose of the ball is refused; the previous state remains valid.

        """
        self._check(percept)
        self.planner.check_goal(goal)
        started = replace(
            state, status=NavStatus.STOPPING, reason='', message='planning', goal=goal,
            next=NavStatus.DRIVING, replans=0, recoveries=0, alignments=0, agreeing=(0, 0),
            last=percept, moving=percept.stamp)
        if state.status.ended and abs(percept.speed) < REST_SPEED_MAX:
            # A ball at rest needs no stop.
            route = self._route(started, percept)
            return self._enter(replace(started, route=route), 0, percept)
        return started

    def cancel(self, state: NavigationState, reason: str = 'canceled',
               message: str = 'the ball was stopped') -> NavigationState:
        """Return the state that stops the ball and ends the goal."""
        if state.status.ended:
            return state
        status = NavStatus.CANCELED if reason == 'canceled' else NavStatus.FAILED
        return replace(state, status=NavStatus.STOPPING, next=status, reason=reason,
                       message=message)

    def with_floor(self, state: NavigationState, floor: Floor) -> NavigationState:
        """
        Change the map; with an active goal, stop the ball and replan.

        An equal map has no effect.  Raises `ConfigurationError` as `RoutePlanner` does; the
        previous map remains valid.
        """
        if floor.has_map_of(self.planner.floor):
            return state
        # Without places, the numbers of the learned data refer to the previous floor.
        self.planner = RoutePlanner(
            floor, self._knowledge, state.learned.on(self.planner.floor.features))
        state = replace(state, learned=self.planner.learned, replans=0)
        return state if state.status.ended else self._stop(
            state, 'map_replaced', 'the map was replaced')

    def advance(self, state: NavigationState, percept: Percept
                ) -> Tuple[NavigationState, Command]:
        """Return the next state and the command; sensor data never raise an exception."""
        if state.status.ended:
            return replace(state, last=percept), REST
        try:
            self._check(percept)
        except RefusedError as error:
            return replace(self.cancel(state, error.reason, str(error)), last=state.last), REST
        if abs(percept.speed) >= REST_SPEED_MAX:
            state = replace(state, moving=percept.stamp)
        jumped = state.status is not NavStatus.STOPPING and self._jumped(state.last, percept)
        state = replace(state, last=percept)
        if jumped:
            state = self._stop(state, 'localisation_jump', 'the localisation jumped')
        if state.status is NavStatus.STOPPING:
            return self._stopping(state, percept)
        if state.status is NavStatus.CROSSING:
            return self._crossing(state, percept)
        return self._driving(state, percept)

    @staticmethod
    def _check(percept: Percept) -> None:
        if not all(math.isfinite(item) for item in percept[:5]):
            raise RefusedError('localisation or odometry is not finite, or a quaternion has '
                               f'length 0: {percept[:5]}', 'not_finite', 'pose')

    @staticmethod
    def _jumped(last: Optional[Percept], percept: Percept) -> bool:
        if last is None or not 0.0 <= percept.stamp - last.stamp <= PERCEPT_GAP_MAX:
            return False
        moved = max(abs(last.speed), abs(percept.speed)) * (percept.stamp - last.stamp)
        return math.hypot(percept.x - last.x, percept.y - last.y) > moved + JUMP_DISTANCE or abs(
            math.remainder(percept.heading - last.heading, 2.0 * math.pi)) > JUMP_ANGLE

    def _stop(self, state: NavigationState, reason: str, message: str) -> NavigationState:
        """Return the state that stops the ball and replans."""
        return replace(state, status=NavStatus.STOPPING, next=NavStatus.DRIVING, reason=reason,
                       message=message, recoveries=state.recoveries + 1)

    def _stopping(self, state: NavigationState, percept: Percept
                  ) -> Tuple[NavigationState, Command]:
        if percept.stamp - state.moving < REST_TIME_MIN:
            return state, REST
        if state.next is not NavStatus.DRIVING:
            assert state.next is not None
            return replace(state, status=state.next, next=None), REST
        if state.replans >= REPLANS_MAX:
            return replace(
                state, status=NavStatus.FAILED, next=None, reason='no_arrival',
                message=f'no arrival after {REPLANS_MAX} routes; the last one ended because '
                f'{state.message}'), REST
        try:
            route = self._route(state, percept)
        except RefusedError as error:
            return replace(state, status=NavStatus.FAILED, next=None, reason=error.reason,
                           message=str(error)), REST
        return self._enter(replace(state, route=route, replans=state.replans + 1), 0,
                           percept), REST

    def _route(self, state: NavigationState, percept: Percept) -> Route:
        """Plan with the known heights; if that fails, plan to steps that are not measured yet."""
        assert state.goal is not None
        start = percept.x, percept.y, percept.heading
        self.planner.learn(state.learned)
        try:
            return self.planner.route(start, state.goal)
        except RefusedError as error:
            if error.reason not in ('no_route', 'improbable'):
                raise
            with suppress(RefusedError):
                return self.planner.route(start, state.goal, explore=True)
            raise

    def _enter(self, state: NavigationState, index: int, percept: Percept) -> NavigationState:
        """Start a segment at rest."""
        assert state.route is not None and state.goal is not None
        if index >= len(state.route.segments):
            away = math.dist((percept.x, percept.y), state.goal[:2])
            if away <= GOAL_TOLERANCE or state.replans >= REPLANS_MAX:
                return replace(state, status=NavStatus.SUCCEEDED, index=index, path=None,
                               reason='', message=f'arrived {away:.2f} m from the goal')
            return replace(state, status=NavStatus.STOPPING, next=NavStatus.DRIVING,
                           message=f'{away:.2f} m from the goal')
        segment = state.route.segments[index]
        path = Path.of(segment.points, segment.direction)
        _, left = path.project(percept.x, percept.y, 0.0)
        state = replace(state, status=NavStatus.DRIVING, index=index, along=0.0, path=path,
                        aside=abs(left), next=None, anchor=(0.0, percept.stamp), agreeing=(0, 0))
        if segment.feature is None:
            return state
        if state.alignments < ALIGNMENTS_MAX and not self._may_cross(state, segment, percept):
            return self._align(state, segment, percept)
        return replace(state, status=NavStatus.CROSSING, crossing_start=percept.stamp)

    def _may_cross(self, state: NavigationState, crossing: Segment, percept: Percept) -> bool:
        """Return whether a crossing may start, and its end costs less time than an alignment."""
        assert state.goal is not None
        end = self.planner.reached(percept[1:4], crossing)
        if end is None:
            return False
        try:
            route = self.planner.route(end, state.goal, self.planner.explores)
        except RefusedError:
            return False
        return route.time - (state.remaining - crossing.time) \
            <= 2.0 * ALIGNING_DISTANCE / BACKWARD_SPEED

    def _align(self, state: NavigationState, crossing: Segment, percept: Percept
               ) -> NavigationState:
        """Back off along the line of a crossing and return to its start; without room, replan."""
        assert state.path is not None and crossing.feature is not None
        _, aside = state.path.project(percept.x, percept.y, 0.0)
        turned = math.remainder(percept.heading - crossing.heading, 2.0 * math.pi)
        state = replace(state, alignments=state.alignments + 1, message=(
            f'{aside:+.2f} m and {math.degrees(turned):+.0f} degrees off the line of the '
            f'{crossing.feature.label}'))
        assert state.route is not None
        room = min(self.planner.room_before(crossing), ALIGNING_DISTANCE)
        if room < 0.5 * ALIGNING_DISTANCE:
            return replace(state, status=NavStatus.STOPPING, next=NavStatus.DRIVING)
        (x, y), heading = crossing.points[0], crossing.heading
        behind = x - room * math.cos(heading), y - room * math.sin(heading)
        there = Segment(((x, y), behind), None, None, room / BACKWARD_SPEED, -1, heading)
        back = there._replace(points=(behind, (x, y)), direction=1)
        done, left = state.route.segments[:state.index], state.route.segments[state.index:]
        route = state.route._replace(segments=(*done, there, back, *left))
        return self._enter(replace(state, route=route), state.index, percept)

    def _driving(self, state: NavigationState, percept: Percept
                 ) -> Tuple[NavigationState, Command]:
        assert state.path is not None
        path = state.path
        along, left = path.project(percept.x, percept.y, state.along)
        state = replace(state, along=max(along, state.along))
        course = percept.heading + (0.0 if path.direction > 0 else math.pi)
        turned = math.remainder(course - float(np.interp(along, path.along, path.courses)),
                                2.0 * math.pi)
        resting = percept.stamp - state.moving >= REST_TIME_MIN
        if path.length - along <= SEGMENT_TOLERANCE:
            if resting:
                return self._enter(state, state.index + 1, percept), REST
            return state, REST
        # Half the clearance of the path is reserved for deviations in addition to the initial one,
        # also at the point where a ball that brakes now would stop.
        rests = min(self._braking.distance(abs(percept.speed), 0.0), path.length - along)
        there = (percept.x + rests * math.cos(course), percept.y + rests * math.sin(course))
        planned = [float(np.interp(along + rests, path.along, items)) for items in path.points.T]
        clearance, (_, aside) = self.planner.clearance, path.project(*there, along)
        if abs(turned) > HEADING_ERROR_MAX or abs(aside) > state.aside + 0.5 * CLEARANCE \
                and clearance(there) < min(clearance(planned), CLEARANCE) - 0.5 * CLEARANCE \
                < clearance((percept.x, percept.y)):
            return self._stop(state, 'off_path', (
                f'the ball is {left:+.2f} m and {math.degrees(turned):+.0f} degrees off its '
                'path')), REST
        if along > state.anchor[0] + PROGRESS_MIN:
            state = replace(state, anchor=(along, percept.stamp))
        elif percept.stamp - state.anchor[1] > PROGRESS_TIMEOUT:
            # If the ball touches a mapped wall, no obstacle is added: the next route leads away.
            if path.direction in self.planner.leaving(percept[1:4]):
                state = replace(state, learned=state.learned.with_obstacles((
                    (percept.x + (self._radius + CLEARANCE) * math.cos(course),
                     percept.y + (self._radius + CLEARANCE) * math.sin(course)),)))
            return self._stop(state, 'stuck', 'the ball makes no progress'), REST
        state = self._watch(state, percept)
        if state.status is NavStatus.STOPPING:
            return state, REST
        speed, yaw_rate = self._tracker.follow(
            path, along, left, percept.heading, percept.speed, self._tuning.cruise_speed
            if path.direction > 0 else 0.5 * self._tuning.cruise_speed)
        if max(state.agreeing) > 0:
            speed = 0.0  # until the obstacle is confirmed
        return state, Command(speed, yaw_rate)

    def _watch(self, state: NavigationState, percept: Percept) -> NavigationState:
        """Check for obstacles on the path, and for steps that are not on the map."""
        path, route, learned = state.path, state.route, state.learned
        assert path is not None and route is not None
        along = np.linspace(state.along, min(state.along + LOOK_AHEAD, path.length), SAMPLES)
        ahead = np.column_stack([np.interp(along, path.along, items) for items in path.points.T])

        def blocks(point: Point) -> bool:
            return self._on(point, ahead) and not self._explained(point)
        # A laser may see the ball itself.
        points = [point for point in percept.points or ()
                  if math.dist(point, percept[1:3]) >= self._radius]
        seen, unmapped = any(map(blocks, points)), []
        for distance, height in percept.faces or ():
            point = (percept.x + distance * math.cos(percept.heading),
                     percept.y + distance * math.sin(percept.heading))
            if path.direction < 0:
                continue
            number = self._feature_at(point)
            if number is not None:
                if any(segment.number == number for segment in route.segments[state.index:]):
                    learned = self._measured(learned, number, height)
            elif blocks(point):
                unmapped.append(point)
        # The sensors have different rates: a percept may contain no measurement.
        agreeing = tuple(count if measured is None else count + 1 if agrees else 0
                         for count, measured, agrees in zip(
                             state.agreeing, (percept.points, percept.faces),
                             (seen, unmapped or learned is not state.learned)))
        if max(agreeing) < AGREEING_MIN:
            return replace(state, agreeing=agreeing)
        obstacle = seen or bool(unmapped)
        if obstacle:
            # The next route avoids all observed points, not only those on this path.
            learned = learned.with_obstacles((*unmapped, *(
                point for point in points if not self._explained(point))))
        return self._stop(
            replace(state, learned=learned, agreeing=(0, 0)), 'obstacle' if obstacle else 'higher',
            'an obstacle is on the path' if obstacle else 'a step is higher than on the map')

    def _measured(self, learned: Learned, number: int, height: float) -> Learned:
        """Return learned data with a measured height if it exceeds the known one."""
        known = self.planner.features[number].height
        # An area below its surroundings has a negative height, and its edge rises outwards.
        return learned.with_height(number, math.copysign(height, known)) \
            if height > abs(known) + HEIGHT_ERROR_MAX else learned

    def _on(self, point: Point, ahead: NDArray[np.float64]) -> bool:
        """Return whether the ball would touch a point on its path."""
        return bool((np.hypot(ahead[:, 0] - point[0], ahead[:, 1] - point[1])
                     < self._radius + 0.5 * CLEARANCE).any())

    def _explained(self, point: Point) -> bool:
        """Return whether a wall of the map is near a point."""
        return self.planner.floor.nearest_wall(point)[0] < EXPLAINED_DISTANCE

    def _feature_at(self, point: Point) -> Optional[int]:
        """Return the number of the feature whose line is nearest to a point, None if not near."""
        away, number = min(
            ((min(float(distance_to_segment(*point, *segment)) for segment in feature.segments)
              - 0.5 * feature.width, number)
             for number, feature in enumerate(self.planner.floor.features)),
            default=(math.inf, None))
        return number if away < EXPLAINED_DISTANCE else None

    def _crossing(self, state: NavigationState, percept: Percept
                  ) -> Tuple[NavigationState, Command]:
        segment = state.segment
        path = state.path
        assert segment is not None and segment.feature is not None and path is not None
        assert segment.crossing is not None
        report = percept.crossing
        if report is None and percept.stamp - state.crossing_start > CROSSING_TIMEOUT:
            report = CrossingReport(False, f'it took more than {CROSSING_TIMEOUT:g} s')
        if report is not None:
            learned = state.learned
            known = self.planner.features[segment.number].height
            if math.isfinite(report.height):
                learned = learned.with_height(
                    segment.number, math.copysign(report.height, known))
            # A different height explains a refusal.
            if report.touched or report.crossed or not abs(
                    abs(report.height) - abs(known)) > HEIGHT_ERROR_MAX:
                learned = learned.with_outcome(
                    segment.number, segment.sign, segment.crossing.run_up, report.crossed)
            state = replace(state, learned=learned, alignments=0)
            if report.crossed:
                # The stop position behind the step is only known now.
                return replace(state, status=NavStatus.STOPPING, next=NavStatus.DRIVING,
                               replans=max(state.replans - 1, 0), message=report.message), REST
            return self._stop(state, 'crossing_failed', (
                f'the {segment.feature.label} was not crossed: {report.message}')), REST
        turned = math.remainder(percept.heading - segment.heading, 2.0 * math.pi)
        if abs(turned) > HEADING_ERROR_MAX:
            # The outcome contains no information about the run-up.
            return self._stop(state, 'off_path', (
                f'the {segment.feature.label} has turned the ball by '
                f'{math.degrees(turned):+.0f} degrees')), REST
        if crossings_between(segment.feature.segments, segment.points[0], percept[1:3]) \
                and self.planner.room_ahead(percept[1:4]) < self._braking.distance(
                    abs(percept.speed), 0.0):
            # A low cord may pass unnoticed: then the decision does not stop the ball behind it.
            return self._stop(state, 'off_path', (
                f'the ball leaves the room behind the {segment.feature.label}')), REST
        if abs(percept.speed) < REST_SPEED_MAX and state.moving > state.crossing_start \
                and state.along < 0.5 * segment.crossing.run_up \
                and state.alignments < ALIGNMENTS_MAX \
                and self.planner.reached(percept[1:4], segment) is None:
            # The decision has backed off for another attempt, which starts at another pose.
            # Close to the step, a ball with a swinging pendulum is slow, too.
            return self._align(state, segment, percept), REST
        along, left = path.project(percept.x, percept.y, state.along)
        state = replace(state, along=along)
        if segment.crossing.run_up - along > self._braking.distance(abs(percept.speed), 0.0):
            # The decision measures the step itself.
            state = self._watch(state, percept._replace(faces=None))
            if state.status is NavStatus.STOPPING:
                return state, REST
        to_edge = min(float(distance_to_segment(percept.x, percept.y, *piece))
                      for piece in segment.feature.segments)
        yaw_rate = 0.0
        if percept.speed < 0.0 or to_edge > EDGE_DISTANCE + EDGE_TIME * percept.speed:
            yaw_rate = self._tracker.yaw_rate(path, along, left, percept.heading,
                                              percept.speed)
        return state, Command(0.0, yaw_rate, crosses=True)
