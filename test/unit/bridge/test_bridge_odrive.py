# SPDX-License-Identifier: Apache-2.0
"""Behaviour of the firmware of an ODrive, each case in a complete session."""
from itertools import product
import re

import pytest
from refusals import refused
from tiers import pairs, slow
from virtual_robot import VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import ConfigurationError, DriveError, LinkError, RefusedError

KINDS = ('odrive 0.5', 'odrive 0.6')
both = pytest.mark.parametrize('kind', KINDS)
CONTROLLER = 'axis0.controller.config.'


def type_lines(robot, *lines):
    """Send lines as from a serial terminal while the bridge is off."""
    for line in lines:
        robot.device.receive(f'{line}\n'.encode(), robot.now)
        robot.pass_time(0.01)


def refusal(robot, field):
    """Return the message that refuses the drive, with `field` as its first setting."""
    with refused('inconsistent', field, ConfigurationError) as caught:
        robot.session.configure()
    assert robot.lines == 0
    return str(caught.value)


# Limits

@both
def test_a_drive_with_factory_velocity_limits_is_refused_with_the_lines_to_type(kind):
    robot = VirtualRobot(kind, quirks=('vel_limit',))
    refused_with = refusal(robot, 'velocity limit in torque mode')
    assert 'overspeed error' in refused_with
    line = f'w {CONTROLLER}vel_limit 144'
    assert line in refused_with
    type_lines(robot, line)
    robot.ready()
    for _ in range(3):  # faster than 0.07 m/s, the speed at the factory limit
        report = robot.run(0.2, torque=1.5)
    assert robot.plant.state.velocity_x > 0.2
    assert report.state is MotorState.ARMED and not report.e_stop


def test_with_factory_limits_a_rolling_ball_would_be_disarmed():
    # The reason for the check: the same drive, with its limit reset after configure.
    robot = VirtualRobot('odrive 0.5').ready()
    robot.device.properties[CONTROLLER + 'vel_limit'] = 2.0
    report = robot.run(1.0, torque=1.5)
    assert report.e_stop.reason is StopReason.DISARMED_BY_DRIVE
    assert report.e_stop.names == ('CONTROLLER_FAILED', 'CONTROLLER_ERROR_OVERSPEED')
    assert 0.0 < robot.plant.state.velocity_x < 0.2 and robot.motor == 0.0


@both
def test_a_drive_without_regeneration_is_refused_and_the_remedy_corrects_it(kind):
    robot = VirtualRobot(kind, quirks=('regeneration',))
    type_lines(robot, *re.findall(
        r'w config\.dc_max_negative_current -[\d.]+', refusal(robot, 'braking')))
    assert robot.ready().run(0.2, torque=0.5).state is MotorState.ARMED


def test_a_drive_with_factory_settings_works_after_all_remedies():
    robot = VirtualRobot('odrive 0.5', quirks=('factory',))
    refused_with = refusal(robot, 'torque limit')
    lines = re.findall(r'w [\w.]+ [-+\w.]+', refused_with)
    calibration = 'w axis0.requested_state 3'  # before the watchdog, which is not fed yet
    lines.remove(calibration)
    lines.remove('w axis0.config.enable_watchdog 0')
    type_lines(robot, calibration)
    robot.pass_time(2.5)
    type_lines(robot, *lines)
    report = robot.ready().run(0.3, torque=0.5)
    assert report.state is MotorState.ARMED and not report.e_stop


# Firmware

def test_old_firmware_is_refused_with_its_version():
    robot = VirtualRobot('odrive 0.5')
    robot.device.properties['fw_version_revision'] = 3
    with refused('firmware', 'firmware', DriveError) as caught:
        robot.session.configure()
    assert '0.5.3' in str(caught.value)
    assert robot.lines == 0


def test_0_5_4_reports_the_cause_of_a_disarm_although_it_truncates_the_number():
    robot = VirtualRobot('odrive 0.5', quirks=('0.5.4',)).ready()
    robot.device.properties[CONTROLLER + 'vel_limit'] = 2.0
    report = robot.run(1.0, torque=1.5)
    assert {'MOTOR_ERROR_UNKNOWN_VOLTAGE_COMMAND', 'CONTROLLER_ERROR_OVERSPEED'} \
        <= set(report.e_stop.names)


# The cause of a disarm

@pytest.mark.parametrize('kind, phase', [
    *pairs(KINDS, [0.002 * number for number in range(0, 66, 9)]),
    *slow(*product(KINDS, (0.002 * number for number in range(0, 66, 3) if number % 9)))])
def test_an_expired_watchdog_is_named_before_the_next_request(kind, phase):
    robot = VirtualRobot(kind).ready()
    robot.run(0.1 + phase, torque=0.1)
    robot.to_drive = lambda data: b''.join(  # all torque commands are lost
        line for line in data.splitlines(True) if not line.startswith(b'c '))
    report = robot.run(0.25, torque=0.1)
    assert report.e_stop.reason is StopReason.DISARMED_BY_DRIVE
    assert report.e_stop.names == ('WATCHDOG_TIMER_EXPIRED',)
    assert report.state is MotorState.DISARMED


# Clearing of faults

def tripped(kind):
    """Return a robot whose drive has disarmed the motor."""
    robot = VirtualRobot(kind).ready()
    robot.run(0.1, torque=0.1)
    robot.device.over_current()
    robot.run(0.2)
    assert robot.session.supervisor.e_stop and robot.tick().telemetry.faults
    return robot


@both
def test_faults_are_cleared_on_request_and_the_motor_stays_without_power(kind):
    robot = tripped(kind)
    assert robot.session.clear_faults() == 'the drive reports no faults'
    report = robot.run(0.5)
    assert report.telemetry.faults == () and report.state is MotorState.DISARMED
    assert report.e_stop and robot.session.control.counts['links_lost'] == 0
    robot.session.release()
    assert robot.run(0.1, torque=0.1).state is MotorState.ARMED


@both
def test_clearing_of_recurring_faults_is_refused(kind):
    robot = tripped(kind)
    robot.temperature = 200.0
    robot.pass_time(0.01)
    with refused('standing', 'drive', RefusedError):
        robot.session.clear_faults()


def test_faults_are_not_cleared_while_the_motor_could_turn():
    robot = VirtualRobot()
    with refused('missing', 'drive', RefusedError):
        robot.session.clear_faults()
    robot.ready()
    with refused('refused', 'e_stop', RefusedError):
        robot.session.clear_faults()
    robot.session.engage('a person')
    with refused('busy', 'motor', RefusedError):
        robot.session.clear_faults()
    robot.run(0.1)
    assert robot.session.clear_faults()
    robot.plugged = False
    with refused('failed', 'drive', RefusedError):
        robot.session.clear_faults()
    assert robot.session.control.power.state is MotorState.DISCONNECTED


@pytest.mark.parametrize('error', [
    DriveError('not from here', 'not_clearable', 'drive'),
    LinkError('the cable is out', 'gone', 'port')])
def test_the_reason_why_faults_cannot_be_cleared_is_reported(monkeypatch, error):
    robot = tripped('odrive 0.5')

    def refuse(self, timeout):
        raise error
    monkeypatch.setattr(type(robot.session.line.driver), 'clear_faults', refuse)
    assert issubclass(type(robot.session.line.driver), Driver)
    with refused('failed', 'drive', RefusedError) as caught:
        robot.session.clear_faults()
    assert str(error) in str(caught.value)
