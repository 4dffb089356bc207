# SPDX-License-Identifier: Apache-2.0
"""Hazards in a complete session: delayed replies, a second sender, changed settings, restarts."""
from dataclasses import replace

import pytest
from virtual_robot import ALL, STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.drives.can_frames import CanFrame, record
from ballbot_ros.drives.odrive.cansimple import codec as cansimple
from ballbot_ros.drives.vesc.can import codec as vesc_can
from ballbot_ros.drives.vesc.uart import driver as vesc


def age_of_measurements(robot, latency, seconds):
    """Return the largest age of a measurement while the motor produced torque [s]."""
    start, largest = robot.now, 0.0
    for _ in range(round(seconds / STEP)):
        robot._delay = max(latency(robot.now - start), 0.5 * STEP)
        robot.run(STEP, torque=0.5)
        estimate = robot.session.fusion.estimate
        if robot.motor != 0.0 and estimate is not None:
            largest = max(largest, robot.now - estimate.stamp)
    return largest


@pytest.mark.parametrize('protocol', ['roboclaw', *(
    pytest.param(name, marks=pytest.mark.slow) for name in ALL if name != 'roboclaw')])
def test_replies_with_growing_delay_end_the_torque(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.1, torque=0.5)
    assert robot.motor != 0.0
    assert age_of_measurements(robot, lambda time: 0.2 * time, 2.0) < 0.11
    assert robot.motor == 0.0


def hazards_of(report):
    """Return the changed settings that caused the e-stop; [''] for another sender."""
    assert report.e_stop.reason is StopReason.HAZARD
    return list(report.e_stop.names)


def run_until_stopped(robot, seconds):
    """Run with torque until an e-stop or for `seconds`; return the last report."""
    for _ in range(round(10.0 * seconds)):
        report = robot.run(0.1, torque=0.1)
        if report.e_stop:
            break
    return report


@pytest.mark.parametrize('protocol, frame', [
    ('odrive_can 0.5', CanFrame(cansimple.SET_INPUT_TORQUE, bytes(4))),
    ('vesc_can', vesc_can.packet(vesc_can.SET_CURRENT, 0, bytes(4)))])
@pytest.mark.parametrize('rearm', [False, True])
def test_torque_of_another_sender_engages_the_e_stop(protocol, frame, rearm):
    robot = VirtualRobot(protocol, rearm=rearm).ready()
    robot.run(0.1, torque=0.5)
    robot.waiting.append((robot.now, record(frame)))
    report = robot.run(0.05, torque=0.5)
    assert hazards_of(report) == [''] and robot.motor == 0.0
    assert report.state is not MotorState.ARMED


def test_a_limit_of_the_drive_that_is_raised_under_power_engages_the_e_stop():
    robot = VirtualRobot('roboclaw').ready()
    robot.run(0.1, torque=0.5)
    robot.device.settings = replace(robot.device.settings, torque_limit=2.0, current_limit=80.0)
    assert hazards_of(robot.run(0.3, torque=0.5)) == ['max current [A]']


@pytest.mark.slow
@pytest.mark.parametrize('protocol', ['vesc', 'vesc_can'])
@pytest.mark.parametrize('setting', ['l_current_max', 'timeout'])
def test_settings_of_a_vesc_that_change_under_power_engage_the_e_stop(
        protocol, setting, monkeypatch):
    period = 0.5  # instead of 5 s
    monkeypatch.setattr(vesc, 'READ_BACK_PERIOD', period)
    robot = VirtualRobot(protocol).ready()
    robot.run(1.1 * period, torque=0.1)
    assert not robot.session.supervisor.e_stop
    device = robot.device
    if setting == 'timeout':
        device.application = device.application._replace(timeout=3.0)
    else:
        device.limits[setting] *= 10.0
    report = run_until_stopped(robot, 2.2 * period)
    assert setting in hazards_of(report) and robot.motor == 0.0


@pytest.mark.slow
@pytest.mark.parametrize('protocol', ['odrive 0.5', 'odrive 0.6', 'odrive_can 0.6'])
@pytest.mark.parametrize('setting, value', [
    ('axis0.config.watchdog_timeout', 3.0), ('axis0.config.enable_watchdog', 0)])
def test_settings_of_an_odrive_that_change_under_power_engage_the_e_stop(protocol, setting, value):
    robot = VirtualRobot(protocol).ready()
    robot.run(1.0, torque=0.1)
    assert not robot.session.supervisor.e_stop
    robot.device.properties[setting] = value
    report = run_until_stopped(robot, 7.0)
    assert setting in hazards_of(report) and robot.motor == 0.0


@pytest.mark.parametrize('boot_time', [0.005, 0.02, 0.05, 0.09])
def test_after_a_short_restart_of_a_roboclaw_its_serial_timeout_still_ends_the_torque(boot_time):
    robot = VirtualRobot('roboclaw').ready()
    robot.device.settings = replace(robot.device.settings, boot_time=boot_time, watchdog=0.0)
    robot.run(0.1, torque=0.5)
    robot.device.reboot(robot.now)
    robot.run(boot_time + 0.05, torque=0.5)
    robot.pass_time(0.12)  # the process is killed
    assert robot.motor == 0.0
