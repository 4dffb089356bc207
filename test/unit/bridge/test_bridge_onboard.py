# SPDX-License-Identifier: Apache-2.0
"""Control laws on board: each estimate is answered immediately, and every end ends the torque."""
import math

import pytest
from refusals import refused
from tiers import slow
from virtual_robot import SERIAL, STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.control import load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.errors import MessageError, RefusedError
from ballbot_ros.physics import load_robot

GEAR = 50.0 * 0.9
UP = SetPoint(Mode.HOLD, 0.5)


def ready(protocol='odrive', **others):
    """Return a robot with gentle laws on board, armed and idle."""
    return VirtualRobot(protocol, onboard='gentle', **others).ready()


@pytest.mark.parametrize('protocol', SERIAL)
def test_a_set_point_moves_the_pendulum_there(protocol):
    robot = ready(protocol)
    report = robot.loop(0.4, UP)
    assert robot.plant.state.pendulum_angle == pytest.approx(0.5, abs=0.06)
    assert report.commanded and report.set_point.value == 0.5


def test_the_torque_of_an_estimate_is_sent_before_the_next_request():
    robot = ready()
    robot.loop(0.1, UP)
    sent = []
    send = robot.session.line.driver.send_torque
    robot.session.line.driver.send_torque = lambda torque, ask=True: (
        sent.append((torque, ask)), send(torque, ask))
    for _ in range(20):
        robot.session.tick()
        assert not sent  # the tick sends only a request
        report = robot.session.report(robot.session.await_answer(STEP))
        [(torque, ask)] = sent
        assert not ask and torque * GEAR == pytest.approx(report.torque)
        sent.clear()


def test_the_torque_is_that_of_the_controller_for_the_same_estimate():
    robot = ready(torque_rate_limit=1e6)
    other = PendulumController(load_robot('gimball'), load_tuning('gentle'))
    robot.loop(0.2, UP)
    other.give(UP)
    for _ in range(50):
        report = robot.loop(STEP, UP)
        torque = other.torque(report.estimate.readings, report.torque)
    # The other controller started later; the difference has decayed.
    assert report.torque == pytest.approx(torque, abs=1e-9)


def test_an_armed_robot_is_idle_until_the_first_set_point():
    robot = VirtualRobot(onboard='gentle').active()
    robot.session.give(SetPoint(Mode.SPEED, 0.0))
    robot.session.release()
    report = robot.loop(0.3)
    assert report.state is MotorState.ARMED and not report.commanded
    assert report.set_point.mode is Mode.IDLE and robot.motor == 0.0


@pytest.mark.parametrize('law, topic, value, node', [
    (UP, 'set_point', '0.5 rad', '/planner'),
    (SetPoint(Mode.DRIVE, -2.0), 'set_point', '-2 rad/s', '/planner'),
    (SetPoint(Mode.SPEED, 0.3), 'cmd_vel', '0.3 m/s', '/teleop')])
def test_a_refused_release_names_the_request_for_motion_and_its_sender(law, topic, value, node):
    robot = ready()
    robot.session.engage('button')
    for _ in range(10):
        with refused('e_stop', 'e_stop', MessageError):
            robot.session.give(law)
        robot.loop(0.02)
    with refused('standing', 'set_point', RefusedError) as caught:
        robot.session.release()
    for part in (topic, value, node):
        assert part in str(caught.value)
    assert robot.motor == 0.0 and not robot.device.armed
    robot.loop(0.6, SetPoint(Mode.HOLD, 0.0))
    robot.session.release()
    assert robot.loop(0.2, UP).commanded and robot.motor != 0.0


def test_the_e_stop_ends_the_torque_and_the_set_point():
    robot = ready()
    robot.loop(0.1, UP)
    robot.session.engage('button')
    report = robot.loop(STEP)
    assert report.torque == 0.0 and report.set_point.mode is Mode.IDLE
    robot.loop(0.6)
    robot.session.release()
    report = robot.loop(0.2)
    assert report.state is MotorState.ARMED and report.set_point.mode is Mode.IDLE


def test_a_request_that_is_not_followed_also_inhibits_the_release():
    robot = ready()
    robot.session.engage('button')
    robot.loop(0.6)
    robot.session.law.record_request(UP)
    with refused('standing', 'set_point', RefusedError):
        robot.session.release()
    robot.loop(0.6)
    robot.session.law.record_request(SetPoint(Mode.HOLD, 0.0))  # rest is not motion
    robot.session.release()


def test_the_pendulum_is_lowered_and_then_released_when_set_points_end():
    robot = ready(damping_time=0.4)
    robot.loop(0.3, UP)
    assert robot.loop(0.45).commanded
    report = robot.loop(0.25)
    assert report.timed_out and report.set_point.mode is Mode.HOLD
    assert abs(robot.plant.state.pendulum_angle) < 0.25
    report = robot.loop(0.5)
    assert report.set_point.mode is Mode.IDLE and robot.motor == 0.0
    assert robot.loop(0.1, UP).commanded and not report.e_stop


@pytest.mark.parametrize('delay', [*slow(0.05), 0.5])
def test_a_late_loop_prolongs_the_lowering_by_at_most_the_watchdog_of_the_drive(delay):
    robot = ready(damping_time=0.4)
    robot.loop(0.3, UP)
    last, before = robot.now, len(robot.torques)
    robot.loop(0.88)
    assert robot.motor != 0.0
    robot.pass_time(delay)
    robot.loop(0.3)
    pulling = [number for number, torque in enumerate(robot.torques[before:], 1) if torque]
    bound = 0.5 + 0.4 + robot.hardware.connection.watchdog
    assert robot.now - last > bound and STEP * pulling[-1] <= bound + 2 * STEP


@pytest.mark.parametrize('protocol', SERIAL)
def test_the_torque_ends_within_the_command_timeout_when_estimates_end(protocol):
    robot = ready(protocol)
    robot.loop(0.2, UP)
    assert robot.motor != 0.0
    # The drive still accepts torques but does not answer requests for positions.
    robot.session.line.driver._requests = lambda: b''
    start = robot.now
    while robot.motor != 0.0:
        robot.session.give(UP)
        robot.session.tick()
        robot.pass_time(STEP)
    assert robot.now - start <= robot.hardware.limits.command_timeout + 2 * STEP


def test_commands_are_refused_on_board_and_set_points_in_direct_control_with_the_parameter():
    robot = ready()
    with refused('onboard', 'control'):
        robot.session.command(0.1, robot.now)
    assert robot.session.supervisor.gate.refused['onboard'] == 1
    with refused('direct', 'control'):
        VirtualRobot().ready().session.give(UP)


def test_a_set_point_from_the_future_is_followed_no_longer_than_a_current_one():
    robot = ready()
    robot.session.give(SetPoint(Mode.HOLD, 0.5, robot.now + 0.04))
    assert robot.session.law.set_point.stamp == robot.now
    with pytest.raises(MessageError) as refused:
        robot.session.give(SetPoint(Mode.HOLD, 0.5, robot.now + 0.5))
    assert refused.value.reason == 'from_the_future'


def test_laws_take_over_from_each_other_without_a_jump():
    robot = ready(torque_rate_limit=1e6)
    laws = (UP, SetPoint(Mode.SPEED, 0.3), SetPoint(Mode.DRIVE, -1.0), SetPoint(Mode.HOLD, -0.4))
    robot.loop(0.3, UP)
    for law in laws[1:]:
        before = robot.session.supervisor.torque
        robot.session.give(law)
        after = robot.loop(STEP).torque
        # The effect of the motion in one period at the gains of the tuning.
        assert abs(after - before) < 0.15
        robot.loop(0.3, law)


@pytest.mark.slow
def test_the_ball_crosses_a_step_with_laws_on_board():
    robot = ready(terrain=[{'flat': {'length': 1.426}}, {'step': {'height': 0.031}},
                           {'flat': {'length': 3.0}}])
    wanted, last = SetPoint(Mode.HOLD, 0.45), robot.now + 6.0
    while robot.plant.state.x < 2.0 and robot.now < last:
        report = robot.loop(0.02, wanted)
        if robot.plant.state.velocity_x > 1.0:
            wanted = SetPoint(Mode.HOLD, 0.0)
    assert robot.plant.state.x >= 2.0 and not report.e_stop
    assert robot.session.supervisor.counts['timeouts'] == 0
    assert math.isfinite(report.torque)
