# SPDX-License-Identifier: Apache-2.0
"""The compiled filter agrees with the matrix form, and covariances stay valid."""
from dataclasses import replace

from hypothesis import given, strategies
from matrix_filter import MatrixFilter
import numpy as np
import pytest

from ballbot_ros.estimation import Estimate, FilterTuning, ImuReading, PendulumFilter
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
ROBOTS = {'gimball': GIMBALL, 'heavier': replace(
    GIMBALL, pendulum_mass=3.1, pendulum_length=0.12, pendulum_inertia=0.02, joint_friction=0.05,
    rolling_friction=0.02, ball_inertia=0.04, gravity=3.7)}
angles = strategies.floats(-7.0, 7.0)
rates = strategies.floats(-30.0, 30.0)
torques = strategies.floats(-5.0, 5.0)
seeds = strategies.integers(0, 2**32 - 1)
readings = strategies.builds(
    ImuReading, strategies.just(0.0), rates, strategies.floats(-40.0, 40.0),
    strategies.floats(-40.0, 40.0), strategies.floats(-300.0, 300.0))
imus = strategies.none() | readings
robots = strategies.sampled_from(sorted(ROBOTS))
# The gate of the second one accepts any force.
tunings = strategies.sampled_from([FilterTuning(), FilterTuning(
    encoder_sd=0.02, timing_sd=0.003, gyro_sd=0.5, gyro_drift=0.2, gravity_sd=2.0,
    gravity_gate=1e9, pendulum_noise=0.7, ball_noise=0.4, pendulum_noise_with_imu=11.0,
    ball_noise_with_imu=13.0)])


def random_estimate(seed, angle, joint, rate, ball_rate, size=0.1):
    """Return an estimate with a random covariance."""
    root = size * np.random.default_rng(seed).normal(size=(5, 5))
    covariance = root @ root.T + 1e-4 * np.eye(5)
    return Estimate(3.0, np.array([angle, joint, rate, ball_rate, 0.01]), covariance, 7.0)


def assert_same(found, expected):
    """Compare two estimates to rounding, covariances relative to the standard deviations."""
    assert found.stamp == pytest.approx(expected.stamp, abs=1e-12)
    assert found.encoder_zero == expected.encoder_zero
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12, atol=1e-12)
    size = np.sqrt(np.diag(expected.covariance))
    np.testing.assert_allclose(found.covariance / np.outer(size, size),
                               expected.covariance / np.outer(size, size), rtol=0.0, atol=1e-12)


@given(robots, tunings, seeds, angles, angles, rates, rates, torques, imus,
       strategies.floats(1e-5, 0.02))
def test_predictions_agree_with_the_matrix_form(
        name, tuning, seed, angle, joint, rate, ball_rate, torque, imu, duration):
    estimate = random_estimate(seed, angle, joint, rate, ball_rate)
    assert_same(*(kind(ROBOTS[name], tuning).predict(estimate, 3.0 + duration, torque, imu)
                  for kind in (PendulumFilter, MatrixFilter)))


@given(tunings, seeds, angles, rates, rates, strategies.floats(-0.5, 0.5),
       strategies.floats(0.0, 0.01))
def test_encoder_updates_agree_with_the_matrix_form(
        tuning, seed, angle, rate, ball_rate, off, latency):
    estimate = random_estimate(seed, 0.3, angle, rate, ball_rate)
    assert_same(*(kind(GIMBALL, tuning).with_encoder(estimate, 7.0 + angle + off, latency)
                  for kind in (PendulumFilter, MatrixFilter)))


@given(robots, tunings, seeds, angles, angles, rates, readings, strategies.floats(0.0, 0.5))
def test_imu_updates_agree_with_the_matrix_form(
        name, tuning, seed, angle, joint, ball_rate, imu, period):
    estimate = random_estimate(seed, angle, joint, 1.0, ball_rate)
    assert_same(*(kind(ROBOTS[name], tuning).with_imu(estimate, imu, period)
                  for kind in (PendulumFilter, MatrixFilter)))


@given(seeds, angles, rates, torques, imus)
def test_predictions_and_updates_do_not_modify_an_estimate(seed, angle, rate, torque, imu):
    estimate = random_estimate(seed, angle, 0.2, rate, 0.5)
    mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
    kalman = PendulumFilter(GIMBALL)
    later = kalman.with_encoder(kalman.predict(estimate, 3.004, torque, imu), 7.3)
    if imu is not None:
        later = kalman.with_imu(later, imu, 0.004)
    assert (estimate.mean == mean).all() and (estimate.covariance == covariance).all()
    assert not np.shares_memory(later.mean, mean) and later.mean.shape == (5,)


@pytest.mark.slow
@given(seeds, strategies.lists(strategies.tuples(torques, imus, strategies.floats(-0.3, 0.3)),
                               min_size=1, max_size=30))
def test_a_covariance_stays_symmetric_and_positive(seed, inputs):
    estimate, kalman = random_estimate(seed, 0.1, 0.2, 1.0, 0.5), PendulumFilter(GIMBALL)
    for torque, imu, off in inputs:
        estimate = kalman.predict(estimate, estimate.stamp + 0.002, torque, imu)
        if imu is not None:
            estimate = kalman.with_imu(estimate, imu, 0.002)
        estimate = kalman.with_encoder(estimate, 7.0 + estimate.mean[1] + off)
        largest = np.abs(estimate.covariance).max()
        np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, rtol=0.0,
                                   atol=1e-12 * largest)
        assert np.linalg.eigvalsh(estimate.covariance).min() >= -1e-12 * largest
