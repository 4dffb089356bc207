# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors, line and drive in simulated time: no torque on data that cannot be right."""
import pytest
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.motor_state import MotorState
from ballbot_ros.control import Mode, SetPoint

PROTOCOLS = ('odrive 0.5', 'odrive_can 0.6', 'vesc', 'roboclaw')
FORWARD = SetPoint(Mode.HOLD, 0.45)


def time_to_zero(robot, fault, seconds=2.0, set_point=FORWARD):
    """Return the time from a fault to the last torque of the motor [s], infinite for none."""
    begin = robot.now
    fault(robot)
    first = len(robot.torques)
    robot.loop(seconds, set_point=None) if set_point is None else loop(robot, seconds, set_point)
    pulling = [number for number, torque in enumerate(robot.torques[first:], 1) if torque]
    last = begin + STEP * pulling[-1] if pulling else begin
    return last - begin if last < robot.now - 0.1 else float('inf')


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
