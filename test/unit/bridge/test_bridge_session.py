# SPDX-License-Identifier: Apache-2.0
"""The motor is stopped in every case, as shown by the torque of the emulated motor."""
from dataclasses import replace
import math

import pytest
from refusals import refused
from tiers import pairs, slow
from virtual_robot import ALL, STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.control import load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.drives.driver import STOP_PERIOD
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import (
    ConfigurationError, DriveError, EstimateLostError, LinkError, RefusedError)
from ballbot_ros.physics import load_robot

PROTOCOLS = [*slow(ALL[0]), *ALL[1:3], *slow(ALL[3]), *ALL[4:]]


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_command_reaches_the_motor_as_torque_at_the_pendulum(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.1, torque=0.9)
    # A RoboClaw applies a voltage: its torque is computed from a speed that is a period old.
    assert robot.motor == pytest.approx(
        0.9 / (50.0 * 0.9), rel=0.03 if protocol == 'roboclaw' else 0.01)


def test_the_estimate_follows_the_true_pendulum_over_the_line():
    robot = VirtualRobot().ready()
    for _ in range(300):
        report = robot.run(STEP, torque=0.8)
        if report.estimate is not None:
            error = report.estimate.readings.pendulum_angle - robot.plant.state.pendulum_angle
            assert abs(error) < math.radians(1.5)
    assert robot.plant.state.pendulum_angle > 0.3


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['odrive 0.5', 'odrive 0.6'])
def test_the_ball_crosses_a_step_with_bridge_and_controller(kind):
    robot = VirtualRobot(kind, terrain=[{'flat': {'length': 1.426}}, {'step': {'height': 0.031}},
                                        {'flat': {'length': 3.0}}]).ready()
    controller = PendulumController(load_robot('gimball'), load_tuning('gentle'))
    controller.give(SetPoint(Mode.HOLD, 0.45))
    torque, last = 0.0, robot.now + 6.0
    while robot.plant.state.x < 2.0 and robot.now < last:
        report = robot.run(STEP, torque)  # a period late, as over ROS
        if robot.plant.state.velocity_x > 1.0:
            controller.give(SetPoint(Mode.HOLD, 0.0))
        if report.estimate is not None:
            torque = controller.torque(report.estimate.readings)
    assert robot.plant.state.x >= 2.0  # its centre is past the edge, by half a metre
    assert report.state is MotorState.ARMED and not report.e_stop
    assert robot.session.control.counts['links_lost'] == 0


def test_a_joint_of_opposite_direction_gives_the_same_motion():
    angles = []
    for direction in (1, -1):
        robot = VirtualRobot()
        robot.joint = replace(robot.hardware.joint, direction=direction)
        robot.change(joint=robot.joint).ready()
        report = robot.run(0.3, torque=0.8)
        angles.append((robot.plant.state.pendulum_angle, report.torque))
    assert angles[0] == pytest.approx(angles[1], rel=1e-3)


def test_configure_stops_a_motor_that_was_left_turning():
    robot = VirtualRobot()
    robot.device.receive(b'w axis0.requested_state 8\nc 0 0.05\n', robot.now)
    assert robot.device.torque() > 0.0
    robot.session.configure()
    robot.pass_time(STEP)
    assert robot.motor == 0.0


@pytest.mark.parametrize('settings, field, command', [
    ({'watchdog': 0.0}, 'watchdog', 'w axis0.config.enable_watchdog 1'),
    ({'watchdog': 1.0}, 'watchdog', 'w axis0.config.watchdog_timeout 0.1'),
    ({'torque_limit': 0.5}, 'torque limit', 'w axis0.motor.config.torque_lim 0.0888889')])
def test_a_drive_with_unsafe_settings_is_refused_with_the_remedy(settings, field, command):
    robot = VirtualRobot(settings=DriveSettings(**{'torque_limit': 0.08, **settings}))
    with refused('inconsistent', field, ConfigurationError) as caught:
        robot.session.configure()
    assert command in str(caught.value)
    assert robot.lines == 0


def test_without_a_drive_configure_leaves_no_open_line():
    robot = VirtualRobot()
    robot.plugged = False
    with pytest.raises(LinkError):
        robot.session.configure()
    with refused('missing', 'drive', RefusedError):
        robot.session.activate()
    assert robot.lines == 0


def test_the_motor_has_no_power_before_the_e_stop_is_released():
    robot = VirtualRobot().active()
    report = robot.run(0.2, torque=1.0)
    assert report.state is MotorState.DISARMED and not robot.device.armed
    with refused('refused', 'set_point', RefusedError):
        robot.session.release()


def test_the_e_stop_is_not_released_before_the_bridge_is_active():
    robot = VirtualRobot()
    with refused('standing', 'drive', RefusedError):
        robot.session.release()
    robot.session.configure()
    robot.run(0.1)
    with refused('standing', 'state', RefusedError):
        robot.session.release()


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_answer_arrives_within_the_period_of_its_request(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.pass_time(STEP)
    for _ in range(100):
        robot.session.tick()
        asked = robot.now
        assert robot.session.expecting
        estimate = robot.session.await_answer(STEP)
        assert estimate.stamp == pytest.approx(asked) and not robot.session.expecting
        robot.session.command(0.5, robot.now)
        robot.pass_time(STEP)  # the rest of the period
    assert robot.motor == pytest.approx(0.5 / (50.0 * 0.9), rel=0.05)


def test_a_delay_of_the_bridge_does_not_count_as_silence_of_the_drive():
    robot = VirtualRobot().ready()
    robot.session.tick()
    robot.session.await_answer(STEP)
    robot.now += 0.25
    robot.session.tick()
    assert robot.session.control.counts['silent'] == 0
    assert robot.session.supervisor.e_stop.reason is StopReason.HELD_UP


@pytest.mark.parametrize('error', [
    LinkError('planted', 'gone', 'port'), DriveError('planted', 'odd', 'drive')])
def test_a_command_that_cannot_be_sent_is_a_lost_line_and_no_error_of_its_caller(error):
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.5)

    def fail(*_):
        raise error
    robot.session.line.driver.send_torque = fail
    robot.pass_time(STEP)
    robot.session.tick()  # sends only a request
    robot.session.command(0.5, robot.now)
    assert robot.session.line.driver is None and robot.session.control.counts['links_lost'] == 1
    assert robot.session.supervisor.e_stop.reason is StopReason.LOST


def test_an_e_stop_while_the_line_breaks_keeps_its_own_reason():
    robot = VirtualRobot().ready()
    robot.plugged = False
    robot.session.engage('button')
    assert robot.session.line.driver is None
    assert robot.session.supervisor.e_stop.reason is StopReason.REQUESTED


def test_a_line_that_breaks_during_a_stop_is_lost_once():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.5)
    robot.session.line.driver.poll = lambda: robot.session.line.driver.telemetry
    robot.session.supervisor.trigger(EStop(StopReason.REQUESTED, 'button'))
    robot.plugged = False  # detected when the stop is sent
    robot.session.tick()
    assert robot.session.line.driver is None and robot.session.control.counts['links_lost'] == 1


def test_more_commands_than_periods_do_not_overload_the_line():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.1)
    before = robot.session.line.driver.counts['sent']
    for number in range(100):
        robot.pass_time(STEP)
        robot.session.tick()
        for part in range(5):
            robot.session.command(0.1 + 0.001 * part, robot.now)
    sent = robot.session.line.driver.counts['sent'] - before
    assert 100 <= sent <= 203  # a request and a torque per period
    robot.session.tick()
    assert robot.session.supervisor.torque == pytest.approx(0.104)  # the newest command counts


@pytest.mark.parametrize('protocol, end', pairs(ALL, ['engage', 'deactivate', 'close']))
def test_every_deliberate_end_leaves_the_motor_without_power(end, protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=1.0)
    assert robot.motor != 0.0
    session = robot.session
    session.engage('button') if end == 'engage' else getattr(session, end)()
    robot.pass_time(STEP)
    assert robot.motor == 0.0
    robot.torques.clear()
    robot.run(0.2, torque=0.0)
    assert not any(robot.torques)


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_motor_stops_within_a_tenth_of_a_second_after_the_last_command(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=1.0)
    assert robot.motor != 0.0
    robot.torques.clear()
    robot.run(0.2)
    stopped = next(i for i, torque in enumerate(robot.torques) if torque == 0.0)
    assert stopped * STEP <= 0.1 and not any(robot.torques[stopped:])


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_torque_ends_when_the_bridge_is_killed(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=1.0)
    assert robot.motor != 0.0
    robot.pass_time(0.11)  # without a tick: SIGKILL
    assert robot.motor == 0.0


def test_a_stop_is_repeated_until_the_drive_confirms_it():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=1.0)
    lost, receive = [], robot.device.receive

    def drop(data, now):
        if len(lost) < 8:
            lost.append(data)
            return b''
        return receive(data, now)
    robot.device.receive = drop
    robot.session.engage('button')
    assert robot.run(STEP).state is MotorState.STOPPING
    report = robot.run(0.25)
    assert report.state is MotorState.DISARMED and not robot.device.armed
    assert len(lost) == 8


@pytest.mark.parametrize('protocol', [*ALL[::3], *slow(*ALL[1::3], *ALL[2::3])])
@pytest.mark.parametrize('rearm', [False, *slow(True)])
def test_an_unplugged_drive_is_found_within_a_second_and_armed_only_with_rearm(rearm, protocol):
    robot = VirtualRobot(protocol, rearm=rearm).ready()
    robot.run(0.2, torque=0.5)
    robot.plugged = False
    robot.run(0.4, torque=0.5)
    assert robot.motor == 0.0 and not robot.session.line.driver
    robot.plugged = True
    robot.run(1.0, torque=0.5)
    assert robot.session.line.driver and robot.lines == 1
    assert robot.session.control.counts['links_lost'] == robot.session.line.reconnects == 1
    assert (robot.motor != 0.0) is rearm
    assert bool(robot.session.supervisor.e_stop) is not rearm


@pytest.mark.slow
@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_repeated_losses_of_the_line_do_not_count_as_trips_of_the_drive(protocol):
    robot = VirtualRobot(protocol, rearm=True).ready()
    for _ in range(5):  # the pause after the fourth trip would be longer than a second
        robot.run(0.2, torque=0.05)
        robot.plugged = False
        robot.run(0.4, torque=0.05)
        robot.plugged = True
        for _ in range(10):
            robot.run(0.1, torque=0.05)
            if robot.motor != 0.0:
                break
        assert robot.motor != 0.0


@pytest.mark.parametrize('protocol', [*ALL[2::3], *slow(*ALL[::3], *ALL[1::3])])
@pytest.mark.parametrize('rearm', [*slow(False), True])
def test_a_rebooted_drive_is_found_and_armed_only_with_rearm(rearm, protocol):
    robot = VirtualRobot(protocol, rearm=rearm).ready()
    robot.run(0.2, torque=0.5)
    robot.device.reboot(robot.now)
    robot.run(1.5, torque=0.5)
    assert robot.session.line.driver
    assert (robot.motor != 0.0) is rearm


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_drive_that_disarms_by_itself_is_detected(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=0.5)
    robot.device.over_current()
    robot.run(0.3, torque=0.5)
    assert robot.session.supervisor.e_stop.reason is StopReason.DISARMED_BY_DRIVE
    assert robot.session.control.counts['disarmed_by_drive'] == 1


@pytest.mark.slow
def test_a_drive_that_trips_on_each_arming_is_armed_after_increasing_pauses():
    robot = VirtualRobot(rearm=True).ready()
    for _ in range(round(6.0 / STEP)):
        robot.run(STEP, torque=0.0)
        if robot.device.armed:
            robot.device.over_current()
    # After 0, 0.3, 0.9, 2.1 and 4.5 s, plus the time of detection.
    assert 4 <= robot.session.control.counts['disarmed_by_drive'] <= 5


@pytest.mark.parametrize('rearm', [False, *slow(True)])
def test_a_motor_that_cannot_be_armed_is_tried_again_only_with_rearm(rearm, caplog):
    robot = VirtualRobot(rearm=rearm).active()
    normal, robot.temperature = robot.temperature, 200.0
    robot.session.release()
    robot.run(1.0, torque=0.5)
    assert not any(robot.torques)
    assert len([text for text in caplog.messages if 'cannot arm' in text]) == 1
    robot.temperature = normal
    robot.run(1.0, torque=0.5)
    assert (robot.motor != 0.0) is rearm


@pytest.mark.slow
def test_fifty_unplugs_leave_no_line_open_and_no_flood_in_the_log(caplog):
    robot = VirtualRobot()
    robot.session.configure()
    for _ in range(50):
        robot.plugged = False
        robot.run(0.02)
        robot.plugged = True
        robot.run(0.2)
    assert robot.lines == 1
    assert len(caplog.messages) <= 50 * 3  # loss, cause, recovery
    assert robot.session.line.reconnects == 50


# Requests of the owner --------------------------------------------------------------------

def test_a_session_does_nothing_before_configure_and_after_close():
    robot = VirtualRobot()
    robot.session.deactivate()
    assert robot.tick() is None and robot.session.await_answer(STEP) is None
    robot.ready()
    assert robot.tick().state is MotorState.ARMED
    robot.session.close()
    assert robot.session.supervisor.e_stop.reason is StopReason.CLOSED
    assert robot.tick() is None and robot.lines == 0
    assert not robot.session.expecting and robot.session.await_answer(STEP) is None
    robot.session.close()


def test_a_second_configure_disarms_the_motor_and_opens_one_line():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=1.0)
    robot.session.configure()
    assert robot.run(STEP).state is MotorState.DISARMED and robot.lines == 1
    robot.torques.clear()
    robot.run(0.2, torque=1.0)
    assert not any(robot.torques) and not robot.device.armed


def test_after_deactivate_it_still_measures_and_needs_a_new_activation_and_release():
    robot = VirtualRobot().ready()
    robot.session.deactivate()
    report = robot.run(0.1, torque=0.0)
    assert report.state is MotorState.DISARMED and report.estimate is not None
    with refused('standing', 'state', RefusedError):
        robot.session.release()
    robot.session.activate()
    report = robot.run(0.6)
    assert report.state is MotorState.DISARMED and report.e_stop.reason is StopReason.DEACTIVATED
    robot.session.release()
    assert robot.run(0.1).state is MotorState.ARMED


def test_activation_without_a_drive_is_refused():
    robot = VirtualRobot()
    with refused('missing', 'drive', RefusedError):
        robot.session.activate()
    robot.ready()
    robot.plugged = False
    robot.run(0.1)
    with refused('missing', 'drive', RefusedError):
        robot.session.activate()


@pytest.mark.parametrize('end', ['deactivate', 'close'])
def test_a_stop_that_the_drive_does_not_confirm_is_awaited_for_half_a_second(end, caplog):
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=1.0)
    receive, robot.device.receive = robot.device.receive, lambda data, now: b''
    start = robot.now
    getattr(robot.session, end)()
    assert robot.now - start == pytest.approx(0.5, abs=0.05)
    assert any('not confirmed' in text for text in caplog.messages)
    assert 'not confirmed' in robot.session.control.unconfirmed
    if end == 'deactivate':  # the watchdog stops the drive, and a handshake confirms it
        assert robot.run(STEP).state is MotorState.DISCONNECTED
        robot.device.receive = receive
        assert robot.run(0.5).state is MotorState.DISARMED and not robot.device.armed
    else:
        assert robot.lines == 0


# The e-stop -------------------------------------------------------------------------------

def test_an_e_stop_of_the_supervisor_disarms_the_motor():
    robot = VirtualRobot(held=True, speed_limit=1.0).ready()
    robot.run(0.05, torque=0.1)
    robot.plant.state = robot.plant.state._replace(pendulum_rate=6.0)
    report = robot.run(0.1, torque=0.1)
    assert report.e_stop.reason is StopReason.RUNAWAY
    assert report.state is MotorState.DISARMED and not robot.device.armed


def test_a_diverged_estimate_engages_the_e_stop_even_with_rearm(caplog):
    robot = VirtualRobot(rearm=True).ready()

    def fail(*_):
        raise EstimateLostError('planted', 'diverged', 'pendulum_angle')
    robot.session.fusion.encoder = fail
    report = robot.run(0.1, torque=0.5)
    assert report.e_stop.reason is StopReason.DIVERGED and 'planted' in caplog.messages
    assert report.state is MotorState.DISARMED and report.estimate is None


def test_the_e_stop_is_not_released_while_the_drive_is_silent_or_has_not_confirmed():
    robot = VirtualRobot().active()
    robot.run(0.1)
    robot.now += 0.101
    with refused('standing', 'encoder', RefusedError):
        robot.session.release()
    robot.run(0.1)
    robot.session.release()
    robot.run(0.1)
    robot.device.receive = lambda data, now: b''
    robot.session.engage('button')
    with refused('standing', 'motor', RefusedError):
        robot.session.release()


def test_engaging_the_e_stop_twice_stops_once():
    robot = VirtualRobot().ready()
    robot.session.engage('first')
    sent = robot.session.line.driver.counts['sent']
    robot.session.engage('second')
    assert robot.session.supervisor.e_stop.text == 'first'
    assert robot.session.line.driver.counts['sent'] == sent


@pytest.mark.parametrize('wanted', ['inactive', 'stopped'])
def test_a_command_is_not_sent_without_power(wanted):
    robot = VirtualRobot().ready()
    robot.session.deactivate() if wanted == 'inactive' else robot.session.engage('button')
    sent = robot.session.line.driver.counts['sent']
    robot.session.command(1.0, robot.now)
    assert robot.session.line.driver.counts['sent'] == sent
    assert robot.session.supervisor.torque == 0.0


def test_a_command_is_sent_immediately():
    robot = VirtualRobot().ready()
    robot.session.tick()
    robot.pass_time(STEP)
    robot.session.command(0.5, robot.now)
    robot.pass_time(STEP)  # without a tick
    assert robot.motor > 0.0


def test_a_command_before_the_motor_is_armed_is_neither_sent_nor_an_error():
    robot = VirtualRobot().active()
    robot.session.release()
    robot.session.command(0.5, robot.now)
    assert robot.session.line.driver is not None
    assert robot.run(STEP).state is MotorState.ARMED
    robot.pass_time(STEP)
    assert robot.motor == 0.0


def test_while_a_stop_is_repeated_each_period_has_its_request():
    robot = VirtualRobot().ready()
    receive = robot.device.receive
    robot.device.receive = lambda data, now: receive(
        data.replace(b'requested_state 1', b'requested_state 8'), now)
    robot.session.engage('button')
    for _ in range(20):
        assert robot.run(STEP).state is MotorState.STOPPING and robot.session.expecting


# A drive that is silent -------------------------------------------------------------------

def silent_since(robot):
    """Cut off the drive; return the time of the first unanswered request [s]."""
    robot.session.tick()
    robot.session.await_answer(STEP)
    robot.device.receive = lambda data, now: b''
    robot.session.tick()
    return robot.now


@pytest.mark.parametrize('rearm', [False, True])
def test_a_silent_drive_is_stopped_after_a_tenth_of_a_second_and_lost_after_three(rearm):
    robot = VirtualRobot(rearm=rearm).ready()
    start = silent_since(robot)
    changes = {}
    while robot.now - start < 0.35:
        report = robot.run(STEP)
        changes.setdefault(report.state, robot.now - start)
    assert changes[MotorState.ARMED] < 0.01
    assert changes[MotorState.STOPPING] == pytest.approx(0.1, abs=2.5 * STEP)
    assert changes[MotorState.DISCONNECTED] == pytest.approx(0.3, abs=2.5 * STEP)
    assert bool(robot.session.supervisor.e_stop) is not rearm
    assert robot.session.control.counts['links_lost'] == 1


@pytest.mark.parametrize('rearm', [False, True])
def test_a_drive_that_is_lost_before_arming_is_armed_on_return_only_with_rearm(rearm):
    robot = VirtualRobot(rearm=rearm).active()
    robot.session.release()
    robot.plugged = False  # detected before or during arming
    assert robot.run(STEP).state is MotorState.DISCONNECTED
    robot.plugged = True
    robot.run(1.0, torque=0.5)
    assert robot.session.line.driver is not None and (robot.motor != 0.0) is rearm
    assert bool(robot.session.supervisor.e_stop) is not rearm


def test_no_torque_is_based_on_an_old_motion_although_the_drive_answers():
    robot = VirtualRobot(on_timeout='settle').ready()
    robot.run(0.08, torque=2.0)
    driver = robot.session.line.driver
    poll = driver.poll

    def at_an_unknown_time():  # as after delayed writes
        return poll()._replace(measured=None)
    driver.poll = at_an_unknown_time
    robot.run(0.05)
    assert robot.motor != 0.0
    robot.run(0.06)
    assert robot.motor == 0.0


def test_an_answer_that_breaks_off_is_a_lost_line():
    robot = VirtualRobot().ready()
    robot.session.tick()
    robot.plugged = False
    assert robot.session.await_answer(STEP) is None
    assert robot.session.line.driver is None and not robot.session.expecting
    assert robot.tick().state is MotorState.DISCONNECTED


def test_a_missing_answer_is_awaited_for_one_period_at_most():
    robot = VirtualRobot().ready()
    silent_since(robot)
    start = robot.now
    assert robot.session.await_answer(STEP) is None and robot.session.expecting
    assert robot.now - start <= 1.01 * STEP


def test_slow_arming_is_not_a_timeout():
    robot = VirtualRobot(rearm=True).active()
    driver, receive = robot.session.line.driver, robot.device.receive
    arm = driver.arm

    def slowly(timeout):
        robot.now += 0.15
        robot.device.receive = receive
        arm(timeout)
        robot.device.receive = drop

    def drop(data, now):
        return b''
    driver.arm, robot.device.receive = slowly, drop
    robot.session.tick()  # its request is dropped
    robot.session.release()
    robot.run(0.06)
    assert robot.session.control.counts['armed'] == 1
    assert robot.session.control.counts['silent'] == 0


def test_a_stop_that_is_not_confirmed_is_sent_at_its_period():
    robot = VirtualRobot().ready()
    written = []
    robot.device.receive = lambda data, now: written.append(data) or b''
    robot.session.engage('button')
    robot.run(0.1)
    stops = [data for data in written if b'requested_state 1' in data]
    assert len(stops) == pytest.approx(0.1 / STOP_PERIOD, abs=1)


def test_motor_events_are_counted():
    robot = VirtualRobot().ready()
    robot.session.engage('button')
    robot.run(0.1)
    robot.run(0.1, torque=0.0)
    robot.session.release()
    robot.run(0.1)
    counts = robot.session.control.counts
    assert counts['armed'] == 2 and counts['withdrawn'] == 1 == counts['stopped']
    assert counts['found'] == 1 and not counts['links_lost']
