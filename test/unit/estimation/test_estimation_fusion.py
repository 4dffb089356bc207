# SPDX-License-Identifier: Apache-2.0
"""The estimated pendulum angle against the true one, and what spoils it."""
from dataclasses import replace
import math

from hypothesis import given, strategies
import numpy as np
import pytest

from ballbot_ros.control import linear_rolling, rolling_accelerations
from ballbot_ros.errors import ConfigurationError, MessageError
from ballbot_ros.estimation import (
    Fusion, ImuMounting, ImuReading, PendulumFilter, Rolling, unobservable)
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

GIMBALL = load_robot('gimball')
RATE = 500.0
FLAT = [{'flat': {'length': 30.0}}]
CASES = {
    'rolling': (FLAT, {}, {'x': 0.5}),
    'slope': ([{'slope': {'length': 30.0, 'angle_deg': 4.0}}], {}, {'x': 0.5}),
    'crossing': ([{'flat': {'length': 1.2}}, {'step': {'height': 0.01}}, {'flat': {'length': 9}}],
                 {}, {'x': 0.5}),
    'slip': (FLAT, {'surface_friction': 0.01}, {'x': 0.5}),
    'flight': ([{'flat': {'length': 1.2}}, {'step': {'height': -0.3}}, {'flat': {'length': 30}}],
               {}, {'x': 0.5}),
}
angles = strategies.floats(-3.0, 3.0)
rates = strategies.floats(-20.0, 20.0)


def run(case, duration=2.5, imu=None, mounting=ImuMounting(), believed=GIMBALL, late=0.0):
    """Return estimates and true states of a robot whose pendulum is pushed forward and let go."""
    terrain, changes, start = CASES[case]
    scene = read_scene({'robot': 'gimball', 'robot_changes': changes, 'terrain': terrain,
                        'initial': start, 'duration': duration}, case, case)
    plant, fusion, pairs = Plant(scene, RATE), Fusion(believed, mounting), []
    for number in range(int(duration * RATE)):
        torque = 1.1 * math.sin(1.2 * plant.time)
        before = plant.state
        state = plant.advance(torque)
        if imu is not None and state.time > late:
            fusion.imu(ImuReading(*imu.sample(before, state, number)))
        pairs.append((fusion.encoder(state.time, state.joint_angle + 7.0, torque), state))
    return pairs, fusion


def angle_errors(pairs):
    """Return the errors of the pendulum angle [rad]."""
    return np.array([estimate.readings.pendulum_angle - state.pendulum_angle
                     for estimate, state in pairs])


@given(angles, rates, rates, strategies.floats(-4.0, 4.0))
def test_the_filter_and_the_controller_know_the_same_ball(angle, rate, ball_rate, torque):
    swing, roll, _, _ = Rolling(GIMBALL).accelerations(angle, rate, ball_rate, torque)
    expected = rolling_accelerations(GIMBALL, angle, rate, ball_rate, torque)
    assert (swing, roll) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(angles, rates, rates, strategies.floats(-4.0, 4.0))
def test_the_slopes_are_those_of_the_accelerations(angle, rate, ball_rate, torque):
    rolling, point, step = Rolling(GIMBALL), np.array([angle, rate, ball_rate]), 1e-5
    *_, by_swing, by_roll = rolling.accelerations(*point, torque)
    for index in range(3):
        shift = step * np.eye(3)[index]
        ahead = rolling.accelerations(*(point + shift), torque)
        behind = rolling.accelerations(*(point - shift), torque)
        for row, slopes in ((0, by_swing), (1, by_roll)):
            assert slopes[index] == pytest.approx(
                (ahead[row] - behind[row]) / (2.0 * step), rel=1e-4, abs=1e-3)


def test_about_rest_the_slopes_are_the_linear_model():
    *_, by_swing, by_roll = Rolling(GIMBALL).accelerations(0.0, 0.0, 0.0, 0.0)
    matrix, _ = linear_rolling(GIMBALL, 0.0)
    np.testing.assert_allclose([by_swing, by_roll], matrix[1:], rtol=1e-9)


@pytest.mark.parametrize('case', CASES)
def test_with_an_imu_the_angle_is_right_whatever_the_ball_does(case):
    pairs, _ = run(case, imu=Imu(9.81))
    if case in ('crossing', 'flight'):
        assert pairs[-1][1].x > 1.2 + GIMBALL.ball_radius
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)


@pytest.mark.parametrize('case', ('rolling', 'crossing', 'flight'))
def test_with_a_cheap_imu_the_error_stays_within_what_the_filter_admits(case):
    sensor = Imu(9.81, (0.05, -0.03), gyro_sd=0.005, force_sd=0.1, bias=0.01, seed=3)
    pairs, _ = run(case, imu=sensor, mounting=ImuMounting(0.05, -0.03))
    sds = np.array([estimate.angle_sd for estimate, _ in pairs])
    assert np.all(np.abs(angle_errors(pairs)) < 3.0 * sds)
    assert np.abs(angle_errors(pairs)).max() < math.radians(2.0)


def test_without_an_imu_rolling_on_a_level_floor_is_enough():
    pairs, _ = run('rolling')
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)


def test_without_an_imu_a_slope_is_taken_for_a_lean_and_an_imu_mends_it():
    wrong = np.abs(angle_errors(run('slope')[0])).max()
    mended = np.abs(angle_errors(run('slope', imu=Imu(9.81))[0])).max()
    assert wrong > math.radians(4.0) and wrong > 5.0 * mended


@pytest.mark.parametrize('imu, told_apart', [(False, False), (True, True)])
def test_slope_lean_and_torque_error_are_told_apart_by_an_imu_only(imu, told_apart):
    missing = unobservable(GIMBALL, imu, angle=0.2)
    assert missing == ([] if told_apart else
                       ['pendulum angle', 'constant torque', 'slope of the floor'])


def test_an_imu_that_comes_late_does_not_move_the_pendulum():
    pairs, _ = run('rolling', imu=Imu(9.81), late=1.0)
    found = angle_errors(pairs)
    assert np.abs(np.diff(found)).max() < math.radians(0.5)
    assert abs(found[-1]) < math.radians(1.0)


def test_the_imu_may_sit_anywhere_in_the_shell():
    place = (0.12, -0.08)
    mounting = ImuMounting(*place, imu_angle=0.7)
    central = Imu(9.81)
    pairs, _ = run('rolling', duration=0.4)
    for (_, before), (_, after) in zip(pairs, pairs[1:]):
        far = Imu(9.81, place).sample(before, after, 0)
        back = complex(far.forward, far.upward) * complex(math.cos(0.7), -math.sin(0.7))
        turning = (after.ball_rate - before.ball_rate) * RATE
        moved = mounting.at_centre(
            ImuReading(far.time, far.turn_rate, back.real, back.imag, turning))
        true = central.sample(before, after, 0)
        assert (moved.forward, moved.upward) == pytest.approx(
            (true.forward, true.upward), abs=1e-9)


def test_a_jump_of_the_encoder_is_ignored_and_a_new_zero_is_learned():
    pairs, fusion = run('rolling', duration=1.0)
    estimate, state = pairs[-1]
    angle = state.joint_angle + 7.0
    after = fusion.encoder(state.time + 0.002, angle + 3.0, 0.0)
    assert fusion.jumps == 1
    assert after.readings.pendulum_angle == pytest.approx(
        estimate.readings.pendulum_angle, abs=0.02)
    for number in range(2, 8):
        after = fusion.encoder(state.time + 0.002 * number, angle + 3.0, 0.0)
    assert fusion.rezeroed == 1
    assert abs(after.readings.pendulum_angle - state.pendulum_angle) < 0.05


@pytest.mark.parametrize('values', [(math.nan, 0.0, 0.0), (0.1, math.inf, 0.0),
                                    (0.1, 0.0, math.nan)])
def test_what_is_not_finite_is_refused_and_changes_nothing(values):
    fusion = Fusion(GIMBALL)
    before = fusion.encoder(0.0, 0.0, 0.0)
    with pytest.raises(MessageError, match='must be finite'):
        fusion.encoder(*values)
    with pytest.raises(MessageError, match='must be finite'):
        ImuReading(0.0, *values)
    assert fusion.estimate is before


def test_imu_readings_out_of_order_are_refused():
    fusion = Fusion(GIMBALL)
    fusion.imu(ImuReading(1.0, 0.0, 0.0, 9.81))
    with pytest.raises(MessageError, match='came before'):
        fusion.imu(ImuReading(0.9, 0.0, 0.0, 9.81))


def test_a_ball_without_a_pendulum_is_refused():
    with pytest.raises(ConfigurationError, match='no pendulum'):
        PendulumFilter(load_robot('shellball'))


def test_the_start_is_a_pendulum_that_hangs_and_a_shell_seen_by_the_imu():
    fusion = Fusion(GIMBALL)
    fusion.imu(ImuReading(0.0, 0.0, 9.81 * math.sin(0.4), 9.81 * math.cos(0.4)))
    readings = fusion.encoder(0.001, 12.0, 0.0).readings
    assert readings.pendulum_angle == pytest.approx(0.0, abs=1e-12)
    assert readings.ball_angle == pytest.approx(0.4)


def test_an_encoder_that_remembers_its_zero_and_an_imu_need_no_rest():
    fusion = Fusion(GIMBALL, encoder_zero=11.5)
    fusion.imu(ImuReading(0.0, 0.0, 9.81 * math.sin(-0.2), 9.81 * math.cos(-0.2)))
    assert fusion.encoder(0.001, 12.0, 0.0).readings.pendulum_angle == pytest.approx(0.3)


def test_the_estimate_of_a_wrong_robot_is_wrong_by_little_with_an_imu():
    believed = replace(GIMBALL, pendulum_mass=1.7, joint_friction=0.2)
    pairs, _ = run('rolling', imu=Imu(9.81), believed=believed)
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)
