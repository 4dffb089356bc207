# SPDX-License-Identifier: Apache-2.0
"""An engaged e-stop: no torque, and no motion after release without a new request."""
import pytest

from ballbot_ros.control import (
    checked_controller, ControlTuning, JointReadings, load_tuning, Mode, PendulumController,
    SetPoint, SupervisedController, Supervision)
from ballbot_ros.control.supervised import SET_POINT_GAP
from ballbot_ros.errors import MessageError, UnstableLoopError
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')


def new_controller(**expected):
    """Return a controller that holds the pendulum raised, at time 1 s."""
    controller = SupervisedController(
        PendulumController(GIMBALL, ControlTuning()), Supervision(**expected))
    controller.give(SetPoint(Mode.HOLD, 0.5, 1.0))
    assert answer(controller, 1.0) > 0.0
    return controller


def answer(controller, stamp):
    """Return the torque for a pendulum at 0.1 rad."""
    controller.take(JointReadings(stamp, 0.0, 0.1, 0.0, 0.0))
    return controller.answer()


def refused(controller, value, stamp, mode=Mode.HOLD):
    """Give a set-point that is refused because of the e-stop; return the message."""
    with pytest.raises(MessageError) as caught:
        controller.give(SetPoint(mode, value, stamp))
    assert caught.value.reason == 'e_stop'
    return str(caught.value)


def test_an_engaged_e_stop_stops_the_torque_and_refuses_motion_requests():
    controller = new_controller()
    controller.on_e_stop(True)
    assert answer(controller, 1.1) == 0.0 and controller.set_point.mode is Mode.IDLE
    assert 'the e-stop is engaged' in refused(controller, 0.5, 1.1)
    controller.give(SetPoint(Mode.HOLD, 0.0, 1.1))  # a request of rest is accepted
    assert answer(controller, 1.2) == 0.0 and controller.set_point.mode is Mode.IDLE


@pytest.mark.parametrize('stamp', [-50.0, 50.0])
def test_the_e_stop_is_the_refusal_reason_even_without_joint_states(stamp):
    controller = new_controller(set_point_timeout=0.5)
    controller.on_e_stop(True)
    refused(controller, 0.5, stamp)
    controller.give(SetPoint(Mode.HOLD, 0.0, stamp))
    controller.on_e_stop(False)
    refused(controller, 0.5, 1.0)  # a rest request of unknown age does not count


def test_after_release_motion_is_refused_until_rest_was_requested():
    controller = new_controller()
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
def test_after_a_gap_in_the_set_points_motion_is_accepted(silence, follows):
    controller = new_controller()
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
    controller = new_controller()
    controller.give(SetPoint(Mode.HOLD, 0.4, 1.0))
    assert controller.requested == SetPoint(Mode.HOLD, 0.4, 1.0)
    answer(controller, 1.0 + SET_POINT_GAP)
    assert controller.requested is None


def test_in_lockstep_states_during_an_e_stop_need_no_set_points():
    controller = new_controller(set_point_period=0.02)
    assert answer(controller, 1.02) is None
    controller.on_e_stop(True)
    assert controller.answer() == 0.0


@pytest.mark.parametrize('set_point, rest', [
    (SetPoint(Mode.IDLE, 5.0), True), (SetPoint(Mode.HOLD, 0.0), True),
    (SetPoint(Mode.SPEED, -1e-4), True), (SetPoint(Mode.DRIVE, 0.01), False)])
def test_rest_is_a_hanging_pendulum_a_stationary_ball_or_idle(set_point, rest):
    assert set_point.is_rest == rest


def test_the_torque_ends_when_the_pendulum_has_been_let_down():
    controller = new_controller(set_point_timeout=0.5, let_down_time=1.0)
    assert answer(controller, 1.6) < 0.0 and controller.let_down
    assert answer(controller, 2.4) < 0.0
    assert answer(controller, 2.6) == 0.0 and controller.set_point.mode is Mode.IDLE
    controller.give(SetPoint(Mode.HOLD, 0.5, 2.6))
    assert answer(controller, 2.61) > 0.0 and not controller.let_down


@pytest.mark.slow
def test_a_checked_controller_requires_the_lowest_stable_rate_of_its_gains():
    controller = checked_controller(GIMBALL, load_tuning('published'), 500.0, 0)
    assert controller.expected.lowest_rate == pytest.approx(275.0, rel=5e-3)
    with pytest.raises(UnstableLoopError):
        checked_controller(GIMBALL, load_tuning('published'), 500.0, 1)
