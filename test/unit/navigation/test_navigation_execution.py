# SPDX-License-Identifier: Apache-2.0
"""Execution of routes by a ball with delayed speed and yaw rate: arrival, replanning, rest."""
from dataclasses import replace
import math

import numpy as np
import pytest
from tiers import slow

from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.errors import RefusedError
from ballbot_ros.floors import load_floor
from ballbot_ros.navigation import execution, RoutePlanner
from ballbot_ros.navigation.execution import (
    CrossingReport, NavigationState, Navigator, NavStatus, Percept, REPLANS_MAX, REST,
    SEGMENT_TOLERANCE)
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.navigation.route import CLEARANCE
from ballbot_ros.navigation.tracking import Path
from ballbot_ros.physics import load_robot

KNOWLEDGE = Knowledge(load_robot('gimball'), load_curve('gimball_down'),
                      load_decision_tuning('decision_default'))
KITCHEN, STUDY, BEDROOM = (1.7, 1.4), (1.8, 5.5), (5.3, 5.8)
PERIOD, LAG = 0.05, 0.3


class Ball:
    """A unicycle whose speed and yaw rate follow commands with a lag; crossings succeed."""

    def __init__(self, navigator, x, y, heading=0.0):
        self.navigator, self.state = navigator, NavigationState()
        self.x, self.y, self.heading = x, y, heading
        self.speed = self.yaw_rate = self.time = 0.0
        self.offset = (0.0, 0.0)
        self.points = self.faces = self.report = None
        self.every = 1  # percepts per measurement
        self.crosses = self._cross
        self.path = []

    def percept(self):
        report, self.report = self.report, None
        measured = round(self.time / PERIOD) % self.every == 0
        return Percept(self.time, self.x + self.offset[0], self.y + self.offset[1], self.heading,
                       self.speed, *((self.points, self.faces) if measured else (None, None)),
                       report)

    def _cross(self, segment):
        self.x, self.y = segment.points[-1]
        self.heading = segment.heading
        return CrossingReport(True, 'over')

    def begin(self, goal):
        self.state = self.navigator.begin(self.state, goal, self.percept())

    def run(self, seconds, until=lambda ball: ball.state.status.ended):
        for _ in range(round(seconds / PERIOD)):
            if until(self):
                return
            self.step()

    def step(self):
        before = self.state.segment
        self.state, command = self.navigator.advance(self.state, self.percept())
        if command.crosses:
            self.report = self.crosses(before)
            # This change of position within one period is a crossing, not a jump.
            self.state = replace(self.state, last=None)
        fraction = 1.0 - math.exp(-PERIOD / LAG)
        self.speed += fraction * (command.speed - self.speed)
        self.yaw_rate += fraction * (command.yaw_rate - self.yaw_rate)
        self.heading += PERIOD * self.yaw_rate
        self.x += PERIOD * self.speed * math.cos(self.heading)
        self.y += PERIOD * self.speed * math.sin(self.heading)
        self.time += PERIOD
        self.path.append((self.x, self.y))


@pytest.fixture(scope='module')
def planner():
    return RoutePlanner(load_floor('apartment'), KNOWLEDGE)


@pytest.fixture
def navigator(planner):
    planner.learn(NavigationState().learned)
    return Navigator(planner, KNOWLEDGE)


def at_rest(ball):
    return abs(ball.speed) < 0.03


@pytest.mark.parametrize('heading', [0.0, *slow(2.0, -1.3)])
def test_the_ball_arrives_and_stays_clear_of_walls(navigator, planner, heading):
    ball = Ball(navigator, *KITCHEN, heading)
    ball.begin(BEDROOM)
    expected = ball.state.remaining
    ball.run(200.0)
    assert ball.state.status is NavStatus.SUCCEEDED, ball.state.message
    assert math.dist((ball.x, ball.y), BEDROOM) < 0.15 and at_rest(ball)
    assert 0.0 < expected and ball.state.remaining == 0.0
    clear = min(planner._clear.flat[planner._node(point)] for point in ball.path)
    assert clear > planner.ball_radius - 0.02


def test_cancellation_ends_at_rest(navigator):
    ball = Ball(navigator, *KITCHEN)
    ball.begin(STUDY)
    ball.run(4.0)
    assert not at_rest(ball)
    ball.state = navigator.cancel(ball.state)
    ball.run(10.0)
    assert ball.state.status is NavStatus.CANCELED and at_rest(ball)


def test_another_goal_stops_the_ball_and_replaces_the_first(navigator):
    ball = Ball(navigator, *KITCHEN)
    ball.begin(STUDY)
    ball.run(4.0)
    ball.begin((2.5, 1.0))
    assert ball.state.status is NavStatus.STOPPING
    ball.run(120.0)
    assert ball.state.status is NavStatus.SUCCEEDED
    assert math.dist((ball.x, ball.y), (2.5, 1.0)) < 0.15


def test_a_refused_goal_does_not_replace_the_active_one(navigator):
    ball = Ball(navigator, *KITCHEN)
    ball.begin(STUDY)
    ball.run(2.0)
    with pytest.raises(RefusedError) as caught:
        ball.begin((0.05, 3.0))
    assert caught.value.reason == 'wall'
    assert ball.state.goal == STUDY and ball.state.status is NavStatus.DRIVING


@pytest.mark.parametrize('every', [1, 5])
def test_an_obstacle_on_the_path_is_driven_around(navigator, every):
    ball = Ball(navigator, 0.6, 5.0)
    ball.every = every
    ball.begin((2.8, 5.0))
    ball.points = tuple((1.8, 4.95 + 0.04 * number) for number in range(8))
    ball.run(120.0)
    assert ball.state.status is NavStatus.SUCCEEDED, ball.state.message
    assert ball.state.learned.obstacles
    away = min(math.dist(point, place) for place in ball.points for point in ball.path)
    assert away > navigator.planner.ball_radius


def test_all_unmapped_points_of_a_scan_are_learned_with_an_obstacle(navigator):
    ball = Ball(navigator, 0.6, 5.0, 0.0)
    ball.begin((2.8, 5.0))
    # Three points are on the path of the ball, and one is beside the path.
    ball.points = (*((1.6, 4.9 + 0.1 * number) for number in range(3)), (1.6, 4.3))
    ball.run(20.0, until=lambda ball: ball.state.learned.obstacles)
    assert set(ball.state.learned.obstacles) == set(ball.points)


@pytest.mark.parametrize(('share', 'seen'), [(0.9, False), (1.05, True)])
def test_points_of_a_scan_within_the_ball_are_no_obstacles(navigator, share, seen):
    ball = Ball(navigator, 0.6, 5.0)
    ball.begin((2.8, 5.0))

    def stopped(ball):
        away = share * navigator.planner.ball_radius
        ball.points = ((ball.x + away * math.cos(ball.heading),
                        ball.y + away * math.sin(ball.heading)),)
        return ball.state.learned.obstacles or ball.state.status.ended
    ball.run(60.0, until=stopped)
    assert bool(ball.state.learned.obstacles) is seen
    assert seen or ball.state.status is NavStatus.SUCCEEDED and not ball.state.recoveries


@pytest.mark.parametrize(('speed', 'ends'), [(0.0, True), (0.1, True), (1.2, False)])
def test_an_obstacle_ends_a_crossing_up_to_its_last_braking_point(navigator, speed, ends):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: None
    ball.begin(STUDY)
    ball.run(60.0, until=lambda ball: ball.state.status is NavStatus.CROSSING)
    start, end = np.array(ball.state.segment.points)
    ball.points = (tuple(start + 0.8 * (end - start)),)
    for _ in range(3):
        ball.state, _ = navigator.advance(
            ball.state, ball.percept()._replace(speed=speed))
    assert (ball.state.reason == 'obstacle') is ends
    assert (ball.state.status is NavStatus.CROSSING) is not ends
    assert bool(ball.state.learned.obstacles) is ends


def test_walls_of_the_map_are_not_learned_as_obstacles(navigator, planner):
    ball = Ball(navigator, *KITCHEN)
    rows, columns = np.nonzero(planner.floor.cells == 2)
    ball.points = tuple(planner.floor.center_of(int(row), int(column))
                        for row, column in zip(rows[::3], columns[::3]))
    ball.begin((2.8, 0.8))
    ball.run(60.0)
    assert ball.state.status is NavStatus.SUCCEEDED and not ball.state.learned.obstacles


def test_the_measured_edge_of_a_pit_agrees_with_its_depth(tmp_path):
    path = tmp_path / 'floor.yaml'
    path.write_text('walls: {size: [4, 4], lines: []}\nfeatures:\n- {kind: level, height: -0.02, '
                    'polygon: [[0.0, 0.0], [2.0, 0.0], [2.0, 4.0], [0.0, 4.0]]}')
    ball = Ball(Navigator(RoutePlanner(load_floor(path), KNOWLEDGE), KNOWLEDGE), 1.0, 2.0)
    ball.begin((3.3, 2.0))
    while ball.state.status is not NavStatus.CROSSING:
        ball.faces = (((2.0 - ball.x) / math.cos(ball.heading), 0.02),)
        ball.step()
        assert ball.time < 60.0
    assert not ball.state.learned.heights and not ball.state.recoveries


def test_a_measured_rise_belongs_to_the_nearest_feature(tmp_path):
    path = tmp_path / 'floor.yaml'
    path.write_text(
        'walls: {size: [4, 4], lines: []}\nfeatures:\n'
        '- {kind: threshold, height: 0.01, width: 0.03, line: [[2.0, 0.0], [2.0, 4.0]]}\n'
        '- {kind: level, height: 0.03, '
        'polygon: [[2.15, 0.0], [4.0, 0.0], [4.0, 1.2], [2.15, 1.2]]}')
    navigator = Navigator(RoutePlanner(load_floor(path), KNOWLEDGE), KNOWLEDGE)
    ball = Ball(navigator, 1.2, 1.5, -0.5)
    ball.begin((3.3, 2.5))
    assert {segment.number for segment in ball.state.route.segments} == {-1, 0}
    for x, learned in (2.15, {}), (2.0, {0: pytest.approx(0.03)}):
        for _ in range(3):
            ball.state, _ = navigator.advance(ball.state, ball.percept()._replace(
                faces=(((x - ball.x) / math.cos(ball.heading), 0.03),)))
        assert dict(ball.state.learned.heights) == learned


@pytest.mark.slow
def test_a_refused_crossing_is_learned_and_the_goal_fails_without_another_route(navigator):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: CrossingReport(False, 'too high', 0.2)
    ball.begin(STUDY)
    ball.run(200.0)
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'no_route')
    assert 'kitchen threshold of 200 mm' in ball.state.message and at_rest(ball)
    assert dict(ball.state.learned.heights) == {0: 0.2}


@pytest.mark.parametrize('crossed', [True, False])
def test_a_crossing_reports_a_height_after_success_and_failure(navigator, crossed):
    ball = Ball(navigator, *KITCHEN, 1.57)
    height = navigator.planner.floor.features[0].height - 0.002
    ball.crosses = lambda segment: CrossingReport(crossed, 'report', height, touched=crossed)
    ball.begin(STUDY)
    ball.run(200.0, until=lambda ball: ball.state.learned.heights)
    assert dict(ball.state.learned.heights) == {0: pytest.approx(height)}
    assert ball.state.learned.outcomes[0][3] is crossed


@pytest.mark.slow
def test_repeated_failures_exclude_a_crossing(navigator):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: CrossingReport(False, 'slipped', touched=True)
    ball.begin(STUDY)
    ball.run(400.0)
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'no_route')
    numbers, _, run_ups, crossed, _ = zip(*ball.state.learned.outcomes)
    assert set(numbers) == {0} and not any(crossed)
    # A failure does not affect longer run-ups.
    assert list(run_ups) == sorted(run_ups)


@pytest.mark.parametrize('crosses', [False, True])
def test_a_localisation_jump_stops_the_ball_and_triggers_replanning(navigator, crosses):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: None
    ball.begin(STUDY)
    ball.run(60.0, until=lambda ball: ball.speed > 0.2 if not crosses
             else ball.state.status is NavStatus.CROSSING)
    ball.run(0.2)
    ball.state = replace(ball.state, last=ball.percept())
    ball.offset = (0.0, -1.0)
    ball.step()
    assert ball.state.reason == 'localisation_jump' and ball.state.recoveries == 1
    # A ball at rest before a crossing does not need to stop.
    assert (ball.state.status is NavStatus.STOPPING) == (not crosses)
    ball.run(10.0, until=lambda ball: ball.state.status is not NavStatus.STOPPING)
    assert ball.state.status is NavStatus.DRIVING and at_rest(ball)


def test_a_position_that_is_not_finite_ends_the_goal_with_the_ball_at_rest(navigator):
    ball = Ball(navigator, *KITCHEN)
    ball.begin(STUDY)
    ball.run(4.0)
    ball.offset = (math.nan, 0.0)
    ball.step()
    ball.offset = (0.0, 0.0)
    ball.run(10.0)
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'not_finite')
    assert at_rest(ball)


def test_a_new_map_is_used_for_planning_after_a_stop(navigator):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.begin((2.9, 2.2))
    ball.run(3.0)
    floor = load_floor('apartment')
    floor.cells[floor.cell_of((2.9, 2.2))] = 2
    ball.state = navigator.with_floor(ball.state, floor)
    assert ball.state.status is NavStatus.STOPPING
    ball.run(20.0)
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'wall') and at_rest(ball)


def test_a_goal_without_arrival_after_the_last_route_fails_with_a_reason_of_its_own(navigator):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.begin((2.9, 2.2))
    ball.state = replace(ball.state, replans=REPLANS_MAX)
    ball.offset = (0.0, 0.4)
    ball.run(20.0)
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'no_arrival')
    assert 'the localisation jumped' in ball.state.message and at_rest(ball)


def test_repeated_changes_of_the_map_do_not_end_the_goal(navigator, monkeypatch):
    monkeypatch.setattr(execution, 'REPLANS_MAX', 1)
    floor = load_floor('apartment')
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.begin((2.9, 2.2))
    for features in (floor.features[1:], floor.features[2:], floor.features[3:]):
        ball.run(0.2)
        ball.state = navigator.with_floor(ball.state, replace(floor, features=features))
        assert ball.state.status is NavStatus.STOPPING
        ball.run(10.0, until=lambda ball: ball.state.status is not NavStatus.STOPPING)
    ball.run(60.0)
    assert ball.state.status is NavStatus.SUCCEEDED, ball.state.message


def test_an_equal_map_does_not_stop_the_ball(navigator, planner):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.begin((2.9, 2.2))
    ball.run(1.0)
    state = ball.state
    assert navigator.with_floor(state, load_floor('apartment')) is state
    assert state.status is NavStatus.DRIVING and navigator.planner is planner


def test_a_new_map_without_the_first_feature_keeps_the_heights_of_the_others(navigator):
    floor = load_floor('apartment')
    state = navigator.begin(NavigationState(
        learned=Learned(heights=((0, 0.02), (2, 0.04)))),
        (2.9, 2.2), Percept(0.0, *KITCHEN, 0.0, 0.0))
    state = navigator.with_floor(state, replace(floor, features=floor.features[1:]))
    assert state.learned.heights == navigator.planner.learned.heights == ((1, 0.04),)


def test_a_ball_without_progress_learns_an_obstacle(navigator):
    ball = Ball(navigator, *KITCHEN)
    ball.begin((2.9, 1.4))
    held = (ball.x + 0.3, 0.0)

    def hold():
        if ball.x > held[0] and ball.y > 1.2:
            ball.x, ball.speed = held[0], 0.0
    for _ in range(400):
        if ball.state.learned.obstacles:
            break
        ball.step()
        hold()
    assert ball.state.reason == 'stuck'
    (x, _), = ball.state.learned.obstacles
    assert x > ball.x


@pytest.mark.parametrize('degrees, direction', [(3.0, -1), (-3.0, 1)])
def test_a_ball_stuck_at_a_mapped_wall_leaves_in_the_other_direction_and_learns_no_obstacle(
        navigator, planner, degrees, direction):
    ball = Ball(navigator, 1.5, 0.05 + planner.ball_radius, math.radians(degrees))
    ball.begin((2.9, 1.4))
    path = Path.of([(1.5, ball.y), (1.5 + direction, ball.y)], direction)
    ball.state = replace(ball.state, path=path, anchor=(0.0, -10.0))
    ball.step()
    assert ball.state.reason == 'stuck' and not ball.state.learned.obstacles
    ball.run(2.0, lambda ball: ball.state.status is NavStatus.DRIVING)
    assert ball.state.segment.direction == -direction


def test_a_ball_beside_the_line_of_a_crossing_backs_off_and_returns_to_the_line(navigator):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.begin(STUDY)
    ball.run(60.0, until=lambda ball: (
        ball.state.segment and ball.state.segment.feature is None
        and ball.state.route.segments[ball.state.index + 1].feature is not None
        and ball.state.path.length - ball.state.along <= SEGMENT_TOLERANCE))
    ball.x += 0.25
    ball.run(10.0, until=lambda ball: ball.state.alignments == 1)
    there, back, crossing = ball.state.route.segments[ball.state.index:ball.state.index + 3]
    assert (there.direction, back.direction) == (-1, 1) and crossing.feature is not None
    assert there.points == back.points[::-1] and back.points[-1] == crossing.points[0]
    ball.run(30.0, until=lambda ball: ball.state.status is NavStatus.CROSSING)
    assert at_rest(ball)
    assert math.dist((ball.x, ball.y), crossing.points[0]) < 0.1


def crossing_ball(navigator, degrees):
    """Return a ball that has turned by an angle since the start of its crossing."""
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: None
    ball.begin(STUDY)
    ball.run(60.0, until=lambda ball: ball.state.status is NavStatus.CROSSING)
    ball.heading += math.radians(degrees)
    ball.state = replace(ball.state, last=None)
    return ball


@pytest.mark.parametrize(('degrees', 'moved', 'begins'), [
    (3.0, True, True), (40.0, True, False), (40.0, False, True)])
def test_only_a_new_attempt_ends_where_no_crossing_may_start(navigator, degrees, moved, begins):
    ball = crossing_ball(navigator, degrees)
    if moved:
        ball.state = replace(ball.state, moving=ball.state.crossing_start + PERIOD)
    ball.step()
    assert (ball.state.status is NavStatus.CROSSING) is begins
    assert ball.state.alignments == (0 if begins else 1)


def test_a_ball_that_is_slow_close_to_the_step_continues(navigator):
    """The pendulum swings back before the touch, and the ball is almost at rest."""
    ball = crossing_ball(navigator, 40.0)
    along = 0.7 * ball.state.segment.crossing.run_up
    ball.y += along
    ball.state = replace(ball.state, along=along, moving=ball.state.crossing_start + PERIOD)
    ball.step()
    assert ball.state.status is NavStatus.CROSSING and ball.state.alignments == 0


def test_a_ball_turned_by_the_edge_stops_and_replans(navigator):
    ball = crossing_ball(navigator, 50.0)
    ball.step()
    assert (ball.state.status, ball.state.reason) == (NavStatus.STOPPING, 'off_path')
    assert ball.state.learned.outcomes == ()


@pytest.mark.parametrize('speed, stops', [(0.5, True), (0.05, False)])
def test_a_ball_that_leaves_the_room_behind_the_step_stops(navigator, speed, stops):
    """The decision does not stop the ball behind a step that it has not observed."""
    ball = crossing_ball(navigator, 0.0)
    segment = ball.state.segment
    (x, y), way = segment.points[-1], (math.cos(segment.heading), math.sin(segment.heading))
    room = navigator.planner.room_ahead((x, y, segment.heading))
    ball.x, ball.y = (at + (room - 0.15) * part for at, part in zip((x, y), way))
    ball.speed = speed
    ball.step()
    assert (ball.state.status is NavStatus.STOPPING) is stops


@pytest.mark.parametrize('speed', [0.05, -0.05])
def test_run_up_and_backing_off_are_steered_towards_the_line(navigator, speed):
    ball = Ball(navigator, *KITCHEN, 1.57)
    ball.crosses = lambda segment: None
    ball.begin(STUDY)
    ball.run(60.0, until=lambda ball: ball.state.status is NavStatus.CROSSING)
    ball.heading += 0.1
    _, turns = navigator.advance(
        replace(ball.state, last=None), ball.percept()._replace(speed=speed))
    assert turns.crosses and turns.yaw_rate < -0.01


@pytest.mark.parametrize('aside, turned, reason', [
    (0.0, 0.6, ''), (0.4, 0.6, ''), (-0.4, -0.6, ''), (0.0, 0.9, 'off_path'),
    (0.75, -0.6, 'off_path'), (0.75, 0.6, ''), (-0.65, 0.6, 'off_path'), (-0.65, -0.6, '')])
def test_a_deviation_triggers_replanning_if_the_ball_would_come_too_close_to_a_wall_or_carpet(
        navigator, aside, turned, reason):
    ball = Ball(navigator, 4.6, 0.9, math.pi / 2.0)
    ball.begin((4.6, 2.2))
    ball.x, ball.heading, ball.speed = ball.x + aside, ball.heading + turned, 0.4
    ball.state = replace(ball.state, last=None)
    ball.step()
    assert ball.state.reason == reason
    assert ball.state.status is (NavStatus.STOPPING if reason else NavStatus.DRIVING)


@pytest.mark.parametrize(('degrees', 'starts'), [(0.0, True), (-20.0, True), (50.0, False)])
def test_planner_and_navigator_agree_whether_a_crossing_can_start_at_a_pose(
        navigator, planner, degrees, starts):
    route = planner.route((*KITCHEN, 1.57), BEDROOM)
    index = next(index for index, segment in enumerate(route.segments) if segment.feature)
    segment = route.segments[index]
    pose = *segment.points[0], segment.heading + math.radians(degrees)
    assert (planner.reached(pose, segment) is not None) is starts
    entered = navigator._enter(
        NavigationState(route=route, goal=BEDROOM), index, Percept(0.0, *pose, 0.0))
    assert (entered.status is NavStatus.CROSSING) is starts


@pytest.mark.parametrize(('degrees', 'starts'), [
    (0.0, True), (-6.0, True), (10.0, False), (-16.0, False)])
def test_a_crossing_starts_only_if_a_route_leads_on_from_its_end(degrees, starts, tmp_path):
    """On a small platform before a door, the ball cannot turn beside the line of the door."""
    path = tmp_path / 'floor.yaml'
    path.write_text(
        'walls: {size: [2.5, 4.4], lines: [[[0, 2.6], [0.7, 2.6]], [[1.8, 2.6], [2.5, 2.6]]]}\n'
        'features: [{kind: level, height: 0.0245, '
        'polygon: [[0.75, 1.4], [1.75, 1.4], [1.75, 2.25], [0.75, 2.25]]}]')
    planner, goal = RoutePlanner(load_floor(path), KNOWLEDGE), (1.2, 3.5)
    route = planner.route((1.2, 0.95, 0.5 * math.pi), goal)
    index, segment = next(item for item in enumerate(route.segments) if item[1].feature)
    pose = *segment.points[0], segment.heading + math.radians(degrees)
    assert planner.reached(pose, segment) is not None
    entered = Navigator(planner, KNOWLEDGE)._enter(
        NavigationState(route=route, goal=goal), index, Percept(0.0, *pose, 0.0))
    assert (entered.status is NavStatus.CROSSING) is starts
    assert (planner.route(pose, goal).segments[0].feature is not None) is starts


def test_a_ball_closer_to_a_wall_than_the_clearance_crosses_only_away_from_it(planner):
    place = 2.55, 3.7
    crossing = next(item for item in planner.route((*KITCHEN, 1.57), BEDROOM).segments
                    if item.feature and item.feature.kind == 'cord')
    assert planner._clear.flat[planner._node(place)] < planner.ball_radius + CLEARANCE
    for turned, free in ((-0.1, True), (0.1, False)):
        assert (planner.reached((*place, turned), crossing._replace(
            points=(place, (3.4, 3.7)), heading=0.0)) is not None) is free


@pytest.mark.parametrize(('turned', 'stops'), [(-0.5, True), (0.5, False)])
def test_a_ball_that_would_have_to_brake_at_a_wall_stops_before_its_deviation_is_large(
        navigator, planner, turned, stops):
    ball = Ball(navigator, *KITCHEN)
    ball.begin(STUDY)
    path = Path.of([(1.0, 0.4), (2.6, 0.4)], 1)
    ball.state = replace(ball.state, path=path, along=0.5, anchor=(0.5, 0.0), last=None)
    _, command = navigator.advance(ball.state, ball.percept()._replace(
        x=1.5, y=0.4, heading=turned, speed=0.3))
    assert (command is REST) is stops


def step_too_high_on_the_map(tmp_path, height_sd, height=0.053):
    path = tmp_path / 'floor.yaml'
    path.write_text('walls: {size: [6, 3], lines: []}\nfeatures:\n- '
                    f'{{kind: step, height: {height}, '
                    f'height_sd: {height_sd}, line: [[3.0, 3.0], [3.0, 0.0]]}}')
    return Ball(Navigator(RoutePlanner(load_floor(path), KNOWLEDGE), KNOWLEDGE), 1.0, 1.5)


def test_a_step_that_may_be_lower_than_on_the_map_is_attempted_without_another_route(tmp_path):
    ball, goal = step_too_high_on_the_map(tmp_path, 0.002), (5.0, 1.5)
    with pytest.raises(RefusedError) as caught:
        ball.navigator.planner.route((1.0, 1.5, 0.0), goal)
    assert caught.value.reason == 'no_route'
    ball.begin(goal)
    ball.run(100.0)
    assert ball.state.status is NavStatus.SUCCEEDED, ball.state.message
    assert not ball.state.learned.heights


def test_a_step_that_is_measured_lower_is_crossed_with_its_measured_height(tmp_path):
    ball, run_ups = step_too_high_on_the_map(tmp_path, 0.002), []

    def cross(segment):
        run_ups.append(segment.crossing.run_up)
        return ball._cross(segment) if len(run_ups) > 1 else CrossingReport(False, 'high', 0.04)
    ball.crosses = cross
    ball.begin((5.0, 1.5))
    ball.run(100.0)
    assert ball.state.status is NavStatus.SUCCEEDED, ball.state.message
    assert dict(ball.state.learned.heights) == {0: 0.04} and run_ups[1] > run_ups[0]


@pytest.mark.parametrize('seen', [True, False])
def test_a_step_that_is_as_high_as_on_the_map_ends_the_goal_before_it(tmp_path, seen):
    ball = step_too_high_on_the_map(tmp_path, 0.002)
    ball.crosses = lambda segment: CrossingReport(False, 'too high', 0.0535)
    ball.begin((5.0, 1.5))
    while not ball.state.status.ended:
        ball.faces = ((3.0 - ball.x, 0.0535),) if seen and ball.speed > 0.05 else ()
        ball.step()
        assert ball.time < 100.0
    assert (ball.state.status, ball.state.reason) == (NavStatus.FAILED, 'no_route')
    assert dict(ball.state.learned.heights) == {0: 0.0535} and at_rest(ball)


@pytest.mark.parametrize('height_sd, height', [(0.0, 0.053), (0.002, 0.06), (0.001, 0.2)])
def test_a_step_that_is_certainly_too_high_is_not_attempted(tmp_path, height_sd, height):
    ball = step_too_high_on_the_map(tmp_path, height_sd, height)
    with pytest.raises(RefusedError) as caught:
        ball.begin((5.0, 1.5))
    assert caught.value.reason == 'no_route'
