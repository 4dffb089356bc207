# SPDX-License-Identifier: Apache-2.0
"""Odometry compared with closed forms and with the simulated robot."""
from functools import cache
import math

from hypothesis import given, strategies as some
import numpy as np
import pytest
from tiers import pairs

from ballbot_ros.estimation import (
    EncoderReading, Estimate, Fusion, ImuReading, OdometryFilter, OdometryTuning)
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

GIMBALL = load_robot('gimball')
RADIUS = GIMBALL.ball_radius
STEP = 0.002
CERTAIN = OdometryTuning(radius_error=0.0)


def estimate(stamp, ball_angle=0.0, ball_rate=0.0, angle_sd=0.0):
    """Return an estimate of a ball with a hanging pendulum."""
    covariance = np.zeros((5, 5))
    covariance[0, 0] = angle_sd**2
    return Estimate(stamp, np.array([0.0, -ball_angle, 0.0, ball_rate, 0.0]), covariance, 0.0)


def imu(stamp, angle, forward, upward=9.81):
    """Return the reading of an IMU at an angle [rad] for a force in world axes [m/s2]."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return ImuReading(stamp, 0.0, forward * cosine + upward * sine,
                      upward * cosine - forward * sine)


def follow(motion, duration, odometry=OdometryFilter(GIMBALL)):
    """Return the odometry after `motion(time)`: ball angle and rate, forward and upward force."""
    state = odometry.start(estimate(0.0, *motion(0.0)[:2]))
    for number in range(1, round(duration / STEP) + 1):
        now = number * STEP
        angle, rate, forward, upward = motion(now)
        # The IMU reports the mean since its last reading.
        middle = motion(now - 0.5 * STEP)
        state = odometry.advance(state, estimate(now, angle, rate),
                                 None if forward is None else imu(now, angle, *middle[2:]))
    return state


def test_rolling_forward_is_a_negative_ball_rate_times_the_radius():
    state = follow(lambda now: (-2.0 * now, -2.0, None, None), 3.0)
    assert state.position == pytest.approx(6.0 * RADIUS)
    assert state.speed == pytest.approx(2.0 * RADIUS)


def test_acceleration_without_slip_adds_no_slip_distance():
    state = follow(lambda now: (-1.5 * now**2, -3.0 * now, 3.0 * RADIUS, 9.81), 1.0)
    assert state.position == pytest.approx(1.5 * RADIUS, rel=1e-6)
    assert abs(state.way) < 1e-9 and abs(state.slip) < 1e-9


def test_in_flight_the_speed_is_constant_for_any_rotation_of_the_ball():
    # Takes off at 1 m/s after 0.1 s and spins up by 20 rad/s2, for 0.3 s.
    def flight(now):
        rate, air = -1.0 / RADIUS, max(now - 0.1, 0.0)
        return rate * now - 10.0 * air**2, rate - 20.0 * air, 0.0, 9.81 if now < 0.1 else 0.0
    state = follow(flight, 0.4)
    assert state.speed == pytest.approx(1.0, abs=1e-3)
    assert state.position == pytest.approx(0.4, abs=1e-3)
    assert state.slip == pytest.approx(-RADIUS * 6.0, abs=1e-3)


def test_accelerometer_errors_in_flight_accumulate_in_the_variance():
    """Integrated white noise of density q: variances q t of speed and q t^3 / 3 of position."""
    tuning = OdometryTuning(radius_error=0.0, shock_part=0.0)
    landed = follow(lambda now: (0.0, 0.0, 0.0, 0.0), 1.0, OdometryFilter(GIMBALL, tuning))
    density = tuning.force_sd**2 * 0.1
    assert landed.speed_variance == pytest.approx(density, rel=0.01)
    assert landed.position_variance == pytest.approx(density / 3.0, rel=0.01)


def test_an_impact_increases_the_variances_of_position_and_speed():
    def rolling(impact):
        return follow(lambda now: (-2.0 * now, -2.0, 0.0, 9.81 + (
            impact if 0.50 <= now < 0.52 else 0.0)), 0.52)
    quiet, hit = rolling(0.0), rolling(60.0)
    assert hit.position_variance > quiet.position_variance
    assert hit.speed_variance > 4.0 * quiet.speed_variance


def test_an_impact_is_counted_once_while_its_reading_is_the_newest():
    odometry = OdometryFilter(GIMBALL)
    state = follow(lambda now: (0.0, 0.0, 0.0, 9.81), 0.5, odometry)
    impact = imu(0.502, 0.0, 50.0)
    for number in range(1, 20):
        state = odometry.advance(state, estimate(0.5 + number * STEP), impact)
    assert state.speed == pytest.approx(50.0 * STEP, rel=0.01)


def test_a_radius_error_scales_with_distance_and_cancels_on_the_way_back():
    tuning = OdometryTuning(
        radius_error=0.01, slip_part=0.0, slip_at_rest=1e-6, force_sd=1e-6)
    odometry = OdometryFilter(GIMBALL, tuning)
    there = follow(lambda now: (-5.0 * now, -5.0, 0.0, 9.81), 2.0, odometry)
    assert there.position_variance == pytest.approx((0.01 * 10.0 * RADIUS)**2, rel=1e-3)
    back = follow(lambda now: (-5.0 * min(now, 4.0 - now), -5.0 if now < 2.0 else 5.0, None, None),
                  4.0, OdometryFilter(GIMBALL, OdometryTuning(
                      radius_error=0.01, slip_unseen=0.0, slip_at_rest=1e-6)))
    assert back.position_variance < 1e-6


def test_rolling_without_imu_readings_increases_the_variance():
    def position_variance(watched):
        force = (0.0, 9.81) if watched else (None, None)
        return follow(lambda now: (-2.0 * now, -2.0, *force), 2.0).position_variance
    assert position_variance(False) > 4.0 * position_variance(True)


@pytest.mark.slow
def test_uncertainty_of_a_ball_at_rest_stays_below_a_centimetre_in_a_minute():
    state = follow(lambda now: (0.0, 0.0, 0.0, 9.81), 60.0)
    assert 0.0 < math.sqrt(state.position_variance) < 0.01


def test_a_shift_of_the_ball_angle_does_not_move_the_position():
    odometry = OdometryFilter(GIMBALL, CERTAIN)
    before = follow(lambda now: (-2.0 * now, -2.0, 0.0, 9.81), 0.5, odometry)
    after = odometry.advance(before, estimate(0.502, 2.0, -2.0), imu(0.502, 2.0, 0.0))
    assert after.position == pytest.approx(before.position + 2.0 * STEP * RADIUS, abs=1e-6)
    assert after.position_variance > before.position_variance
    later = odometry.advance(after, estimate(0.504, 2.0 - 2.0 * STEP, -2.0))
    assert later.position == pytest.approx(before.position + 4.0 * STEP * RADIUS, abs=1e-6)


def test_after_a_lost_estimate_the_position_is_kept_with_a_deviation_of_a_metre():
    odometry = OdometryFilter(GIMBALL)
    before = follow(lambda now: (-2.0 * now, -2.0, 0.0, 9.81), 0.5)
    after = odometry.advance(odometry.lost(before), estimate(0.502, 0.1, 0.0))
    assert after.position == pytest.approx(before.position, abs=0.01)
    assert math.sqrt(after.position_variance) > 1.0
    assert math.isfinite(odometry.advance(after, estimate(0.504, 0.1, 0.0)).position)


def test_an_estimate_without_a_later_stamp_changes_nothing():
    odometry = OdometryFilter(GIMBALL)
    state = odometry.start(estimate(1.0))
    assert odometry.advance(state, estimate(1.0, 0.5, 3.0)) is state
    assert odometry.advance(state, estimate(0.9, 0.5, 3.0)) is state


@pytest.mark.slow
@given(some.lists(some.tuples(
    some.floats(1e-4, 0.5), some.floats(-3.0, 3.0), some.floats(-30.0, 30.0),
    some.none() | some.tuples(some.floats(-100.0, 100.0), some.floats(-100.0, 100.0))),
    min_size=1, max_size=30))
def test_variances_are_never_negative_for_any_sequence(steps):
    odometry, stamp, angle = OdometryFilter(GIMBALL), 0.0, 0.0
    state = odometry.start(estimate(0.0))
    for step, turn, rate, force in steps:
        stamp, angle = stamp + step, angle + turn
        state = odometry.advance(state, estimate(stamp, angle, rate), None if force is None
                                 else ImuReading(stamp, 0.0, *force))
        assert state.position_variance >= 0.0 and state.speed_variance >= 0.0
        assert state.way_variance * state.slip_variance - state.covariance**2 >= -1e-9 * (
            state.way_variance * state.slip_variance)


def ground(height, before=1.2):
    """Return a floor with one step."""
    return [{'flat': {'length': before}}, {'step': {'height': height}}, {'flat': {'length': 40}}]


CASES = {
    'rolling': ([{'flat': {'length': 40.0}}], {}),
    'slope': ([{'slope': {'length': 40.0, 'angle_deg': 4.0}}], {}),
    'crossing': (ground(0.03), {}),
    'spinning at a wall': (ground(0.08), {}),
    'off an edge': (ground(-0.3), {}),
    'bumps': ([piece for _ in range(5) for piece in (*ground(0.008, 0.5)[:2],
                                                     *ground(-0.008, 0.5)[:2])]
              + [{'flat': {'length': 40.0}}], {}),
    'smooth floor': ([{'flat': {'length': 40.0}}], {'surface_friction': 0.1}),
}


@cache
def drive(case, push, late=0):
    """
    Return the errors of position and speed and their standard deviations in each period.

    IMU readings arrive in batches of `late` + 1.
    """
    terrain, changes = CASES[case]
    plant = Plant(read_scene({'robot': 'gimball', 'robot_changes': changes, 'terrain': terrain,
                              'initial': {'x': 0.3}, 'duration': 5.0}, case, case), 1.0 / STEP)
    fusion, odometry = Fusion(GIMBALL), OdometryFilter(GIMBALL)
    sensor = Imu(9.81, gyro_sd=0.005, force_sd=0.1, bias=0.005, seed=1)
    start = plant.state
    state, before, rows, held = None, start, [], []

    def follow_imu(estimate, reading):
        nonlocal state
        if state is not None:
            state = odometry.advance(state, estimate, reading)
    fusion.follower = follow_imu
    for number in range(2500):
        now = plant.advance(push(plant))
        if number % 2:  # 250 Hz, like a low-cost IMU
            held.append(ImuReading(*sensor.sample(before, now, number)))
            before = now
        if len(held) > late:
            for reading in held:
                fusion.imu(reading)
            held.clear()
        found = fusion.encoder(EncoderReading(now.time, now.joint_angle, plant.torque))
        state = odometry.start(found) if state is None else odometry.advance(state, found)
        rows.append((now.x - start.x - state.position, now.velocity_x - state.speed,
                     math.sqrt(state.position_variance), math.sqrt(state.speed_variance)))
    return np.abs(np.array(rows)).T


def swing(plant):
    """Return a sinusoidal torque [N m]."""
    return 1.1 * math.sin(1.2 * plant.time)


def charge(plant):
    """Return a torque [N m] that raises the pendulum for 1.2 s and then only damps."""
    state = plant.state
    return 1.57 - 0.5 * state.pendulum_angle - 0.2 * state.pendulum_rate \
        if plant.time < 1.2 else -0.3 * state.pendulum_rate


@pytest.mark.parametrize('case, push', pairs(list(CASES), [swing, charge]))
def test_the_true_position_is_within_three_deviations_on_any_ground(case, push):
    position, speed, position_sd, speed_sd = drive(case, push)
    assert np.mean(position < 3.0 * position_sd) > 0.99
    assert np.mean(speed < 3.0 * speed_sd) > 0.99
    # The deviation must also be small; a large one would always pass the test above.
    assert np.median(position_sd) < (0.15 if case == 'off an edge' else 0.05)


@pytest.mark.slow
@pytest.mark.parametrize('case', ('crossing', 'spinning at a wall', 'bumps'))
def test_late_readings_in_batches_are_counted_once(case):
    """An impact in a reading that is the newest for 20 ms must not act for 20 ms."""
    in_time, late = drive(case, charge)[0], drive(case, charge, late=4)[0]
    assert abs(late[-1] - in_time[-1]) < 0.02 and np.abs(late - in_time).max() < 0.08
