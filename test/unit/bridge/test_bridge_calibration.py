# SPDX-License-Identifier: Apache-2.0
"""Calibration with scripted answers, against an emulated drive with a ball whose shell is held."""
from dataclasses import replace
import math

import numpy as np
import pytest
from virtual_robot import VirtualRobot

from ballbot_ros.bridge.commissioning.calibration import Calibrator, fit
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli.calibrate_motor import write
from ballbot_ros.config.files import config_folder, read_yaml
from ballbot_ros.errors import RefusedError
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')


class Script:
    """A person who does as asked; `answers` replace what is said to questions."""

    def __init__(self, robot, degrees=90.0, **answers):
        self.robot, self.degrees, self.answers = robot, degrees, answers
        self.said, self.asked = [], []

    def say(self, text):
        """Keep it."""
        self.said.append(text)

    def ask(self, question):
        """Turn the pendulum where the question says so, and answer."""
        self.asked.append(question)
        for part, answer in self.answers.items():
            if part in question:
                if answer is None:
                    raise RefusedError('ended by the person')
                return answer
        angle = {'Turn it': math.radians(self.degrees)}.get(question[:7], 0.0)
        plant = self.robot.plant
        plant.state = plant.state._replace(pendulum_angle=plant.state.ball_angle + angle,
                                           pendulum_rate=0.0)
        self.robot.pass_time(0.002)
        return 'yes' if 'Is that so' in question else ''


def calibrate(robot, dialogue=None):
    """Return what is found; the drive is a fresh one."""
    driver = robot.connect()
    driver.identify()
    return Calibrator(robot.hardware, GIMBALL, driver, dialogue or Script(robot)).run()


@pytest.mark.parametrize('protocol, direction, factor', [
    ('odrive', 1, 0.8), ('vesc', -1, 1.0)])
def test_what_joins_drive_and_pendulum_is_found(protocol, direction, factor):
    robot = VirtualRobot(protocol, held=True)
    # The real gear is a little lossier than the file says, and turns the other way.
    robot.joint = replace(robot.joint, direction=direction,
                          gear_efficiency=robot.joint.gear_efficiency * factor)
    found = calibrate(robot)
    assert found.direction == direction
    assert found.encoder_scale == pytest.approx(1.0 / 50.0, rel=0.01)
    assert found.torque_factor == pytest.approx(factor, rel=0.03)
    robot.pass_time(0.01)
    assert robot.motor == 0.0


def test_the_motor_moves_gently():
    robot = VirtualRobot(held=True)
    fastest = []
    passing = robot.pass_time
    robot.pass_time = lambda seconds: (passing(seconds), fastest.append(
        abs(robot.plant.state.joint_rate)))
    calibrate(robot)
    assert max(fastest) < 1.5
    assert max(np.abs(robot.torques)) * 45.0 < 0.7


@pytest.mark.parametrize('answers', [{'Is that so': 'no'}, {'Turn it': None}, {'Hands off': None}])
def test_it_can_be_ended_at_every_question(answers):
    robot = VirtualRobot(held=True)
    with pytest.raises(RefusedError, match='ended'):
        calibrate(robot, Script(robot, **answers))
    robot.pass_time(0.2)
    assert not any(robot.torques)


def test_ctrl_c_under_torque_ends_in_a_stop():
    robot = VirtualRobot(held=True)
    passing = robot.pass_time

    def interrupt(seconds):
        passing(seconds)
        if robot.motor > 0.005:
            robot.pass_time = passing
            raise KeyboardInterrupt
    robot.pass_time = interrupt
    with pytest.raises(KeyboardInterrupt):
        calibrate(robot)
    robot.torques.clear()
    robot.pass_time(0.05)
    assert not any(robot.torques)


def test_an_encoder_that_is_not_connected_is_noticed():
    robot = VirtualRobot(held=True)
    with pytest.raises(RefusedError, match='is the encoder connected'):
        calibrate(robot, Script(robot, degrees=2.0))


def test_an_angle_that_was_not_a_right_one_may_be_told_and_a_wrong_file_is_noticed():
    robot = VirtualRobot(held=True)
    robot.hardware = replace(robot.hardware, joint=replace(robot.hardware.joint, gear_ratio=40.0))
    script = Script(robot, degrees=60.0)
    asking = script.ask
    script.ask = lambda question: asking(question) or ('60' if 'Turn it' in question else '')
    found = calibrate(robot, script)
    assert found.encoder_scale == pytest.approx(1.0 / 50.0, rel=0.02)
    assert any('the file was wrong' in text for text in script.said)


def test_torque_that_turns_the_encoder_back_is_refused():
    robot = VirtualRobot(held=True)
    torque = robot.device.torque
    robot.device.torque = lambda: -torque()
    with pytest.raises(RefusedError, match='opposite signs'):
        calibrate(robot)
    robot.pass_time(0.01)
    assert robot.motor == 0.0


def test_the_fit_separates_factor_and_friction():
    levels = [0.1, 0.2, 0.3, 0.2, 0.1, -0.1, -0.2, -0.3, -0.2, -0.1]
    moving = np.sign(np.diff(levels, prepend=0.0))
    angles = np.arcsin((0.8 * np.array(levels) - 0.04 * moving) / 1.24)
    factor, sd, friction = fit(levels, list(angles), 1.24)
    assert (factor, friction) == pytest.approx((0.8, 0.04), rel=1e-6) and sd < 1e-6


def test_a_pendulum_that_friction_holds_is_refused():
    with pytest.raises(RefusedError, match='hardly moved'):
        fit([0.1, 0.2, -0.2], [0.0, 1e-3, 0.0], 1.24)


def test_what_is_written_can_be_read_and_says_that_it_was_measured(tmp_path):
    robot = VirtualRobot(held=True)
    path = tmp_path / 'mine.yaml'
    write(path, read_yaml(config_folder() / 'hardware/gimball_odrive.yaml'), calibrate(robot),
          'gimball_odrive')
    hardware = load_hardware(str(path))
    assert hardware.provenance['joint.torque_factor'].source == 'measured'
    assert hardware.joint.torque_factor == pytest.approx(1.0, rel=0.03)
