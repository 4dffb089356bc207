# SPDX-License-Identifier: Apache-2.0
"""A model maps a state to a later state, or raises an error that gives the reason."""
from dataclasses import FrozenInstanceError, replace
from functools import cache, partial
import math
import warnings

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.config.files import shipped_files
from ballbot_ros.errors import BallbotError, PlausibilityWarning, SimulationError
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.simulation.run import CHUNK
from ballbot_ros.physics.simulation.trajectory import UNITS

GIMBALL = load_robot('gimball')
MODEL = Model(GIMBALL, Terrain.step(0.03, at=1.0), solver=Solver())
at_start = cache(partial(MODEL.at_rest, 0.7, 0.8, 0.3))  # compiles kernels
LAW = Actuation('velocity', set_rate=3.0, velocity_ki=2.0)
DRIVE = LAW.actuator(GIMBALL)


# Pure function ----------------------------------------------------------------------------

def test_advance_is_a_pure_function():
    start = State(*at_start())
    first = MODEL.advance(start, DRIVE, 2000)
    MODEL.advance(MODEL.at_rest(-1.0, 2.0), DRIVE, 777)  # something else in between
    assert MODEL.advance(start, DRIVE, 2000) == first
    assert start == at_start()
    # An equal model that has not been used before gives the same result.
    assert Model(GIMBALL, Terrain.step(0.03, at=1.0)).advance(start, DRIVE, 2000) == first


def test_two_advances_equal_one():
    assert MODEL.advance(MODEL.advance(at_start(), DRIVE, 600), DRIVE, 1400)[1:] == pytest.approx(
        MODEL.advance(at_start(), DRIVE, 2000)[1:], rel=1e-12, abs=1e-15)


def test_a_repeated_run_is_bit_identical():
    runs = [load_scene('fig7_bottom').simulate() for _ in range(2)]
    np.testing.assert_array_equal(runs[0].rows, runs[1].rows)


def test_the_samples_of_a_run_are_states_of_the_model():
    start = state = at_start()
    run = simulate(MODEL, start, LAW, 0.2, 1e-3)
    for index in range(1, len(run), 50):
        state = MODEL.advance(start, LAW.actuator(GIMBALL, 0.0, start.joint_angle), 10 * index)
        assert run.state(index)[1:] == pytest.approx(state[1:], rel=1e-11, abs=1e-14)
        assert run['pendulum_torque'][index] == pytest.approx(MODEL.torque(
            run.state(index), LAW.actuator(GIMBALL, 0.0, start.joint_angle)), rel=1e-12)


def test_a_run_may_start_at_a_later_time():
    run = simulate(MODEL, at_start()._replace(time=5.0), Actuation(), 0.2)
    assert run['time'][0] == 5.0 and run['time'][-1] == pytest.approx(5.2, rel=1e-14)
    np.testing.assert_allclose(run['x'], simulate(MODEL, at_start(), Actuation(), 0.2)['x'],
                               rtol=1e-12)


def test_models_robots_and_terrains_are_immutable():
    for thing, name in ((MODEL, 'robot'), (GIMBALL, 'ball_mass'), (MODEL.solver, 'step'),
                        (LAW, 'law'), (MODEL.terrain, 'vertices')):
        with pytest.raises(FrozenInstanceError):
            setattr(thing, name, None)
    with pytest.raises(ValueError, match='read-only'):
        MODEL.terrain.vertices[0, 0] = 9.0
    with pytest.raises(TypeError):
        GIMBALL.provenance['ball_mass'] = None


def test_times_of_the_samples_carry_no_accumulated_rounding():
    run = simulate(Model(GIMBALL, Terrain.flat()), MODEL.at_rest(0.0), Actuation(), 3.0)
    np.testing.assert_allclose(run['time'], np.arange(3001) * 1e-3, rtol=0.0, atol=1e-14)


def test_duration_is_rounded_up_to_a_whole_number_of_samples():
    assert len(simulate(MODEL, at_start(), Actuation(), 0.0101)) == 12
    assert len(simulate(MODEL, at_start(), Actuation(), 0.01)) == 11


def test_progress_is_reported_and_an_interruption_keeps_the_samples_so_far():
    reported = []

    def stop(elapsed):
        reported.append(elapsed)
        if len(reported) == 2:
            raise KeyboardInterrupt

    run = simulate(MODEL, at_start(), Actuation(), 3.0, progress=stop)
    assert reported == pytest.approx([CHUNK * 1e-3, 2 * CHUNK * 1e-3], rel=1e-12)
    assert len(run) == 2 * CHUNK + 1


def test_energies_and_contacts_agree_with_the_columns():
    run = simulate(MODEL, at_start(), LAW, 0.3)
    for index in (0, 80, 200):
        energies = MODEL.energies(run.state(index))
        assert energies.kinetic == pytest.approx(run['kinetic_energy'][index], rel=1e-13)
        assert energies.total == pytest.approx(
            run['kinetic_energy'][index] + run['potential_energy'][index]
            + run['contact_energy'][index], rel=1e-13)
        touches = MODEL.touches(run.state(index))
        assert sum(touch.normal_force * touch.normal_y - touch.friction_force * touch.normal_x
                   for touch in touches) == pytest.approx(
                       run['contact_force_y'][index], rel=1e-12, abs=1e-12)
    assert set(run.columns) == set(UNITS)
    assert run.state(0) == at_start()
    assert at_start().dissipated_energy == 0.0


@pytest.mark.parametrize('slope_deg', [-10.0, 0.0, 3.0])
@pytest.mark.parametrize('speed', [0.0, 0.7])
def test_at_rest_means_supported_and_rolling_without_slip(slope_deg, speed):
    model = Model(GIMBALL, Terrain.slope(math.radians(slope_deg)))
    start = model.at_rest(0.2, speed)
    (touch,) = model.touches(start)
    assert touch.normal_force * touch.normal_y == pytest.approx(GIMBALL.weight, rel=1e-9)
    assert touch.slip_velocity == pytest.approx(0.0, abs=1e-3 * speed + 1e-15)
    assert math.hypot(start.velocity_x, start.velocity_y) == pytest.approx(speed, rel=1e-14)


def test_at_rest_with_the_printed_lever_has_no_slip_by_the_printed_formula():
    model = Model(GIMBALL, Terrain.flat(), ContactOptions(slip_lever='radius'))
    start = model.at_rest(0.0, 1.0)
    assert start.ball_rate == -1.0 / GIMBALL.ball_radius
    assert model.touches(start)[0].slip_velocity == pytest.approx(0.0, abs=1e-15)


# Errors -----------------------------------------------------------------------------------

def failure_of(reason, field, model, start, actuation=Actuation(), duration=1.0,
               output_step=None):
    """Return the error of a run that must fail, after checking the parts of its message."""
    with refused(reason, field, SimulationError) as caught:
        simulate(model, start, actuation, duration, output_step or model.solver_in_use.step)
    error = caught.value
    assert isinstance(error, BallbotError)
    assert f't = {error.time:.6g} s' in str(error)
    assert error.quantity in str(error) and error.remedy in str(error)
    return error


@pytest.mark.parametrize('method', ['semi_implicit', 'rk4'])
def test_divergence_from_a_too_long_step_is_reported(shellball, method):
    # The contact of the empty ball oscillates at 247 rad/s: 20 ms steps are unstable.
    model = Model(shellball, Terrain.flat(), solver=Solver(method, 0.02))
    start = model.at_rest(0.0, 1.0)._replace(y=shellball.ball_radius - 0.01)
    error = failure_of('penetrated', 'y', model, start, duration=30.0)
    assert '0.02 s' in error.remedy
    assert len(error.trajectory) >= 1
    assert np.isfinite(error.trajectory.rows).all()
    assert error.trajectory['time'][-1] < error.time


def test_a_too_long_step_without_divergence_violates_the_energy_balance():
    # With 5 ms steps the friction of eq. (9) alternates between its limits and stays bounded.
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(step=5e-3))
    start = model.at_rest(0.0, 1.0)._replace(y=GIMBALL.ball_radius - 0.01)
    error = failure_of('unbalanced', 'step', model, start, duration=5.0)
    assert '0.005 s' in error.remedy
    run = error.trajectory
    assert np.abs(run.energy_residual).max() < 0.1 * run.energy_in_play
    with refused('unbalanced', 'step', SimulationError):
        model.advance(start, Actuation().actuator(GIMBALL), 1000)


def test_gains_too_stiff_for_the_step_are_named_as_a_remedy():
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(step=1e-2))
    stiff = Actuation('position', set_angle=1.0, position_kp=40.0, position_kd=1e5)
    error = failure_of('penetrated', 'y', model, State(y=500.0), stiff, 9.0)
    assert '0.01 s' in error.remedy and 'gains' in error.remedy


def test_an_overflow_is_reported_with_its_quantity():
    model = Model(GIMBALL, Terrain.flat(), solver=Solver())
    error = failure_of('not_finite', 'x', model, State(y=9.0, pendulum_rate=1e200))
    assert 'ball_rate' not in error.quantity
    assert '0.0001 s' in error.remedy and 'gains' in error.remedy


def test_too_deep_penetration_is_reported_with_its_position():
    model = Model(GIMBALL, Terrain.flat())
    error = failure_of('penetrated', 'y', model, State(x=1.5, y=1.0, velocity_y=-30.0))
    assert 'x = 1.5 m' in error.quantity
    assert 'contact_stiffness' in error.remedy
    assert 0.02 < error.time < 0.05
    # The last sample is still valid.
    assert error.trajectory['y'][-1] > 0.0


def test_advance_raises_the_same_error_as_a_run():
    with refused('penetrated', 'y', SimulationError):
        MODEL.advance(State(y=1.0, velocity_y=-30.0), DRIVE, 5000)


@pytest.mark.parametrize('x, height, inside', [
    (0.3, 1.0, False), (0.76, 1.0, False), (0.78, 1.0, True), (0.9, 1.0, True),
    (0.9, 0.05, False)])
def test_only_a_start_inside_a_wall_warns(x, height, inside):
    model = Model(GIMBALL, Terrain.step(height, at=1.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        simulate(model, model.at_rest(x, 0.2), Actuation(), 0.01)
    found = {str(item.message) for item in caught if item.category is PlausibilityWarning}
    assert len(found) == inside
    assert all(f'{1e3 * (x - 1.0 + GIMBALL.ball_radius):.3g} mm' in text for text in found)


@pytest.mark.parametrize('name', ['time', 'y', 'ball_rate', 'motor_work'])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_start_that_is_not_finite_is_refused_by_name(name, value):
    with refused('not_finite', name):
        MODEL.check_start(MODEL.at_rest(0.0)._replace(**{name: value}))


def test_neither_shipped_scenes_nor_a_start_during_an_impact_warn():
    fall = simulate(MODEL, State(x=0.3, y=0.5, velocity_y=-2.0), Actuation(), 0.5)
    deepest = fall.state(int(np.argmax(fall['penetration'])))
    scenes = [load_scene(name) for name in shipped_files('scenes')]
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        MODEL.check_start(deepest)
        for scene in scenes:
            scene.model.check_start(scene.start)


@pytest.mark.parametrize('x, method, tolerance, warned', [
    (0.0, 'adaptive', 1e-14, 0), (1e9, 'adaptive', 1e-3, 0), (1e9, 'adaptive', 1e-9, 1),
    (1e9, 'rk4', 1e-9, 0)])
def test_a_tolerance_below_the_rounding_of_the_position_warns(x, method, tolerance, warned):
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(method, tolerance=tolerance))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        model.check_start(model.at_rest(x))
    assert [item.category for item in caught] == warned * [PlausibilityWarning]


@pytest.mark.parametrize('duration', [0.0, -1.0, math.nan, math.inf])
def test_impossible_durations_are_refused(duration):
    with refused('out_of_range', 'duration'):
        simulate(MODEL, at_start(), Actuation(), duration)


@pytest.mark.parametrize('output_step', [2.5e-4, 5e-5, 1e-9])
def test_output_steps_that_do_not_fit_are_refused(output_step):
    with refused('inconsistent', 'output_step'):
        simulate(MODEL, at_start(), Actuation(), 1.0, output_step)


@pytest.mark.parametrize('law', ['position', 'velocity', 'torque', 'voltage'])
def test_a_ball_without_pendulum_can_only_roll_freely(shellball, law):
    with refused('missing', 'law'):
        Actuation(law).actuator(shellball)
    assert Actuation().actuator(shellball).law == 0


def test_voltage_needs_a_motor():
    with refused('missing', 'motor'):
        Actuation('voltage').actuator(replace(GIMBALL, motor=None))


def test_torque_limit_holds_for_every_law():
    state = State(y=9.0, pendulum_angle=-2.0, pendulum_rate=-50.0)
    for law in ('position', 'velocity', 'torque', 'voltage'):
        drive = Actuation(law, set_angle=2.0, set_rate=50.0, torque=9.0, voltage=12.0,
                          torque_limit=0.7).actuator(GIMBALL)
        assert MODEL.torque(state, drive) == 0.7
