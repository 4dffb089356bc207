# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors, line and drive in simulated time: no torque on implausible data."""
from dataclasses import replace
from itertools import cycle
import math
import random

import pytest
from refusals import refused
from session_faults import (
    broken_belt, bunched_replies, COMMON_FAULTS, DRIVE_FAULTS, FAULTS, FORWARD, frozen, gyro,
    hold_up, in_degrees, in_g, kept_torque, loop, loop_late, lossy_bus, lost_status,
    mounted_backwards, noisy_line, repeated,
    reversed_encoder, sagging_supply, scaled_encoder, second_node, slow_reader, time_to_zero,
    transmitted, upside_down)
from tiers import pairs, slow
from virtual_robot import GIMBALL, STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState, RECONNECT_TIMEOUT
from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.driver import LARGEST_NUMBER
from ballbot_ros.errors import RefusedError
from ballbot_ros.estimation import ImuMounting, ImuReading

PROTOCOLS = ('odrive 0.5', 'odrive_can 0.6', 'vesc', 'roboclaw')


@pytest.mark.parametrize('drive, fault', pairs(
    [*((protocol, 'gentle') for protocol in PROTOCOLS), ('odrive 0.5', 'published')],
    ['encoder frozen', 'encoder frozen, its velocity too', 'encoder reversed']))
def test_an_encoder_that_contradicts_the_torque_engages_the_e_stop(drive, fault):
    protocol, tuning = drive
    robot = VirtualRobot(protocol, onboard=tuning).ready()
    assert time_to_zero(robot, FAULTS[fault]) < 0.3
    assert robot.session.supervisor.e_stop.reason in (
        StopReason.JOINT_TORQUE, StopReason.ENCODER_VELOCITY)
    assert robot.session.control.power.state is MotorState.DISARMED
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 1.6


@pytest.mark.parametrize('protocol, fault', pairs(
    PROTOCOLS, [frozen(True), reversed_encoder(True)]))
def test_an_encoder_that_contradicts_the_velocity_of_the_drive_engages_the_e_stop(
        protocol, fault):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.4, torque=2.0)
    fault(robot)
    report = robot.run(0.4, torque=0.1)  # too little torque to contradict it
    assert report.e_stop.reason is StopReason.ENCODER_VELOCITY
    assert report.state is not MotorState.ARMED and robot.motor == 0.0


@pytest.mark.parametrize('protocol', ['odrive', *slow('vesc', 'roboclaw')])
@pytest.mark.parametrize('seed', [0, *slow(1, 3)])
def test_a_busy_machine_causes_no_e_stop(protocol, seed):
    rng = random.Random(seed)
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    hold_up(robot, rng, 0.045)
    # The delays together are shorter than the watchdog of the drive.
    for _ in range(8):
        loop_late(robot, rng, 0.05, 0.4, SetPoint(Mode.HOLD, rng.uniform(-1.2, 1.2)))
    assert not robot.session.supervisor.e_stop


@pytest.mark.parametrize('fault', [
    frozen(True), *slow(frozen(False), reversed_encoder(True)), reversed_encoder(False)])
def test_a_contradiction_is_found_on_a_busy_machine(fault):
    rng = random.Random(1)
    robot = VirtualRobot('vesc', onboard='gentle').ready()
    loop(robot, 0.1, FORWARD)
    hold_up(robot, rng, 0.02)
    fault(robot)
    loop_late(robot, rng, 0.02, 1.0, FORWARD)
    assert robot.session.supervisor.e_stop and not robot.motor


@pytest.mark.parametrize('fault', [reversed_encoder(False), *slow(transmitted(-1.0))])
@pytest.mark.parametrize('pause', [0.06, *slow(0.085)])  # of the machine; the torque continues
def test_a_reversed_encoder_or_motor_is_found_despite_long_pauses(fault, pause):
    robot = VirtualRobot('vesc', imu=False, onboard='gentle').ready()
    loop(robot, 0.4, SetPoint(Mode.HOLD, 0.9))
    fault(robot)
    for _ in range(40):
        robot.pass_time(pause)
        loop(robot, 0.02, SetPoint(Mode.HOLD, 0.9))
    assert robot.session.supervisor.e_stop.reason is StopReason.JOINT_TORQUE and not robot.motor
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 2.0


@pytest.mark.slow
def test_steps_and_walls_at_full_torque_cause_no_e_stop():
    for height, set_point in ((0.031, SetPoint(Mode.SPEED, 1.0)), (0.2, SetPoint(Mode.HOLD, 1.4))):
        robot = VirtualRobot(onboard='published', terrain=[
            {'flat': {'length': 1.426}}, {'step': {'height': height}}, {'flat': {'length': 3.0}}])
        loop(robot.ready(), 4.0, set_point)
        assert not robot.session.supervisor.e_stop
        assert max(map(abs, robot.torques)) > 0.9 * robot.hardware.options().torque_limit


@pytest.mark.parametrize('speed', [0.05, *slow(-0.1, 0.3)])
def test_an_imu_that_is_mounted_backwards_engages_the_e_stop_at_any_speed(speed):
    robot = VirtualRobot(onboard='gentle')
    mounted_backwards(robot)
    loop(robot.ready(), 3.0, SetPoint(Mode.SPEED, speed))
    assert robot.session.supervisor.e_stop.reason is StopReason.JOINT_TORQUE
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 1.6


def test_a_motor_near_its_highest_speed_causes_no_e_stop():
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 4.0, SetPoint(Mode.HOLD, 1.5))
    assert not robot.session.supervisor.e_stop
    assert robot.plant.state.joint_rate > 7.0  # it delivers a part of the requested torque


@pytest.mark.parametrize('before, after', [
    (SetPoint(Mode.SPEED, 2.5), 0.5),
    *slow((SetPoint(Mode.DRIVE, 11.0), 0.5), (SetPoint(Mode.DRIVE, 11.0), -1.5))])
def test_braking_at_the_highest_speed_of_the_motor_causes_no_e_stop(before, after):
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 2.5, before)
    assert robot.plant.state.joint_rate > 6.0
    loop(robot, 0.5, SetPoint(Mode.SPEED, after))
    assert not robot.session.supervisor.e_stop


@pytest.mark.parametrize('share', [0.5, *slow(0.42)])
def test_a_sagging_supply_causes_no_e_stop(share):
    robot = VirtualRobot(onboard='gentle')
    sagging_supply(share)(robot)
    loop(robot.ready(), 3.0, SetPoint(Mode.HOLD, 1.5))
    assert robot.plant.state.joint_rate > 3.0  # less than half of the usual rate
    loop(robot, 0.5, SetPoint(Mode.SPEED, -0.5))
    assert not robot.session.supervisor.e_stop


@pytest.mark.parametrize('scale', [0.1, *slow(0.2)])
def test_a_joint_that_follows_a_small_part_of_its_torque_engages_the_e_stop(scale):
    robot = VirtualRobot(onboard='gentle').ready()
    assert time_to_zero(robot, scaled_encoder(scale, scale)) < 0.5
    assert robot.session.supervisor.e_stop.reason is StopReason.JOINT_TORQUE
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 1.6


@pytest.mark.parametrize('protocol', [*PROTOCOLS[:2], *slow(*PROTOCOLS[2:])])
def test_a_drive_that_does_not_confirm_its_status_is_stopped(protocol):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.1, FORWARD)
    assert time_to_zero(robot, lost_status) < 0.25
    assert robot.session.control.counts['unconfirmed'] == 1


@pytest.mark.parametrize('protocol, delay', pairs(PROTOCOLS, [0.12, 0.7]))
def test_a_loop_delayed_beyond_the_watchdog_engages_the_e_stop_with_every_drive(protocol, delay):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.3, FORWARD)
    assert robot.motor != 0.0
    robot.pass_time(delay)  # the process is suspended
    robot.torques.clear()
    loop(robot, 0.3, FORWARD)
    assert robot.session.supervisor.e_stop.reason is StopReason.HELD_UP
    assert not any(robot.torques) and robot.session.control.power.state is MotorState.DISARMED


def test_a_command_after_a_delay_beyond_the_watchdog_is_not_sent():
    robot = VirtualRobot('vesc')
    robot.device.application = robot.device.application._replace(timeout=0.04)
    robot.change(connection=replace(robot.hardware.connection, watchdog=0.05)).ready()
    robot.run(0.1, torque=0.5)
    assert robot.motor != 0.0
    robot.pass_time(0.06)
    robot.session.command(0.5, robot.now)  # before the first period of the loop
    robot.torques.clear()
    report = robot.run(0.1)
    assert report.e_stop.reason is StopReason.HELD_UP and not any(robot.torques)


@pytest.mark.parametrize('protocol', ['roboclaw', *slow(*PROTOCOLS[:3])])
def test_with_rearm_a_delayed_loop_arms_again_after_a_pause(protocol):
    robot = VirtualRobot(protocol, onboard='gentle', rearm=True).ready()
    loop(robot, 0.3, FORWARD)
    robot.pass_time(0.12)
    robot.torques.clear()
    loop(robot, 0.28, FORWARD)
    assert not any(robot.torques)
    loop(robot, 0.3, FORWARD)
    counts = robot.session.control.counts
    assert robot.motor != 0.0 and (counts['held_up'], counts['armed']) == (1, 2)


@pytest.mark.parametrize('protocol', ['roboclaw', *slow('vesc', 'odrive_can 0.6')])
def test_replies_at_a_lower_rate_than_the_gains_need_end_the_torque(protocol):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.2, FORWARD)
    assert 0.5 < time_to_zero(robot, bunched_replies(0.08)) < 1.0
    assert robot.session.law.too_slow and not robot.session.supervisor.e_stop


@pytest.mark.parametrize('seed', [0, *slow(6, 8)])
def test_lost_frames_are_not_mistaken_for_encoder_jumps(seed):
    robot = VirtualRobot('odrive_can 0.6', onboard='gentle').ready()
    lossy_bus(0.1, seed)(robot)
    for number in range(8):
        loop(robot, 0.3, SetPoint(Mode.HOLD, 1.2 * (-1) ** number))
    assert not robot.session.supervisor.e_stop and not robot.session.fusion.jumps


def test_set_points_are_accepted_and_dropped_while_the_drive_is_searched_for():
    robot = VirtualRobot(onboard='gentle', rearm=True).ready()
    loop(robot, 0.1, FORWARD)
    robot.plugged = False
    loop(robot, 1.5, FORWARD)  # raises no `MessageError`
    robot.plugged = True
    robot.loop(1.0)
    assert robot.session.control.power.state is MotorState.ARMED
    assert robot.session.law.set_point.mode is Mode.IDLE and not any(robot.torques[-500:])


def test_preemption_of_the_process_does_not_count_as_an_unconfirmed_status():
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 0.1, FORWARD)
    robot.pass_time(0.25)  # meanwhile the watchdog of the drive trips
    robot.loop(0.05)
    assert robot.session.control.counts['unconfirmed'] == 0


@pytest.mark.parametrize('fault, reason', [
    (repeated, 'imu_frozen'), (in_degrees, 'imu_turn_rate'), (in_g, 'imu_gravity'),
    (upside_down, 'imu_turn_rate')])
def test_an_imu_that_is_not_plausible_engages_the_e_stop(fault, reason):
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 0.2, FORWARD)
    assert time_to_zero(robot, fault, 6.0, SetPoint(Mode.SPEED, 0.5)) < 1.6
    assert robot.session.supervisor.e_stop.reason in (reason, StopReason.JOINT_TORQUE)


def test_wrong_turn_rates_of_single_readings_do_not_change_the_estimate():
    robot, rng = VirtualRobot(onboard='gentle').ready(), random.Random(1)
    gyro(lambda rate: rate + rng.choice((-35.0, 35.0)) * (rng.random() < 0.1))(robot)
    loop(robot, 0.6, SetPoint(Mode.SPEED, 0.5))
    assert not robot.session.supervisor.e_stop and robot.refused.reason == 'outlier'
    angle = robot.session.fusion.estimate.readings.pendulum_angle
    assert angle == pytest.approx(robot.plant.state.pendulum_angle, abs=0.03)


def test_smaller_errors_of_turn_rates_change_the_estimate_as_their_mean():
    robot, rng, errors = VirtualRobot(onboard='gentle').ready(), random.Random(1), []
    gyro(lambda rate: rate + 8.0 * (rng.random() < 0.01))(robot)
    for _ in range(40):
        loop(robot, 0.1, SetPoint(Mode.SPEED, 0.5))
        angle = robot.session.fusion.estimate.readings.pendulum_angle
        errors.append(abs(angle - robot.plant.state.pendulum_angle))
    assert not robot.session.supervisor.e_stop and max(errors) < 0.4


def test_the_centripetal_acceleration_of_an_imu_away_from_the_centre_is_plausible():
    robot, height, rate = VirtualRobot(), 0.22, -12.0  # 3.2 g at the speed limit of the joint
    sensing = robot.change(imu=ImuMounting(imu_upward=height)).session.sensing
    for number in range(1000):
        time = STEP * number
        angle = rate * time
        sensing.imu(ImuReading(
            time, rate, 9.81 * math.sin(angle), 9.81 * math.cos(angle) - height * rate**2), time)
        assert not sensing.imu_fault


@pytest.mark.parametrize('fault, reason, set_point', [
    (repeated, 'imu_frozen', FORWARD), (in_g, 'imu_gravity', SetPoint(Mode.IDLE))])
def test_the_e_stop_is_not_released_while_the_imu_is_not_plausible(fault, reason, set_point):
    robot = VirtualRobot(onboard='gentle').ready()
    fault(robot)
    loop(robot, 2.0, set_point)
    assert robot.session.supervisor.e_stop.reason == robot.refused.reason == reason
    with refused('standing', 'imu', RefusedError):
        robot.session.release()


@pytest.mark.parametrize('mode, value', [
    (Mode.HOLD, 10.0), (Mode.HOLD, -1.7), (Mode.DRIVE, 100.0), (Mode.SPEED, 5.0)])
def test_set_points_beyond_the_limits_are_refused(mode, value):
    robot = VirtualRobot(onboard='gentle').ready()
    with refused('out_of_range', mode.value):
        robot.session.give(SetPoint(mode, value))
    assert robot.session.law.set_point.mode is Mode.IDLE


@pytest.mark.parametrize('protocol, fault', [
    *pairs(PROTOCOLS, list(DRIVE_FAULTS)), *zip(cycle(PROTOCOLS), COMMON_FAULTS)])
def test_each_fault_ends_the_torque(protocol, fault):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.2, FORWARD)
    time_to_zero(robot, FAULTS[fault], 3.0, SetPoint(Mode.SPEED, 0.5))


# A RoboClaw computes its voltage from the measured velocity; the others get a torque.
@pytest.mark.parametrize('protocol', ['vesc', *slow('roboclaw')])
@pytest.mark.parametrize('fault', [
    scaled_encoder(1.0, 0.0), scaled_encoder(1.0, 0.5), scaled_encoder(1.0, 2.0),
    transmitted(0.5), transmitted(3.0), broken_belt], ids=[
        'velocity 0', 'half the velocity', 'twice the velocity', 'half the torque',
        'three times the torque', 'broken belt'])
def test_a_fault_without_an_e_stop_keeps_the_robot_within_its_limits(protocol, fault):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.5, SetPoint(Mode.SPEED, 0.5))
    fault(robot)
    robot.history.clear()
    loop(robot, 4.0, SetPoint(Mode.SPEED, 0.5))
    states = robot.history.values()
    assert max(abs(state.pendulum_angle) for state in states) < 1.0
    assert max(abs(state.ball_rate) for state in states) * GIMBALL.ball_radius < 0.55
    assert max(abs(state.joint_rate) for state in states) < 5.0
    assert not robot.session.supervisor.e_stop


def test_a_drive_that_keeps_its_torque_engages_the_e_stop():
    robot = VirtualRobot('vesc', onboard='gentle').ready()
    loop(robot, 0.5, SetPoint(Mode.SPEED, 0.5))
    assert time_to_zero(robot, kept_torque, 2.0, SetPoint(Mode.SPEED, 0.5)) < 1.0
    assert robot.session.supervisor.e_stop.reason is StopReason.JOINT_TORQUE


@pytest.mark.parametrize('protocol', ['odrive_can 0.5', 'vesc_can', *slow('odrive_can 0.6')])
def test_two_drives_with_the_same_id_on_a_bus_end_the_torque(protocol):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.5, SetPoint(Mode.SPEED, 0.5))
    assert time_to_zero(robot, second_node, 2.0, SetPoint(Mode.SPEED, 0.5)) < 0.6
    assert robot.session.supervisor.e_stop.reason in (
        StopReason.DISARMED_BY_DRIVE, StopReason.JOINT_TORQUE)


@pytest.mark.parametrize('protocol', ['vesc', *slow(*PROTOCOLS[:2], 'roboclaw')])
def test_another_device_on_the_port_of_the_drive_gets_no_torque(protocol):
    robot = VirtualRobot(protocol, onboard='gentle', rearm=True).ready()
    loop(robot, 0.1, FORWARD)
    robot.plugged = False
    loop(robot, 0.1, FORWARD)
    written, noise = [], random.Random(1)
    robot.plugged, robot.to_drive = True, lambda data: written.append(data) or b''
    robot.from_drive = lambda data: noise.randbytes(11)
    loop(robot, 3.0, FORWARD)
    assert written and robot.session.control.power.state is MotorState.DISCONNECTED
    assert robot.session.control.counts['armed'] == 1 and not robot.motor
    assert 'no complete reply' in robot.session.line.trouble


@pytest.mark.parametrize('protocol, change', pairs(PROTOCOLS, [
    lambda byte, rng: b'', lambda byte, rng: bytes([byte, byte]),
    lambda byte, rng: bytes([byte ^ 1 << rng.randrange(8)]),
    lambda byte, rng: bytes([byte, rng.randrange(256)])]))
def test_a_line_that_corrupts_each_hundredth_byte_stops_the_motor_or_does_no_harm(
        protocol, change):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.5, SetPoint(Mode.SPEED, 0.5))
    noisy_line(change)(robot)
    loop(robot, 2.0, SetPoint(Mode.SPEED, 0.5))
    assert max(abs(state.pendulum_angle) for state in robot.history.values()) < 1.6
    cause = robot.session.supervisor.e_stop
    if cause:
        assert cause.reason in (StopReason.SILENT, StopReason.UNCONFIRMED, StopReason.LOST,
                                StopReason.DISARMED_BY_DRIVE, StopReason.HAZARD)
        robot.loop(0.5)
        assert not any(robot.torques[-100:])


def slowly_read(protocol, rate):
    """Return a rolling robot whose drive reads at a limited rate [bytes/s]."""
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    loop(robot, 0.3, FORWARD)
    slow_reader(rate)(robot)
    loop(robot, 0.05, FORWARD)
    return robot


@pytest.mark.parametrize('protocol', [
    'roboclaw', 'vesc_can', *slow(*PROTOCOLS[:3], 'odrive_can 0.5')])
@pytest.mark.parametrize('rate', [*slow(100.0), 1000.0])
def test_a_drive_that_reads_slowly_executes_few_commands_after_a_stop(protocol, rate):
    robot = slowly_read(protocol, rate)
    driver = robot.session.line.driver
    robot.session.engage('requested')
    limit = LARGEST_NUMBER * driver.budget().bytes_out / rate + 2.0 * driver.options.watchdog
    robot.loop(limit)
    robot.torques.clear()
    robot.loop(0.3)
    assert robot.torques and not any(robot.torques)


@pytest.mark.parametrize('protocol', ['vesc', *slow(*PROTOCOLS[:2], 'roboclaw', 'odrive_can 0.5')])
@pytest.mark.parametrize('rate', [60.0, *slow(90.0)])
def test_the_watchdog_stops_a_drive_that_reads_with_pauses_between_bytes(protocol, rate):
    robot = slowly_read(protocol, rate)
    robot.session.engage('requested')
    robot.loop(RECONNECT_TIMEOUT + 2.0 * robot.hardware.connection.watchdog)
    robot.torques.clear()
    robot.loop(0.3)
    assert robot.torques and not any(robot.torques)


@pytest.mark.parametrize('protocol', [*slow(*PROTOCOLS[:3]), PROTOCOLS[3]])
def test_a_slow_line_limits_the_rate_of_commands_and_not_their_age(protocol):
    robot = VirtualRobot(protocol, onboard='gentle').ready()
    slow_reader(3000.0)(robot)
    loop(robot, 2.0, FORWARD)
    assert not robot.session.supervisor.e_stop and any(robot.torques)


@pytest.mark.parametrize('direction', ['to_drive', 'from_drive'])
def test_a_vesc_continues_after_a_corrupted_length(direction):
    robot = VirtualRobot('vesc', onboard='gentle').ready()
    loop(robot, 0.2, FORWARD)
    length = iter([b'\xff'])
    setattr(robot, direction, lambda data: data and data[:1] + next(length, data[1:2]) + data[2:])
    loop(robot, 0.5, FORWARD)
    assert not robot.session.supervisor.e_stop and next(length, None) is None


def test_after_a_fault_of_the_encoder_a_new_configuration_at_rest_permits_the_release():
    robot = VirtualRobot(onboard='gentle').ready()
    loop(robot, 0.5, SetPoint(Mode.SPEED, 0.8))
    time_to_zero(robot, frozen(False), set_point=SetPoint(Mode.SPEED, 0.8))
    robot.loop(3.0)  # the ball rolls on
    robot.encoder = lambda true: true
    robot.loop(6.0)
    assert abs(robot.plant.state.pendulum_angle) < 0.1
    with refused('standing', 'pendulum_angle', RefusedError):
        robot.session.release()
    robot.session.configure()
    robot.session.activate()
    robot.loop(0.6)
    robot.session.release()
    loop(robot, 2.0, SetPoint(Mode.SPEED, 0.3))
    assert not robot.session.supervisor.e_stop


def test_an_imu_upside_down_inhibits_the_release_if_the_encoder_zero_is_set():
    robot = VirtualRobot('roboclaw', onboard='gentle')
    robot.change(joint=replace(robot.hardware.joint, encoder_zero=0.0))
    upside_down(robot)
    robot.active().run(0.7)
    with pytest.raises(RefusedError):
        robot.session.release()
    loop(robot, 0.5, SetPoint(Mode.IDLE))
    assert not any(robot.torques)


@pytest.mark.slow
@pytest.mark.parametrize('torque', [0.35, *slow(0.05)])  # below the threshold of the torque check
@pytest.mark.parametrize('fault, turn', [
    *slow((frozen(False), 4.5), (reversed_encoder(False), 2.3)), (upside_down, 2.3)])
def test_contradictory_sensors_stop_slow_motion_within_a_fraction_of_a_turn(
        fault, turn, torque):
    robot = VirtualRobot().ready()
    robot.run(0.3, torque=torque)
    fault(robot)
    start = robot.plant.state.ball_angle
    for _ in range(800):
        robot.run(0.02, torque=torque)
        if robot.session.supervisor.e_stop:
            break
    assert robot.session.supervisor.e_stop.reason is StopReason.IMU_TURN_RATE
    assert abs(robot.plant.state.ball_angle - start) < turn


@pytest.mark.slow
def test_an_imu_upside_down_at_rest_is_detected_within_a_fraction_of_a_turn():
    robot = VirtualRobot()
    upside_down(robot)  # a shell at rest may lie on any side, so this is plausible
    robot.ready()
    for _ in range(600):
        robot.run(0.02, torque=0.1)
        if robot.session.supervisor.e_stop:
            break
    assert robot.session.supervisor.e_stop
    assert abs(robot.plant.state.ball_angle) < 2.3
