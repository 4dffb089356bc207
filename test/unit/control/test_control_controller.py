# SPDX-License-Identifier: Apache-2.0
"""The controller: control laws, torque limit, integral, and repeated and refused inputs."""
from dataclasses import replace
import math

from hypothesis import assume, example, given, strategies
import pytest
from refusals import refused

from ballbot_ros.control import (
    ControlTuning, JointReadings, load_tuning, Mode, PendulumController, SetPoint)
from ballbot_ros.errors import MessageError
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
FREE = ControlTuning(torque_limit=1e6)
number = strategies.floats(-20.0, 20.0)


def at(stamp, ball_angle=0.0, joint_angle=0.0, ball_rate=0.0, joint_rate=0.0):
    return JointReadings(stamp, ball_angle, joint_angle, ball_rate, joint_rate)


def controller_for(set_point, tuning=FREE):
    controller = PendulumController(GIMBALL, tuning)
    controller.give(set_point)
    return controller


def test_without_a_set_point_there_is_no_torque():
    assert PendulumController(GIMBALL, FREE).torque(at(0.0, 1.0, 1.0, 5.0, 5.0)) == 0.0


@given(number, number, number, number, number)
def test_hold_is_law_11(set_angle, ball, joint, ball_rate, joint_rate):
    torque = controller_for(SetPoint('hold', set_angle)).torque(
        at(0.0, ball, joint, ball_rate, joint_rate))
    expected = (40.0 * (set_angle - (ball + joint)) - 10.0 * (ball_rate + joint_rate)
                + GIMBALL.largest_gravity_torque * math.sin(ball + joint))
    assert torque == pytest.approx(expected, abs=1e-9)


@given(number, number, number, number, number, strategies.floats(1e-3, 10.0))
def test_drive_is_law_12_from_the_time_of_the_set_point(
        set_rate, ball, start, joint, joint_rate, elapsed):
    controller = controller_for(
        SetPoint('drive', set_rate, 3.0), replace(FREE, velocity_ki=2.0))
    controller.torque(at(3.0, ball, start))
    torque = controller.torque(at(3.0 + elapsed, ball, joint, 0.0, joint_rate))
    expected = (10.0 * (set_rate - joint_rate) + 2.0 * (set_rate * elapsed - (joint - start))
                + GIMBALL.largest_gravity_torque * math.sin(ball + joint))
    assert torque == pytest.approx(expected, abs=1e-6)


@given(number, number, number, number, number)
def test_torque_stays_within_the_limit(value, ball, joint, ball_rate, joint_rate):
    for mode in Mode:
        torque = controller_for(SetPoint(mode, value), load_tuning('published')).torque(
            at(0.0, ball, joint, ball_rate, joint_rate))
        assert abs(torque) <= 4.0


def test_gravity_compensation_can_be_disabled():
    tuning = replace(FREE, gravity_compensation=False)
    torque = controller_for(SetPoint('hold', 0.5), tuning).torque(at(0.0, 0.0, 0.5))
    assert torque == 0.0


def test_a_repeated_stamp_gives_the_same_torque():
    controller = controller_for(SetPoint('drive', 1.0), replace(FREE, velocity_ki=5.0))
    controller.torque(at(0.0))
    first = controller.torque(at(0.1, joint_rate=0.5))
    assert controller.torque(at(0.1, joint_rate=0.5)) == first
    assert controller.torque(at(0.1, joint_angle=1.0, joint_rate=9.0)) == first


def test_a_new_set_point_applies_even_at_a_repeated_stamp():
    controller = controller_for(SetPoint('hold', 1.0))
    assert controller.torque(at(0.0)) == pytest.approx(40.0)
    controller.give(SetPoint('idle', stamp=0.0))
    assert controller.torque(at(0.0)) == 0.0


def test_repeating_the_set_point_does_not_restart_the_integral():
    tuning = replace(FREE, velocity_ki=2.0)
    once = controller_for(SetPoint('drive', 1.0), tuning)
    often = controller_for(SetPoint('drive', 1.0), tuning)
    for index in range(50):
        often.give(SetPoint('drive', 1.0, 0.1 * index))
        assert often.torque(at(0.1 * index)) == once.torque(at(0.1 * index))
    often.give(SetPoint('drive', 2.0, 5.0))
    assert often.torque(at(5.0)) == pytest.approx(20.0)   # a new set-point does


def test_the_integral_does_not_wind_up_at_the_limit():
    tuning = ControlTuning(velocity_kp=1.0, velocity_ki=2.0, torque_limit=4.0)
    controller = controller_for(SetPoint('drive', 3.0), tuning)
    for index in range(1000):   # ten seconds against a wall
        torque = controller.torque(at(0.01 * index))
    assert torque == pytest.approx(4.0, abs=0.1)
    # At twice the set rate: without anti-windup the torque would stay at the limit.
    assert controller.torque(at(10.0, joint_rate=6.0)) < 0.0


@pytest.mark.slow
@given(strategies.floats(-3.0, 3.0), strategies.lists(
    strategies.tuples(strategies.floats(0.01, 1.0), strategies.floats(-3.0, 3.0),
                      strategies.sampled_from([-1.5, 0.0, 1.5])),
    min_size=1, max_size=20))
@example(1.0, [(1.0, -1.0, 0.0), (0.01, 1.1, 1.5), (0.5, 1.1, 1.5), (0.1, 1.1, -1.5)])
def test_at_the_limit_the_integral_only_changes_away_from_it(set_rate, motion):
    limit, kp, ki = 4.0, 1.0, 2.0
    controller = controller_for(SetPoint('drive', set_rate), ControlTuning(
        velocity_kp=kp, velocity_ki=ki, torque_limit=limit))
    stamp = joint = lag = 0.0
    controller.torque(at(0.0))
    for period, rate, lean in motion:
        stamp, joint = stamp + period, joint + rate * period
        moved = (set_rate - rate) * period
        rest = kp * (set_rate - rate) + GIMBALL.largest_gravity_torque * math.sin(lean)
        law = rest + ki * (lag + moved)
        assume(abs(abs(law) - limit) > 1e-6)  # exclude cases that rounding decides
        if not (abs(law) > limit and moved * law > 0.0):
            lag += moved
        assert controller.torque(at(stamp, lean - joint, joint, 0.0, rate)) == pytest.approx(
            max(-limit, min(limit, rest + ki * lag)), abs=1e-6)


@pytest.mark.parametrize('rate', [9.0, -9.0])
def test_a_set_point_that_starts_at_the_limit_has_no_initial_integral(rate):
    controller = controller_for(SetPoint('drive', rate), ControlTuning(
        velocity_kp=1.0, velocity_ki=2.0, torque_limit=4.0, gravity_compensation=False))
    assert controller.torque(at(0.0)) == math.copysign(4.0, rate)
    assert controller.torque(at(1.0, joint_angle=rate, joint_rate=rate)) == pytest.approx(
        0.0, abs=1e-12)


def test_reset_restores_the_initial_state():
    controller = controller_for(SetPoint('hold', 1.0, 100.0))
    controller.torque(at(100.0))
    controller.reset()
    assert controller.set_point.mode is Mode.IDLE
    assert controller.torque(at(0.0)) == 0.0
    controller.give(SetPoint('hold', 0.0, 0.0))


def test_older_stamps_are_refused():
    controller = controller_for(SetPoint('hold', 0.0, 2.0))
    with refused('stale', error=MessageError):
        controller.give(SetPoint('hold', 1.0, 1.0))
    controller.torque(at(2.0))
    with refused('stale', error=MessageError):
        controller.torque(at(1.5))
    assert controller.set_point.value == 0.0


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_are_refused(bad):
    for index in range(5):
        values = [0.0] * 5
        values[index] = bad
        with refused('not_finite', error=MessageError):
            JointReadings(*values)
    for arguments in ((bad, 0.0), (0.0, bad)):
        with refused('not_finite', error=MessageError):
            SetPoint('hold', *arguments)


def test_unknown_mode_is_refused():
    with refused('unknown_mode', error=MessageError):
        SetPoint('fly', 1.0)
