# SPDX-License-Identifier: Apache-2.0
"""The ball touches where the distance to the ground has a local minimum, on any ground."""
from dataclasses import replace
import math

from hypothesis import assume, given, settings, strategies
import numpy as np
import pytest

from ballbot_ros.physics import (
    Actuation, contact, ContactOptions, dynamics, load_robot, Model, simulate, Solver, State,
    Terrain)
from ballbot_ros.physics.contact import (
    CORNER, EDGE, FRICTION, KIND, NORMAL_X, NORMAL_Y, PENETRATION, POINT_X, POINT_Y, SURFACE)

BOT = load_robot('gimball')
RADIUS = BOT.ball_radius
NUMBERS = dynamics.Numbers.of(BOT, ContactOptions())
FREE = Actuation()


def rows_at(terrain, x, y, robot=BOT):
    """Return the contacts of a ball, a row each."""
    ground = terrain.profile(robot.surface_friction, robot.edge_friction)
    table = contact.contact_table(len(ground))
    count = contact.find_contacts(x, y, robot.ball_radius, ground, table)
    return table[:count].copy()


def loads_at(terrain, x, y, velocity_x=0.0, velocity_y=0.0, ball_rate=0.0, robot=BOT,
             options=ContactOptions()):
    """Return what the contacts do: force, torque, and the two powers lost."""
    ground = terrain.profile(robot.surface_friction, robot.edge_friction)
    return np.array(contact.contact_loads(
        dynamics.Numbers.of(robot, options), ground, contact.contact_table(len(ground)), x, y,
        velocity_x, velocity_y, ball_rate))


def energy_at(terrain, x, y):
    """Return the energy in the contact springs [J]."""
    ground = terrain.profile(BOT.surface_friction, BOT.edge_friction)
    return contact.spring_energy(NUMBERS, ground, contact.contact_table(len(ground)), x, y)


def touching_height(terrain, x):
    """Return the height at which a ball above `x` first touches."""
    low = float(terrain.height(x))
    high = float(terrain.vertices[:, 1].max()) + abs(low) + 3.0 * RADIUS
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if len(rows_at(terrain, x, middle)) else (low, middle)
    return low


strides = strategies.tuples(
    strategies.one_of(strategies.just(0.0), strategies.floats(0.004, 0.3)),
    strategies.floats(-0.12, 0.12)).filter(lambda stride: abs(stride[0]) + abs(stride[1]) > 3e-3)


@strategies.composite
def terrains(draw):
    """Return a ground of up to eight segments, faces among them."""
    inner = draw(strategies.lists(strides, min_size=0, max_size=6))
    ends = [draw(strategies.tuples(strategies.just(1.0), strategies.floats(-0.3, 0.3)))
            for _ in range(2)]
    points = np.cumsum([[-1.0, 0.0], ends[0], *inner, ends[1]], axis=0)
    return Terrain(points)


@strategies.composite
def touching(draw):
    """Return a ground, and the centre of a ball pressed up to 8 mm into it."""
    terrain = draw(terrains())
    x = draw(strategies.floats(-0.4, 1.0))
    y = touching_height(terrain, x) - draw(strategies.floats(1e-5, 8e-3))
    assume(y > terrain.height(x) + 0.5 * RADIUS)
    return terrain, x, y


velocities = strategies.tuples(
    strategies.floats(-1.5, 1.5), strategies.floats(-1.5, 1.5), strategies.floats(-9.0, 9.0))


# The rule ---------------------------------------------------------------------------------

def signed_squares(terrain, x, y):
    """Return the sum of +-penetration^2 over the extrema of the distance, by sampling."""
    vertices = terrain.vertices.copy()
    vertices[0] += vertices[0] - vertices[1]  # the ends go on, so make them long enough
    vertices[-1] += vertices[-1] - vertices[-2]
    tangents = np.diff(vertices, axis=0)
    many = np.maximum(2, (np.hypot(*tangents.T) / 5e-4).astype(int))
    segments = np.repeat(np.arange(len(many)), many)
    part = np.concatenate([np.arange(count) / count for count in many])
    points = vertices[segments] + part[:, None] * tangents[segments]
    distance = np.hypot(points[:, 0] - x, points[:, 1] - y)
    found = 0.0
    inner, before, after = distance[1:-1], distance[:-2], distance[2:]
    extreme = ((inner < before) & (inner <= after)) | ((inner > before) & (inner >= after))
    for index in np.flatnonzero(extreme & (inner < RADIUS)) + 1:
        tangent, past = tangents[segments[index]], tangents[segments[index - 1]]
        depth = RADIUS - distance[index]
        least = distance[index] < distance[index - 1]
        turn = past[0] * tangent[1] - past[1] * tangent[0]  # 0 but at a vertex
        offset = np.array([x, y]) - points[index]
        in_front = tangent[0] * offset[1] - tangent[1] * offset[0] > 0.0
        if least and (in_front or (part[index] == 0.0 and turn < 1e-9)):
            found += depth**2
        elif not least and turn > 0.0:
            found -= depth**2
    return found


@settings(max_examples=150)
@given(touching())
def test_contacts_are_the_extrema_of_the_distance(case):
    terrain, x, y = case
    rows = rows_at(terrain, x, y)
    signs = np.where(rows[:, KIND] == CORNER, -1.0, 1.0)
    assert signs @ rows[:, PENETRATION]**2 == pytest.approx(
        signed_squares(terrain, x, y), rel=1e-3, abs=2e-8)


@given(touching())
def test_minima_and_maxima_alternate_and_each_lies_on_the_ground(case):
    terrain, x, y = case
    rows = rows_at(terrain, x, y)
    assert len(rows)
    corners = rows[:, KIND] == CORNER
    assert not corners[[0, -1]].any()
    for index in np.flatnonzero(corners):
        assert not corners[index - 1] and not corners[index + 1]
        # The farthest point is farther than both of its neighbours.
        assert rows[index, PENETRATION] <= rows[[index - 1, index + 1], PENETRATION].min()
    for row in rows:
        point = np.array([row[POINT_X], row[POINT_Y]])
        normal = np.array([row[NORMAL_X], row[NORMAL_Y]])
        assert normal @ normal == pytest.approx(1.0, rel=1e-12)
        np.testing.assert_allclose(
            point + (RADIUS - row[PENETRATION]) * normal, [x, y], atol=1e-12)
        starts, steps = terrain.vertices[:-1], np.diff(terrain.vertices, axis=0)
        place = np.einsum('ij,ij->i', point - starts, steps) / np.einsum('ij,ij->i', steps, steps)
        place[1:] = np.maximum(place[1:], 0.0)  # the end segments go on for ever
        place[:-1] = np.minimum(place[:-1], 1.0)
        gap = np.hypot(*(starts + place[:, None] * steps - point).T).min()
        assert gap < 1e-9


@pytest.mark.parametrize('x, kinds', [
    (-0.30, [SURFACE]),              # lower plane
    (-0.115, [SURFACE, CORNER, EDGE]),  # lower plane and corner, Fig. 2
    (0.02, [SURFACE])])              # upper plane
def test_the_three_contacts_of_figure_2(x, kinds):
    # A low step, so that both are touched at once; the edge keeps its point while surfaces roll.
    terrain = Terrain.step(0.03)
    rows = rows_at(terrain, x, terrain.height(x) + RADIUS - 0.002)
    assert [int(row[KIND]) for row in rows] in (kinds, [kind for kind in kinds if kind != CORNER])
    for row in rows[rows[:, KIND] == EDGE]:
        assert row[[POINT_X, POINT_Y]] == pytest.approx([0.0, 0.03], abs=1e-15)
    for row in rows[rows[:, KIND] == SURFACE]:
        assert row[POINT_X] == pytest.approx(x, abs=1e-15)


def test_rolling_up_an_edge_touches_only_the_edge():
    rows = rows_at(Terrain.step(0.03), -0.03, 0.03 + RADIUS - 0.004)
    assert [int(row[KIND]) for row in rows] == [EDGE]
    assert rows[0, NORMAL_X] < 0.0 < rows[0, NORMAL_Y]


@pytest.mark.parametrize('height, kind', [(0.9, EDGE), (1.1, SURFACE)])
def test_a_face_higher_than_the_radius_is_a_wall(height, kind):
    rows = rows_at(Terrain.step(height * RADIUS), -RADIUS + 0.002, RADIUS)
    assert int(rows[-1, KIND]) == kind
    if kind == SURFACE:
        assert rows[-1, [NORMAL_X, NORMAL_Y]] == pytest.approx([-1.0, 0.0], abs=1e-15)
        assert rows[-1, PENETRATION] == pytest.approx(0.002, rel=1e-9)


def test_a_wall_corner_gives_two_full_contacts_and_nothing_else():
    rows = rows_at(Terrain.step(1.0), -RADIUS + 0.003, RADIUS - 0.002)
    assert [int(row[KIND]) for row in rows] == [SURFACE, SURFACE]
    assert rows[:, PENETRATION] == pytest.approx([0.002, 0.003], rel=1e-9)
    assert rows[:, FRICTION] == pytest.approx(BOT.surface_friction, rel=1e-15)


def test_an_edge_is_touched_within_its_normal_cone_only():
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.5]])  # down a bend at the origin
    for angle in np.linspace(-0.3, 0.8, 56):
        direction = np.array([math.sin(angle), math.cos(angle)])
        rows = rows_at(terrain, *((RADIUS - 0.001) * direction))
        inside = 0.0 <= angle <= math.atan(0.5)
        if abs(angle) > 1e-9:
            assert ([int(row[KIND]) for row in rows] == [EDGE]) == inside


# Symmetries -------------------------------------------------------------------------------

def same_kinds(rows, other):
    """Tell whether two balls have like contacts; where a foot falls on a vertex rounding says."""
    return np.array_equal(rows[:, KIND], other[:, KIND])


@given(touching(), velocities, strategies.floats(-3.0, 3.0), strategies.floats(-3.0, 3.0))
def test_moving_the_ground_moves_nothing_else(case, motion, right, up):
    terrain, x, y = case
    moved = Terrain(terrain.vertices + [right, up])
    assume(same_kinds(rows_at(terrain, x, y), rows_at(moved, x + right, y + up)))
    here, there = loads_at(terrain, x, y, *motion), loads_at(moved, x + right, y + up, *motion)
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-6)


@given(touching(), velocities)
def test_a_mirrored_ground_gives_mirrored_contacts(case, motion):
    terrain, x, y = case
    mirrored = Terrain(terrain.vertices[::-1] * [-1.0, 1.0])
    rows, other = rows_at(terrain, x, y), rows_at(mirrored, -x, y)[::-1]
    assume(same_kinds(rows, other))
    np.testing.assert_allclose(
        rows[:, 1:] * [-1.0, 1.0, -1.0, 1.0, 1.0, 1.0], other[:, 1:], atol=1e-9)
    velocity_x, velocity_y, rate = motion
    np.testing.assert_allclose(
        loads_at(terrain, x, y, *motion) * [-1.0, 1.0, -1.0, 1.0, 1.0],
        loads_at(mirrored, -x, y, -velocity_x, velocity_y, -rate), rtol=1e-6, atol=1e-6)


@given(touching(), velocities, strategies.lists(strategies.floats(0.05, 0.95), max_size=5))
def test_a_vertex_more_on_a_straight_line_changes_nothing(case, motion, places):
    terrain, x, y = case
    points = list(terrain.vertices)
    added = []
    for number, place in enumerate(places):
        segment = number % (len(terrain.vertices) - 1)
        one, two = terrain.vertices[segment:segment + 2]
        added.append((segment, place, one + place * (two - one)))
    # From the back, so that the places in front keep their numbers.
    for segment, _, point in sorted(added, key=lambda item: item[:2], reverse=True):
        points.insert(segment + 1, point)
    points = np.array(points)
    steps = np.diff(points, axis=0)
    assume((np.hypot(*steps.T) > 1e-4).all() and (steps[:, 0] >= 0.0).all())
    # Exactly at the new vertex the contact is called an edge, with the friction of one.
    rows = rows_at(terrain, x, y)
    assume(all(np.hypot(*(row[[POINT_X, POINT_Y]] - point)) > 1e-6
               for row in rows for *_, point in added))
    np.testing.assert_allclose(loads_at(Terrain(points), x, y, *motion),
                               loads_at(terrain, x, y, *motion), rtol=1e-6, atol=1e-5)


# Round ground as the limit of many vertices -----------------------------------------------

def arc(radius, count, bump):
    """Return a bump or a bowl of a radius, its axis at the origin, with `count` chords."""
    angles = np.linspace(-1.0, 1.0, count + 1)
    points = radius * np.column_stack([np.sin(angles), (1.0 if bump else -1.0) * np.cos(angles)])
    outward = 1.0 if not bump else -1.0
    ends = points[[0, -1]] + [[-1.0, outward], [1.0, outward]]
    return Terrain(np.vstack([ends[0], points, ends[1]]))


@pytest.mark.parametrize('bump, radius', [(True, 0.05), (True, 0.5), (False, 0.4), (False, 2.0)])
def test_finer_arcs_converge_to_the_circle_with_the_square_of_the_chord(bump, radius):
    depth, up = 0.004, 1.0 if bump else -1.0
    reach = radius + up * (RADIUS - depth)
    exact = 0.5 * NUMBERS.stiffness * depth**2
    errors = []
    for count in (40, 80, 160, 320):
        terrain = arc(radius, count, bump)
        errors.append(max(
            abs(energy_at(terrain, reach * math.sin(angle), up * reach * math.cos(angle)) - exact)
            for angle in np.linspace(-0.5, 0.5, 317)))
    assert errors[-1] < 0.02 * exact
    for coarse, fine in zip(errors, errors[1:]):
        assert 3.0 < coarse / fine < 5.0


# Energy of the springs --------------------------------------------------------------------

def lossless(robot=BOT):
    """Return a robot whose contact neither damps nor rubs."""
    return replace(robot, contact_damping=0.0, surface_friction=0.0, edge_friction=0.0)


@settings(max_examples=150)
@given(touching())
def test_force_is_the_gradient_of_the_spring_energy(case):
    terrain, x, y = case
    hop = 1e-7
    gradient = [(energy_at(terrain, x + hop, y) - energy_at(terrain, x - hop, y)) / (2.0 * hop),
                (energy_at(terrain, x, y + hop) - energy_at(terrain, x, y - hop)) / (2.0 * hop)]
    force = loads_at(terrain, x, y, robot=lossless())[:2]
    # Where a contact begins within the hop, the second derivative jumps by the stiffness.
    np.testing.assert_allclose(force, np.negative(gradient), rtol=1e-5,
                               atol=4.0 * NUMBERS.stiffness * hop)


PATHS = {
    'concave bend': Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.1]]),
    'two concave bends': Terrain([[-1.0, 0.02], [0.0, 0.0], [0.01, 0.0], [1.0, 0.1]]),
    'convex bend': Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.3]]),
    'ridge': Terrain([[-1.0, -0.2], [0.0, 0.0], [1.0, -0.3]]),
    'low step': Terrain.step(0.001),
    'small bump': Terrain([[-1.0, 0.0], [0.0, 0.0], [0.002, 0.001], [0.004, 0.0], [1.0, 0.0]]),
}


@pytest.mark.parametrize('name', PATHS)
def test_energy_is_continuous_along_a_path(name):
    # As finely sampled as it may be, no step of the energy is left.
    terrain = PATHS[name]

    def largest_step(count):
        values = [energy_at(terrain, x, 0.02 * math.sin(9.0 * x) * 0.1 + RADIUS - 0.003)
                  for x in np.linspace(-0.08, 0.08, count)]
        assert max(values) > 0.05
        return np.abs(np.diff(values)).max()

    coarse, fine = largest_step(1001), largest_step(8001)
    assert fine < 0.2 * coarse


def test_without_the_farthest_point_the_energy_would_jump():
    def minima_only(x):
        rows = rows_at(PATHS['concave bend'], x, RADIUS - 0.003)
        return float(np.sum(rows[rows[:, KIND] != CORNER, PENETRATION]**2))

    values = np.array([minima_only(x) for x in np.linspace(-0.08, 0.08, 8001)])
    # Contacts of 3 mm each merge into one.
    assert np.abs(np.diff(values)).max() > 0.99 * 0.003**2


@pytest.mark.parametrize('angle_deg', [1.0, 4.0, 15.0])
def test_a_lossless_ball_keeps_its_energy_through_a_bend(angle_deg):
    # Down a slope, through the bend, and on along the floor, with frictions all off.
    robot = replace(lossless(), joint_friction=0.0, rolling_friction=0.0)
    terrain = Terrain([[-1.0, math.tan(math.radians(angle_deg))], [0.0, 0.0], [1.0, 0.0]])
    model = Model(robot, terrain, solver=Solver(step=2e-5))
    run = simulate(model, model.at_rest(-0.3, 0.8, 0.4), FREE, 1.0)
    assert run['x'][-1] > 0.3
    total = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    assert np.abs(total - total[0]).max() < 1e-6 * run.energy_in_play
    assert run.dissipated_energy[-1] == 0.0


# Forces -----------------------------------------------------------------------------------

@settings(max_examples=200)
@given(touching(), velocities)
def test_dampers_and_friction_only_take(case, motion):
    terrain, x, y = case
    loads = loads_at(terrain, x, y, *motion)
    assert loads[3] >= -1e-9 * abs(loads[:2]).max()
    assert loads[4] >= 0.0


@pytest.mark.parametrize('height', [3e-4, 1e-3, 4e-3])
def test_friction_only_takes_on_steps_lower_than_the_dent_of_the_ball(height):
    random = np.random.default_rng(5)
    terrain, corners = Terrain.step(height), 0
    for _ in range(2000):
        x, dent = -0.05 * random.random(), 0.008 * random.random()
        speed = random.uniform(0.1, 1.2)
        motion = speed, random.normal(0.0, 0.3), -speed / RADIUS * random.normal(1.0, 0.02)
        y = touching_height(terrain, x) - dent if dent > 0.007 else RADIUS - dent
        corners += (rows_at(terrain, x, y)[:, KIND] == CORNER).any()
        assert loads_at(terrain, x, y, *motion)[4] >= 0.0
    assert corners > 200


def test_friction_passes_from_floor_to_ramp_without_a_jump():
    # Equal friction on both, the ball sliding: the force changes as slowly as the place.
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.1]])

    def largest_step(count):
        loads = [loads_at(terrain, x, RADIUS - 0.003, 0.5)[2]
                 for x in np.linspace(-0.06, 0.04, count)]
        return np.abs(np.diff(loads)).max()

    assert largest_step(4001) < 0.3 * largest_step(501)


@given(strategies.floats(-1.0, 1.0), strategies.floats(1e-4, 0.5), strategies.booleans())
def test_friction_scale_is_odd_bounded_rising_and_whole_at_the_threshold(slip, threshold, smooth):
    scale = contact.friction_scale(slip, threshold, float(smooth))
    assert -1.0 <= scale <= 1.0
    assert scale == -contact.friction_scale(-slip, threshold, float(smooth))
    assert scale * slip >= 0.0
    assert contact.friction_scale(slip + 1e-3, threshold, float(smooth)) >= scale
    assert contact.friction_scale(threshold, threshold, float(smooth)) == 1.0


def test_shapes_of_the_friction_scale():
    values = [[contact.friction_scale(part, 1.0, smooth) for part in (0.0, 0.25, 0.5, 0.75, 1.0)]
              for smooth in (0.0, 1.0)]
    assert values[0] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert values[1] == pytest.approx([0.0, 0.3671875, 0.6875, 0.9140625, 1.0], rel=1e-15)
    ends = [(1.0 - contact.friction_scale(1.0 - 1e-6, 1.0, smooth)) / 1e-6
            for smooth in (0.0, 1.0)]
    assert ends == pytest.approx([1.0, 0.0], abs=1e-5)


@pytest.mark.parametrize('velocity, rate, sign', [
    (1.0, 0.0, -1.0),        # slides forward: held back
    (0.0, -5.0, 1.0),        # spins as for rolling forward: driven forward
    (0.0, 5.0, -1.0)])
def test_friction_opposes_the_slip_of_a_counter_clockwise_ball(velocity, rate, sign):
    depth = 0.002
    force_x, force_y, torque, _, loss = loads_at(
        Terrain.flat(), 0.0, RADIUS - depth, velocity, 0.0, rate)
    assert force_y == pytest.approx(BOT.contact_stiffness * depth, rel=1e-9)
    assert force_x == pytest.approx(sign * BOT.surface_friction * force_y, rel=1e-12)
    assert torque == pytest.approx(force_x * (RADIUS - depth), rel=1e-12)  # eq. (10)
    assert loss == pytest.approx(
        abs(force_x) * abs(velocity + (RADIUS - depth) * rate), rel=1e-12)


def test_only_the_literal_damper_pulls():
    place = (Terrain.flat(), 0.0, RADIUS - 1e-4, 0.0, 1.0)
    assert loads_at(*place)[1] == 0.0
    pulled = loads_at(*place, options=ContactOptions(pulling=True))[1]
    assert pulled == pytest.approx(
        BOT.contact_stiffness * 1e-4 - BOT.contact_damping, rel=1e-9)


def test_friction_of_a_segment_and_of_a_vertex_replaces_that_of_the_robot():
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.05], [1.0, 0.05]],
                      [0.5, np.nan, np.nan], [np.nan, np.nan, 0.7, np.nan])
    assert rows_at(terrain, -0.5, RADIUS - 0.001)[0, FRICTION] == 0.5
    assert rows_at(terrain, 0.5, 0.05 + RADIUS - 0.001)[0, FRICTION] == BOT.surface_friction
    edge = rows_at(terrain, -0.01, 0.05 + RADIUS - 0.004)
    assert edge[0, KIND] == EDGE and edge[0, FRICTION] == 0.7


def test_a_ball_at_rest_between_wall_and_floor_stays():
    model = Model(BOT, Terrain.step(1.0))
    start = model.at_rest(-RADIUS - 1e-6)
    run = simulate(model, start, FREE, 1.0)
    assert np.abs(run['x'] - start.x).max() < 1e-9
    assert [touch.kind for touch in model.touches(State(x=-RADIUS + 1e-3, y=start.y))] \
        == [SURFACE, SURFACE]
