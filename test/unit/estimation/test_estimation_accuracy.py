# SPDX-License-Identifier: Apache-2.0
"""The estimated pendulum angle compared with the true angle of the simulated robot."""
from dataclasses import replace
import math

import numpy as np
import pytest

from ballbot_ros.estimation import EncoderReading, Fusion, ImuMounting, ImuReading
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


def run(case, duration=2.5, imu=None, mounting=ImuMounting(), assumed=GIMBALL, late=0.0):
    """Return estimates and true states under a sinusoidal torque, and the fusion."""
    terrain, changes, start = CASES[case]
    scene = read_scene({'robot': 'gimball', 'robot_changes': changes, 'terrain': terrain,
                        'initial': start, 'duration': duration}, case, case)
    plant, fusion, pairs = Plant(scene, RATE), Fusion(assumed, mounting), []
    for number in range(int(duration * RATE)):
        torque = 1.1 * math.sin(1.2 * plant.time)
        before = plant.state
        state = plant.advance(torque)
        if imu is not None and state.time > late:
            fusion.imu(ImuReading(*imu.sample(before, state, number)))
        reading = EncoderReading(state.time, state.joint_angle + 7.0, torque)
        pairs.append((fusion.encoder(reading), state))
    return pairs, fusion


def angle_errors(pairs):
    """Return the errors of the pendulum angle [rad]."""
    return np.array([estimate.readings.pendulum_angle - state.pendulum_angle
                     for estimate, state in pairs])


@pytest.mark.parametrize('case', CASES)
def test_with_an_imu_the_angle_is_accurate_for_any_motion_of_the_ball(case):
    pairs, _ = run(case, imu=Imu(9.81))
    if case in ('crossing', 'flight'):
        assert pairs[-1][1].x > 1.2 + GIMBALL.ball_radius
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)


@pytest.mark.parametrize('case', ('rolling', 'crossing', 'flight'))
def test_with_a_low_cost_imu_the_error_stays_within_three_deviations(case):
    sensor = Imu(9.81, (0.05, -0.03), gyro_sd=0.005, force_sd=0.1, bias=0.01, seed=3)
    pairs, _ = run(case, imu=sensor, mounting=ImuMounting(0.05, -0.03))
    sds = np.array([estimate.angle_sd for estimate, _ in pairs])
    assert np.all(np.abs(angle_errors(pairs)) < 3.0 * sds)
    assert np.abs(angle_errors(pairs)).max() < math.radians(2.0)


def test_without_an_imu_the_angle_is_accurate_on_a_level_floor():
    pairs, _ = run('rolling')
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)


def test_an_imu_corrects_the_angle_error_on_a_slope():
    wrong = np.abs(angle_errors(run('slope')[0])).max()
    corrected = np.abs(angle_errors(run('slope', imu=Imu(9.81))[0])).max()
    assert wrong > math.radians(4.0) and wrong > 5.0 * corrected


def test_a_late_start_of_the_imu_does_not_shift_the_pendulum_angle():
    pairs, _ = run('rolling', imu=Imu(9.81), late=1.0)
    found = angle_errors(pairs)
    assert np.abs(np.diff(found)).max() < math.radians(0.5)
    assert abs(found[-1]) < math.radians(1.0)


def test_with_an_imu_wrong_robot_parameters_cause_a_small_error():
    assumed = replace(GIMBALL, pendulum_mass=1.7, joint_friction=0.2)
    pairs, _ = run('rolling', imu=Imu(9.81), assumed=assumed)
    assert np.abs(angle_errors(pairs)).max() < math.radians(1.0)
