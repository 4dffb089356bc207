# SPDX-License-Identifier: Apache-2.0
"""Measurements of the robot: their values, times and lifetimes."""
from dataclasses import replace
import math

import pytest

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.motor_state import MEASUREMENT_AGE_MAX
from ballbot_ros.bridge.sensing import Sensing
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot

ROBOT = load_robot('gimball')


def sensing(imu_required=False, encoder_zero=None):
    """Return a `Sensing` that starts at 10 s."""
    hardware = load_hardware('gimball_odrive')
    found = Sensing(replace(
        hardware, joint=replace(hardware.joint, encoder_zero=encoder_zero),
        connection=replace(hardware.connection, imu_required=imu_required)), ROBOT)
    found.begin(10.0)
    return found


def take(found, time, position=0.0, measured=None):
    """Feed an answer of the drive, by default measured on arrival."""
    return found.take(Telemetry(
        time=time, measured=time if measured is None else measured, position=position))


def test_the_joint_angle_follows_from_the_gear_ratio():
    found = sensing()
    first = take(found, 10.01)
    later = take(found, 10.012, 0.05 * 50.0)
    assert first.readings.joint_angle == 0.0
    assert 0.0 < later.readings.joint_angle - first.readings.joint_angle <= 0.05


def test_an_estimate_has_the_time_of_measurement_however_late_it_is_read():
    found = sensing()
    found.ask(10.1)
    assert take(found, 10.101, measured=10.1).stamp == 10.1
    found.ask(10.102)
    assert take(found, 10.132, measured=10.102).stamp == 10.102
    assert take(found, 10.133, measured=10.101).stamp == 10.102  # never earlier


def test_an_answer_without_a_time_of_measurement_gives_no_estimate():
    found = sensing()
    found.ask(10.1)
    assert found.take(Telemetry(time=10.101, position=1.0)) is None
    assert not found.expecting and found.fusion.estimate is None


def test_an_old_measurement_is_not_returned():
    found = sensing()
    assert found.take(Telemetry()) is None
    assert found.take(Telemetry(time=10.1)) is None
    assert found.take(Telemetry(position=1.0)) is None
    assert take(found, 10.0) is None and take(found, 9.9) is None  # from before it started
    assert take(found, 10.1) is not None and take(found, 10.1) is None


def test_refused_readings_do_not_prolong_the_life_of_an_estimate():
    found = sensing()
    assert take(found, 10.1) is not None
    late = 10.1 + MEASUREMENT_AGE_MAX + 1e-3
    with pytest.raises(MessageError):
        take(found, late, math.nan)
    assert not found.is_stale(late) and found.motion(late) is None


def test_an_answer_is_expected_from_the_request_until_it_arrives():
    found = sensing()
    assert not found.expecting
    found.ask(10.1)
    assert found.expecting
    take(found, 10.0)
    assert found.expecting
    take(found, 10.101)
    assert not found.expecting
    found.ask(10.2)
    found.begin(10.3)
    assert not found.expecting


def test_silence_counts_from_the_first_unanswered_request():
    found = sensing()
    assert found.silence(20.0) == 0.0
    found.ask(20.0)
    found.ask(20.05)
    assert found.silence(20.1) == pytest.approx(0.1)
    found.restart(20.08)
    assert found.silence(20.1) == pytest.approx(0.02)
    take(found, 20.11)
    assert found.silence(30.0) == 0.0
    found.ask(30.0)
    assert found.silence(30.01) == pytest.approx(0.01)


def test_the_motion_is_available_from_the_first_measurement_until_it_is_stale():
    found = sensing()
    assert found.motion(10.0) is None
    estimate = take(found, 10.5)
    motion, readings = found.motion(10.5), estimate.readings
    assert motion == (readings.pendulum_angle, readings.pendulum_rate, readings.joint_rate)
    assert found.motion(10.5 + MEASUREMENT_AGE_MAX - 1e-9) is not None
    assert found.motion(10.5 + MEASUREMENT_AGE_MAX + 1e-9) is None


def test_after_a_reconnection_the_motion_is_available_from_the_first_measurement():
    found = sensing()
    take(found, 10.5)
    found.begin(30.0)
    assert found.motion(30.05) is None  # the estimate is twenty seconds old
    take(found, 30.05)
    assert found.motion(30.05) is not None


def test_without_a_required_imu_the_motion_is_unavailable():
    found = sensing(imu_required=True)
    take(found, 10.5)
    assert found.needs_imu(10.5) and found.motion(10.5) is None
    found.imu_watch.silent = False  # has been steady
    found.imu(ImuReading(10.5, 0.0, 0.0, 9.81), 10.5)
    assert not found.needs_imu(10.5) and found.motion(10.5) is not None
    assert found.needs_imu(10.6) and found.motion(10.6) is None
    assert not sensing().needs_imu(10.5)


def test_speed_is_reported_at_the_last_imu_reading_unless_that_is_stale():
    found = sensing()
    for number in range(1, 20):
        now = 10.0 + 0.002 * number
        if number <= 10:  # later the IMU is late
            found.fusion.imu(ImuReading(now, 0.0, 0.0, 9.81))
        take(found, now)
    steady, newest = found.steady_odometry(), found.odometry
    assert steady.stamp == pytest.approx(10.02) and newest.stamp == pytest.approx(10.038)
    assert steady.speed_variance < 0.01 * newest.speed_variance
    take(found, 10.06)
    assert found.steady_odometry() is found.odometry
    found.fusion.imu(ImuReading(10.061, 0.0, 0.0, 9.81))
    take(found, 10.062)
    assert found.steady_odometry().stamp == pytest.approx(10.061)


def test_a_stored_encoder_zero_gives_the_joint_angle_only_with_an_imu():
    for zero, imu, expected in ((0.2, True, 0.3), (None, True, 0.0), (0.2, False, 0.0)):
        found = sensing(encoder_zero=zero)
        if imu:
            found.fusion.imu(ImuReading(10.4, 0.0, 0.0, 9.81))
        readings = take(found, 10.4, 0.5 * 50.0).readings
        assert readings.joint_angle == pytest.approx(expected, abs=1e-6)
