# SPDX-License-Identifier: Apache-2.0
"""The adaptive method: accurate at the kinks of the contact law and cheap between them."""
from dataclasses import replace

from contact_cases import MOVING, options, rough
from hypothesis import given, strategies as some
import numpy as np
import pytest
from tiers import pairs

from ballbot_ros.crossing import held_at
from ballbot_ros.jit import compiled
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.mechanics import contact, equations, modes
from ballbot_ros.physics.mechanics.equations import angle_trig, System
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.simulation.solver import METHODS
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import Workspace


def with_tolerance(name, tolerance):
    return load_scene(name, solver=Solver('adaptive', tolerance=tolerance))


@pytest.mark.parametrize('name', MOVING)
def test_a_scene_ends_where_ten_times_finer_fixed_steps_end(name):
    fixed = load_scene(name, solver=Solver('rk4', 1e-5)).simulate()
    found = with_tolerance(name, 1e-10).simulate()
    # The remaining difference is the first-order error of the fixed steps at the kinks.
    assert found['x'][-1] == pytest.approx(fixed['x'][-1], abs=2e-5)
    assert found['time'] == pytest.approx(fixed['time'], abs=1e-12)


@pytest.mark.parametrize('name', MOVING)
def test_the_relative_energy_balance_error_is_below_one_in_ten_million(name):
    run = with_tolerance(name, 1e-10).simulate()
    assert np.max(np.abs(run.energy_residual)) < 1e-7 * run.energy_in_play


@pytest.mark.parametrize('name', MOVING)
def test_a_smaller_tolerance_gives_a_smaller_error(name):
    exact = with_tolerance(name, 1e-13).simulate()
    errors = [abs(with_tolerance(name, tolerance).simulate()['x'][-1] - exact['x'][-1])
              for tolerance in (1e-6, 1e-11)]
    assert errors[1] < 1e-8 and errors[1] < 0.1 * errors[0]


def test_energy_is_conserved_when_a_ball_bounces_without_loss():
    robot = replace(load_robot('shellball'), contact_damping=0.0, rolling_friction=0.0)
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-12))
    start = State(x=0.0, y=0.5)
    run = simulate(model, start, Actuation(), 60.0)
    bounces = np.sum((run['contact_energy'][:-1] == 0.0) & (run['contact_energy'][1:] > 0.0))
    total = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    assert bounces > 90
    assert np.max(np.abs(total - total[0])) < 1e-7 * run.energy_in_play


def test_a_crossing_takes_far_fewer_evaluations_than_with_fixed_steps():
    found = with_tolerance('fig7_top', 1e-8).simulate()
    fixed = load_scene('fig7_top', solver=Solver('rk4')).simulate()
    assert 0 < found.effort.events < 50
    assert found.effort.evaluations < 0.1 * fixed.effort.evaluations


def test_the_output_step_does_not_change_the_run():
    scene = with_tolerance('fig7_top', 1e-10)
    coarse = scene.simulate(output_step=0.1)
    assert coarse['x'] == pytest.approx(scene.simulate()['x'][::100], abs=1e-9)


@pytest.mark.parametrize('name, method', pairs(['fig7_top', 'shellball_drop'], METHODS))
def test_the_interval_of_progress_reports_does_not_change_the_run(name, method, monkeypatch):
    scene = load_scene(name)
    solver = Solver(method, 1e-3 if method == 'trapezoidal' else 1e-4, 1e-7)
    model, runs = replace(scene.model, solver=solver), []
    for chunk in (7, 100, 10**9):
        monkeypatch.setattr('ballbot_ros.physics.simulation.run.CHUNK', chunk)
        reports = []
        runs.append(simulate(model, scene.start, scene.actuation, 0.6, 1e-3,
                             progress=reports.append))
        assert reports[-1] == pytest.approx(0.6) and (len(reports) > 1) == (chunk < 10**9)
    for run in runs[1:]:
        assert np.array_equal(run.rows, runs[0].rows)
        assert run.effort == runs[0].effort


def test_advancing_period_by_period_agrees_with_one_run():
    scene = with_tolerance('fig7_bottom', 1e-11)
    drive = scene.actuation.actuator(scene.model.robot)
    state = scene.start
    for _ in range(500):
        state = scene.model.advance(state, drive, 20)
    assert state.x == pytest.approx(scene.simulate()['x'][1000], abs=1e-8)
    assert scene.model.advance(state, drive, 20) == scene.model.advance(state, drive, 20)


states = some.builds(
    State, x=some.floats(-0.5, 2.3), y=some.floats(0.15, 0.35), ball_angle=some.floats(-9, 9),
    pendulum_angle=some.floats(-4, 4), ball_rate=some.floats(-9, 9),
    pendulum_rate=some.floats(-9, 9), velocity_x=some.floats(-2, 2),
    velocity_y=some.floats(-2, 2))


@pytest.mark.slow
@given(states, options, some.booleans())
def test_the_formulas_of_a_mode_equal_the_contact_law_inside_the_mode(state, choice, held):
    model = Model(load_robot('gimball'), rough(), choice)
    actuation = replace(held_at(0.3), torque_limit=5.0) if held else Actuation()
    system = System(model.parameters, model.profile, actuation.actuator(model.robot))
    mode = contact.ContactMode.of(len(model.profile))
    vector, law, formulas = np.array(state[1:]), np.zeros(SIZE), np.zeros(SIZE)
    equations.derivative(0.0, vector, system, mode, law)
    count = modes.find_mode(0.0, vector, system, mode)
    modes.mode_derivative(0.0, vector, system, mode, formulas)
    assert count == contact.find_contacts(
        state.x, state.y, model.robot.ball_radius, model.profile, mode.contacts)
    assert formulas == pytest.approx(law, rel=1e-9, abs=1e-9)
    if modes.smooth_contacts(mode):
        # The integrators use a second, faster implementation of the accelerations.
        for offset in (0.0, 0.3, -2.0):  # of the pendulum angle whose sine and cosine are known
            start = angle_trig(state.pendulum_angle + offset)
            quick = modes.mode_accelerations(0.0, vector, start, system, mode)
            assert quick == pytest.approx(law[4:8], rel=1e-9, abs=1e-9)


@given(states)
def test_no_guard_of_the_mode_of_a_state_is_violated_by_that_state(state):
    model = Model(load_robot('gimball'), rough())
    system = System(model.parameters, model.profile, Actuation().actuator(model.robot))
    size, vector = len(model.profile), np.array(state[1:])
    workspace = Workspace.of(size)
    modes.find_mode(0.0, vector, system, workspace.mode)
    assert modes.violated_guards(0.0, vector, system, workspace.mode, 0, 2 * size - 3,
                                 workspace.violated) == 0


@compiled
def call_sum(work, factors, count):
    values.sum_rows(work, values.END, values.START, 0.5, factors, 1, values.STAGES, count)


def test_sum_rows_adds_the_weighted_stages_to_the_start():
    draw = np.random.default_rng(7)
    work, factors = draw.normal(size=values.ROWS), draw.normal(size=8)
    stages = work[values.STAGES:values.DENSE].reshape(8, values.WIDTH)[:, :8]
    start = work[values.START:values.START + 8].copy()
    call_sum(work, factors, 3)
    expected = start + 0.5 * (factors[1:4] @ stages[:3])
    assert work[values.END:values.END + 8] == pytest.approx(expected, rel=1e-12, abs=1e-12)
