# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors, line and drive in simulated time: no torque on data that cannot be right."""
from dataclasses import replace
import math

import pytest
from refusals import refused
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.errors import RefusedError
from ballbot_ros.imus.plausibility import EXPLANATIONS

PROTOCOLS = ('odrive 0.5', 'odrive_can 0.6', 'vesc', 'roboclaw')
FORWARD = SetPoint(Mode.HOLD, 0.45)


def time_to_zero(robot, fault, seconds=2.0, set_point=FORWARD):
    """Return the time from a fault to the last torque of the motor [s]."""
    fault(robot)
    first = len(robot.torques)
    for _ in range(round(seconds / 0.02)):
        loop(robot, 0.02, set_point)
        if robot.session.supervisor.e_stop:
            break
    robot.loop(0.2)
    assert not any(robot.torques[-round(0.1 / STEP):])
    pulling = [number for number, torque in enumerate(robot.torques[first:], 1) if torque]
    return STEP * pulling[-1] if pulling else 0.0


def loop(robot, seconds, set_point):
    """Let the bridge run, and take set-points as long as it accepts them."""
    end = robot.now + seconds
    while robot.now < end - 1e-9:
        if not robot.session.supervisor.e_stop:
            robot.session.give(set_point)
        robot.loop(0.02)


def frozen(velocity):
    """Return a fault: the encoder repeats its last position."""
    def plant(robot):
        position = robot.device.sensed.position
        robot.encoder = lambda true: true._replace(
            position=position, velocity=true.velocity if velocity else 0.0)
    return plant


def reversed_encoder(robot):
    """Let the encoder count backwards from where it is."""
    position = robot.device.sensed.position
    robot.encoder = lambda true: true._replace(
        position=2.0 * position - true.position, velocity=-true.velocity)


@pytest.mark.parametrize('protocol', PROTOCOLS)
@pytest.mark.parametrize('tuning', ['gentle', 'published'])
@pytest.mark.parametrize('fault', [frozen(True), frozen(False), reversed_encoder],
                         ids=['frozen', 'frozen with its velocity', 'reversed'])
def test_an_encoder_that_contradicts_the_torque_engages_the_e_stop(protocol, tuning, fault):
    robot = VirtualRobot(protocol, onboard=tuning).ready()
    assert time_to_zero(robot, fault) < 0.3
    assert 'the joint does not follow its torque' in robot.session.supervisor.e_stop
    assert robot.session.control.power.state is MotorState.DISARMED
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 1.6


def test_steps_and_walls_at_full_torque_are_no_contradiction():
    for height, set_point in ((0.031, SetPoint(Mode.SPEED, 1.0)), (0.2, SetPoint(Mode.HOLD, 1.4))):
        robot = VirtualRobot(onboard='published', terrain=[
            {'flat': {'length': 1.426}}, {'step': {'height': height}}, {'flat': {'length': 3.0}}])
        loop(robot.ready(), 4.0, set_point)
        assert not robot.session.supervisor.e_stop
        assert max(map(abs, robot.torques)) > 0.9 * robot.hardware.options().torque_limit


def lost_status(robot):
    """Let status replies get lost, and the drive trip."""
    driver = robot.session.line.driver
    poll, known = driver.poll, driver.telemetry

    def without_status():
        poll()
        driver.telemetry = driver.telemetry._replace(
            status_time=known.status_time, armed=known.armed, faults=known.faults)
        return driver.telemetry
    driver.poll = without_status


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_drive_that_does_not_confirm_its_status_is_stopped(protocol):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.1, FORWARD)
    assert time_to_zero(robot, lost_status) < 0.25
    assert 'has not reported for 0.2 s whether it is armed' in robot.session.supervisor.e_stop


def test_a_process_that_was_preempted_does_not_take_the_status_for_lost():
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 0.1, FORWARD)
    robot.pass_time(0.25)  # the drive trips by its watchdog meanwhile
    robot.loop(0.05)
    assert 'has not reported' not in robot.session.supervisor.e_stop


def repeated(robot):
    """Let the IMU repeat its last reading."""
    last = []
    robot.reading = lambda true: last.append(true) or replace(last[0], stamp=true.stamp)


def in_degrees(robot):
    """Let the IMU report its turn rate in degrees per second."""
    robot.reading = lambda true: replace(true, turn_rate=math.degrees(true.turn_rate))


def in_g(robot):
    """Let the IMU report specific forces in multiples of gravity."""
    robot.reading = lambda true: replace(
        true, forward=true.forward / 9.81, upward=true.upward / 9.81)


def upside_down(robot):
    """Mount the IMU turned by half a turn about its forward axis."""
    robot.reading = lambda true: replace(
        true, turn_rate=-true.turn_rate, upward=-true.upward)


@pytest.mark.parametrize('fault, reason', [
    (repeated, 'imu_frozen'), (in_degrees, 'imu_turn_rate'), (in_g, 'imu_gravity'),
    (upside_down, 'imu_turn_rate')])
def test_an_imu_that_is_not_plausible_engages_the_e_stop(fault, reason):
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 0.2, FORWARD)
    assert time_to_zero(robot, fault, 6.0, SetPoint(Mode.SPEED, 0.5)) < 1.6
    why = robot.session.supervisor.e_stop
    assert why == EXPLANATIONS[reason] or 'the joint does not follow its torque' in why


@pytest.mark.parametrize('fault, reason, set_point', [
    (repeated, 'imu_frozen', FORWARD), (in_g, 'imu_gravity', SetPoint(Mode.IDLE))])
def test_the_e_stop_is_not_released_while_the_imu_is_not_plausible(fault, reason, set_point):
    robot = VirtualRobot(onboard='gentle').ready()
    fault(robot)
    loop(robot, 2.0, set_point)
    assert robot.session.supervisor.e_stop == EXPLANATIONS[reason]
    assert robot.refused.reason == reason
    with pytest.raises(RefusedError) as caught:
        robot.session.release()
    assert EXPLANATIONS[reason] in str(caught.value)


@pytest.mark.parametrize('mode, value', [
    (Mode.HOLD, 10.0), (Mode.HOLD, -1.7), (Mode.DRIVE, 100.0), (Mode.SPEED, 5.0)])
def test_set_points_beyond_the_limits_are_refused(mode, value):
    robot = VirtualRobot(onboard='gentle').ready()
    with refused('out_of_range', mode.value):
        robot.session.give(SetPoint(mode, value))
    assert robot.session.law.set_point.mode is Mode.IDLE
