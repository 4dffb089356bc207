# SPDX-License-Identifier: Apache-2.0
"""A motor that is stopped however things end, and the torque of the emulated one to prove it."""
from dataclasses import replace
import math

import pytest
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.control import load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import ConfigurationError, DriveError, LinkError, RefusedError
from ballbot_ros.physics import load_robot

PROTOCOLS = ('odrive 0.5', 'odrive 0.6', 'vesc', 'roboclaw')


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_command_reaches_the_motor_as_torque_at_the_pendulum(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.1, torque=0.9)
    # A RoboClaw makes a voltage: its torque is computed from a speed that is a period old.
    assert robot.motor == pytest.approx(
        0.9 / (50.0 * 0.9), rel=0.03 if protocol == 'roboclaw' else 0.01)


def test_the_estimate_follows_the_true_pendulum_through_the_wire():
    robot = VirtualRobot().ready()
    for _ in range(300):
        report = robot.run(STEP, torque=0.8)
        if report.estimate is not None:
            error = report.estimate.readings.pendulum_angle - robot.plant.state.pendulum_angle
            assert abs(error) < math.radians(1.5)
    assert robot.plant.state.pendulum_angle > 0.3


@pytest.mark.parametrize('kind', ['odrive 0.5', 'odrive 0.6'])
def test_bridge_and_controller_take_the_ball_over_a_step(kind):
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


def test_a_joint_of_the_other_direction_gives_the_same_pendulum():
    angles = []
    for direction in (1, -1):
        robot = VirtualRobot()
        robot.joint = replace(robot.hardware.joint, direction=direction)
        robot.hardware = replace(robot.hardware, joint=robot.joint)
        robot.start()
        robot.ready()
        report = robot.run(0.3, torque=0.8)
        angles.append((robot.plant.state.pendulum_angle, report.torque))
    assert angles[0] == pytest.approx(angles[1], rel=1e-3)


def test_configure_stops_a_motor_that_somebody_left_turning():
    robot = VirtualRobot()
    robot.device.receive(b'w axis0.requested_state 8\nc 0 0.05\n', robot.now)
    assert robot.device.torque() > 0.0
    robot.session.configure()
    robot.pass_time(STEP)
    assert robot.motor == 0.0


@pytest.mark.parametrize('settings, complaint', [
    ({'watchdog': 0.0}, 'watchdog is off'), ({'watchdog': 1.0}, 'watchdog is 1 s'),
    ({'torque_limit': 0.5}, 'torque limit')])
def test_a_drive_that_is_not_set_safely_is_refused_with_what_to_type(settings, complaint):
    robot = VirtualRobot(settings=DriveSettings(**{'torque_limit': 0.08, **settings}))
    with pytest.raises(ConfigurationError, match=f'{complaint}.*w axis0'):
        robot.session.configure()
    assert robot.lines == 0


def test_without_a_drive_configure_leaves_no_open_line():
    robot = VirtualRobot()
    robot.plugged = False
    with pytest.raises(LinkError):
        robot.session.configure()
    with pytest.raises(RefusedError, match='no drive'):
        robot.session.activate()
    assert robot.lines == 0


def test_the_motor_has_no_power_before_the_e_stop_is_released():
    robot = VirtualRobot()
    robot.session.configure()
    robot.session.activate()
    report = robot.run(0.2, torque=1.0)
    assert report.state is MotorState.DISARMED and not robot.device.armed
    with pytest.raises(RefusedError, match='other than zero'):
        robot.session.release()


def test_the_e_stop_is_not_released_before_the_bridge_is_active():
    robot = VirtualRobot()
    with pytest.raises(RefusedError, match='line to the drive is down'):
        robot.session.release()
    robot.session.configure()
    robot.run(0.1)
    with pytest.raises(RefusedError, match='not active'):
        robot.session.release()


def test_without_an_imu_there_is_no_torque_unless_the_file_says_so():
    robot = VirtualRobot()
    robot._imu = None
    robot.session.configure()
    robot.session.activate()
    robot.run(0.1)
    with pytest.raises(RefusedError, match='no IMU'):
        robot.session.release()
    free = VirtualRobot(imu=False).ready()
    free.run(0.1, torque=0.5)
    assert free.motor > 0.0


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_the_answer_to_the_question_of_a_period_arrives_within_it(protocol):
    robot = VirtualRobot(protocol).ready()
    for _ in range(100):
        robot.session.tick()
        asked = robot.now
        assert robot.session.expecting
        report = robot.session.await_answer(STEP)
        assert report.estimate.stamp == pytest.approx(asked) and not robot.session.expecting
        robot.session.command(0.5, robot.now)
        robot.pass_time(STEP)  # the rest of the period
    assert robot.motor == pytest.approx(0.5 / (50.0 * 0.9), rel=0.05)


def test_a_bridge_that_was_held_up_does_not_take_the_drive_for_silent():
    robot = VirtualRobot().ready()
    robot.session.tick()
    robot.session.await_answer(STEP)
    robot.now += 0.25
    robot.session.tick()
    assert 'silent' not in robot.session.supervisor.e_stop


@pytest.mark.parametrize('error', [LinkError('gone', 'planted'), DriveError('odd', 'planted')])
def test_a_command_that_cannot_be_sent_is_a_lost_line_and_no_error_of_who_gave_it(error):
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.5)

    def fail(*_):
        raise error
    robot.session.line.driver.send_torque = fail
    robot.pass_time(STEP)
    robot.session.tick()  # which only asks
    robot.session.command(0.5, robot.now)
    assert robot.session.line.driver is None and robot.session.control.counts['links_lost'] == 1
    assert robot.session.supervisor.e_stop == 'the line was lost: planted'


def test_a_line_that_breaks_during_a_stop_is_lost_once():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.5)
    robot.session.line.driver.poll = lambda: robot.session.line.driver.telemetry
    robot.session.supervisor.trigger('button')
    robot.plugged = False  # noticed when the stop is written
    robot.session.tick()
    assert robot.session.line.driver is None and robot.session.control.counts['links_lost'] == 1


def test_more_commands_than_periods_do_not_crowd_the_line():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=0.1)
    before = robot.session.line.driver.counts['sent']
    for number in range(100):
        robot.pass_time(STEP)
        robot.session.tick()
        for part in range(5):
            robot.session.command(0.1 + 0.001 * part, robot.now)
    sent = robot.session.line.driver.counts['sent'] - before
    assert 100 <= sent <= 203  # a question and a torque per period
    robot.session.tick()
    assert robot.session.supervisor.torque == pytest.approx(0.104)  # and the newest counts


def test_an_imu_that_falls_silent_takes_the_torque_away():
    robot = VirtualRobot().ready()
    robot.run(0.2, torque=1.0)
    robot._imu = None
    robot.run(0.1, torque=1.0)
    assert robot.motor == 0.0


@pytest.mark.parametrize('protocol', PROTOCOLS)
@pytest.mark.parametrize('end', ['engage', 'deactivate', 'close'])
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
def test_commands_that_stop_coming_stop_the_motor_within_a_tenth_of_a_second(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=1.0)
    assert robot.motor != 0.0
    robot.torques.clear()
    robot.run(0.2)
    stopped = next(i for i, torque in enumerate(robot.torques) if torque == 0.0)
    assert stopped * STEP <= 0.1 and not any(robot.torques[stopped:])


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_bridge_that_vanishes_is_outlived_by_no_torque(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=1.0)
    assert robot.motor != 0.0
    robot.pass_time(0.11)  # nobody ticks: SIGKILL
    assert robot.motor == 0.0


def test_a_stop_is_repeated_until_the_drive_confirms_it():
    robot = VirtualRobot().ready()
    robot.run(0.1, torque=1.0)
    lost, receive = [], robot.device.receive

    def deaf(data, now):
        if len(lost) < 8:
            lost.append(data)
            return b''
        return receive(data, now)
    robot.device.receive = deaf
    robot.session.engage('button')
    assert robot.run(STEP).state is MotorState.STOPPING
    report = robot.run(0.15)
    assert report.state is MotorState.DISARMED and not robot.device.armed
    assert len(lost) == 8


@pytest.mark.parametrize('protocol', PROTOCOLS)
@pytest.mark.parametrize('rearm', [False, True])
def test_after_unplugging_it_is_back_within_a_second_and_armed_only_by_policy(rearm, protocol):
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


@pytest.mark.parametrize('protocol', PROTOCOLS)
@pytest.mark.parametrize('rearm', [False, True])
def test_after_a_reboot_of_the_drive_likewise(rearm, protocol):
    robot = VirtualRobot(protocol, rearm=rearm).ready()
    robot.run(0.2, torque=0.5)
    robot.device.reboot(robot.now)
    robot.run(1.5, torque=0.5)
    assert robot.session.line.driver
    assert (robot.motor != 0.0) is rearm


@pytest.mark.parametrize('protocol', PROTOCOLS)
def test_a_drive_that_disarms_by_itself_is_noticed(protocol):
    robot = VirtualRobot(protocol).ready()
    robot.run(0.2, torque=0.5)
    robot.device.over_current()
    robot.run(0.3, torque=0.5)
    assert 'the drive disarmed the motor' in robot.session.supervisor.e_stop
    assert robot.session.control.counts['disarmed_by_drive'] == 1


@pytest.mark.parametrize('rearm', [False, True])
def test_a_motor_that_cannot_be_armed_is_tried_again_only_by_policy(rearm, caplog):
    robot = VirtualRobot(rearm=rearm)
    robot.session.configure()
    robot.run(0.1)
    robot.session.activate()
    normal, robot.temperature = robot.temperature, 200.0
    robot.session.release()
    robot.run(1.0, torque=0.5)
    assert not any(robot.torques)
    assert len([text for text in caplog.messages if 'cannot arm' in text]) == 1
    robot.temperature = normal
    robot.run(1.0, torque=0.5)
    assert (robot.motor != 0.0) is rearm


def test_fifty_unplugs_leave_no_line_open_and_no_flood_in_the_log(caplog):
    robot = VirtualRobot()
    robot.session.configure()
    for _ in range(50):
        robot.plugged = False
        robot.run(0.02)
        robot.plugged = True
        robot.run(0.2)
    assert robot.lines == 1
    assert len(caplog.messages) <= 50 * 3  # lost, why it is not found, found
    assert robot.session.line.reconnects == 50
