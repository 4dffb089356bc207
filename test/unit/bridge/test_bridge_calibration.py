# SPDX-License-Identifier: Apache-2.0
"""Calibration with scripted answers on an emulated drive; the shell of the ball is held."""
from dataclasses import replace
import math
import os
import shlex
import signal

import numpy as np
import pytest
from refusals import refused
from scipy.optimize import curve_fit
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge import drive_line
from ballbot_ros.bridge.commissioning.calibration import Calibrator, fit
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli import calibrate_motor, main
from ballbot_ros.cli.calibrate_motor import write
from ballbot_ros.config.files import find_config, read_yaml
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.errors import BallbotError, RefusedError
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')


class Script:
    """A scripted person; `answers` maps a part of a question to its answer, None to cancel."""

    def __init__(self, robot, degrees=90.0, **answers):
        self.robot, self.degrees, self.answers = robot, degrees, answers
        self.said, self.asked = [], []

    def say(self, text):
        """Record the text."""
        self.said.append(text)

    def ask(self, question):
        """Turn the pendulum if the question asks for it, and answer."""
        self.asked.append(question)
        answer = next((answer for part, answer in self.answers.items() if part in question), '')
        if answer is None:
            raise RefusedError('ended by the person', 'cancelled', '')
        angle = {'Turn it': math.radians(self.degrees)}.get(question[:7], 0.0)
        plant = self.robot.plant
        plant.state = plant.state._replace(pendulum_angle=plant.state.ball_angle + angle,
                                           pendulum_rate=0.0)
        self.robot.pass_time(0.002)
        return answer or ('yes' if 'Ready' in question else '')


def calibrate(robot, dialogue=None):
    """Return the result of a calibration with a new drive."""
    driver = robot.connect()
    driver.identify()
    return Calibrator(robot.hardware, GIMBALL, driver, dialogue or Script(robot)).run()


@pytest.mark.slow
@pytest.mark.parametrize('protocol, direction, factor', [
    ('odrive', 1, 0.8), ('vesc', -1, 1.0)])
def test_the_joint_between_drive_and_pendulum_is_identified(protocol, direction, factor):
    robot = VirtualRobot(protocol, held=True)
    # The real gear differs from the file in efficiency or direction.
    robot.joint = replace(robot.joint, direction=direction,
                          gear_efficiency=robot.joint.gear_efficiency * factor)
    found = calibrate(robot)
    assert found.direction == direction
    assert found.encoder_scale == pytest.approx(1.0 / 50.0, rel=0.01)
    assert found.torque_factor == pytest.approx(factor, rel=0.03)
    assert abs(found.friction) < 0.01  # this joint has no friction at rest
    robot.pass_time(0.01)
    assert robot.motor == 0.0


@pytest.fixture(scope='module')
def calibrated():
    """Return a robot, its calibration result, the duration [s], and the states under torque."""
    robot, states = VirtualRobot(held=True), []
    start, passing = robot.now, robot.pass_time
    robot.pass_time = lambda seconds: (passing(seconds), states.append(
        robot.plant.state) if any(robot.torques) else None)
    return robot, calibrate(robot), robot.now - start, states


def test_the_motor_moves_gently(calibrated):
    robot, _, _, states = calibrated
    assert max(abs(state.joint_rate) for state in states) < 1.5
    assert max(np.abs(robot.torques)) * 45.0 < 0.7


@pytest.mark.parametrize('answers', [{'Ready': 'no'}, {'Turn it': None}, {'Hands off': None}])
def test_the_calibration_can_be_cancelled_at_every_question(answers):
    robot = VirtualRobot(held=True)
    with refused('cancelled', error=RefusedError):
        calibrate(robot, Script(robot, **answers))
    robot.pass_time(0.2)
    assert not any(robot.torques)


def test_ctrl_c_under_torque_stops_the_motor():
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


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_the_verb_under_torque_stops_the_motor(number, tmp_path, monkeypatch):
    robot = VirtualRobot(held=True)
    passing, driver = robot.pass_time, robot.connect()

    def end(seconds):
        passing(seconds)
        if robot.motor > 0.005:
            robot.pass_time = passing
            os.kill(os.getpid(), number)
    robot.pass_time = end
    monkeypatch.setattr(drive_line, 'handshake', lambda *_: (driver, driver.identify(), []))
    monkeypatch.setattr(calibrate_motor, 'Console', lambda: Script(robot))
    before = signal.signal(number, signal.SIG_DFL)  # under nohup, SIGHUP is ignored
    try:
        assert main(['calibrate-motor', '--out', str(tmp_path / 'my_motor.yaml')]) == 128 + number
    finally:
        signal.signal(number, before)
    robot.torques.clear()
    robot.pass_time(0.05)
    assert robot.torques and not any(robot.torques)


@pytest.mark.parametrize('protocol', ['odrive', 'vesc', 'roboclaw'])
@pytest.mark.parametrize('delay', [math.inf, 0.3])
def test_torque_ends_when_measurements_stop(protocol, delay):
    robot = VirtualRobot(protocol, held=True)
    passing, after = robot.pass_time, []

    def late(seconds):
        passing(seconds)
        if robot.motor > 0.005:
            robot._delay = delay
        if robot._delay == delay:
            after.append(robot.motor)
    robot.pass_time = late
    with pytest.raises(BallbotError):
        calibrate(robot)
    assert STEP * sum(torque != 0.0 for torque in after) < 0.15 and not any(after[-10:])


def test_a_disconnected_encoder_is_detected():
    robot = VirtualRobot(held=True)
    with refused('failed', 'gear_ratio', RefusedError):
        calibrate(robot, Script(robot, degrees=2.0))


@pytest.mark.slow
def test_the_turned_angle_may_differ_from_90_degrees_and_a_wrong_file_is_detected():
    robot = VirtualRobot(held=True)
    robot.change(joint=replace(robot.hardware.joint, gear_ratio=40.0))
    script = Script(robot, degrees=60.0, **{'Turn it': '60'})
    found = calibrate(robot, script)
    assert found.encoder_scale == pytest.approx(1.0 / 50.0, rel=0.02)
    assert any('the file was wrong' in text for text in script.said)


@pytest.mark.slow
def test_an_invalid_answer_repeats_the_question():
    robot = VirtualRobot(held=True)
    script = Script(robot)
    wrong = {'Turn it': ['5', '-90', '430', 'level'], 'Ready': ['yse', ''],
             'Let the': ['wait'], 'rest again': ['no'], 'Hands off': ['no']}
    times, ask = {part: len(answers) + 1 for part, answers in wrong.items()}, script.ask

    def mistype_first(question):
        right = ask(question)
        answers = [answers for part, answers in wrong.items() if part in question and answers]
        return answers[0].pop() if answers else right
    script.ask = mistype_first
    assert calibrate(robot, script).direction in (-1, 1)
    assert times == {part: sum(part in question for question in script.asked) for part in wrong}


@pytest.mark.slow
def test_the_pendulum_may_be_turned_by_more_than_one_revolution():
    robot = VirtualRobot(held=True)
    script = Script(robot, degrees=380.0, **{'Turn it': '380'})
    assert calibrate(robot, script).encoder_scale == pytest.approx(1.0 / 50.0, rel=0.01)
    assert not any('the file was wrong' in text for text in script.said)


@pytest.mark.slow
def test_the_measured_scale_is_compared_with_the_scale_in_the_file():
    robot = VirtualRobot(held=True)
    robot.change(joint=replace(robot.hardware.joint, encoder_scale=0.02))
    script = Script(robot)
    assert calibrate(robot, script).encoder_scale == pytest.approx(0.02, rel=0.01)
    assert not any('the file was wrong' in text for text in script.said)
    robot.change(joint=replace(robot.hardware.joint, encoder_scale=0.002))
    with refused('failed', 'gear_ratio', RefusedError):
        calibrate(robot)


@pytest.mark.slow
def test_the_direction_of_a_motor_without_a_gear_is_found():
    robot = VirtualRobot(held=True, settings=DriveSettings(torque_limit=5.0, current_limit=200.0))
    robot.change(joint=replace(robot.hardware.joint, gear_ratio=1.0, direction=-1))
    robot.joint = robot.hardware.joint
    found = calibrate(robot, Script(robot, degrees=40.0, **{'Turn it': '40'}))
    assert found.direction == -1 and found.encoder_scale == pytest.approx(1.0, rel=0.01)


def test_the_pendulum_is_lifted_to_half_a_radian_in_steps_of_three_seconds(calibrated):
    _, _, seconds, states = calibrated
    angles = [state.pendulum_angle for state in states]
    # Three steps up and two down, on each side.
    assert seconds == pytest.approx(10 * 3.0, abs=0.5)
    assert 0.45 < max(angles) < 0.6 and -0.6 < min(angles) < -0.45


@pytest.mark.slow
def test_the_torque_is_at_most_nine_tenths_of_the_limit():
    robot = VirtualRobot(held=True, torque_limit=0.3)
    calibrate(robot)
    assert max(np.abs(robot.torques)) * 45.0 == pytest.approx(0.27, rel=0.01)


@pytest.mark.parametrize('rate, stopped', [(3.6, False), (-3.6, False), (4.4, True),
                                           (-4.4, True)])
def test_a_pendulum_that_is_too_fast_is_stopped(rate, stopped):
    robot = VirtualRobot(held=True)
    passing = robot.pass_time

    def push(seconds):
        passing(seconds)
        if robot.motor > 0.001:
            robot.pass_time = passing
            robot.plant.state = robot.plant.state._replace(
                pendulum_angle=math.copysign(0.2, -rate), pendulum_rate=rate)
    robot.pass_time = push
    start, receive = robot.now, robot.device.receive

    def end_after_a_step(data, now):
        if now > start + 3.0:
            robot.device.receive = receive
            raise KeyboardInterrupt
        return receive(data, now)
    robot.device.receive = end_after_a_step
    with pytest.raises(RefusedError if stopped else KeyboardInterrupt) as caught:
        calibrate(robot)
    assert not stopped or caught.value.field == 'pendulum_rate'
    robot.pass_time(0.01)
    assert robot.motor == 0.0


def test_a_pendulum_that_swings_too_far_is_stopped():
    robot = VirtualRobot(held=True)
    torque = robot.device.torque
    robot.device.torque = lambda: 4.0 * torque()
    with refused('failed', 'pendulum_angle', RefusedError):
        calibrate(robot)
    assert 0.95 < abs(robot.plant.state.pendulum_angle) < 1.2


def test_a_drive_with_a_fault_and_one_without_a_position_are_refused():
    robot = VirtualRobot(held=True)
    passing = robot.pass_time

    def fail(seconds):
        passing(seconds)
        if robot.motor > 0.001:
            robot.device.over_current()
    robot.pass_time = fail
    with refused('failed', 'drive', RefusedError):
        calibrate(robot)
    robot = VirtualRobot(held=True)
    script = Script(robot)
    asking = script.ask

    def stop_answering(question):
        robot.device.receive = lambda data, now: b''
        return asking(question)
    script.ask = lambda question: (stop_answering if 'hang' in question else asking)(question)
    start = robot.now
    with refused('missing', 'encoder', RefusedError):
        driver = robot.connect()
        driver.identify()
        driver.stop = lambda: None
        Calibrator(robot.hardware, GIMBALL, driver, script).run()
    assert robot.now - start == pytest.approx(1.0, abs=0.1)


def test_torque_that_turns_the_encoder_backwards_is_refused():
    robot = VirtualRobot(held=True)
    torque = robot.device.torque
    robot.device.torque = lambda: -torque()
    with refused('failed', 'encoder', RefusedError):
        calibrate(robot)
    robot.pass_time(0.01)
    assert robot.motor == 0.0


def test_the_fit_separates_factor_and_friction():
    levels = [0.1, 0.2, 0.3, 0.2, 0.1, -0.1, -0.2, -0.3, -0.2, -0.1]
    moving = np.sign(np.diff(levels, prepend=0.0))
    angles = np.arcsin((0.8 * np.array(levels) - 0.04 * moving) / 1.24)
    factor, sd, friction = fit(levels, list(angles), 1.24)
    assert (factor, friction) == pytest.approx((0.8, 0.04), rel=1e-6) and sd < 1e-6


def test_the_standard_deviation_agrees_with_least_squares():
    levels = np.array([0.1, 0.2, 0.3, 0.2, 0.1, -0.1, -0.2, -0.3, -0.2, -0.1])
    moving = np.sign(np.diff(levels, prepend=0.0))
    lifted = 0.8 * levels - 0.04 * moving + 0.01 * np.sin(7.0 * np.arange(10))
    found, covariance = curve_fit(
        lambda _, factor, friction: factor * levels - friction * moving, levels, lifted)
    factor, sd, friction = fit(list(levels), list(np.arcsin(lifted / 1.24)), 1.24)
    assert (factor, friction) == pytest.approx(tuple(found), rel=1e-6)
    assert sd == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-6)


def test_the_fit_needs_a_minimum_motion_of_the_pendulum():
    assert fit([0.1, 0.2, -0.2], [0.0, 0.021 / 1.24, -0.021 / 1.24], 1.24)[0] > 0.0
    with refused('failed', 'torque_limit', RefusedError):
        fit([0.1, 0.2, -0.2], [0.0, 0.019 / 1.24, -0.019 / 1.24], 1.24)


def test_a_pendulum_that_friction_holds_is_refused():
    with refused('failed', 'torque_limit', RefusedError):
        fit([0.1, 0.2, -0.2], [0.0, 1e-3, 0.0], 1.24)


def test_a_written_file_is_readable_and_marked_as_measured(calibrated, tmp_path):
    path = tmp_path / 'mine.yaml'
    write(path, read_yaml(find_config('hardware', 'gimball_odrive')), calibrated[1],
          'gimball_odrive')
    hardware = load_hardware(str(path))
    assert hardware.provenance['joint.torque_factor'].source == 'measured'
    assert hardware.joint.torque_factor == pytest.approx(1.0, rel=0.03)


def test_the_written_file_refers_to_the_robot_of_its_base(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(['new', 'robot', 'my_robot.yaml'])
    main(['new', 'hardware', 'base/motor.yaml', '--robot', 'my_robot.yaml'])
    robot = VirtualRobot(held=True)
    driver = robot.connect()
    monkeypatch.setattr(drive_line, 'handshake', lambda *_: (driver, driver.identify(), []))
    monkeypatch.setattr(calibrate_motor, 'Console', lambda: Script(robot))
    assert main([
        'calibrate-motor', '--hardware', 'base/motor.yaml', '--out', 'my motor.yaml']) == 0
    assert load_robot(load_hardware('my motor.yaml').robot).name == 'my_robot'
    hint = shlex.split(capsys.readouterr().out.rpartition('Next: ')[2])
    assert hint[-1] == f'hardware:={tmp_path / "my motor.yaml"}'
