# SPDX-License-Identifier: Apache-2.0
"""Implicit methods: order, damping, and agreement with the explicit method."""
from dataclasses import replace
import math

from contact_cases import MOVING
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.crossing import held_at
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import find_mode
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.physics.simulation.solver import PRESETS
from ballbot_ros.physics.solvers import rodas5p, values
from ballbot_ros.physics.solvers.dense import interpolate
from ballbot_ros.physics.solvers.values import NOTHING, Workspace

GIMBALL = load_robot('gimball')


def run_with(name, method, tolerance):
    return load_scene(name, solver=Solver(method, tolerance=tolerance)).simulate()


@pytest.mark.parametrize('name', MOVING)
def test_all_methods_with_adaptive_steps_agree(name):
    end = run_with(name, 'explicit', 1e-11)['x'][-1]
    for method in ('implicit', 'adaptive'):
        found = run_with(name, method, 1e-11)
        assert found['x'][-1] == pytest.approx(end, abs=1e-8), method
        assert np.max(np.abs(found.energy_residual)) < 1e-6 * found.energy_in_play, method


def implicit_step(model, state, step, actuation=Actuation()):
    """Return the state after one step, the states at three times within it, and the error."""
    system = System(model.parameters, model.profile,
                    actuation.actuator(model.robot, 0.0, state.joint_angle))
    workspace = Workspace.of(len(model.profile))
    vector, middle = np.array(state[1:]), np.zeros((3, 13))
    find_mode(0.0, vector, system, workspace.mode)
    rodas5p.step(0.0, vector, step, NOTHING, system, workspace)
    rodas5p.prepare_dense(step, workspace)
    for row, theta in enumerate((0.25, 0.5, 0.75)):
        interpolate(theta, workspace.work, middle[row])
    end, error = (workspace.work[row:row + 13].copy() for row in (values.END, values.ERROR))
    return end, middle, error


def test_a_step_has_local_order_six_and_its_estimate_and_interpolation_five():
    # A rolling ball with a swinging pendulum, driven by law (12).  The friction ramp is wide
    # enough to show the order at step sizes whose error is above rounding.
    model = Model(replace(GIMBALL, slip_threshold=0.5), Terrain.flat())
    state = model.at_rest(0.0, 0.5, 1.0)._replace(pendulum_rate=2.0)
    actuation = Actuation('velocity', set_rate=3.0, velocity_kp=0.1, velocity_ki=0.5)
    exact = replace(model, solver=Solver('explicit', tolerance=1e-14))
    errors, estimates, gaps = [], [], []
    for step in (4e-3, 2e-3):
        end, middle, estimate = implicit_step(model, state, step, actuation)
        rows = simulate(exact, state, actuation, step, step / 4.0)
        found = np.array([[rows[name][row] for name in ('x', 'y', 'pendulum_angle')]
                          for row in range(1, 5)])
        picked = [2, 3, 1]
        errors.append(np.max(np.abs(end[picked] - found[3])))
        gaps.append(np.max(np.abs(middle[:, picked] - found[:3])))
        estimates.append(np.max(np.abs(estimate[picked])))
    assert math.log2(estimates[0] / estimates[1]) > 4.5
    assert math.log2(gaps[0] / gaps[1]) > 4.0
    assert math.log2(errors[0] / errors[1]) > 5.0
    assert errors[0] < estimates[0]


def growth(z):
    """Return the stability function of the implicit method: y1 / y0 for y' = z y / h."""
    stages, start = [], 1.0
    for stage in range(rodas5p.STAGES):
        if stage <= rodas5p.OWN_START:
            start = 1.0 + sum(a * u for a, u in zip(rodas5p.A[stage], stages))
        else:
            start += stages[-1]
        coupled = sum(c * u for c, u in zip(rodas5p.COUPLING[stage], stages))
        stages.append((z * start + coupled) / (1.0 / rodas5p.GAMMA - z))
    return start + stages[-1]


def test_the_implicit_method_is_of_order_five_and_l_stable():
    errors = [abs(growth(z) - math.exp(z)) for z in (-0.4, -0.2)]
    assert math.log2(errors[0] / errors[1]) > 5.9
    assert abs(growth(-1e8)) < 1e-6
    # No growth on the imaginary axis, and therefore none in the left half-plane.
    assert max(abs(growth(complex(0.0, y))) for y in np.geomspace(1e-2, 1e5, 2000)) < 1 + 1e-9


def test_one_long_implicit_step_damps_a_slip_that_explicit_steps_cannot():
    model = Model(GIMBALL, Terrain.flat(), solver=Solver('explicit', tolerance=1e-11))
    state = model.at_rest(0.0, 0.5)._replace(ball_rate=-0.5 / 0.2244 + 0.01)
    slip = model.touches(state)[0].slip_velocity
    # A step about twenty times as long as the decay time of the slip.
    end, _, _ = implicit_step(model, state, 0.02)
    later = model.touches(State(0.02, *end))[0].slip_velocity
    exact = model.touches(model.advance(state, Actuation().actuator(GIMBALL), 200))
    assert abs(slip) > 2e-3
    assert abs(later - exact[0].slip_velocity) < 0.1 * abs(slip)


def test_rolling_for_a_minute_takes_few_adaptive_steps():
    model = Model(GIMBALL, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-6))
    run = simulate(model, model.at_rest(0.0, 1.0), Actuation(), 60.0, 1.0)
    exact = simulate(replace(model, solver=Solver('explicit', tolerance=1e-11)),
                     model.at_rest(0.0, 1.0), Actuation(), 60.0, 1.0)
    assert run['x'] == pytest.approx(exact['x'], abs=1e-5)
    assert run.effort.steps < 600 and exact.effort.steps > 10_000


def test_a_tiny_slip_threshold_costs_the_implicit_method_little_and_the_explicit_one_much():
    def effort(method, threshold):
        robot = replace(GIMBALL, slip_threshold=threshold)
        model = Model(robot, Terrain.flat(), solver=Solver(method, tolerance=1e-8))
        return simulate(model, model.at_rest(0.0, 0.5, 0.5), Actuation(), 1.0).effort.evaluations
    assert effort('explicit', 1e-4) > 30 * effort('explicit', 1e-2)
    assert effort('implicit', 1e-4) < 3 * effort('implicit', 1e-2)
    assert effort('adaptive', 1e-4) < 3 * effort('adaptive', 1e-2)


def test_the_adaptive_method_uses_explicit_steps_only_if_accuracy_limits_them():
    def effort(method, tolerance):
        return run_with('fig7_top', method, tolerance).effort.evaluations
    assert effort('adaptive', 1e-13) < 1.1 * effort('explicit', 1e-13) < effort('implicit', 1e-13)
    assert effort('adaptive', 1e-6) < 0.8 * effort('explicit', 1e-6)


def test_stiff_gains_do_not_require_short_steps():
    actuation = replace(held_at(0.5), position_kp=4e4, position_kd=1e4)
    model = Model(GIMBALL, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-8))
    run = simulate(model, model.at_rest(0.0), actuation, 1.0)
    assert run['pendulum_angle'][-1] == pytest.approx(0.5, abs=0.03)
    assert run.effort.steps < 1000


def test_the_trapezoidal_rule_is_of_order_two():
    model = Model(GIMBALL, Terrain.flat())
    start = model.at_rest(0.0, 0.5, 1.0)

    def end(**solver):
        return simulate(replace(model, solver=Solver(**solver)), start, Actuation(), 0.5)['x'][-1]
    exact = end(method='explicit', tolerance=1e-13)
    errors = [abs(end(method='trapezoidal', step=step, tolerance=1e-7) - exact)
              for step in (4e-4, 2e-4, 1e-4)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)
    assert math.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.3)


def test_the_trapezoidal_rule_conserves_the_energy_of_an_undamped_spring():
    robot = replace(load_robot('shellball'), contact_damping=0.0, rolling_friction=0.0)
    model = Model(robot, Terrain.flat(), solver=Solver('trapezoidal', step=1e-3, tolerance=1e-9))
    rest = model.at_rest(0.0)
    pressed = rest._replace(y=rest.y - 0.5 * robot.static_penetration)
    run = simulate(model, pressed, Actuation(), 5.0)
    total = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    swing = np.max(run['kinetic_energy'])
    assert np.max(np.abs(total - total[0])) < 1e-4 * swing


def test_the_preset_paper_reproduces_the_figure_and_is_selected_by_name():
    assert PRESETS['paper'] == Solver('trapezoidal', step=1e-3, tolerance=1e-9)
    scene = read_scene({'robot': 'gimball', 'solver': 'paper', 'duration': 0.1}, 'here', 'rest')
    assert scene.model.solver == PRESETS['paper']
    with refused('not_a_choice', 'solver'):
        read_scene({'robot': 'gimball', 'solver': 'adams', 'duration': 0.1}, 'here', 'rest')
    exact = run_with('fig7_top', 'adaptive', 1e-11)
    found = load_scene('fig7_top', solver=PRESETS['paper']).simulate()
    assert found['x'] == pytest.approx(exact['x'], abs=1e-4)
    assert np.max(np.diff(found['time'])) < 1.1e-3


@pytest.mark.parametrize('method', ['implicit', 'trapezoidal'])
def test_a_run_beyond_its_work_budget_is_refused(method):
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(method, work_budget=50))
    with refused('over_budget', 'work_budget', SimulationError):
        simulate(model, model.at_rest(0.0, 0.5), Actuation(), 5.0)
