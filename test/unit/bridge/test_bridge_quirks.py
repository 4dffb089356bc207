# SPDX-License-Identifier: Apache-2.0
"""Quirks of drive firmware that the bridge must handle, each in a complete session."""
from dataclasses import replace
import math

import pytest
from refusals import refused
from tiers import slow
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.errors import ConfigurationError, DriveError


@pytest.mark.parametrize('idle', [
    *slow(*(0.102 + 0.004 * number for number in range(12))),
    *(0.1 + 0.004 * number for number in range(13))])
def test_a_vesc_is_armed_after_any_idle_time(idle):
    robot = VirtualRobot('vesc')
    robot.session.configure()
    robot.run(idle)
    robot.session.activate()
    robot.session.release()
    report = robot.run(0.1, torque=0.5)
    assert report.state is MotorState.ARMED and not report.e_stop
    assert robot.motor > 0.0 and robot.session.control.counts['disarmed_by_drive'] == 0


@pytest.mark.slow
def test_the_kill_switch_of_a_vesc_ends_the_torque_until_the_next_release():
    robot = VirtualRobot('vesc', quirks=('kill_switch',)).ready()
    robot.run(0.1, torque=0.5)
    assert robot.motor > 0.0
    robot.stop_switch = 1.0
    report = robot.run(0.05, torque=0.5)
    assert robot.motor == 0.0 and report.e_stop.reason is StopReason.DISARMED_BY_DRIVE
    assert report.telemetry.faults == ('KILL_SW_ACTIVE',)
    robot.run(0.6, torque=0.0)
    robot.session.release()
    assert robot.run(0.1).e_stop.reason is StopReason.NOT_ARMED
    robot.stop_switch = 0.0
    robot.torques.clear()
    assert robot.run(0.6, torque=0.0).state is MotorState.DISARMED and not any(robot.torques)
    robot.session.release()
    robot.run(0.1, torque=0.5)
    assert robot.motor > 0.0


def test_a_vesc_with_old_firmware_is_refused_with_its_version():
    robot = VirtualRobot('vesc')
    robot.device.version = (5, 2)
    with refused('firmware', 'firmware', DriveError) as caught:
        robot.session.configure()
    assert '5.02' in str(caught.value)
    assert robot.lines == 0


def test_a_vesc_without_regeneration_is_refused():
    robot = VirtualRobot('vesc', quirks=('regen_limit',))
    with refused('inconsistent', 'braking power', ConfigurationError):
        robot.session.configure()


@pytest.mark.parametrize('firmware', ['5.03', '6.02', '6.05', '7.01'])
def test_each_supported_firmware_of_a_vesc_works(firmware):
    robot = VirtualRobot(f'vesc {firmware}').ready()
    robot.run(0.1, torque=0.9)
    assert robot.motor == pytest.approx(0.9 / (50.0 * 0.9), rel=0.01)


def test_a_hot_vesc_warns_and_stays_armed():
    robot = VirtualRobot('vesc').ready()
    robot.temperature = 88.0
    report = robot.run(0.1, torque=0.5)
    assert report.telemetry.warnings == ('MOSFET_TEMP_CUTOFF',)
    assert report.state is MotorState.ARMED and not report.e_stop


# RoboClaw

@pytest.mark.parametrize('bus_voltage, temperature, warning', [
    (24.0, 90.0, 'TEMPERATURE_WARNING'), (9.5, 35.0, 'MAIN_VOLTAGE_LOW_WARNING')])
def test_a_roboclaw_warning_is_reported_without_a_stop(bus_voltage, temperature, warning):
    robot = VirtualRobot('roboclaw').ready()
    robot.bus_voltage, robot.temperature = bus_voltage, temperature
    report = robot.run(0.2, torque=0.3)
    assert report.telemetry.warnings == (warning,) and report.telemetry.faults == ()
    assert report.state is MotorState.ARMED and not report.e_stop
    robot.bus_voltage, robot.temperature = 24.0, 35.0
    assert robot.run(0.2, torque=0.3).telemetry.warnings == () and robot.motor > 0.0


def test_the_e_stop_input_of_a_roboclaw_is_named():
    robot = VirtualRobot('roboclaw').ready()
    robot.run(0.1, torque=0.5)
    assert robot.motor > 0.0
    robot.stop_switch = 1.0
    report = robot.run(0.1, torque=0.5)
    assert report.e_stop.reason is StopReason.DISARMED_BY_DRIVE
    assert 'E_STOP' in report.e_stop.names and report.state is not MotorState.ARMED
    robot.stop_switch = 0.0
    robot.run(0.6, torque=0.0)
    assert robot.motor == 0.0
    robot.session.release()
    robot.run(0.1, torque=0.5)
    assert robot.motor > 0.0


def test_the_serial_timeout_of_a_roboclaw_is_set_at_every_start():
    robot = VirtualRobot('roboclaw')
    robot.device.__init__(replace(robot.device.settings, watchdog=0.0))
    robot.ready()
    robot.run(0.1, torque=0.5)
    robot.pass_time(0.12)  # without a tick
    assert robot.motor == 0.0 and robot.device._timeout == 1
    robot.run(0.6, torque=0.0)
    robot.session.release()
    robot.run(0.1, torque=0.0)
    robot.device.reboot(robot.now)
    robot.run(1.5, torque=0.0)
    assert robot.session.line.reconnects == 0  # too short for a reconnection
    robot.session.release()
    robot.run(0.1)
    assert robot.session.control.power.state is MotorState.ARMED and robot.device._timeout == 1


def test_a_roboclaw_without_a_serial_timeout_is_refused():
    robot = VirtualRobot('roboclaw', quirks=('no_timeout',))
    with refused('inconsistent', 'watchdog', ConfigurationError):
        robot.session.configure()


# An encoder that jumps

@pytest.mark.parametrize('protocol', ['odrive 0.5', *slow('vesc', 'roboclaw')])
@pytest.mark.parametrize('turns', [2.0, -2.0])
def test_a_jump_of_two_turns_is_reported_and_the_angle_stays_correct(protocol, turns, caplog):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.3, torque=0.8)
    robot.encoder_jump = turns * math.tau
    for _ in range(100):
        report = robot.run(STEP, torque=0.8)
        if report.estimate is not None:
            error = report.estimate.readings.pendulum_angle - robot.plant.state.pendulum_angle
            assert abs(error) < math.radians(1.5)
    assert report.state is MotorState.ARMED and not report.e_stop
    assert robot.session.fusion.rezeroed == 1
    warnings = [text for text in caplog.messages if 'encoder jumped' in text]
    assert warnings == [
        f'the encoder jumped by {turns * math.tau / 50.0:.3f} rad at the joint; '
        'its zero was shifted by the same angle']


def test_repeated_encoder_jumps_end_the_torque_and_then_disarm_the_motor():
    robot = VirtualRobot('vesc').ready()
    robot.run(0.3, torque=0.8)
    start, off = robot.now, math.inf
    while robot.now - start < 0.15:
        robot.encoder_jump = -robot.encoder_jump or 4.0 * math.tau
        report = robot.run(STEP, torque=0.8)
        off = min(off, robot.now - start) if robot.motor == 0.0 else math.inf
    assert off <= 0.03
    assert report.e_stop.reason is StopReason.ENCODER_JUMPS
    assert report.state is not MotorState.ARMED


@pytest.mark.parametrize('protocol', ['vesc', *slow('roboclaw')])
def test_the_angle_stays_correct_when_a_restarted_drive_has_another_zero(protocol):
    robot = VirtualRobot(protocol, rearm=True).ready()
    robot.run(0.22, torque=0.8)
    joint = robot.plant.state.joint_angle
    assert 0.2 < abs(joint) < 0.5  # less than half a radian, but not zero
    robot.device.reboot(robot.now)
    for _ in range(500):
        report = robot.run(STEP, torque=0.0)
        if report.estimate is not None:
            truth = robot.history[round(report.estimate.stamp / STEP)]
            error = report.estimate.readings.pendulum_angle - truth.pendulum_angle
            assert abs(error) < math.radians(3.0)
    assert robot.session.fusion.rezeroed == 1
    assert robot.session.fusion.last_jump == pytest.approx(-joint, abs=0.15)
