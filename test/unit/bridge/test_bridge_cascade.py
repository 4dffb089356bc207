# SPDX-License-Identifier: Apache-2.0
"""Laws on board whose rate term is closed in the drive: a whole session, and what is refused."""
from dataclasses import replace
import math

import numpy as np
import pytest
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.cascade import Cascade
from ballbot_ros.bridge.feasibility import check_cascade
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.control import load_tuning, Mode, SetPoint
from ballbot_ros.errors import ConfigurationError

KD = load_tuning('published').position_kd
GAIN = 'axis0.controller.config.vel_gain'


def with_cascade(name='gimball_odrive', cascade=KD):
    """Return hardware whose drive damps."""
    hardware = load_hardware(name)
    return replace(hardware, connection=replace(hardware.connection, cascade=cascade))


def robot_with(cascade, every=1):
    """Return a robot with the paper's gains on board, ready, for a loop of every so many steps."""
    robot = VirtualRobot('odrive 0.5', onboard='published')
    robot.hardware = replace(robot.hardware, connection=replace(
        robot.hardware.connection, cascade=cascade, loop_rate=1.0 / (every * STEP)))
    robot.every = every
    robot.start()
    return robot.ready()


def follow(robot, seconds, mode=Mode.HOLD, value=0.5):
    """Let the bridge work at its rate; return the pendulum angles at all steps."""
    angles = []
    for number in range(round(seconds / STEP)):
        robot.pass_time(STEP)
        if number % robot.every == 0:
            robot.session.give(SetPoint(mode, value))
            robot.session.tick()
        elif number % robot.every == 1:
            robot.session.await_answer(0.0)
        angles.append(robot.plant.state.pendulum_angle)
    return angles


def swing(angles):
    """Return between which angles the pendulum is in the end."""
    late = angles[-200:]
    return max(late) - min(late)


def deviation(robot):
    """Return by how much the motor's torque changes from step to step in the end [N m]."""
    return float(np.std(np.diff(robot.torques[-200:])))


@pytest.mark.parametrize('every', [2, 10])
def test_the_paper_s_gains_hold_with_the_cascade_at_any_rate_of_the_loop(every):
    # 250 and 50 Hz.
    robot = robot_with(KD, every)
    angles = follow(robot, 1.2)
    assert swing(angles) < 0.005 and angles[-1] == pytest.approx(0.48, abs=0.01)
    assert deviation(robot) < 0.005


@pytest.mark.parametrize('every', [3, 10])
def test_without_the_cascade_they_shake_at_those_rates(every):
    robot = robot_with(0.0, every)
    assert swing(follow(robot, 1.2)) > 0.02 and deviation(robot) > 0.02


@pytest.mark.parametrize('mode, value', [(Mode.DRIVE, -2.0), (Mode.SPEED, 0.3)])
def test_the_other_laws_whose_rate_term_it_is_roll_as_without(mode, value):
    speeds = []
    for cascade in (KD, 0.0):
        robot = robot_with(cascade)
        follow(robot, 0.8, mode, value)
        speeds.append(robot.plant.state.velocity_x)
    assert abs(speeds[0]) > 0.02 and speeds[0] == pytest.approx(speeds[1], rel=0.05)


def test_the_drive_gets_the_gain_of_the_law_in_its_units():
    robot = robot_with(KD)
    joint = robot.joint
    gain = KD / (joint.gear_ratio**2 * joint.gear_efficiency)  # at the motor, per rad/s
    assert robot.device.properties[GAIN] == pytest.approx(gain * math.tau, rel=1e-4)


def test_the_motor_stops_when_the_bridge_does():
    robot = robot_with(KD)
    follow(robot, 0.3)
    assert robot.motor != 0.0
    robot.torques.clear()
    robot.pass_time(0.2)  # nobody ticks
    stopped = robot.torques.index(0.0) * STEP
    assert stopped <= 0.1 + 2 * STEP and not any(robot.torques[round(stopped / STEP):])


@pytest.mark.parametrize('act', ['engage', 'deactivate', 'close'])
def test_whatever_ends_it_ends_in_a_stop(act):
    robot = robot_with(KD)
    follow(robot, 0.3)
    getattr(robot.session, act)(*(['a person'] if act == 'engage' else []))
    robot.run(0.05)
    assert robot.motor == 0.0 and not robot.device.armed


def test_the_limits_of_the_bridge_hold():
    robot = robot_with(KD)
    limit = robot.hardware.options().torque_limit
    follow(robot, 0.5, value=1.2)
    assert max(map(abs, robot.torques)) <= limit + 1e-9
    assert robot.session.tick().state is MotorState.ARMED


def test_where_heat_takes_torque_away_the_drive_does_not_add_it():
    robot = robot_with(KD)
    follow(robot, 0.3)
    mode = 'axis0.controller.config.control_mode'
    assert robot.device.properties[mode] == 2
    robot.temperature = 85.0  # which the bridge hears of within half a second
    follow(robot, 0.6)
    assert 0.0 < robot.session.supervisor.derating < 1.0
    assert robot.device.properties[mode] == 1 and robot.motor != 0.0


def test_beyond_the_angle_limit_the_drive_does_not_damp_for_it_does_not_know_the_limit():
    robot = robot_with(KD)
    robot.hardware = replace(robot.hardware, limits=replace(
        robot.hardware.limits, angle_limit=0.3))
    robot.start()
    robot.ready()
    modes = []
    for _ in range(200):  # it swings past the limit, and the law turns it back
        angle = robot.session.fusion.estimate.readings.pendulum_angle
        follow(robot, STEP, value=1.5 if angle < 0.299 else 0.0)
        if angle > 0.3 and robot.motor:
            modes.append(robot.device.properties['axis0.controller.config.control_mode'])
    assert modes and set(modes[1:]) == {1}


def test_the_limits_of_the_drive_cut_what_it_adds():
    robot = robot_with(KD)
    robot.device.properties['axis0.motor.config.torque_lim'] = 0.01
    follow(robot, 0.2, value=1.2)
    assert max(map(abs, robot.torques)) == pytest.approx(0.01)


def test_a_set_point_that_is_taken_back_leaves_no_torque():
    robot = robot_with(KD)
    follow(robot, 0.3)
    follow(robot, 0.1, Mode.IDLE, 0.0)
    assert robot.motor == 0.0
    assert robot.device.properties['axis0.controller.config.control_mode'] == 1


@pytest.mark.parametrize('name, cascade, told', [
    ('gimball_odrive', 8.0, 'must be position_kd of the tuning, 10 N m s/rad, or 0, got 8'),
    ('gimball_vesc', KD, 'must be 0, got 10: a VESC does not damp')])
def test_a_cascade_that_would_not_be_the_law_is_refused(name, cascade, told):
    with pytest.raises(ConfigurationError, match=told):
        check_cascade(with_cascade(name, cascade), load_tuning('published'))


@pytest.mark.parametrize('cascade', [0.0, KD])
def test_a_cascade_that_is_the_law_s_is_accepted(cascade):
    check_cascade(with_cascade(cascade=cascade), load_tuning('published'))


def test_a_tuning_whose_torque_limit_the_drive_would_not_keep_to_is_refused():
    tuning = replace(load_tuning('published'), torque_limit=1.0)
    with pytest.raises(ConfigurationError, match='must not be below that of the hardware, 4 N m'):
        check_cascade(with_cascade(), tuning)
    check_cascade(with_cascade(cascade=0.0), tuning)


def test_firmware_0_6_is_refused_before_there_is_power():
    robot = VirtualRobot('odrive 0.6', onboard='published')
    robot.hardware = with_cascade()
    robot.start()
    with pytest.raises(ConfigurationError, match='cascade is not known of firmware 0.6'):
        robot.session.configure()


# What is sent

def cascade(gain=10.0, limit=400.0):
    """Return one, 0.1 s as the longest step."""
    return Cascade(gain, limit, 0.1)


def test_a_torque_is_due_at_the_rate_that_it_answers():
    here = cascade()
    here.answered(rate=2.0, excess=0.0)
    assert here.rate(1.0, torque=3.0, asked=3.0) == pytest.approx(2.0)


def test_what_the_torque_limit_cut_off_is_made_up_for_where_the_joint_turns_slower():
    here = cascade(limit=1e6)
    here.answered(2.0, excess=5.0)
    here.rate(1.0, 4.0, 4.0)  # the first one starts from the torque in force
    # 4 + 5 N m were due at 2 rad/s, so 4 N m are at half a rad/s more.
    assert here.rate(1.01, 4.0, 4.0) == pytest.approx(2.5)


def test_the_level_changes_no_faster_than_the_torque_may():
    here = cascade(limit=100.0)
    here.answered(0.0, 0.0)
    assert here.rate(1.0, 0.5, 0.5) == pytest.approx(0.0)
    here.answered(0.0, 20.0)
    for number in range(1, 30):
        level = 0.5 + 0.2 * number  # 100 N m/s in steps of 2 ms
        assert here.rate(1.0 + 0.002 * number, 0.5, 0.5) * 10.0 + 0.5 == pytest.approx(level)
    assert here.rate(99.0, 0.5, 0.5) * 10.0 + 0.5 == pytest.approx(level + 10.0)  # of 0.1 s


@pytest.mark.parametrize('end', [
    lambda here: here.forget(), lambda here: here.answered(2.0, None)])
def test_without_a_law_whose_rate_term_it_is_torque_is_sent_alone(end):
    here = cascade()
    assert here.rate(1.0, 3.0, 3.0) is None
    here.answered(2.0, 0.0)
    assert here.rate(1.0, 3.0, 3.0) is not None
    end(here)
    assert here.rate(1.1, 3.0, 3.0) is None


def test_no_torque_is_sent_alone_and_what_comes_after_it_starts_anew():
    here = cascade(limit=1e-9)
    here.answered(2.0, 0.0)
    assert here.rate(1.0, 3.0, 3.0) == pytest.approx(2.0)
    assert here.rate(1.1, 0.0, 0.0) is None
    here.answered(-7.0, 0.0)
    assert here.rate(1.2, 1.0, 1.0) == pytest.approx(-7.0)
