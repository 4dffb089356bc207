# SPDX-License-Identifier: Apache-2.0
"""A change of control law blends linearly from the torque in force, without a jump."""
from dataclasses import replace

from hypothesis import given, strategies
import pytest

from ballbot_ros.control import (
    ControlTuning, JointReadings, load_tuning, Mode, PendulumController, SetPoint)
from ballbot_ros.control.controller import RETUNING
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
# Without gravity and limits, (11) is kp (angle - phi) - kd phi' and (12) kp (rate - theta2').
PLAIN = ControlTuning(position_kp=6.0, position_kd=0.8, velocity_kp=0.8, torque_limit=1e6,
                      gravity_compensation=False, blend_time=0.1)


def at(stamp, angle=0.2, rate=0.0):
    """Return readings of a moving pendulum and a ball at rest."""
    return JointReadings(stamp, 0.0, angle, 0.0, rate)


def driven(tuning=PLAIN, set_point=SetPoint(Mode.HOLD, 0.5)):
    """Return a controller that has followed a set-point for longer than the blend time."""
    controller = PendulumController(GIMBALL, tuning)
    controller.give(set_point)
    for number in range(51):
        controller.torque(at(0.002 * number))
    return controller


def test_the_difference_fades_linearly_over_the_blend_time():
    controller = driven()
    held = 6.0 * (0.5 - 0.2)
    assert controller.torque(at(0.2)) == pytest.approx(held)
    controller.give(SetPoint(Mode.DRIVE, 1.0))
    own = 0.8 * 1.0  # for a joint at rest
    for share in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5):
        expected = own + max(0.0, 1.0 - share) * (held - own)
        assert controller.torque(at(0.3 + 0.1 * share)) == pytest.approx(expected)


def test_the_blend_starts_at_the_torque_in_force_if_it_is_given():
    controller = driven()
    controller.give(SetPoint(Mode.DRIVE, 1.0))
    assert controller.torque(at(0.3), in_force=0.35) == pytest.approx(0.35)
    assert controller.torque(at(0.35), in_force=9.9) == pytest.approx(0.8 + 0.5 * (0.35 - 0.8))


def test_from_idle_a_law_starts_at_zero_torque_and_idle_is_immediate():
    controller = PendulumController(GIMBALL, PLAIN)
    controller.torque(at(0.0))
    controller.give(SetPoint(Mode.HOLD, 0.5))
    assert controller.torque(at(0.01)) == 0.0
    assert controller.torque(at(0.06)) == pytest.approx(0.5 * 1.8)
    controller.give(SetPoint(Mode.IDLE))
    assert controller.torque(at(0.07)) == 0.0
    controller.give(SetPoint(Mode.HOLD, 0.5))
    assert controller.torque(at(0.08)) == 0.0


def test_another_value_for_the_same_law_is_not_a_change_of_law():
    controller = driven()
    controller.give(SetPoint(Mode.HOLD, -0.1))
    assert controller.torque(at(0.3)) == pytest.approx(6.0 * (-0.1 - 0.2))


def test_a_change_of_law_during_a_blend_starts_at_the_present_torque():
    controller = driven()
    controller.give(SetPoint(Mode.DRIVE, 1.0))
    controller.torque(at(0.3))
    before = controller.torque(at(0.35))
    controller.give(SetPoint(Mode.HOLD, 0.0))
    assert controller.torque(at(0.35)) == pytest.approx(before)
    assert controller.torque(at(0.5)) == pytest.approx(-1.2)


def test_a_reset_ends_the_blend():
    controller = driven()
    controller.give(SetPoint(Mode.DRIVE, 1.0))
    controller.torque(at(0.3))
    controller.reset()
    assert controller.torque(at(0.31)) == 0.0
    controller.give(SetPoint(Mode.DRIVE, 1.0))
    assert controller.torque(at(0.32)) == 0.0


def test_without_a_blend_time_a_law_takes_over_immediately():
    assert load_tuning('published').blend_time == ControlTuning().blend_time == 0.0
    controller, fresh = (PendulumController(GIMBALL, ControlTuning()) for _ in range(2))
    controller.give(SetPoint(Mode.HOLD, 0.5))
    controller.torque(at(0.1))
    for one in (controller, fresh):
        one.give(SetPoint(Mode.DRIVE, 1.0))
    assert controller.torque(at(0.2)) == fresh.torque(at(0.2))


@given(strategies.lists(strategies.tuples(
    strategies.sampled_from([Mode.HOLD, Mode.DRIVE, Mode.SPEED]),
    strategies.floats(-1.0, 1.0), strategies.integers(1, 60)), min_size=2, max_size=6))
def test_changes_of_law_cause_no_jump_and_respect_the_limit(orders):
    controller = PendulumController(GIMBALL, replace(load_tuning('gentle'), torque_limit=1.5))
    stamp, last, mode = 0.0, controller.torque(at(0.0)), Mode.IDLE
    for new_mode, value, periods in orders:
        controller.give(SetPoint(new_mode, value, stamp))
        for number in range(periods):
            stamp += 0.002
            torque = controller.torque(at(stamp))
            assert abs(torque) <= 1.5
            if number == 0 and new_mode is not mode:
                assert torque == pytest.approx(last, abs=1e-9)
            last = torque
        mode = new_mode


@pytest.mark.parametrize('set_point', [SetPoint(Mode.HOLD, 0.5), SetPoint(Mode.DRIVE, 1.0)])
def test_new_gains_take_over_without_a_jump_even_without_a_blend_time(set_point):
    tuning = replace(PLAIN, blend_time=0.0, velocity_ki=2.0)
    controller = driven(tuning, set_point)
    before = controller.torque(at(0.2))
    stiffer = replace(tuning, position_kp=12.0, velocity_kp=1.6, velocity_ki=4.0)
    controller.retune(stiffer)
    assert controller.torque(at(0.2)) == before  # the same reading gives the same torque
    fresh = driven(stiffer, set_point)
    jump = controller.torque(at(0.202)) - before
    assert abs(jump) < 0.02 * abs(before) < 0.02 * abs(fresh.torque(at(0.202)))
    assert controller.torque(at(0.2 + 2.0 * RETUNING)) == pytest.approx(
        fresh.torque(at(0.2 + 2.0 * RETUNING)))
    assert controller.set_point == set_point


def test_the_slope_estimate_is_kept_under_new_gains():
    controller = PendulumController(GIMBALL, load_tuning('gentle'))
    controller.give(SetPoint(Mode.SPEED, 0.3))
    for number in range(300):
        controller.torque(at(0.002 * number, angle=0.1))
    learnt = controller.slope
    controller.retune(replace(load_tuning('gentle'), observer_rate=3.0))
    controller.torque(at(0.602, angle=0.1))
    assert learnt != 0.0 and controller.slope == pytest.approx(learnt, rel=0.05)
