# SPDX-License-Identifier: Apache-2.0
"""A scene in the page runs as in `ballbot simulate`, until the user changes it."""
import math

import pytest

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.view.scene_run import SceneRun


def run_of(name='doorstep'):
    return SceneRun(load_scene(name))


def advanced(run, seconds):
    run.advance(round(seconds / run.period))
    return run


@pytest.mark.parametrize('name', ['fig7_top', 'fig7_middle', 'voltage_start'])
def test_an_unchanged_scene_runs_as_in_simulate(name):
    scene = load_scene(name, solver=Solver('rk4'))  # the method of a control period
    run = advanced(SceneRun(scene), 0.5)
    rows = scene.simulate()
    at = int(round(0.5 / scene.run.output_step))
    assert run.state.x == pytest.approx(rows['x'][at], abs=1e-9)
    assert run.state.pendulum_angle == pytest.approx(rows['pendulum_angle'][at], abs=1e-8)
    assert run.frame().pendulum_torque == pytest.approx(rows['pendulum_torque'][at], abs=1e-6)


def test_time_does_not_accumulate_rounding_errors():
    run = run_of('flat')
    for _ in range(1000):
        run.advance(1)
    assert run.state.time == 1000 * run.period


def test_a_ball_at_rest_is_carried_by_its_contact():
    frame = run_of('flat').frame()
    [contact] = frame.contacts
    weight = load_scene('flat').model.robot.weight
    assert contact.force_y == pytest.approx(weight) and contact.y == pytest.approx(0.0)
    assert frame.decision is None and frame.e_stop is False


def momentum(run):
    state, robot = run.state, run.robot
    swing = robot.pendulum_mass * robot.pendulum_length * state.pendulum_rate
    return robot.total_mass * state.velocity_x + swing * math.cos(state.pendulum_angle)


def test_the_forces_drawn_are_those_that_move_the_robot():
    run = run_of('flat')
    run.set_law(law='torque')
    run.set_law(set_point=1.0)
    advanced(run, 0.3)
    begin, before = momentum(run), run.frame()
    run.advance(1)
    pushes = [sum(each.force_x for each in frame.contacts) for frame in (before, run.frame())]
    assert sum(pushes) / 2.0 == pytest.approx((momentum(run) - begin) / run.period, rel=0.02)
    assert abs(pushes[0]) > 0.5


def test_the_speed_law_reaches_its_set_point():
    run = run_of('flat')
    run.set_law(law='speed')
    run.set_law(set_point=0.5)
    assert advanced(run, 6.0).state.velocity_x == pytest.approx(0.5, abs=0.03)


def test_another_law_starts_with_a_zero_set_point():
    run = run_of('voltage_start')
    assert run.law.set_point == 7.0
    run.set_law(law='torque')
    assert run.law.set_point == 0.0


def test_the_torque_of_a_law_is_limited_to_that_of_the_motor():
    run = run_of('flat')
    run.set_law(law='position')
    run.set_law(set_point=90.0)
    run.advance(1)
    assert run.frame().pendulum_torque == pytest.approx(run.robot.motor.maximum_torque)


def test_with_the_e_stop_there_is_no_torque():
    run = advanced(run_of('voltage_start'), 0.3)
    assert run.frame().pendulum_torque > 0.1
    run.e_stop = True
    assert run.frame().pendulum_torque == 0.0
    work = run.state.motor_work
    assert advanced(run, 0.2).state.motor_work == work


def test_another_robot_restarts_with_a_law_that_it_supports():
    run = advanced(run_of('voltage_start'), 0.3)
    run.set_robot('shellball')
    assert run.state.time == 0.0 and run.law.law == 'free'
    assert run.frame().pendulum_angle is None and run.frame().pendulum_torque is None


def test_another_friction_does_not_change_the_present_state():
    run = advanced(run_of('voltage_start'), 0.3)
    state = run.state
    run.set_friction(0.9)
    assert run.state == state and run.robot.edge_friction == 0.9


def test_an_accuracy_enables_the_error_estimate_and_zero_disables_it():
    run = run_of('fig7_top')
    assert run.error_estimate is None
    run.set_accuracy(1e-4)
    assert advanced(run, 0.2).error_estimate < 1e-4 and run.accuracy_lost_at == math.inf
    run.set_accuracy(0.0)
    assert run.error_estimate is None and run.model.solver == run.scene.model.solver_in_use


def test_a_refused_request_changes_nothing():
    run = advanced(run_of('voltage_start'), 0.1)
    state, model, law = run.state, run.model, run.law
    for act in (lambda: run.set_accuracy(5.0), lambda: run.set_robot('swimmer'),
                lambda: run.set_law(set_point=500.0)):
        with pytest.raises(ConfigurationError):
            act()
    assert (run.state, run.model, run.law) == (state, model, law) and run.accuracy is None


def test_the_curve_is_that_of_robot_and_law_or_none():
    run = run_of('doorstep')
    assert run.curve().name == 'gimball_free'
    run.set_law(law='position')
    assert run.curve().name == 'gimball_down'
    run.set_law(set_point=90.0)
    assert run.curve().name == 'gimball_horizontal'
    run.set_law(set_point=45.0)
    assert run.curve() is None
    run.set_friction(0.5)
    assert run.curve() is None
