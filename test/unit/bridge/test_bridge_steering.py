# SPDX-License-Identifier: Apache-2.0
"""A robot with a second motor turns, and each fault of one axis ends the torque of both."""
from dataclasses import replace
from itertools import product
import math
import random

import pytest
from refusals import refused
from session_faults import (
    frozen, hold_up, loop, loop_late, rebooted_drive, requested_stop, reversed_encoder,
    silent_drive, silent_imu, tripped_drive, unplugged)
from tiers import pairs, slow
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.feasibility import wire_budget
from ballbot_ros.bridge.hardware_file import load_hardware, read_hardware
from ballbot_ros.bridge.lean import LateralAxis
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.session import Session
from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.drives.roboclaw import codec
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
TURN = SetPoint(Mode.SPEED, 0.5, yaw_rate=0.25)
STEERING = {'gear_ratio': 50.0}

OTHERS = ('odrive 0.5', 'vesc_can', 'odrive_can 0.6')

with_a_roboclaw = pytest.mark.parametrize('robot', ['roboclaw'], indirect=True)


@pytest.fixture(params=['roboclaw', *slow(*OTHERS)])
def robot(request):
    """Return a robot that steers, its e-stop released; an ODrive has a port for each motor."""
    return VirtualRobot(request.param, onboard='gentle', steering=True).ready()


@pytest.mark.parametrize('seed', range(4))
def test_the_lean_observer_stays_within_the_range_of_its_model(seed):
    choose, speed, now, lean, rate = random.Random(seed), 0.4, 0.0, 0.0, 0.0
    hardware = load_hardware('gimball_roboclaw_steering')
    gear = hardware.steering.gear_ratio
    sensing = LateralAxis(hardware.lateral(GIMBALL), GIMBALL, lambda: speed, lambda: None)
    sensing.begin(now)
    for _ in range(1500):
        pause = choose.choice((0.0005, 0.002, 0.01, 0.03))
        now, rate = now + pause, min(max(rate + choose.gauss(0.0, 3.0), -20.0), 20.0)
        lean, speed = lean + rate * pause, min(max(speed + choose.gauss(0.0, 0.1), -3.0), 3.0)
        found = sensing.take(Telemetry(now, now, gear * lean, gear * rate))
        assert found is None or max(map(abs, found.readings[2:5])) < 60.0


@pytest.fixture
def turning(robot):
    """Return a robot in a turn."""
    robot.loop(0.3, TURN)
    assert any(robot.torques[-50:]) and any(robot.leans[-50:])
    return robot


@pytest.mark.slow
@pytest.mark.parametrize('robot, speed, yaw_rate', [
    ('roboclaw', 0.3, 0.15), ('odrive 0.5', 0.5, -0.3), ('vesc_can', -0.4, 0.2),
    ('odrive_can 0.6', 0.7, 0.1)], indirect=['robot'])
def test_it_turns_at_the_commanded_yaw_rate(robot, speed, yaw_rate):
    robot.loop(5.0, SetPoint(Mode.SPEED, speed, yaw_rate=yaw_rate))
    heading = robot.lateral.heading
    robot.loop(2.0, SetPoint(Mode.SPEED, speed, yaw_rate=yaw_rate))
    assert (robot.lateral.heading - heading) / 2.0 == pytest.approx(yaw_rate, rel=0.03)
    assert robot.session.lateral.state.tilt == pytest.approx(robot.lateral.tilt, abs=0.005)
    assert not robot.session.supervisor.e_stop


@pytest.mark.slow
@with_a_roboclaw
def test_odometry_follows_the_turn(robot):
    for yaw_rate in (0.3, -0.2, 0.0):
        robot.loop(1.5, SetPoint(Mode.SPEED, 0.4, yaw_rate=yaw_rate))
    assert robot.session.course.pose == pytest.approx(robot.course.pose, abs=0.02)
    assert abs(robot.course.y) > 0.2
    robot.session.engage('test')
    robot.loop(1.5)
    robot.session.release()
    robot.loop(0.5, SetPoint(Mode.SPEED, 0.4))
    assert robot.session.course.pose == pytest.approx(robot.course.pose, abs=0.05)


@pytest.mark.slow
@with_a_roboclaw
def test_without_a_yaw_rate_it_drives_straight(robot):
    robot.loop(3.0, SetPoint(Mode.SPEED, 0.5))
    assert robot.lateral.heading == 0.0 and abs(robot.lateral.lean) < 1e-3


@pytest.mark.slow
@with_a_roboclaw
def test_the_lean_stays_within_the_limit_of_the_robot(robot):
    leans = []
    for _ in range(75):
        robot.loop(0.02, SetPoint(Mode.SPEED, 0.5, yaw_rate=3.0))
        leans.append(abs(robot.lateral.lean))
    assert 0.2 < max(leans) < 1.1 * GIMBALL.steering.largest_lean
    assert not robot.session.supervisor.e_stop


def silent_axis(number):
    """Return a fault that drops all replies to one axis."""
    def plant(robot):
        driver = robot.session.axes[number].line.driver
        driver._parser.feed = lambda data: []
    return plant


COMMON_FAULTS = {
    'lean reversed': reversed_encoder(True, axis=1),
    'lean reversed, velocity too': reversed_encoder(False, axis=1),
    'lean frozen': frozen(True, axis=1), 'lean frozen, velocity too': frozen(False, axis=1),
    'requested': requested_stop, 'silent IMU': silent_imu}
DRIVE_FAULTS = {
    'unplugged': unplugged, 'lean silent': silent_axis(1), 'joint silent': silent_axis(0),
    'silent drive': silent_drive, 'tripped': tripped_drive, 'rebooted': rebooted_drive}
FAULTS = {**COMMON_FAULTS, **DRIVE_FAULTS}
QUICK = ('unplugged', 'lean silent', 'lean reversed')


# Only the faults of line and drive depend on the protocol.
@pytest.mark.parametrize('robot, fault', [
    *product(['roboclaw'], QUICK),
    *slow(*(('roboclaw', fault) for fault in FAULTS if fault not in QUICK),
          *product(OTHERS, DRIVE_FAULTS))], indirect=['robot'])
def test_each_fault_of_one_axis_ends_the_torque_of_both(turning, fault):
    robot, first = turning, len(turning.torques)
    FAULTS[fault](robot)
    set_point = SetPoint(Mode.SPEED, 0.5, yaw_rate=-0.4)  # requires torque on both axes
    for _ in range(100):
        loop(robot, 0.02, set_point)
        if robot.session.supervisor.e_stop:
            break
    robot.loop(0.3)
    assert all(axis.supervisor.e_stop for axis in robot.session.axes)
    last = max(number for torques in (robot.torques, robot.leans)
               for number, torque in enumerate(torques, 1) if torque)
    assert STEP * (last - first) < 0.7
    states = {axis.power.state for axis in robot.session.axes}
    assert states <= {MotorState.DISARMED, MotorState.DISCONNECTED}


def test_both_axes_have_the_cause_of_one_axis_with_the_names_of_its_faults(turning):
    cause = EStop(StopReason.DISARMED_BY_DRIVE, 'the drive disarmed the motor: HOT', ('HOT',))
    turning.session.axes[1].supervisor.trigger(cause)
    turning.loop(0.01, TURN)
    assert turning.session.supervisor.e_stop == cause


@pytest.mark.slow
@pytest.mark.parametrize('velocity', [True, False])
def test_a_frozen_lean_encoder_is_detected_at_a_low_yaw_rate(velocity):
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True).ready()
    robot.loop(1.5, SetPoint(Mode.SPEED, 0.5))
    frozen(velocity, axis=1)(robot)
    loop(robot, 0.3, SetPoint(Mode.SPEED, 0.5, yaw_rate=0.08))
    assert robot.session.supervisor.e_stop and not robot.leans[-1]


@pytest.mark.slow
@pytest.mark.parametrize('seed', [3, 8, 9])
def test_late_commands_and_replies_cause_no_fault_of_the_lean_axis(seed):
    rng = random.Random(seed)
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True).ready()
    hold_up(robot, rng, 0.04)
    loop_late(robot, rng, 0.04, 3.0, TURN)
    assert not robot.session.supervisor.e_stop
    assert robot.lateral.heading > 0.3


@pytest.mark.parametrize('robot, exit_by', pairs(
    ['roboclaw', 'odrive 0.5', 'vesc_can', 'odrive_can 0.6'], ['deactivate', 'close']),
    indirect=['robot'])
def test_each_exit_stops_both_motors_and_both_confirm_it(turning, exit_by):
    getattr(turning.session, exit_by)()
    turning.pass_time(STEP)
    assert turning.torques[-1] == turning.leans[-1] == 0.0
    assert not any(axis.unconfirmed for axis in turning.session.axes)
    expected = MotorState.DISARMED if exit_by == 'deactivate' else MotorState.DISCONNECTED
    assert {axis.power.state for axis in turning.session.axes} == {expected}
    assert turning.lines == (exit_by == 'deactivate')


def test_the_drive_stops_both_motors_when_the_process_is_killed(turning):
    turning.pass_time(0.2)  # nothing is sent; the serial timeout is 0.1 s
    assert turning.torques[-1] == turning.leans[-1] == 0.0


@pytest.mark.slow
def test_an_axis_on_its_own_port_ends_the_torque_of_both_when_it_is_unplugged():
    robot = VirtualRobot('vesc', onboard='gentle', steering=True).ready()
    robot.loop(1.0, TURN)
    robot.second_port.plugged = False
    robot.loop(0.3)
    assert not any(robot.torques[-50:]) and not any(robot.leans[-50:])
    assert all(axis.line.driver is None for axis in robot.session.axes)
    robot.second_port.plugged = True
    robot.loop(1.0)
    robot.session.release()
    robot.loop(1.0, TURN)
    assert any(robot.torques[-50:]) and any(robot.leans[-50:])


@pytest.mark.slow
@pytest.mark.parametrize('rearm', [False, True])
def test_after_a_lost_line_both_axes_are_found_and_armed_again(rearm):
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True, rearm=rearm).ready()
    robot.loop(1.0, TURN)
    unplugged(robot)
    robot.loop(0.3)
    robot.plugged = True
    robot.loop(1.5)
    assert all(axis.line.driver is not None for axis in robot.session.axes)
    if not rearm:
        robot.session.release()
    robot.loop(1.0, TURN)
    assert {axis.power.state for axis in robot.session.axes} == {MotorState.ARMED}
    assert any(robot.torques[-50:]) and any(robot.leans[-50:])


def test_no_axis_has_torque_before_both_are_armed(robot):
    session = robot.session
    session.engage('test')
    robot.loop(0.7)
    second = session.axes[1]
    arm, second._arm = second._arm, lambda driver: None
    session.release()
    robot.loop(0.5, TURN)
    assert session.control.power.state is MotorState.ARMED
    assert not any(robot.torques[-200:])
    second._arm = arm
    robot.loop(0.5, TURN)
    assert any(robot.torques[-50:])


@pytest.mark.slow
def test_the_other_axis_is_fed_while_one_arms_slowly(robot):
    session, driver = robot.session, robot.session.axes[1].line.driver
    session.engage('test')
    robot.loop(0.7)
    arm = driver._arm

    def slow(deadline):
        driver._until(lambda: False, driver.clock() + 0.2)
        arm(driver.clock() + 0.25)
    driver._arm = slow
    session.release()
    robot.loop(1.0, TURN)
    assert not session.supervisor.e_stop
    assert {axis.power.state for axis in session.axes} == {MotorState.ARMED}


def test_a_second_drive_with_wrong_settings_is_refused_and_no_line_stays_open():
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True)
    answers, right = robot.device._answers, robot.device._answers[codec.GET_MAX_CURRENT[1]]
    answers[codec.GET_MAX_CURRENT[1]] = lambda: (99999, 0)
    with refused('inconsistent', 'torque limit'):
        robot.session.configure()
    assert robot.lines == 0 and robot.session.line.driver is None
    answers[codec.GET_MAX_CURRENT[1]] = right
    robot.session.configure()


def with_steering(name, robot='gimball', **steering):
    """Return hardware of the package with a section steering."""
    hardware = load_hardware(name)
    content = {
        'name': 'test', 'robot': robot, 'joint': {'gear_ratio': 50.0},
        'limits': {'torque_limit': 4.0}, 'drive': dict(hardware.drive),
        'connection': {'protocol': hardware.connection.protocol, 'port': '/dev/ttyA'},
        'steering': {**STEERING, **steering}}
    return read_hardware(content, 'test')


@pytest.mark.parametrize('hardware, reason, field', [
    (lambda: with_steering('gimball_roboclaw').lateral(GIMBALL), 'inconsistent', 'axis'),
    (lambda: with_steering('gimball_vesc_can').lateral(GIMBALL), 'inconsistent', 'can_id'),
    (lambda: with_steering('gimball_odrive').lateral(GIMBALL), 'missing', 'port'),
    (lambda: load_hardware('gimball_odrive').lateral(GIMBALL), 'missing', 'steering'),
    (lambda: with_steering('gimball_vesc', port='/dev/ttyB').lateral(load_robot('shellball')),
     'missing', 'steering'),
    (lambda: with_steering('gimball_roboclaw', drive={'watchdog': 3.0}), 'inconsistent',
     'watchdog'),
    (lambda: with_steering('gimball_roboclaw', largest_lean=0.3), 'unknown_name', 'largest_lean'),
    (lambda: with_steering('gimball_roboclaw', gear_ratio=math.nan), 'not_finite', 'gear_ratio')])
def test_a_section_steering_that_cannot_work_is_refused(hardware, reason, field):
    with refused(reason, field):
        hardware()


def test_limits_of_the_lateral_axis_are_those_of_the_robot():
    lateral = load_hardware('gimball_roboclaw_steering').lateral(GIMBALL)
    assert lateral.limits.torque_limit == GIMBALL.steering.largest_torque
    assert lateral.limits.angle_limit == GIMBALL.steering.largest_lean
    assert lateral.limits.speed_limit == GIMBALL.steering.largest_lean_rate


def test_the_laws_must_run_on_board_to_steer():
    hardware = load_hardware('gimball_roboclaw_steering')
    with refused('inconsistent', 'control'):
        Session(hardware, GIMBALL, lambda: None, connect_lateral=lambda: None)


def test_both_axes_count_in_the_budget_of_a_line_that_they_share():
    hardware = load_hardware('gimball_roboclaw_steering')
    both = wire_budget(hardware, GIMBALL)
    one = wire_budget(replace(hardware, steering=None), GIMBALL)
    assert both.bytes_in == 2 * one.bytes_in and both.bytes_out == 2 * one.bytes_out


def test_frequent_bytes_while_an_axis_arms_feed_the_other_at_a_limited_rate():
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True).ready()
    axis, fed = robot.session.axes[1], []
    axis.line.driver.feed = lambda: fed.append(robot.now)
    for _ in range(100):
        axis.feed()
    assert 0 < len(fed) <= 2


@pytest.mark.parametrize('number', [0, 1])
def test_an_axis_has_no_torque_while_the_measurements_of_the_other_are_too_old(number):
    robot = VirtualRobot('roboclaw', onboard='gentle', steering=True).ready()
    loop(robot, 0.3, TURN)
    torques = (robot.torques, robot.leans)[number]
    assert torques[-1]
    robot.session.axes[1 - number].sensing.is_stale = lambda now: True
    loop(robot, 0.02, TURN)
    assert not torques[-1]
