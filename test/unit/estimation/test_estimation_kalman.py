# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter: start, linearisation, readings equal to the prediction, steady state."""
from dataclasses import fields, replace
import math

from hypothesis import given, strategies
import numpy as np
import pytest
from refusals import refused
from scipy.linalg import expm, solve_discrete_are

from ballbot_ros.control import RollingModel
from ballbot_ros.control.rolling_model import rolling_accelerations
from ballbot_ros.estimation import Estimate, FilterTuning, ImuReading, PendulumFilter
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
MODEL = RollingModel(GIMBALL)
TUNING = FilterTuning()
G = GIMBALL.gravity
FILTER = PendulumFilter(GIMBALL)
EXACT = np.zeros((5, 5))
UPRIGHT = ImuReading(0.0, 0.0, 0.0, G)
angles = strategies.floats(-3.0, 3.0)
rates = strategies.floats(-10.0, 10.0)
torques = strategies.floats(-4.0, 4.0)


def known(mean, covariance=EXACT, zero=0.0):
    """Return an estimate at time 0 with a mean, a covariance and an encoder zero."""
    return Estimate(0.0, np.array(mean, dtype=float), np.array(covariance, dtype=float), zero)


def uncertain(seed):
    """Return a random covariance."""
    root = np.random.default_rng(seed).normal(size=(5, 5))
    return root @ root.T + np.eye(5)


def rolling_imu(angle, joint, rate, ball_rate, torque):
    """Return the reading of an IMU at the centre of a ball that rolls on a level floor."""
    _, roll = rolling_accelerations(angle, rate, ball_rate, torque, MODEL.numbers)
    turn = joint - angle  # rotation from world to shell
    forward, upward = -GIMBALL.ball_radius * roll, G
    return ImuReading(0.0, ball_rate, forward * math.cos(turn) - upward * math.sin(turn),
                      forward * math.sin(turn) + upward * math.cos(turn), roll)


# Start

def test_at_the_start_the_pendulum_hangs_for_any_encoder_reading():
    estimate = FILTER.start(3.0, 12.5)
    assert estimate.stamp == 3.0 and estimate.encoder_zero == 12.5
    assert estimate.mean.tolist() == [0.0] * 5
    assert estimate.readings.joint_angle == 0.0


def test_at_the_start_each_uncertainty_is_that_of_the_tuning():
    tuning = FilterTuning(start_sd=0.2, encoder_sd=0.03, bias_sd=0.05)
    estimate = PendulumFilter(GIMBALL, tuning).start(0.0, 1.0)
    assert estimate.angle_sd == pytest.approx(0.2)
    assert estimate.rate_sd == pytest.approx(0.01)
    np.testing.assert_allclose(estimate.covariance, np.diag(
        [0.2**2, 0.03**2, 0.01**2, 0.01**2, 0.05**2]), rtol=1e-12)


def test_at_the_start_an_imu_gives_the_ball_angle_and_the_bias():
    imu = ImuReading(0.0, 0.02, G * math.sin(0.4), G * math.cos(0.4))
    estimate = FILTER.start(0.0, 12.0, imu)
    assert estimate.mean == pytest.approx([0.0, -0.4, 0.0, 0.0, 0.02], abs=1e-12)
    assert estimate.readings.ball_angle == pytest.approx(0.4)
    assert estimate.encoder_zero == pytest.approx(12.4)


def test_a_leaning_pendulum_at_the_start_requires_an_imu_and_a_stored_zero():
    imu = ImuReading(0.0, 0.0, G * math.sin(-0.2), G * math.cos(-0.2))
    both = FILTER.start(0.0, 12.0, imu, encoder_zero=11.5)
    assert both.mean[:2] == pytest.approx([0.3, 0.5]) and both.encoder_zero == 11.5
    for estimate in (FILTER.start(0.0, 12.0, imu), FILTER.start(0.0, 12.0, None, 11.5)):
        assert estimate.mean[0] == pytest.approx(0.0, abs=1e-15)


def test_a_ball_without_a_pendulum_is_refused():
    with refused('inconsistent', 'pendulum_mass'):
        PendulumFilter(load_robot('shellball'))


@pytest.mark.parametrize('name', [field.name for field in fields(FilterTuning)])
def test_noise_parameters_are_positive_except_timing_and_drift(name):
    with refused('out_of_range', name):
        FilterTuning(**{name: -1e-3})
    if name in ('timing_sd', 'gyro_drift'):
        assert getattr(FilterTuning(**{name: 0.0}), name) == 0.0
    else:
        with refused('out_of_range', name):
            FilterTuning(**{name: 0.0})
        assert getattr(FilterTuning(**{name: 1e-9}), name) == 1e-9


# Prediction

@given(angles, angles, rates, rates, torques)
def test_an_imu_of_a_rolling_ball_gives_the_same_prediction(
        angle, joint, rate, ball_rate, torque):
    estimate = known([angle, joint, rate, ball_rate, 0.0])
    imu = rolling_imu(angle, joint, rate, ball_rate, torque)
    assert FILTER.predict(estimate, 0.002, torque, imu).mean == pytest.approx(
        FILTER.predict(estimate, 0.002, torque).mean, abs=1e-9)


@pytest.mark.parametrize('with_imu', [False, True])
@given(angles, angles, rates, rates, torques)
def test_the_covariance_follows_the_linearised_prediction(
        with_imu, angle, joint, rate, ball_rate, torque):
    step, mean = 1e-5, np.array([angle, joint, rate, ball_rate, 0.0])
    imu = rolling_imu(*mean[:4], torque) if with_imu else None
    exact = replace(TUNING, pendulum_noise=1e-9, ball_noise=1e-9, gyro_drift=0.0,
                    pendulum_noise_with_imu=1e-9, ball_noise_with_imu=1e-9)
    predict = PendulumFilter(GIMBALL, exact).predict

    def per_second(shift):
        ahead, behind = (predict(known(mean + sign * shift), step, torque, imu).mean
                         for sign in (1, -1))
        return ((ahead - behind) / 2e-4 - shift / 1e-4) / step

    motion = np.array([per_second(1e-4 * unit) for unit in np.eye(5)]).T
    covariance = uncertain(1)
    change = (predict(known(mean, covariance), step, torque, imu).covariance - covariance) / step
    expected = motion @ covariance + covariance @ motion.T
    np.testing.assert_allclose(change, expected, rtol=1e-2, atol=1e-2 * np.abs(expected).max())


@pytest.mark.parametrize('stamp', [-1.0, 0.0, 1e-10, 1e-9])
def test_a_prediction_to_an_earlier_time_returns_the_estimate(stamp):
    estimate = known([0.5, -0.3, 1.0, -2.0, 0.01])
    assert FILTER.predict(estimate, stamp, 1.0) is estimate


# Updates

@given(angles, angles, rates, rates, torques)
def test_an_imu_reading_equal_to_the_prediction_changes_no_angle(
        angle, joint, rate, ball_rate, torque):
    estimate = known([angle, joint, rate, ball_rate, 0.0], uncertain(3))
    ungated = PendulumFilter(GIMBALL, FilterTuning(gravity_gate=1e9))
    imu = rolling_imu(angle, joint, rate, ball_rate, torque)
    assert ungated.with_imu(estimate, imu, 0.002).mean == pytest.approx(
        estimate.mean, abs=1e-9)


@pytest.mark.parametrize('force, used', [(8.0, True), (7.9, False), (12.0, True), (12.1, False)])
def test_the_gravity_update_applies_if_the_force_is_within_the_gate(force, used):
    ten = PendulumFilter(replace(GIMBALL, gravity=10.0), FilterTuning(gravity_gate=2.0))
    estimate = known([0.1, 0.0, 0.0, 0.0, 0.0], np.eye(5))
    updated = ten.with_imu(estimate, ImuReading(0.0, 0.0, 0.0, force), 0.1)
    assert (updated.mean[0] != 0.1) == used


# Steady state

def test_the_covariance_at_rest_converges_to_the_riccati_solution():
    step, tuning = 0.002, FilterTuning(encoder_sd=0.01)
    matrix, _ = MODEL.about_held(0.0)
    motion = np.zeros((4, 4))  # pendulum angle, joint angle, pendulum rate, ball rate
    motion[0, 2] = motion[1, 2] = 1.0
    motion[1, 3] = -1.0
    motion[np.ix_([2, 3], [0, 2, 3])] = matrix[1:]
    transition = np.eye(4) + step * motion
    assert transition == pytest.approx(expm(step * motion), abs=0.02)
    noise = step * np.diag([0.0, 0.0, tuning.pendulum_noise**2, tuning.ball_noise**2])
    output = np.array([[0.0], [1.0], [0.0], [0.0]])
    predicted = solve_discrete_are(transition.T, output, noise, [[0.01**2]])
    kalman = PendulumFilter(GIMBALL, tuning)
    estimate = kalman.start(0.0, 0.0)
    for number in range(1, 20001):
        before = kalman.predict(estimate, number * step, 0.0)
        estimate = kalman.with_encoder(before, 0.0)
    np.testing.assert_allclose(before.covariance[:4, :4], predicted, rtol=1e-3, atol=1e-9)
    assert np.abs(estimate.mean).max() == 0.0


def test_the_gyro_bias_is_estimated_at_rest():
    kalman = PendulumFilter(GIMBALL, FilterTuning(gravity_sd=0.1))
    estimate = kalman.start(0.0, 0.0, UPRIGHT)
    for number in range(1, 2001):
        imu = ImuReading(0.002 * number, 0.01, 0.0, G)
        estimate = kalman.with_imu(
            kalman.predict(estimate, imu.stamp, 0.0, imu), imu, 0.002)
        estimate = kalman.with_encoder(estimate, 0.0)
    assert estimate.mean[4] == pytest.approx(0.01, abs=2e-3)
    assert estimate.covariance[4, 4] < 0.1 * TUNING.bias_sd**2


# Properties of an estimate

def test_the_readings_of_an_estimate_give_angles_and_rates_of_ball_and_joint():
    readings = Estimate(2.5, np.array([0.7, 0.3, 5.0, 2.0, 9.0]), EXACT, 0.0).readings
    assert readings.stamp == 2.5
    assert (readings.ball_angle, readings.joint_angle) == pytest.approx((0.4, 0.3))
    assert (readings.ball_rate, readings.joint_rate) == pytest.approx((2.0, 3.0))


def test_a_negative_variance_from_rounding_gives_a_deviation_of_zero():
    estimate = known([0.0] * 5, np.diag([-1e-18, 1.0, -1e-18, 1.0, 1.0]))
    assert estimate.angle_sd == estimate.rate_sd == 0.0
    assert known([0.0] * 5, np.diag([4.0, 1.0, 9.0, 1.0, 1.0])).rate_sd == 3.0
