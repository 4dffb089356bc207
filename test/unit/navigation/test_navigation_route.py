# SPDX-License-Identifier: Apache-2.0
"""Routes: their run-ups, their optimality against an exhaustive search, and refusals."""
from contextlib import suppress
from dataclasses import replace
import math
import re

from hypothesis import example, given, settings, strategies
import numpy as np
from PIL import Image
import pytest

from ballbot_ros.crossing import max_step_heights, rolling
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import Knowledge, load_curve, load_decision_tuning
from ballbot_ros.errors import ConfigurationError, RefusedError
from ballbot_ros.floors import load_floor
from ballbot_ros.floors.floor import distance_to_segment, Floor, Heights, inside, read_map
from ballbot_ros.floors.profile import crossed, cut
from ballbot_ros.navigation import Capability, RoutePlanner, write_masks
from ballbot_ros.navigation.capability import RUN_UPS
from ballbot_ros.navigation.lattice import cells_around, COUNT, LEVELS
from ballbot_ros.navigation.learned import Learned
from ballbot_ros.navigation.route import (
    BACKWARD_SPEED, CLEARANCE, HEADING_DEVIATION_MAX, REVERSAL_TIME)
from ballbot_ros.navigation.sensing import FACE_HEIGHT_MIN
from ballbot_ros.physics import load_robot

TUNING = load_decision_tuning('decision_default')
KNOWLEDGE = Knowledge(load_robot('gimball'), load_curve('gimball_down'), TUNING)
KITCHEN, STUDY, BEDROOM, BATH = (1.7, 1.4), (1.8, 5.5), (5.3, 5.8), (8.1, 5.5)


@pytest.fixture(scope='module')
def flat():
    return RoutePlanner(load_floor('apartment'), KNOWLEDGE)


@pytest.fixture(scope='module')
def capability():
    return Capability(KNOWLEDGE)


def planner_of(tmp_path, features, size=(4, 4), lines='[]'):
    path = tmp_path / 'floor.yaml'
    path.write_text(f'walls: {{size: {list(size)}, lines: {lines}}}\nfeatures:\n'
                    + ''.join(f'  - {feature}\n' for feature in features))
    return RoutePlanner(load_floor(path), KNOWLEDGE)


def choices(capability, faces, height_sd, longest, room):
    """Return the possible crossings with run-ups up to `longest`."""
    found = (capability.crossing(faces, height_sd, run_up, room)
             for run_up in RUN_UPS if run_up <= longest)
    return [item for item in found if item is not None]


def test_higher_steps_require_longer_run_ups(capability):
    run_ups = [choices(capability, [(0.0, height)], 0.001, 3.0, 3.0)[0].run_up
               for height in (0.015, 0.03, 0.04, 0.045)]
    assert run_ups == sorted(run_ups) and run_ups[-1] >= 2.0 * run_ups[0]


def test_a_step_of_45_mm_requires_a_run_up_between_half_a_metre_and_one_and_a_half(capability):
    assert not choices(capability, [(0.0, 0.045)], 0.001, 0.5, 3.0)
    best = choices(capability, [(0.0, 0.045)], 0.001, 1.5, 3.0)[-1]
    assert best.probability >= TUNING.required_probability and best.run_up <= 1.5


def test_a_stored_table_is_used_for_its_robot_only_and_heights_are_rounded_up(
        capability, tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    first = Capability(KNOWLEDGE)
    found = choices(first, [(0.0, 0.0195)], 0.001, 1.0, 1.0)
    first.keep()
    monkeypatch.setattr(Capability, '_search', lambda *_: None)
    assert choices(Capability(KNOWLEDGE), [(0.0, 0.02)], 0.0009, 1.0, 1.0) == found != []
    other = replace(KNOWLEDGE, tuning=replace(TUNING, required_probability=0.8))
    assert choices(Capability(other), [(0.0, 0.02)], 0.001, 1.0, 1.0) == []


@pytest.mark.slow
def test_an_entry_does_not_depend_on_earlier_entries(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    after, alone = Capability(KNOWLEDGE), Capability(KNOWLEDGE)
    choices(after, [(0.0, 0.02)], 0.001, 0.5, 1.0)
    assert choices(after, [(0.0, 0.04)], 0.001, 1.0, 1.0) \
        == choices(alone, [(0.0, 0.04)], 0.001, 1.0, 1.0) != []


def test_no_step_is_crossed_without_room_behind_it(capability):
    assert not choices(capability, [(0.0, 0.02)], 0.001, 3.0, 0.2)


@pytest.mark.slow
def test_more_room_behind_a_step_excludes_no_run_up(capability):
    run_ups = [{item.run_up for item in choices(capability, [(0.0, 0.0375)], 0.002, 1.0, room)}
               for room in (0.6, 0.8, 1.0, 1.3, 1.7, 2.1, 2.5)]
    assert all(less <= more for less, more in zip(run_ups, run_ups[1:])) and run_ups[-1]


def test_after_a_failure_a_crossing_is_planned_with_a_longer_run_up(tmp_path):
    planner, ends = planner_of(tmp_path, [
        '{kind: step, line: [[2.5, 4.0], [2.5, 0.0]], height: 0.02}'], (5, 4)), (
            (1.0, 2.0), (3.8, 2.0))

    def run_up():
        segments = planner.route(*ends).segments
        return next(item.crossing.run_up for item in segments if item.crossing)
    shortest = run_up()
    planner.learn(Learned().with_outcome(0, 1, shortest, False))
    assert run_up() > shortest
    planner.learn(Learned())
    assert run_up() == shortest


def test_a_run_up_longer_than_the_distance_of_all_states_starts_behind_the_last_one(tmp_path):
    x = 1.27
    planner = planner_of(tmp_path, [
        f'{{kind: step, line: [[{x}, 2.0], [{x}, 0.0]], height: 0.041}}'], (5.5, 2))
    segments = planner.route((0.77, 1.0, 0.0), (x + 1.5, 1.0)).segments
    index = next(index for index, item in enumerate(segments) if item.crossing)
    crossing, before = segments[index], segments[index - 1]
    touch = touch_distance(planner.ball_radius, 0.041)
    assert x - touch - crossing.points[0][0] == pytest.approx(crossing.crossing.run_up, abs=0.005)
    assert before.direction == -1 and before.points[-1] == crossing.points[0]


def test_the_bedroom_is_reached_with_a_run_up_that_starts_in_the_living_room(flat):
    route = flat.route(KITCHEN, BEDROOM)
    step = [segment for segment in route.segments
            if segment.feature is not None and segment.feature.name == 'bedroom step']
    # The hall starts at y = 2.8 m, behind the living room.
    assert len(step) == 1 and step[0].points[0][1] < 2.8 and step[0].points[1][1] > 4.0
    assert 'bedroom step' in flat.explain(route, KITCHEN, BEDROOM)


def test_times_and_probabilities_add_up(flat):
    route = flat.route(KITCHEN, BATH)
    assert route.time == pytest.approx(sum(segment.time for segment in route.segments))
    crossings = [segment.crossing for segment in route.segments if segment.crossing]
    assert route.probability == pytest.approx(
        math.prod(crossing.eventual for crossing in crossings))
    assert route.probability >= TUNING.required_probability
    for one, two in zip(route.segments, route.segments[1:]):
        assert one.points[-1] == pytest.approx(two.points[0])


@pytest.mark.parametrize('degrees', [-2.0, 2.0])
def test_planned_crossings_tolerate_errors_of_the_heading(flat, degrees):
    segments = flat.route(KITCHEN, BEDROOM).segments
    for segment in (item for item in segments if item.feature):
        pose = *segment.points[0], segment.heading + math.radians(degrees)
        assert flat.reached(pose, segment) is not None


def test_the_time_of_a_crossing_contains_that_of_further_attempts(flat):
    segment = next(item for item in flat.route(KITCHEN, BEDROOM).segments
                   if item.feature and item.crossing.probability < 0.99)
    once, failing = segment.crossing.time, 1.0 - segment.crossing.probability
    assert segment.time > once * (1.0 + failing)


def test_the_probability_of_a_route_contains_further_attempts_after_a_failure(
        capability, flat):
    for crossing in choices(capability, [(0.0, 0.0425)], 0.001, 2.4, 2.5):
        assert crossing.probability < crossing.eventual < 1.0
    # The first attempts alone are not sufficient.
    route = flat.route(STUDY, BATH)
    once = math.prod(item.crossing.probability for item in route.segments if item.crossing)
    assert once < TUNING.required_probability <= route.probability


def test_a_route_back_descends_the_steps(flat):
    names = [segment.feature.name for segment in flat.route(BATH, KITCHEN).segments
             if segment.feature]
    assert names[:2] == ['bathroom step', 'bedroom step']


@pytest.mark.parametrize('width', [0.2, 0.3])
def test_a_strip_without_room_between_its_edges_is_not_crossed_as_one_step(width, tmp_path):
    planner = planner_of(tmp_path, [
        '{kind: carpet, height: 0.03, '
        f'polygon: [[2.0, 0.0], [{2 + width}, 0.0], [{2 + width}, 4.0], [2.0, 4.0]]}}'])
    with pytest.raises(RefusedError) as caught:
        planner.route((0.8, 2.0), (3.3, 2.0))
    assert caught.value.reason == 'no_route'


@pytest.mark.parametrize('joints', [1, 8])
def test_intermediate_points_of_a_straight_step_do_not_change_the_route(joints, tmp_path):
    def time(points):
        planner = planner_of(tmp_path, [f'{{kind: step, line: {points}, height: 0.02}}'])
        return planner.route((0.8, 2.0), (3.3, 2.0)).time
    straight = time([[2.0, 4.0], [2.0, 0.0]])
    jointed = time([[2.0, 4.0 - 4.0 * index / (joints + 1)] for index in range(joints + 2)])
    # The positions of crossings have a spacing of 0.2 m, and shift with the joints.
    assert jointed == pytest.approx(straight, abs=0.2 / TUNING.cruise_speed)


@pytest.mark.parametrize(('height', 'degrees', 'aligned'), [
    (0.008, 30.0, True), (0.008, 60.0, False), (0.042, 2.0, True), (0.042, 30.0, False)])
def test_the_height_of_a_step_limits_the_angle_at_the_start_of_its_crossing(
        height, degrees, aligned, tmp_path):
    planner = planner_of(tmp_path, [
        f'{{kind: step, line: [[2.2, 4.0], [2.2, 0.0]], height: {height}}}'])
    segments = planner.route((0.8, 2.0), (3.3, 2.0)).segments
    segment = next(item for item in segments if item.feature)
    pose = *segment.points[0], segment.heading + math.radians(degrees)
    assert (planner.reached(pose, segment) is not None) is aligned


@settings(max_examples=25, deadline=None)
@given(strategies.tuples(*[strategies.floats(0.3, 8.7), strategies.floats(0.3, 6.7)] * 2))
@example((8.0, 4.25, 1.0, 1.0))
@example((8.0, 2.5, 1.0, 1.0))
def test_no_route_comes_near_stairs_or_through_walls(flat, ends):
    try:
        route = flat.route(ends[:2], ends[2:])
    except RefusedError as error:
        assert error.reason in ('wall', 'feature', 'no_route', 'improbable')
        return
    assert route.time >= (math.dist(ends[:2], ends[2:]) - 0.3) / 1.2
    if not route.segments:
        assert math.dist(ends[:2], ends[2:]) < 0.3
        return
    stairs = next(item for item in flat.floor.features if item.kind == 'stairs')
    points = np.concatenate([np.linspace(one, two, 20) for one, two in zip(
        route.points, route.points[1:])])
    near = min(distance_to_segment(*points.T, *segment).min() for segment in stairs.segments)
    # A cell of the search is 0.1 m; a ball that starts closer must not come even closer.
    start = min(distance_to_segment(*ends[:2], *segment) for segment in stairs.segments)
    assert near > min(flat.drop_distance - 0.08, start - 0.01)
    for x, y in points:
        assert flat.floor.cells[flat.floor.cell_of((x, y))] == 0


@pytest.mark.parametrize('heading', [-1, 0, 5])
@pytest.mark.parametrize('whole', [True, False])
def test_the_heuristic_is_consistent_and_contains_the_time_of_turns(heading, whole, tmp_path):
    planner = planner_of(
        tmp_path, ['{kind: step, line: [[1.6, 0.05], [1.6, 2.95]], height: 0.01}'], (5, 3),
        '[[[3.2, 1.8], [3.2, 3.0]]]')
    moves, slowness, goal = planner._moves, planner._slowness.ravel(), planner._node((4.3, 2.0))
    start = COUNT * planner._node((0.7, 1.0))
    # No path leads to the corner of the grid: it makes the result exact for all states.
    far = planner._far(goal, heading, planner._slowness, np.array([0 if whole else start]))
    assert far[COUNT * goal + max(heading, 0)] == 0.0
    cells = np.flatnonzero(np.isfinite(slowness))
    for move, (end, way, time) in enumerate(zip(moves.ends, moves.cells, moves.times)):
        before = COUNT * cells + move * COUNT // len(moves.ends)
        most = slowness.take(cells[:, None] + way, mode='clip').max(axis=1)
        bound = time * most + far.take(before + end, mode='clip')
        assert (far[before] <= bound + 1e-9)[np.isfinite(most)].all()
    starts, ends, times, _ = planner._arc_arrays
    assert len(starts) and (far[starts] <= times + far[ends] + 1e-9).all()
    if whole:
        # A ball that faces away from the goal turns, or drives backward.
        assert far[start + COUNT // 2] > far[start] + 1.0


def exhaustive(planner, start, goal):
    """Return the least time over all states and risk levels, by Dijkstra's algorithm [s]."""
    from scipy import sparse
    from scipy.sparse import csgraph
    rows, columns = planner._slowness.shape
    layers = LEVELS + 1
    states = rows * columns * COUNT
    begins, ends, weights = [], [], []
    for row, column in zip(*np.nonzero(np.isfinite(planner._slowness))):
        for number, item in enumerate(planner._rows):
            cells = np.add(cells_around(item.points), (row, column))
            if (cells < 0).any() or (cells >= (rows, columns)).any():
                continue
            slowness = planner._slowness[tuple(cells.T)].max()
            if not math.isfinite(slowness):
                continue
            one = (row * columns + column) * COUNT + item.start
            two = ((row + item.row) * columns + column + item.column) * COUNT + item.end
            for before in (1, -1):
                begins.append((1 - before) // 2 * states + one)
                ends.append((1 - item.direction) // 2 * states + two)
                weights.append(planner._moves.times[number] * slowness
                               + REVERSAL_TIME * (before != item.direction))
    begins, ends, weights = (np.array(item) for item in (begins, ends, weights))
    all_begins = [begins + 2 * states * layer for layer in range(layers)]
    all_ends = [ends + 2 * states * layer for layer in range(layers)]
    all_weights = [weights] * layers
    for one, two, time, level in zip(*planner._arc_arrays):
        for layer in range(layers - level):
            for side in (0, 1):
                all_begins.append([2 * states * layer + side * states + one])
                all_ends.append([2 * states * (layer + level) + two])
                all_weights.append([time])
    graph = sparse.csr_matrix(
        (np.concatenate(all_weights), (np.concatenate(all_begins), np.concatenate(all_ends))),
        shape=(2 * states * layers,) * 2)
    first, costs, _ = planner._starts(start, (1, -1))
    last = planner._node(goal)
    best = math.inf
    for state, cost in zip(first, costs):
        far = csgraph.dijkstra(graph, indices=state).reshape(layers, 2, -1, COUNT)
        best = min(best, cost + far[:, :, last].min())
    return best


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
def test_no_path_on_the_lattice_is_faster_than_the_route(seed, tmp_path, monkeypatch):
    monkeypatch.setattr('ballbot_ros.navigation.route.LEVELS', 4)
    monkeypatch.setattr(f'{__name__}.LEVELS', 4)
    random = np.random.default_rng(seed)
    features = [
        f'{{kind: step, line: [[{x}, 0.05], [{x}, 2.95]], height: {random.uniform(0.008, 0.03)}}}'
        for x in (1.6, 3.2)]
    planner = planner_of(tmp_path, features, (5, 3), '[[[1.6, 1.8], [1.6, 3.0]]]')
    start, goal = (0.7, 1.0, 0.3), (4.3, random.uniform(0.8, 2.2))
    states, costs, slowness = planner._starts(start, (1, -1))
    monkeypatch.setattr(planner, '_starts', lambda *_: (
        states[:1], costs[:1], slowness))
    least = exhaustive(planner, start, goal)
    if not math.isfinite(least):
        with pytest.raises(RefusedError):
            planner.route(start, goal)
        return
    found = planner.route(start, goal).time
    # The time of a route does not include the offset of its start from the lattice.
    assert least - costs[0] - 1e-6 <= found <= 1.05 * least


@pytest.mark.parametrize('place, reason', [
    ((0.1, 3.0), 'wall'), ((100.0, 3.0), 'off_map'), ((math.nan, 3.0), 'not_finite'),
    ((5.5, 4.0), 'feature'), ((8.0, 3.4), 'feature')])
def test_impossible_positions_are_refused(flat, place, reason):
    with pytest.raises(RefusedError) as caught:
        flat.route(KITCHEN, place)
    assert (caught.value.reason, caught.value.field) == (reason, 'goal')
    with pytest.raises(RefusedError) as caught:
        flat.route(place, KITCHEN)
    assert (caught.value.reason, caught.value.field) == (reason, 'start')


@pytest.mark.parametrize('height, beside, refused', [
    (0.03, 0.0, True), (0.03, 0.18, True), (0.03, 0.22, False), (0.012, 0.0, False)])
def test_a_start_on_a_bar_is_refused_over_its_width_unless_the_bar_is_low(
        height, beside, refused, tmp_path):
    planner = planner_of(tmp_path, [
        f'{{kind: threshold, line: [[2.0, 4.0], [2.0, 0.0]], height: {height}, width: 0.3}}'])
    start, goal = (2.0 + beside, 2.0, 0.0), (3.3, 2.0)
    if refused:
        with pytest.raises(RefusedError) as caught:
            planner.route(start, goal)
        assert (caught.value.reason, caught.value.field) == ('feature', 'start')
    else:
        assert not any(segment.feature for segment in planner.route(start, goal).segments)


def test_unknown_space_is_not_a_goal(tmp_path):
    shades = np.full((60, 60), 255, np.uint8)
    shades[:, 40:] = 128
    Image.fromarray(shades).save(tmp_path / 'plan.pgm')
    (tmp_path / 'plan.yaml').write_text('image: plan.pgm\nresolution: 0.05\n'
                                        'origin: [0.0, 0.0, 0.0]\n')
    (tmp_path / 'floor.yaml').write_text('map: plan.yaml')
    planner = RoutePlanner(load_floor(tmp_path / 'floor.yaml'), KNOWLEDGE)
    with pytest.raises(RefusedError) as caught:
        planner.route((1.0, 1.0), (2.5, 1.0))
    assert caught.value.reason == 'unknown'


def test_without_a_route_the_message_names_the_step_that_lacks_run_up(tmp_path):
    planner = planner_of(
        tmp_path, ['{kind: step, name: sill, line: [[1.2, 4.0], [1.2, 0.0]], height: 0.047}'])
    with pytest.raises(RefusedError) as caught:
        planner.route((0.7, 2.0), (3.3, 2.0))
    assert caught.value.reason == 'no_route' and 'sill' in str(caught.value)
    # Down a lower step the ball needs no run-up: 0.85 m suffice to stop behind it.
    lower = planner_of(
        tmp_path, ['{kind: step, name: sill, line: [[1.2, 4.0], [1.2, 0.0]], height: 0.02}'])
    assert lower.route((3.3, 2.0), (0.7, 2.0)).segments


def test_a_higher_required_probability_gives_longer_run_ups_or_a_refusal(tmp_path):
    features = ['{kind: step, line: [[2.0, 4.0], [2.0, 0.0]], height: 0.045}']
    usual = planner_of(tmp_path, features).route((0.8, 2.0), (3.3, 2.0))
    careful = replace(KNOWLEDGE, tuning=replace(TUNING, required_probability=0.98))
    try:
        route = RoutePlanner(load_floor(tmp_path / 'floor.yaml'), careful).route(
            (0.8, 2.0), (3.3, 2.0))
    except RefusedError as error:
        assert error.reason == 'no_route'
        return
    assert route.probability >= 0.98 > usual.probability or route.time >= usual.time


def test_masks_keep_nav2_out_of_steps_and_slow_it_near_stairs(flat, tmp_path):
    files = {path.name for path in write_masks(flat, tmp_path)}
    assert files == {f'{name}{end}' for name in ('keepout', 'speed')
                     for end in ('_mask.pgm', '_mask.yaml', '_filter_info.yaml')}
    floor = flat.floor
    keep_out = np.asarray(Image.open(tmp_path / 'keepout_mask.pgm'))[::-1]
    speed = np.asarray(Image.open(tmp_path / 'speed_mask.pgm'))[::-1]
    assert keep_out.shape == floor.cells.shape
    assert keep_out[floor.cell_of((5.5, 4.0))] == 0  # the bedroom step: occupied
    assert keep_out[floor.cell_of((5.5, 3.4))] == 255
    # No limit far from the stairs, and a lower speed closer to them.
    limits = [255 - int(speed[floor.cell_of((x, 3.4))]) for x in (4.0, 7.2, 7.4)]
    assert limits[0] == 0 and limits[1] > limits[2] > 0


def test_masks_lie_on_the_map_far_from_its_origin(tmp_path):
    corner, resolution = (450123.456, 6543216.7), 1.0 / 30.0
    floor = Floor('hall', np.zeros((60, 60), np.uint8), resolution, corner, ())
    for path in write_masks(RoutePlanner(floor, KNOWLEDGE), tmp_path):
        if path.name.endswith('mask.yaml'):
            assert read_map(path)[1:] == (resolution, corner)


def test_a_keep_out_mask_leaves_foot_and_top_of_a_ramp_open(tmp_path):
    planner = planner_of(tmp_path, [PLATFORM, RAMP.format(3.5)], (9, 5))
    write_masks(planner, tmp_path)
    mask = np.asarray(Image.open(tmp_path / 'keepout_mask.pgm'))[::-1]
    assert [int(mask[planner.floor.cell_of(place)]) for place in (
        (3.5, 2.7), (4.5, 2.7), (5.5, 2.7), (5.5, 1.0), (5.0, 2.0))] == [255, 255, 255, 0, 0]


def test_a_start_close_to_a_wall_is_not_reported_as_separated_from_the_goal(flat):
    # The ball is in a corner, with one wall in front and the other behind.
    with pytest.raises(RefusedError) as caught:
        flat.route((3.673, 4.423, -0.831), (1.98, 3.54))
    assert caught.value.reason == 'no_route' and 'turn' in str(caught.value)


def test_a_start_from_which_no_state_is_reached_is_refused(flat):
    # No free cell around the ball is close enough to its line.
    with pytest.raises(RefusedError) as caught:
        flat.route((5.67, 0.41, -0.37), KITCHEN)
    assert caught.value.reason == 'no_route'


def test_the_distance_kept_from_a_step_depends_on_its_measured_height(tmp_path):
    planner = planner_of(tmp_path, ['{kind: step, line: [[2.0, 4.0], [2.0, 0.0]], height: 0.05}'])
    beside = (1.84, 2.0)
    with pytest.raises(RefusedError) as caught:
        planner.check_goal(beside)
    assert caught.value.reason == 'feature'
    planner.learn(Learned(heights=((0, 0.008),)))
    planner.check_goal(beside)


@pytest.mark.parametrize('learned', [
    Learned(), Learned(heights=((0, 0.012),)), Learned(obstacles=((2.9, 5.6),)),
    Learned(obstacles=((7.4, 1.2), (0.4, 6.5))), Learned().with_outcome(1, 1, 0.5, False)])
def test_routes_do_not_depend_on_earlier_learned_data(learned, flat):
    def times(planner):
        return [planner.route(KITCHEN, goal).time for goal in (STUDY, BEDROOM)]
    flat.learn(Learned(heights=((1, 0.011),), obstacles=((6.5, 3.4), (3.2, 1.1))))
    flat.learn(learned)
    try:
        assert times(flat) == times(RoutePlanner(flat.floor, KNOWLEDGE, learned))
    finally:
        flat.learn(Learned())


def test_descents_are_computed_for_the_shortest_run_up_only(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    computed, search = [], Capability._search
    monkeypatch.setattr(Capability, '_search', lambda *arguments: (
        computed.append(arguments), search(*arguments))[1])
    planner_of(tmp_path, ['{kind: step, line: [[2.5, 4.0], [2.5, 0.0]], height: 0.02}'], (5, 4))
    descents = [item for item in computed if item[1][0][1] < 0.0]
    assert {item[3] for item in descents} == {RUN_UPS[0]}


def test_an_obstacle_behind_a_step_limits_the_room_for_its_crossing(tmp_path):
    planner = planner_of(tmp_path, [
        '{kind: step, line: [[2.0, 2.0], [2.0, 0.0]], height: 0.046}'], (5, 2))
    start, goal = (0.7, 1.0, 0.0), (2.45, 1.0)
    assert planner.route(start, goal).segments
    planner.learn(Learned(obstacles=tuple((2.75, 0.2 + 0.2 * index) for index in range(9))))
    with pytest.raises(RefusedError) as caught:
        planner.route(start, goal)
    assert caught.value.reason == 'no_route'


@pytest.mark.parametrize('heading', [0.0, 0.5])
def test_a_route_that_starts_at_an_obstacle_does_not_come_closer_to_it(flat, heading):
    here = 1.75, 1.4
    obstacle, goal = ((here[0] + ahead * math.cos(heading), here[1] + ahead * math.sin(heading))
                      for ahead in (flat.ball_radius + CLEARANCE, 1.0))
    flat.learn(Learned(obstacles=(obstacle,)))
    try:
        assert flat.route((*here, heading), goal).segments[0].direction == -1
    finally:
        flat.learn(Learned())


def test_a_route_that_starts_near_a_wall_follows_the_heading_and_does_not_approach_it(flat):
    turned = []
    for heading in np.arange(-math.pi, math.pi, 0.2):
        for place in ((0.32, 1.4), (0.6, 2.5)):
            with suppress(RefusedError):
                first = flat.route((*place, heading), (1.8, 1.0)).segments[0]
                (x0, y0), (x1, y1) = first.points[:2]
                course = math.atan2(y1 - y0, x1 - x0) + (math.pi if first.direction < 0 else 0.0)
                turned.append(abs(math.remainder(course - heading, 2.0 * math.pi)))
                # The accuracy of the map is half a cell.
                assert min(map(flat.clearance, first.points)) \
                    > min(flat.clearance(place), CLEARANCE) - 0.026
    assert len(turned) > 30
    assert max(turned) <= HEADING_DEVIATION_MAX


@pytest.mark.parametrize('degrees', [3.0, -3.0, 177.0, -177.0])
@pytest.mark.parametrize('goal', [(0.6, 1.5), (2.5, 1.5)])
def test_a_route_from_contact_with_a_wall_starts_away_from_it(flat, goal, degrees):
    pose = 1.5, 0.05 + flat.ball_radius, math.radians(degrees)
    first = flat.route(pose, goal).segments[0]
    # The route starts forward if the heading points away from the wall.
    assert first.direction == math.copysign(1, degrees)
    assert first.direction * (first.points[-1][0] - pose[0]) * math.cos(pose[2]) > 0.0


def test_a_route_out_of_a_narrow_passage_starts_at_the_ball_and_crosses_no_edge(flat):
    here = (2.45, 3.71, math.radians(-9.6))  # closer to the wall than a route may be
    route = flat.route(here, (5.5, 5.5))
    assert math.dist(route.segments[0].points[0], here[:2]) < 0.1
    free = [segment.points for segment in route.segments if segment.feature is None]
    for points in free:
        for one, two in zip(points, points[1:]):
            assert not crossed(flat.floor, one, two)
    for before, after in zip(route.segments, route.segments[1:]):
        assert math.dist(before.points[-1], after.points[0]) < 1e-9


@pytest.mark.slow
def test_a_route_refused_for_its_product_of_probabilities_has_a_reason_of_its_own(tmp_path):
    # Between the steps there is room for one metre of run-up.
    steps = (3.0, 4.6, 6.2, 7.8, 9.4)
    planner = planner_of(tmp_path, [
        f'{{kind: step, line: [[{x}, 4.0], [{x}, 0.0]], height: 0.049}}' for x in steps],
        size=(11, 4))
    for x in steps:
        assert planner.route((x - 0.8, 2.0), (x + 0.7, 2.0)).segments
    with pytest.raises(RefusedError) as caught:
        planner.route((1.5, 2.0), (10.1, 2.0))
    assert (caught.value.reason, caught.value.field) == ('improbable', 'goal')


def test_a_curve_of_another_robot_is_refused():
    with pytest.raises(ConfigurationError) as caught:
        RoutePlanner(load_floor('apartment'), replace(
            KNOWLEDGE, curve=load_curve('shellball_free')))
    assert (caught.value.reason, caught.value.field) == ('inconsistent', 'curve')


# A platform of 100 mm, and a ramp to it that starts at a given x.
PLATFORM = ('{kind: level, name: platform, polygon: [[5.5, 0], [9, 0], [9, 5], [5.5, 5]], '
            'height: 0.1}')
RAMP = ('{{kind: ramp, name: ramp, polygon: [[{0}, 2], [5.5, 2], [5.5, 3.4], [{0}, 3.4]], '
        'line: [[{0}, 2.7], [5.5, 2.7]], height: 0.1}}')


def heights_along(planner, route):
    """Return the height of the highest face on a route [m]."""
    heights = []
    for segment in route.segments:
        for one, two in zip(segment.points, segment.points[1:]):
            if math.dist(one, two) > 1e-6:
                heights += [abs(edge.height) for edge in cut(planner.floor, one, math.atan2(
                    two[1] - one[1], two[0] - one[0])).edges
                    if 0.0 <= edge.distance <= math.dist(one, two)]
    return max(heights, default=0.0)


@pytest.mark.parametrize('start, goal', [
    ((1.5, 1.0, 0.0), (7.5, 1.5)), ((7.5, 3.5), (1.5, 4.0)), ((1.5, 4.5), (7.0, 4.0))])
def test_a_route_leads_over_a_ramp_from_foot_to_top(tmp_path, start, goal):
    planner = planner_of(tmp_path, [PLATFORM, RAMP.format(3.5)], (9, 5))
    route = planner.route(start, goal)
    assert all(segment.feature is None for segment in route.segments)
    assert heights_along(planner, route) < 0.004
    assert any(inside(*point, planner.floor.features[1].polygon) for point in route.points)


def test_a_route_keeps_the_stopping_distance_from_the_high_sides_of_a_ramp(tmp_path):
    planner = planner_of(tmp_path, [PLATFORM, RAMP.format(3.5)], (9, 5))
    points = planner.route((1.5, 1.0), (7.5, 1.5)).points
    side = ((4.6, 2.0), (5.5, 2.0))  # more than 50 mm high
    assert min(float(distance_to_segment(*point, *side)) for point in points) \
        > planner.drop_distance - 0.05
    assert planner.clearance((5.2, 2.1)) < 0.0 < planner.clearance((5.2, 2.7))


def test_the_outline_of_a_level_along_a_wall_is_ignored(tmp_path):
    """The room on the right is 60 mm lower; its outline is drawn along the walls."""
    room = '{kind: level, polygon: [[4, 0], [8, 0], [8, 4], [4, 4]], height: -0.06}'
    hall = '{kind: level, polygon: [[0, 0], [4, 0], [4, 4], [0, 4]], height: 0.06}'
    for level, x in ((room, 2.0), (hall, 2.0)):
        planner = planner_of(tmp_path, [level], (8, 4), '[[[4, 0], [4, 1.5]], [[4, 2.5], [4, 4]]]')
        planner.check_goal((x, 0.4))
        planner.check_goal((0.4, 2.0))
        planner.check_goal((3.6, 0.5))  # at the wall between the rooms
        with pytest.raises(RefusedError):
            planner.check_goal((3.6, 2.0))  # at the upper side of the door


def test_a_measured_height_is_more_certain_than_the_one_of_the_map(tmp_path):
    """The map has 40 +- 20 mm, which is too uncertain for the available run-up."""
    step = '{kind: step, name: door, line: [[2.5, 4], [2.5, 0]], height: 0.04, height_sd: 0.02}'
    planner = planner_of(tmp_path, [step], (4, 4))
    ends = (0.8, 2.0, 0.0), (3.5, 2.0)
    with pytest.raises(RefusedError):
        planner.route(*ends)
    planner.learn(Learned(heights=((0, 0.04),)))
    assert planner.route(*ends).probability >= TUNING.required_probability


def test_a_refusal_names_the_run_up_and_the_room_of_one_place(tmp_path):
    """The left has more run-up and no room behind, the right less run-up and some room."""
    bar = '{kind: threshold, name: bar, line: [[3, 2.4], [1, 2.4]], height: 0.025, width: 0.05}'
    lines = '[[[1, 2.3], [1, 2.7]], [[3, 0.6], [3, 2.7]], [[1, 2.75], [2, 2.75]], ' \
        '[[2, 0.6], [3, 0.6]], [[2, 3.55], [4, 3.55]], [[2, 2.75], [2, 3.55]]]'
    planner = planner_of(tmp_path, [bar], (4, 4), lines)
    with pytest.raises(RefusedError) as refusal:
        planner.route((1.5, 1.0, 0.5 * math.pi), (3.4, 3.15))
    assert refusal.value.reason == 'no_route'
    assert '0.00 m' not in str(refusal.value)


def test_a_refusal_names_no_ramp_whose_side_the_shortest_path_passes(tmp_path):
    """Cells of the lattice on both sides of the low part of a ramp's side are neighbours."""
    area = 'polygon: [[{0}, 1.09], [{1}, 1.09], [{1}, 2.09], [{0}, 2.09]], height: 0.012'
    planner = planner_of(tmp_path, [
        '{kind: step, name: sill, line: [[0, 2.9], [4.5, 2.9]], height: 0.048}',
        f'{{kind: level, {area.format(0, 2.6)}}}',
        f'{{kind: ramp, name: ramp, {area.format(2.6, 4)}, line: [[4, 2], [2.6, 2]]}}'],
        (4.5, 4.2))
    with pytest.raises(RefusedError) as refusal:
        planner.route((2.5, 3.6), (3.2, 0.4))
    assert 'sill' in str(refusal.value) and 'ramp' not in str(refusal.value)


def test_a_refusal_names_the_door_before_which_the_ball_cannot_turn(tmp_path):
    """A platform before the door leaves less run-up than the ball requires to turn there."""
    planner = planner_of(tmp_path, [
        '{kind: threshold, name: door, line: [[1.5, 2], [2.5, 2]], height: 0.006, width: 0.05}',
        '{kind: level, polygon: [[0.6, 2.6], [3.4, 2.6], [3.4, 3.5], [0.6, 3.5]], height: 0.02}'],
        (4, 5), '[[[0, 2], [1.5, 2]], [[2.5, 2], [4, 2]]]')
    with pytest.raises(RefusedError) as refusal:
        planner.route((2.0, 4.2), (2.0, 0.8))
    assert 'cannot turn in the space between start, ' in str(refusal.value)
    # The run-up before the door and the room behind it are sufficient.
    assert 'door' in str(refusal.value) and 'run-up' not in str(refusal.value)


@pytest.mark.parametrize(('edge', 'start', 'goal', 'lacks', 'suffices'), [
    (0.9, (0.45, 2.0), (4.0, 2.0), 'run-up', 'room'),
    (4.2, (1.0, 2.0), (4.6, 2.0), 'room behind it', 'run-up')])
def test_a_refusal_names_only_what_a_crossing_lacks(
        edge, start, goal, lacks, suffices, tmp_path):
    planner = planner_of(
        tmp_path, [f'{{kind: step, line: [[{edge}, 4], [{edge}, 0]], height: 0.03}}'], (5, 4))
    with pytest.raises(RefusedError) as refusal:
        planner.route(start, goal)
    assert f'm of {lacks}, but ' in str(refusal.value) and suffices not in str(refusal.value)


HIGH = '{kind: step, line: [[2.0, 4.0], [2.0, 0.0]], height: 0.06}'
PODIUM = '{kind: level, polygon: [[2, 0], [4, 0], [4, 4], [2, 4]], height: 0.06}'
PIT = '{kind: level, polygon: [[2, 0], [2, 4], [0, 4], [0, 0]], height: -0.06}'


@pytest.mark.parametrize('order', [1, -1])
def test_the_upper_side_of_a_high_level_is_its_interior_also_beyond_the_ends_of_an_edge(
        order, tmp_path):
    outline = [[1, 1], [5, 1], [5, 3], [3, 3], [3, 5], [1, 5]][::order]
    planner = planner_of(
        tmp_path, [f'{{kind: level, polygon: {outline}, height: 0.06}}'], (6, 6))
    for beside in ((0.7, 1.3), (1.3, 0.7), (3.3, 4.8), (3.3, 3.3), (2.0, 2.0)):
        planner.check_goal(beside)
    for above in ((1.3, 1.3), (2.7, 2.7), (4.7, 2.0)):
        with pytest.raises(RefusedError) as caught:
            planner.check_goal(above)
        assert caught.value.reason == 'feature'


@pytest.mark.parametrize('feature', [HIGH, PODIUM, PIT])
def test_the_upper_side_of_a_high_step_is_a_drop_and_the_lower_side_is_not(feature, tmp_path):
    planner = planner_of(tmp_path, [feature])
    planner.check_goal((1.75, 2.0))
    for beside in (2.25, 2.5):
        with pytest.raises(RefusedError) as caught:
            planner.check_goal((beside, 2.0))
        assert caught.value.reason == 'feature'
        assert planner.clearance((beside, 2.0)) < 0.0
    route = planner.route((2.65, 0.7, 0.5 * math.pi), (2.65, 3.3))
    assert min(x for x, _ in route.points) > 2.0 + planner.drop_distance
    # The route of a ball that starts closer to the edge leads away from it.
    leaving = planner.route((2.4, 0.7, 0.5 * math.pi), (2.65, 3.3))
    assert np.diff([x for x, _ in leaving.points]).min() > -1e-6
    # The upper side is also a drop for Nav2, except where a crossing leads down.
    masks = {}
    for height in ('0.06', '0.04'):
        write_masks(planner_of(tmp_path, [feature.replace('0.06', height)]), tmp_path)
        mask = np.asarray(Image.open(tmp_path / 'keepout_mask.pgm'))[::-1]
        masks[height] = [int(mask[planner.floor.cell_of((x, 2.0))]) for x in (1.6, 2.4, 3.0)]
    assert masks == {'0.06': [255, 0, 255], '0.04': [255, 255, 255]}


def test_a_step_beside_a_ramp_is_not_crossed_on_the_ramp(tmp_path):
    """A ramp covers half of a step of 30 mm in a door; the step requires a run-up."""
    step = '{kind: step, name: door step, line: [[5.5, 3.4], [5.5, 1.4]], height: 0.03}'
    ramp = RAMP.format(4.0).replace('0.1', '0.03').replace('[4.0, 2]', '[4.0, 2.4]').replace(
        '[5.5, 2]', '[5.5, 2.4]')
    planner = planner_of(tmp_path, [step, ramp], (9, 5),
                         '[[[5.5, 0], [5.5, 1.4]], [[5.5, 3.4], [5.5, 5]]]')
    (start, end), = (edge.line for edge in planner.boundaries[0])
    # The wall beside the door extends into it by half its thickness.
    assert start == (5.5, 2.4) and end == pytest.approx((5.5, 1.45))
    for route in (planner.route((1.5, 2.9), (7.5, 2.9)), planner.route((7.5, 2.9), (1.5, 2.9))):
        assert [segment.feature for segment in route.segments] == [None]


def test_a_ramp_on_which_the_ball_cannot_stand_is_closed(tmp_path):
    planner = planner_of(tmp_path, [PLATFORM, RAMP.format(4.5)], (9, 5))  # 5.7 degrees
    with pytest.raises(RefusedError) as refusal:
        planner.route((1.5, 1.0), (7.5, 1.5))
    assert refusal.value.reason == 'no_route'
    with pytest.raises(RefusedError) as refusal:
        planner.check_goal((5.0, 2.7))
    assert refusal.value.reason == 'feature'


def test_a_ramp_that_ends_at_no_level_is_not_refused_for_its_slope_alone(tmp_path):
    planner = planner_of(tmp_path, [
        '{kind: ramp, polygon: [[1.5, 0], [3, 0], [3, 3], [1.5, 3]], height: 0.02, '
        'line: [[1.5, 1], [3, 1]]}'], (5, 3))  # 0.8 degrees
    with pytest.raises(RefusedError, match='edges of ramps'):
        planner.route((0.7, 1.5), (4.2, 1.5))


def test_at_cruise_speed_the_ball_rolls_over_an_open_edge_of_a_ramp():
    crossed_heights = [item.height for item in max_step_heights(
        KNOWLEDGE.robot, [TUNING.cruise_speed, BACKWARD_SPEED], rolling(KNOWLEDGE.robot))]
    assert crossed_heights[0] > FACE_HEIGHT_MIN
    assert crossed_heights == pytest.approx([0.0102, 0.0026], abs=1e-4)  # docs/navigation.md


def test_a_goal_may_be_on_a_ramp(tmp_path):
    planner = planner_of(tmp_path, [PLATFORM, RAMP.format(3.5)], (9, 5))
    assert planner.route((1.5, 1.0), (4.5, 2.7)).segments
    assert planner.route((4.5, 2.7), (1.5, 1.0)).segments


def test_no_run_up_starts_on_a_ramp(tmp_path):
    """The capability of crossings applies to level floor."""
    features = [PLATFORM, RAMP.format(3.5),
                '{kind: step, name: stage, line: [[6.2, 5], [6.2, 0]], height: 0.03}']
    planner = planner_of(tmp_path, features, (9, 5))
    polygon = planner.floor.features[1].polygon
    crossings = [segment for segment in planner.route((1.5, 1.0), (8.0, 2.5)).segments
                 if segment.feature]
    assert crossings and not any(
        inside(*segment.points[0], polygon) for segment in crossings)


@pytest.mark.parametrize('friction, direct', [(0.05, False), (0.2, True)])
def test_no_run_up_is_on_a_floor_with_less_friction_than_the_decision_assumes(
        tmp_path, friction, direct):
    features = ['{kind: step, line: [[3.0, 4.0], [3.0, 0.0]], height: 0.03}',
                f'{{kind: friction, polygon: [[0.9, 1], [3, 1], [3, 4], [0.9, 4]], '
                f'friction: {friction}}}']
    planner = planner_of(tmp_path, features, (6, 4))
    crossing, = (segment for segment in planner.route((0.6, 3.0), (5.0, 3.0)).segments
                 if segment.feature)
    assert (crossing.points[0][1] > 1.0) == direct


@pytest.mark.parametrize('height, through', [(0.06, True), (0.3, False)])
def test_a_route_leads_around_a_hill_on_which_the_ball_cannot_stand(height, through, tmp_path):
    """The hill is a cosine with a radius of 2 m: its steepest slope is pi/4 height / 1 m."""
    y, x = np.meshgrid(np.arange(0.0, 6.0, 0.05), np.arange(0.0, 6.0, 0.05), indexing='ij')
    away = np.hypot(x - 3.0, y - 3.0)
    hill = np.where(away < 2.0, 0.5 * height * (1.0 + np.cos(0.5 * math.pi * away)), 0.0)
    floor = Floor('hill', np.zeros((120, 120), np.uint8), 0.05, (0.0, 0.0), (),
                  heights=Heights(hill, 0.05, (0.0, 0.0)))
    planner = RoutePlanner(floor, KNOWLEDGE)
    points = planner.route((0.6, 3.0), (5.4, 3.0)).points
    nearest = min(math.dist(point, (3.0, 3.0)) for point in points)
    assert (nearest < 0.3) == through and through == (0.25 * math.pi * height < math.tan(0.0756))
    write_masks(planner, tmp_path)
    mask = np.asarray(Image.open(tmp_path / 'keepout_mask.pgm'))[::-1]
    assert (mask[floor.cell_of((2.0, 3.0))] == 255) == through


def test_a_start_close_to_stairs_is_not_separated_from_the_goal(flat):
    ends = (7.9, 3.4, 0.0), (2.6, 1.4)
    assert 'longer than the shortest path' in flat.explain(flat.route(*ends), *ends)


RUG = '{{kind: carpet, name: rug, height: 0.012, ' \
    'polygon: [[2, {0}], [3, {0}], [3, {1}], [2, {1}]]}}'


def test_an_explanation_compares_the_complete_route_with_the_shortest_path(tmp_path):
    ends = (0.7, 2.0), (3.3, 2.0)
    planner = planner_of(tmp_path, ['{kind: step, line: [[2, 4], [2, 0]], height: 0.03}'])
    route = planner.route(*ends)
    longer = float(planner.explain(route, *ends).split(' s longer')[0])
    assert longer == pytest.approx(
        route.time - math.dist(*ends) / TUNING.cruise_speed, abs=0.5 + 0.3)


def test_an_explanation_lists_no_lack_of_an_edge_that_can_be_crossed(tmp_path):
    ends = (0.6, 0.6), (4.4, 0.6)
    planner = planner_of(tmp_path, [RUG.format(0.05, 1.5)], (5, 4))
    route = planner.route(*ends)
    assert not any(segment.crossing for segment in route.segments)
    assert planner.explain(route, *ends).split('; ')[1:] == [
        'the fastest route avoids the rug of 12 mm']


def test_a_refusal_names_the_room_behind_the_edge_on_the_shortest_path(tmp_path):
    """The ball could leave the rug on three sides, but not on that of the goal."""
    planner = planner_of(tmp_path, [
        RUG.format(0.05, 3.95), '{kind: stairs, polygon: [[4, 0], [5, 0], [5, 4], [4, 4]]}'],
        (5, 4))
    with pytest.raises(RefusedError) as refusal:
        planner.route((0.7, 2.0), (3.35, 2.0))
    room = float(re.findall(r'room behind it, but ([0-9.]+) m', str(refusal.value))[-1])
    assert room < 4.0 - planner.drop_distance - 3.0 + 0.1


def test_a_refusal_names_a_ramp_that_is_too_steep(tmp_path):
    area = 'polygon: [[{0}, 1], [{1}, 1], [{1}, 3], [{0}, 3]], height: 0.2'
    planner = planner_of(tmp_path, [
        f'{{kind: level, {area.format(4, 6)}}}',
        f'{{kind: ramp, name: chute, {area.format(2, 4)}, line: [[2, 2], [4, 2]]}}'], (7, 4))
    with pytest.raises(RefusedError) as refusal:
        planner.route((1.0, 2.0), (5.0, 2.0))
    assert 'chute' in str(refusal.value)


@pytest.mark.parametrize('resolution', [0.01, 0.05])
@pytest.mark.parametrize('shift', [0.0, 0.05, 0.1, 0.2])
def test_a_passage_of_the_width_in_the_refusal_is_found_at_any_position(shift, resolution):
    def route(width):
        cells = np.zeros((round(5.0 / resolution), round(4.0 / resolution)), np.uint8)
        low, middle = round((2.0 + shift) / resolution), cells.shape[1] // 2
        cells[:, middle - 2:middle + 2] = 2
        cells[low:low + math.ceil(width / resolution), middle - 2:middle + 2] = 0
        return RoutePlanner(Floor('wall', cells, resolution, (0.0, 0.0), ()), KNOWLEDGE).route(
            (1.0, 2.5), (3.0, 2.5))
    with pytest.raises(RefusedError) as refusal:
        route(0.5)
    found, = re.findall(r'narrower than ([0-9.]+) m', str(refusal.value))
    assert route(float(found)).segments
