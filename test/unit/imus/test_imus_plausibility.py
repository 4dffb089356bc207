# SPDX-License-Identifier: Apache-2.0
"""Plausibility of an IMU: every motion of the robot passes, every kind of sensor fault fails."""
import math

import numpy as np
import pytest

from ballbot_ros.imus.plausibility import EXPLANATIONS, ImuPlausibility
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

RATE = 200.0
GRAVITY = 9.81


def readings(terrain, seconds, torque, speed=0.0):
    """Return readings and joint angles of a simulated robot, with noise."""
    plant = Plant(read_scene({'robot': 'gimball', 'initial': {'x': 0.5, 'speed': speed},
                              'duration': 1.0, 'terrain': terrain}, 'test', 'test'), RATE)
    imu, noise, found = Imu(GRAVITY), np.random.default_rng(1), []
    for number in range(round(seconds * RATE)):
        before = plant.state
        state = plant.advance(torque(number / RATE))
        sample = imu.sample(before, state, number)
        found.append((number / RATE, sample.turn_rate + noise.normal(0.0, 0.005),
                      sample.forward + noise.normal(0.0, 0.05),
                      sample.upward + noise.normal(0.0, 0.05), state.joint_angle))
    return found


def fault(data, change=lambda rate, forward, upward: (rate, forward, upward), encoder=True):
    """Return the first fault and the time of its detection [s]."""
    state = ImuPlausibility()
    for stamp, rate, forward, upward, joint in data:
        state = state.after(stamp, *change(rate, forward, upward), GRAVITY,
                            joint if encoder else None)
        if state.fault:
            return state.fault, stamp
    return '', math.inf


@pytest.fixture(scope='module')
def rolling():
    """Return the readings of a robot that starts to roll on level ground."""
    return readings([{'flat': {'length': 40.0}}], 8.0, lambda time: 0.3)


@pytest.mark.parametrize('terrain, torque, speed', [
    ([{'flat': {'length': 40.0}}], lambda time: 0.9 * math.sin(3.0 * time), 0.0),
    ([{'flat': {'length': 1.0}}, {'step': {'height': -1.0}}, {'flat': {'length': 40.0}}],
     lambda time: 0.3, 1.0),
    ([{'flat': {'length': 1.0}}, {'step': {'height': 0.3}}, {'flat': {'length': 9.0}}],
     lambda time: 0.6, 2.0)])
def test_swinging_falling_from_a_metre_and_hitting_a_wall_are_plausible(terrain, torque, speed):
    assert fault(readings(terrain, 6.0, torque, speed)) == ('', math.inf)


def test_a_correct_sensor_is_plausible(rolling):
    assert fault(rolling) == ('', math.inf)


@pytest.mark.parametrize('change, reason, within', [
    (lambda rate, forward, upward: (0.01, 0.02, 9.8), 'imu_frozen', 1.0),
    (lambda rate, forward, upward: (rate, forward / 9.81, upward / 9.81), 'imu_gravity', 1.6),
    (lambda rate, forward, upward: (rate, 0.1 * forward, upward - 9.81), 'imu_gravity', 1.6),
    (lambda rate, forward, upward: (rate, 9.81 * forward, 9.81 * upward), 'imu_gravity', 1.6),
    (lambda rate, forward, upward: (math.degrees(rate), forward, upward), 'imu_turn_rate', 2.0),
    (lambda rate, forward, upward: (-rate, forward, -upward), 'imu_turn_rate', 6.0),
    (lambda rate, forward, upward: (-rate, forward, upward), 'imu_turn_rate', 4.0),
    (lambda rate, forward, upward: (0.5 * rate, forward, upward), 'imu_turn_rate', 6.0),
    (lambda rate, forward, upward: (max(rate, -0.3), forward, upward), 'imu_turn_rate', 4.0),
    (lambda rate, forward, upward: (rate, -forward, upward), 'imu_turn_rate', 4.0),
    (lambda rate, forward, upward: (1e-3 * forward, 1e-3 * rate, upward), 'imu_turn_rate', 4.0)],
    ids=['frozen', 'in g', 'without gravity', 'gravity twice', 'deg/s', 'upside down',
         'gyro reversed', 'half the scale', 'gyro saturated', 'force reversed', 'axes exchanged'])
def test_a_sensor_fault_is_detected(rolling, change, reason, within):
    found, when = fault(rolling, change)
    assert found == reason and when < within and EXPLANATIONS[reason]


def test_without_an_encoder_identical_readings_are_a_fault(rolling):
    found, when = fault(rolling, lambda *_: (0.0, 0.0, 9.81), encoder=False)
    assert found == 'imu_frozen' and when == pytest.approx(0.25, abs=0.02)


def test_a_simulated_sensor_without_noise_at_rest_is_plausible():
    still = [(number / RATE, 0.0, 0.0, 9.81, 0.0) for number in range(1000)]
    assert fault(still) == ('', math.inf)


@pytest.mark.parametrize('share, reason', [
    (0.45, 'imu_gravity'), (0.55, ''), (1.95, ''), (2.05, 'imu_gravity')])
def test_a_force_is_plausible_from_a_half_to_two_times_gravity(share, reason):
    held = [(number / RATE, 0.0, 0.0, share * GRAVITY, 0.0) for number in range(1000)]
    assert fault(held)[0] == reason


@pytest.mark.parametrize('duration, reason', [(0.09, ''), (0.12, 'imu_turn_rate')])
def test_a_force_below_the_horizontal_is_plausible_during_an_impact_only(duration, reason):
    hit = [(number / RATE, 0.0, 0.0, GRAVITY * (-1.0 if 0.0 <= number / RATE - 1.0 < duration
                                                 else 1.0), 0.0) for number in range(1000)]
    assert fault(hit)[0] == reason


def test_a_contradiction_between_gyro_and_gravity_is_a_fault_until_gravity_has_corrected_it():
    turned = [(number / RATE, 3.0 if number < RATE else 0.0, 1e-3 * (number % 2), GRAVITY)
              for number in range(round(6.0 * RATE))]
    state, faults = ImuPlausibility(), []
    for reading in turned:
        state = state.after(*reading, GRAVITY)
        faults.append(state.fault)
    start, end = faults.index('imu_turn_rate'), len(faults) - faults[::-1].index('imu_turn_rate')
    assert set(faults[start:end]) == {'imu_turn_rate'} and end > start + 0.5 * RATE
    assert not state.fault


def test_a_constant_error_of_the_gyro_is_not_a_fault(rolling):
    assert fault(rolling, lambda rate, *force: (rate + 0.1, *force)) == ('', math.inf)


@pytest.mark.parametrize('scale', [0.97, 1.03])
def test_the_scale_error_of_a_common_gyro_is_plausible_at_the_highest_speed(scale):
    rate = 12.0
    fast = [(number / RATE, scale * rate, GRAVITY * math.sin(rate * number / RATE),
             GRAVITY * math.cos(rate * number / RATE)) for number in range(round(30.0 * RATE))]
    assert fault([(*reading, 0.0) for reading in fast], encoder=False) == ('', math.inf)


@pytest.mark.parametrize('bias', [-0.1, 0.0, 0.1])
def test_a_frozen_encoder_is_detected_on_a_creeping_shell_despite_a_gyro_bias(bias):
    rate = 0.05  # of the shell [rad/s]
    creeping = [(number / RATE, rate, GRAVITY * math.sin(rate * number / RATE),
                 GRAVITY * math.cos(rate * number / RATE)) for number in range(round(140 * RATE))]
    right = [(*reading, -rate * reading[0]) for reading in creeping]
    frozen = [(*reading, 1e-3 * math.sin(reading[0])) for reading in creeping]

    def biased(rate, *force):
        return rate + bias, *force
    assert fault(right, biased) == ('', math.inf)
    found, when = fault(frozen, biased)
    assert found == 'imu_turn_rate' and rate * when == pytest.approx(4.0, abs=1.1)


def test_a_new_zero_of_the_encoder_is_not_a_turn(rolling):
    moved = [(*reading[:4], reading[4] + 50.0 * (reading[0] > 2.0)) for reading in rolling]
    assert fault(moved)[0] == 'imu_turn_rate'
    state, faults = ImuPlausibility(), set()
    for stamp, rate, forward, upward, joint in moved:
        known = joint if not 2.0 < stamp < 2.1 else None
        state = state.after(stamp, rate, forward, upward, GRAVITY, known)
        faults.add(state.fault)
    assert faults == {''}
