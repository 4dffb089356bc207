# SPDX-License-Identifier: Apache-2.0
"""The speed mode of cmd_vel: the controller drives the full model at 500 Hz."""
from dataclasses import replace
import math

import numpy as np
import pytest
from refusals import refused
from tiers import pairs, slow

from ballbot_ros.control import (
    ControlTuning, JointReadings, load_tuning, Mode, PendulumController, SetPoint,
    SupervisedController, Supervision)
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant

GIMBALL = load_robot('gimball')
RATE = 500
LENGTH = 40.0  # of the slope [m]


def plant(slope=0.0, terrain=None, **changes):
    """Return a plant with changed parameters, at rest in the middle of a slope [deg]."""
    scene = read_scene({
        'robot': 'gimball', 'robot_changes': changes, 'duration': 1.0, 'solver': {'step': 2e-4},
        'terrain': terrain or [{'slope': {'length': LENGTH, 'angle_deg': slope}}],
        'initial': {'x': 0.5 * LENGTH * math.cos(math.radians(slope))}}, 'test', 'test')
    return Plant(scene, RATE)


def drive(ball, controller, speeds):
    """Command speeds for their durations; return time, ball speed and pendulum angle."""
    rows = []
    for speed, duration in speeds:
        controller.give(SetPoint(Mode.SPEED, speed, ball.time))
        for _ in range(round(duration * RATE)):
            ball.advance(controller.torque(JointReadings.of(ball.state)))
            rows.append((ball.time, -GIMBALL.ball_radius * ball.state.ball_rate,
                         ball.state.pendulum_angle))
    return np.array(rows)


def controller_for(tuning='published'):
    return PendulumController(GIMBALL, load_tuning(tuning))


def settling_time(rows, speed, share=0.05):
    """Return the time after which the speed stays within a fraction of the set speed [s]."""
    outside = np.flatnonzero(np.abs(rows[:, 1] - speed) > share * abs(speed))
    return (outside[-1] + 1) / RATE if len(outside) else 0.0


@pytest.mark.parametrize('slope, tuning', pairs([-3.0, 0.0, 3.0], ['published', 'gentle']))
def test_a_speed_settles_within_5_percent_in_3_s_and_a_stop_holds(slope, tuning):
    ball, controller = plant(slope), controller_for(tuning)
    drive(ball, controller, [(0.0, 3.0)])  # the observer estimates the slope
    rows = drive(ball, controller, [(0.3, 3.0)])
    assert settling_time(rows, 0.3) < 3.0 and rows[:, 1].max() < 0.315
    rows = drive(ball, controller, [(0.0, 3.0)])
    assert rows[:, 1].min() > -0.002  # no rolling back, on any slope
    assert abs(rows[-1, 1]) < 0.001
    # The observer has estimated the slope from the resistance of an ideal ball.
    assert math.degrees(controller.slope) == pytest.approx(slope, abs=0.05)


@pytest.mark.parametrize('slope', [0.0, *slow(-2.0, 2.0)])
def test_steps_of_the_set_speed_have_little_overshoot(slope):
    ball, controller = plant(slope), controller_for()
    drive(ball, controller, [(0.0, 2.5)])
    before = 0.0
    for speed in (0.1, 0.8, 0.3, -0.3, 0.0):
        rows = drive(ball, controller, [(speed, 3.5)])
        assert settling_time(rows, speed) < 3.5 if speed else abs(rows[-1, 1]) < 0.002
        overshoot = (rows[:, 1] - speed) * math.copysign(1.0, speed - before)
        assert overshoot.max() < 0.05 * max(abs(speed), 0.1)
        before = speed


@pytest.mark.parametrize(('pendulum_mass', 'slope'), [
    (1.25, -3.0), *slow((1.25, 3.0), (2.1, 3.0))])
def test_robots_at_the_ends_of_their_ranges_settle(pendulum_mass, slope):
    # The speed law assumes 1.6 kg.
    ball = plant(slope, pendulum_mass=pendulum_mass, ball_mass=5.4 - pendulum_mass)
    controller = controller_for()
    drive(ball, controller, [(0.0, 3.0)])
    rows = drive(ball, controller, [(0.3, 3.0)])
    assert settling_time(rows, 0.3) < 3.0 and rows[:, 1].max() < 0.33
    rows = drive(ball, controller, [(0.0, 3.0)])
    assert rows[:, 1].min() > -0.03 and abs(rows[-1, 1]) < 0.007


def test_only_a_slope_steeper_than_the_largest_lean_holds_is_reported(caplog):
    for slope, reports in ((4.5, 0), (-7.0, 1)):
        controller = SupervisedController(controller_for(), Supervision())
        ball = plant(slope)
        controller.give(SetPoint(Mode.SPEED, 0.0, 0.0))
        for _ in range(4 * RATE):
            controller.take(JointReadings.of(ball.state))
            ball.advance(controller.answer())
        assert controller.overcome == bool(reports)
        assert len(caplog.messages) == reports
    assert 'a slope of -6.9 degrees' in caplog.text and 'largest lean holds 5.5' in caplog.text


@pytest.mark.slow
def test_a_ball_blocked_by_a_wall_reverses_immediately():
    ball = plant(terrain=[{'flat': {'length': 20.3}}, {'step': {'height': 0.3}},
                          {'flat': {'length': 5.0}}])
    controller = controller_for()
    rows = drive(ball, controller, [(0.3, 10.0)])
    assert abs(rows[-1, 1]) < 0.01
    rows = drive(ball, controller, [(-0.3, 3.0)])
    assert rows[:RATE, 1].min() < -0.02  # within a second
    assert settling_time(rows, -0.3) < 3.0


def test_a_low_torque_limit_does_not_cause_windup():
    # 0.9 N m holds the pendulum at 47 degrees, without acceleration.
    tuning = replace(load_tuning('published'), torque_limit=0.9)
    ball, controller = plant(), PendulumController(GIMBALL, tuning)
    rows = drive(ball, controller, [(0.6, 5.0), (0.0, 5.0)])
    assert rows[:, 1].max() < 0.66 and rows[:, 1].min() > -0.06
    assert abs(rows[-1, 1]) < 0.007


def test_the_first_torque_holds_the_pendulum_at_its_angle():
    controller = controller_for()
    controller.give(SetPoint(Mode.SPEED, 0.5, 0.0))
    torque = controller.torque(JointReadings(0.0, 0.0, 0.4, 0.0, 0.0))
    assert torque == pytest.approx(GIMBALL.largest_gravity_torque * math.sin(0.4))


def readings(stamp, speed=0.0, angle=0.1):
    rate = -speed / GIMBALL.ball_radius
    return JointReadings(stamp, 0.0, angle, rate, -rate)


def test_repeated_readings_give_the_same_torque_and_a_new_speed_applies_immediately():
    tuning = replace(load_tuning('published'), torque_limit=1e6)
    controller, other = (PendulumController(GIMBALL, tuning) for _ in range(2))
    for one in (controller, other):
        one.give(SetPoint(Mode.SPEED, 0.2, 0.0))
        for index in range(10):
            one.torque(readings(0.002 * index, 0.01 * index))
    again = readings(0.002 * 9, 0.09)
    first = controller.torque(again)
    assert controller.torque(again) == first
    controller.give(SetPoint(Mode.SPEED, 0.1, 0.018))
    assert controller.torque(again) != first
    # The torque is the same as if the speed had not changed in between.
    controller.give(SetPoint(Mode.SPEED, 0.2, 0.018))
    assert controller.torque(again) == first == other.torque(again)


def test_the_disturbance_estimate_is_kept_on_a_speed_change_and_reset_on_a_mode_change():
    controller = controller_for()
    controller.give(SetPoint(Mode.SPEED, 0.0, 0.0))
    for index in range(1000):  # the pendulum leans and the ball is at rest: a slope
        controller.torque(readings(0.002 * index))
    learnt = controller.slope
    assert math.degrees(learnt) == pytest.approx(0.59, abs=0.02)  # asin(M2 e sin(0.1) / (M R))
    controller.give(SetPoint(Mode.SPEED, 0.1, 2.0))
    controller.torque(readings(2.0))
    assert controller.slope == pytest.approx(learnt, rel=1e-2)
    controller.give(SetPoint(Mode.HOLD, 0.1, 2.0))
    assert math.isnan(controller.slope) and not controller.overcome
    controller.give(SetPoint(Mode.SPEED, 0.1, 2.0))
    controller.torque(readings(2.002))
    assert controller.slope == 0.0


def test_a_gap_in_the_readings_resets_the_law():
    controller = controller_for()
    controller.give(SetPoint(Mode.SPEED, 0.0, 0.0))
    for index in range(500):
        controller.torque(readings(0.002 * index))
    assert controller.slope != 0.0
    controller.torque(readings(1.6))
    assert controller.slope == 0.0


@pytest.mark.parametrize('name', ['position_kp', 'position_kd'])
def test_the_speed_mode_refuses_zero_position_gains(name):
    controller = PendulumController(GIMBALL, ControlTuning(**{name: 0.0}))
    controller.give(SetPoint(Mode.SPEED, 0.1, 0.0))
    with refused('inconsistent', 'position_kp'):
        controller.torque(readings(0.0))


def test_implausible_readings_give_a_torque_within_the_limit():
    controller = controller_for()
    controller.give(SetPoint(Mode.SPEED, 0.1, 0.0))
    for index, speed in enumerate([0.0, 1e200, -1e300, 1e10, 0.0, 0.0]):
        assert abs(controller.torque(readings(0.002 * index, speed))) <= 4.0
