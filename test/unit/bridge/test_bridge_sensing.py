# SPDX-License-Identifier: Apache-2.0
"""What is known of the robot, when it was measured, and for how long it counts."""
from dataclasses import replace

import pytest

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.motor_state import SILENCE
from ballbot_ros.bridge.sensing import Sensing
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot

ROBOT = load_robot('gimball')
PERIOD = 0.002  # of the shipped hardware


def sensing(imu_required=False, encoder_zero=None):
    """Return a sensing that begins at 10 s."""
    hardware = load_hardware('gimball_odrive')
    found = Sensing(replace(
        hardware, joint=replace(hardware.joint, encoder_zero=encoder_zero),
        connection=replace(hardware.connection, imu_required=imu_required)), ROBOT)
    found.begin(10.0)
    return found


def take(found, time, position=0.0):
    """Give an answer of the drive."""
    return found.take(Telemetry(time=time, position=position), 0.0)


def test_the_joint_turns_as_the_gear_says():
    found = sensing()
    first = take(found, 10.01)
    later = take(found, 10.012, 0.05 * 50.0)
    assert first.readings.joint_angle == 0.0
    assert 0.0 < later.readings.joint_angle - first.readings.joint_angle <= 0.05


def test_an_answer_counts_from_the_question_unless_it_took_more_than_two_periods():
    found = sensing()
    found.ask(10.1)
    assert take(found, 10.1 + 2.0 * PERIOD - 1e-6).stamp == 10.1
    found.ask(10.2)
    assert take(found, 10.2 + 2.1 * PERIOD).stamp == 10.2 + 2.1 * PERIOD


def test_an_answer_that_comes_before_the_next_question_counts_from_its_own_time():
    found = sensing()
    found.ask(10.1)
    assert take(found, 10.05).stamp == 10.05


def test_measurements_are_in_order_though_one_was_late_and_the_next_was_not():
    found = sensing()
    found.ask(10.1)
    late = take(found, 10.11)
    found.ask(10.109)
    assert take(found, 10.1115).stamp == late.stamp == 10.11


def test_what_is_no_new_measurement_is_none():
    found = sensing()
    assert found.take(Telemetry(), 0.0) is None
    assert found.take(Telemetry(time=10.1), 0.0) is None
    assert found.take(Telemetry(position=1.0), 0.0) is None
    assert take(found, 10.0) is None and take(found, 9.9) is None  # from before it began
    assert take(found, 10.1) is not None and take(found, 10.1) is None


def test_an_answer_is_expected_from_the_question_until_it_comes():
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


def test_a_drive_that_was_never_asked_owes_no_answer():
    assert Sensing(load_hardware('gimball_odrive'), ROBOT).silence(20.0) == 0.0


def test_silence_counts_from_the_first_question_without_an_answer():
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


def test_the_motion_is_known_from_the_first_measurement_until_a_silence():
    found = sensing()
    assert found.motion(10.0) is None
    estimate = take(found, 10.5)
    motion, readings = found.motion(10.5), estimate.readings
    assert motion == (readings.pendulum_angle, readings.pendulum_rate, readings.joint_rate)
    assert found.motion(10.5 + SILENCE - 1e-9) is not None
    assert found.motion(10.5 + SILENCE + 1e-9) is None


def test_a_drive_that_was_found_again_counts_as_having_just_answered():
    found = sensing()
    take(found, 10.5)
    found.begin(30.0)
    assert found.motion(30.05) is not None


def test_where_an_imu_is_required_nothing_is_known_without():
    found = sensing(imu_required=True)
    take(found, 10.5)
    assert found.needs_imu(10.5) and found.motion(10.5) is None
    found.fusion.imu(ImuReading(10.5, 0.0, 0.0, 9.81))
    assert not found.needs_imu(10.5) and found.motion(10.5) is not None
    assert found.needs_imu(10.6) and found.motion(10.6) is None
    assert not sensing().needs_imu(10.5)


def test_an_encoder_that_remembers_its_zero_gives_the_joint_angle_with_an_imu_only():
    for zero, imu, expected in ((0.2, True, 0.3), (None, True, 0.0), (0.2, False, 0.0)):
        found = sensing(encoder_zero=zero)
        if imu:
            found.fusion.imu(ImuReading(10.4, 0.0, 0.0, 9.81))
        readings = take(found, 10.4, 0.5 * 50.0).readings
        assert readings.joint_angle == pytest.approx(expected, abs=1e-6)
