# SPDX-License-Identifier: Apache-2.0
"""Contact springs conserve energy; dampers and friction only dissipate it."""
from dataclasses import replace
import math

from contact_cases import (
    BOT, energy_at, loads_at, PARAMETERS, RADIUS, rows_at, touching, touching_height, velocities)
from hypothesis import given, settings, strategies
import numpy as np
import pytest
from tiers import slow

from ballbot_ros.physics import Actuation, ContactOptions, Model, simulate, Solver, State, Terrain
from ballbot_ros.physics.mechanics.contact import (
    CORNER, EDGE, FRICTION, friction_scale, KIND, PENETRATION, sign_beyond, SURFACE)

FREE = Actuation()


# Energy of the springs --------------------------------------------------------------------

def lossless(robot=BOT):
    """Return a robot without contact damping and friction."""
    return replace(robot, contact_damping=0.0, surface_friction=0.0, edge_friction=0.0)


@pytest.mark.slow
@settings(max_examples=150)
@given(touching())
def test_force_is_the_gradient_of_the_spring_energy(case):
    terrain, x, y = case
    hop = 1e-7
    gradient = [(energy_at(terrain, x + hop, y) - energy_at(terrain, x - hop, y)) / (2.0 * hop),
                (energy_at(terrain, x, y + hop) - energy_at(terrain, x, y - hop)) / (2.0 * hop)]
    force = loads_at(terrain, x, y, robot=lossless())[:2]
    # Where a contact starts within the hop, the second derivative jumps by the stiffness.
    np.testing.assert_allclose(force, np.negative(gradient), rtol=1e-5,
                               atol=4.0 * PARAMETERS.stiffness * hop)


PATHS = {
    'concave bend': Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.1]]),
    'two concave bends': Terrain([[-1.0, 0.02], [0.0, 0.0], [0.01, 0.0], [1.0, 0.1]]),
    'convex bend': Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, -0.3]]),
    'ridge': Terrain([[-1.0, -0.2], [0.0, 0.0], [1.0, -0.3]]),
    'low step': Terrain.step(0.001),
    'small bump': Terrain([[-1.0, 0.0], [0.0, 0.0], [0.002, 0.001], [0.004, 0.0], [1.0, 0.0]]),
}


@pytest.mark.parametrize('name', [*slow(*list(PATHS)[:-1]), *list(PATHS)[-1:]])
def test_energy_is_continuous_along_a_path(name):
    # The largest difference between samples vanishes as the sampling is refined.
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
    # Two contacts with a penetration of 3 mm each merge into one.
    assert np.abs(np.diff(values)).max() > 0.99 * 0.003**2


@pytest.mark.parametrize('angle_deg', [1.0, 4.0, 15.0])
def test_a_lossless_ball_keeps_its_energy_through_a_bend(angle_deg):
    # The ball rolls down a slope, through the bend, and along the floor, without any friction.
    robot = replace(lossless(), joint_friction=0.0, rolling_friction=0.0)
    terrain = Terrain([[-1.0, math.tan(math.radians(angle_deg))], [0.0, 0.0], [1.0, 0.0]])
    model = Model(robot, terrain, solver=Solver(step=2e-5))
    run = simulate(model, model.at_rest(-0.3, 0.8, 0.4), FREE, 1.0)
    assert run['x'][-1] > 0.3
    total = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    assert np.abs(total - total[0]).max() < 1e-6 * run.energy_in_play
    assert run.dissipated_energy[-1] == 0.0


# Round ground as the limit of many vertices -----------------------------------------------

def arc(radius, count, bump):
    """Return a bump or bowl of the given radius about the origin, made of `count` chords."""
    angles = np.linspace(-1.0, 1.0, count + 1)
    points = radius * np.column_stack([np.sin(angles), (1.0 if bump else -1.0) * np.cos(angles)])
    outward = 1.0 if not bump else -1.0
    ends = points[[0, -1]] + [[-1.0, outward], [1.0, outward]]
    return Terrain(np.vstack([ends[0], points, ends[1]]))


@pytest.mark.parametrize('bump, radius', [(True, 0.05), (True, 0.5), (False, 0.4), (False, 2.0)])
def test_finer_arcs_converge_to_the_circle_with_the_square_of_the_chord(bump, radius):
    depth, up = 0.004, 1.0 if bump else -1.0
    reach = radius + up * (RADIUS - depth)
    exact = 0.5 * PARAMETERS.stiffness * depth**2
    errors = []
    for count in (40, 80, 160, 320):
        terrain = arc(radius, count, bump)
        errors.append(max(
            abs(energy_at(terrain, reach * math.sin(angle), up * reach * math.cos(angle)) - exact)
            for angle in np.linspace(-0.5, 0.5, 317)))
    assert errors[-1] < 0.02 * exact
    for coarse, fine in zip(errors, errors[1:]):
        assert 3.0 < coarse / fine < 5.0


# Forces -----------------------------------------------------------------------------------

@pytest.mark.slow
@settings(max_examples=200)
@given(touching(), velocities)
def test_dampers_and_friction_only_dissipate_energy(case, motion):
    terrain, x, y = case
    loads = loads_at(terrain, x, y, *motion)
    assert loads[3] >= -1e-9 * abs(loads[:2]).max()
    assert loads[4] >= 0.0


@pytest.mark.parametrize('height', [*slow(3e-4, 4e-3), 1e-3])
def test_friction_only_dissipates_on_steps_lower_than_the_penetration(height):
    random = np.random.default_rng(5)
    terrain, corners = Terrain.step(height), 0
    for _ in range(2000):
        x, depth = -0.05 * random.random(), 0.008 * random.random()
        speed = random.uniform(0.1, 1.2)
        motion = speed, random.normal(0.0, 0.3), -speed / RADIUS * random.normal(1.0, 0.02)
        y = touching_height(terrain, x) - depth if depth > 0.007 else RADIUS - depth
        corners += (rows_at(terrain, x, y)[:, KIND] == CORNER).any()
        assert loads_at(terrain, x, y, *motion)[4] >= 0.0
    assert corners > 200


def test_the_friction_torque_is_continuous_from_floor_to_ramp():
    # With equal friction on both, the torque on a sliding ball is continuous in its position.
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.1]])

    def largest_step(count):
        loads = [loads_at(terrain, x, RADIUS - 0.003, 0.5)[2]
                 for x in np.linspace(-0.06, 0.04, count)]
        return np.abs(np.diff(loads)).max()

    assert largest_step(4001) < 0.3 * largest_step(501)


def scale(slip, threshold, smooth):
    """Return mu_scale of eq. (9)."""
    parameters = PARAMETERS._replace(slip_threshold=threshold, smooth_friction=float(smooth))
    return friction_scale(slip, sign_beyond(slip, parameters.slip_threshold), parameters)


@given(strategies.floats(-1.0, 1.0), strategies.floats(1e-4, 0.5), strategies.booleans())
def test_friction_scale_is_odd_bounded_rising_and_one_at_the_threshold(slip, threshold, smooth):
    found, one = scale(slip, threshold, smooth), 1.0 + 2.0**-52  # or the next number
    assert -one <= found <= one
    assert found == -scale(-slip, threshold, smooth)
    assert found * slip >= 0.0
    assert scale(slip + 1e-3, threshold, smooth) >= found
    assert scale(threshold, threshold, smooth) == pytest.approx(1.0, rel=2.0**-52)


def test_shapes_of_the_friction_scale():
    values = [[scale(slip, 1.0, smooth) for slip in (0.0, 0.25, 0.5, 0.75, 1.0)]
              for smooth in (False, True)]
    assert values[0] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert values[1] == pytest.approx([0.0, 0.3671875, 0.6875, 0.9140625, 1.0], rel=1e-15)
    ends = [(1.0 - scale(1.0 - 1e-6, 1.0, smooth)) / 1e-6
            for smooth in (False, True)]
    assert ends == pytest.approx([1.0, 0.0], abs=1e-5)


@pytest.mark.parametrize('velocity, rate, sign', [
    (1.0, 0.0, -1.0),        # slides forward: held back
    (0.0, -5.0, 1.0),        # spins in the forward rolling direction: driven forward
    (0.0, 5.0, -1.0)])
def test_friction_opposes_the_slip(velocity, rate, sign):
    depth = 0.002
    force_x, force_y, torque, _, loss = loads_at(
        Terrain.flat(), 0.0, RADIUS - depth, velocity, 0.0, rate)
    assert force_y == pytest.approx(BOT.contact_stiffness * depth, rel=1e-9)
    assert force_x == pytest.approx(sign * BOT.surface_friction * force_y, rel=1e-12)
    assert torque == pytest.approx(force_x * (RADIUS - depth), rel=1e-12)  # eq. (10)
    assert loss == pytest.approx(
        abs(force_x) * abs(velocity + (RADIUS - depth) * rate), rel=1e-12)


def test_the_damper_pulls_only_if_the_option_allows_it():
    case = (Terrain.flat(), 0.0, RADIUS - 1e-4, 0.0, 1.0)
    assert loads_at(*case)[1] == 0.0
    pulled = loads_at(*case, options=ContactOptions(pulling=True))[1]
    assert pulled == pytest.approx(
        BOT.contact_stiffness * 1e-4 - BOT.contact_damping, rel=1e-9)


def test_the_friction_of_a_segment_or_vertex_overrides_that_of_the_robot():
    terrain = Terrain([[-1.0, 0.0], [0.0, 0.0], [0.0, 0.05], [1.0, 0.05]],
                      [0.5, np.nan, np.nan], [np.nan, np.nan, 0.7, np.nan])
    assert rows_at(terrain, -0.5, RADIUS - 0.001)[0, FRICTION] == 0.5
    assert rows_at(terrain, 0.5, 0.05 + RADIUS - 0.001)[0, FRICTION] == BOT.surface_friction
    edge = rows_at(terrain, -0.01, 0.05 + RADIUS - 0.004)
    assert edge[0, KIND] == EDGE and edge[0, FRICTION] == 0.7


def test_a_ball_at_rest_between_wall_and_floor_stays_at_rest():
    model = Model(BOT, Terrain.step(1.0))
    start = model.at_rest(-RADIUS - 1e-6)
    run = simulate(model, start, FREE, 1.0)
    assert np.abs(run['x'] - start.x).max() < 1e-9
    assert [touch.kind for touch in model.touches(State(x=-RADIUS + 1e-3, y=start.y))] \
        == [SURFACE, SURFACE]
