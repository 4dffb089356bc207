# SPDX-License-Identifier: Apache-2.0
"""A controller with the e-stop engaged: no torque, no memory, and no jump on release."""
import pytest

from ballbot_ros.control import (
    checked_controller, ControlTuning, JointReadings, load_tuning, Mode, PendulumController,
    SetPoint, SupervisedController, Supervision)
from ballbot_ros.control.supervised import SET_POINT_GAP
from ballbot_ros.errors import MessageError, UnstableLoopError
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')


def made(**expected):
    """Return a controller that follows a raised pendulum, at time 1."""
    controller = SupervisedController(
        PendulumController(GIMBALL, ControlTuning()), Supervision(**expected))
    controller.give(SetPoint(Mode.HOLD, 0.5, 1.0))
    assert answer(controller, 1.0) > 0.0
    return controller


def answer(controller, stamp):
    """Return the answer to a pendulum that hangs."""
    controller.take(JointReadings(stamp, 0.0, 0.1, 0.0, 0.0))
    return controller.answer()


def refused(controller, value, stamp, mode=Mode.HOLD):
    """Give a set-point that is refused because of the e-stop; return the words."""
    with pytest.raises(MessageError) as caught:
        controller.give(SetPoint(mode, value, stamp))
    assert caught.value.reason == 'e_stop'
    return str(caught.value)


def test_while_it_is_engaged_there_is_no_torque_and_what_asks_for_motion_is_refused():
    controller = made()
    controller.on_e_stop(True)
    assert answer(controller, 1.1) == 0.0 and controller.set_point.mode is Mode.IDLE
    assert 'the e-stop is engaged' in refused(controller, 0.5, 1.1)
    controller.give(SetPoint(Mode.HOLD, 0.0, 1.1))  # rest is not motion, and gives no torque
    assert answer(controller, 1.2) == 0.0 and controller.set_point.mode is Mode.IDLE


@pytest.mark.parametrize('stamp', [-50.0, 50.0])
def test_it_is_the_reason_of_a_refusal_though_joint_states_have_stopped(stamp):
    controller = made(set_point_timeout=0.5)
    controller.on_e_stop(True)
    refused(controller, 0.5, stamp)
    controller.give(SetPoint(Mode.HOLD, 0.0, stamp))
    controller.on_e_stop(False)
    refused(controller, 0.5, 1.0)  # rest of unknown age does not count


def test_a_set_point_that_outlives_it_is_refused_until_it_was_at_rest():
    controller = made()
    controller.on_e_stop(True)
    answer(controller, 1.1)
    refused(controller, 0.5, 1.1)
    controller.on_e_stop(False)
    for number in range(200):
        stamp = 1.12 + 0.02 * number
        assert answer(controller, stamp) == 0.0
        assert 'request rest first' in refused(controller, 0.5, stamp)
    controller.give(SetPoint(Mode.SPEED, 0.0, stamp))
    controller.give(SetPoint(Mode.HOLD, 0.5, stamp))
    assert answer(controller, stamp + 0.02) > 0.0


@pytest.mark.parametrize('silence, follows', [
    (SET_POINT_GAP - 0.01, False), (SET_POINT_GAP + 0.01, True)])
def test_a_set_point_that_was_away_long_enough_is_a_new_one(silence, follows):
    controller = made()
    controller.on_e_stop(True)
    answer(controller, 1.1)
    refused(controller, 0.5, 1.1)
    controller.on_e_stop(False)
    answer(controller, 1.1 + silence)
    if follows:
        controller.give(SetPoint(Mode.HOLD, 0.5, 1.1 + silence))
        assert answer(controller, 2.0) > 0.0
    else:
        refused(controller, 0.5, 1.1 + silence)


def test_a_recent_motion_request_is_recorded():
    controller = made()
    controller.give(SetPoint(Mode.HOLD, 0.4, 1.0))
    assert controller.requested == SetPoint(Mode.HOLD, 0.4, 1.0)
    answer(controller, 1.0 + SET_POINT_GAP)
    assert controller.requested is None


def test_in_lockstep_the_states_of_an_e_stop_are_answered_without_set_points():
    controller = made(set_point_period=0.02)
    assert answer(controller, 1.02) is None
    controller.on_e_stop(True)
    assert controller.answer() == 0.0


@pytest.mark.parametrize('set_point, rest', [
    (SetPoint(Mode.IDLE, 5.0), True), (SetPoint(Mode.HOLD, 0.0), True),
    (SetPoint(Mode.SPEED, -1e-4), True), (SetPoint(Mode.DRIVE, 0.01), False)])
def test_rest_is_a_hanging_pendulum_a_standing_ball_or_nothing(set_point, rest):
    assert set_point.is_rest == rest


def test_a_pendulum_that_is_let_down_has_no_torque_after_a_while():
    controller = made(set_point_timeout=0.5, let_down_time=1.0)
    assert answer(controller, 1.6) < 0.0 and controller.let_down
    assert answer(controller, 2.4) < 0.0
    assert answer(controller, 2.6) == 0.0 and controller.set_point.mode is Mode.IDLE
    controller.give(SetPoint(Mode.HOLD, 0.5, 2.6))
    assert answer(controller, 2.61) > 0.0 and not controller.let_down


@pytest.mark.slow
def test_a_checked_controller_expects_the_rate_that_its_gains_need():
    controller = checked_controller(GIMBALL, load_tuning('published'), 500.0, 0)
    assert controller.expected.lowest_rate == pytest.approx(275.0, rel=5e-3)
    with pytest.raises(UnstableLoopError):
        checked_controller(GIMBALL, load_tuning('published'), 500.0, 1)
