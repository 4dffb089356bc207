# SPDX-License-Identifier: Apache-2.0
"""The controller among unreliable neighbours."""
import pytest

from ballbot_ros.control import (
    ControlTuning, JointReadings, Mode, PendulumController, SetPoint, SupervisedController,
    Supervision)
from ballbot_ros.errors import MessageError
from ballbot_ros.physics import load_robot


def made(**expected):
    return SupervisedController(
        PendulumController(load_robot('gimball'), ControlTuning()), Supervision(**expected))


def at(stamp, joint_angle=0.1):
    return JointReadings(stamp, 0.0, joint_angle, 0.0, 0.0)


def answer(controller, stamp):
    controller.take(at(stamp))
    return controller.answer()


def test_a_state_is_answered_once_by_the_law():
    controller = made()
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    assert answer(controller, 0.0) == pytest.approx(-40.0 * 0.1 + 1.2353 * 0.0998, abs=1e-3)
    assert controller.answer() is None


def test_without_a_set_point_there_is_no_torque():
    assert answer(made(), 0.0) == 0.0


def test_states_that_come_too_rarely_get_no_torque_and_one_notice():
    controller = made(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    torques = [answer(controller, 0.01 * index) for index in range(40)]
    assert torques[-1] == 0.0 and controller.too_slow
    assert len(controller.notices) == 1 and '100 Hz' in controller.notices[0]
    for index in range(400):
        torques.append(answer(controller, 1.0 + 0.002 * index))
    assert torques[-1] != 0.0 and not controller.too_slow


def test_an_old_set_point_lets_the_pendulum_down_with_one_notice():
    controller = made(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.HOLD, 1.0, 0.0))
    assert answer(controller, 0.4) > 0.0
    assert answer(controller, 0.6) < 0.0
    answer(controller, 0.7)
    assert controller.set_point == SetPoint(Mode.HOLD, 0.0, 0.0)
    assert len(controller.notices) == 1 and 'let down' in controller.notices[0]
    controller.give(SetPoint(Mode.HOLD, 1.0, 0.71))
    assert answer(controller, 0.72) > 0.0


@pytest.mark.parametrize('stamp, reason', [(1.7e9, 'from_the_future'), (1.0, 'stale')])
def test_a_set_point_of_another_time_is_refused(stamp, reason):
    controller = made(set_point_timeout=0.5)
    controller.take(at(10.0))
    with pytest.raises(MessageError) as caught:
        controller.give(SetPoint(Mode.HOLD, 1.0, stamp))
    assert caught.value.reason == reason


def test_in_lockstep_a_state_waits_for_the_set_point_of_its_period():
    controller = made(set_point_period=0.02)
    assert answer(controller, 0.0) is None
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    assert controller.answer() is not None
    assert answer(controller, 0.018) is not None
    assert answer(controller, 0.02) is None
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.02))
    assert controller.answer() is not None


def test_when_time_goes_back_all_is_forgotten_and_told():
    controller = made()
    controller.give(SetPoint(Mode.HOLD, 1.0, 5.0))
    answer(controller, 5.0)
    assert answer(controller, 1.0) == 0.0
    assert controller.set_point.mode is Mode.IDLE and 'time went back' in controller.notices[0]
