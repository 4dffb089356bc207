# SPDX-License-Identifier: Apache-2.0
"""The supervised controller with missing, slow, stale and repeated inputs."""
from hypothesis import given, strategies
import pytest

from ballbot_ros.control import (
    ControlTuning, JointReadings, Mode, PendulumController, SetPoint, SupervisedController,
    Supervision)
from ballbot_ros.errors import MessageError
from ballbot_ros.physics import load_robot


def new_controller(**expected):
    return SupervisedController(
        PendulumController(load_robot('gimball'), ControlTuning()), Supervision(**expected))


def at(stamp, joint_angle=0.1):
    return JointReadings(stamp, 0.0, joint_angle, 0.0, 0.0)


def answer(controller, stamp):
    controller.take(at(stamp))
    return controller.answer()


def test_each_state_is_answered_once():
    controller = new_controller()
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    assert answer(controller, 0.0) == pytest.approx(-40.0 * 0.1 + 1.2353 * 0.0998, abs=1e-3)
    assert controller.answer() is None


def test_without_a_set_point_there_is_no_torque():
    assert answer(new_controller(), 0.0) == 0.0


def test_a_low_state_rate_gives_no_torque_and_one_warning(caplog):
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    torques = [answer(controller, 0.01 * index) for index in range(40)]
    assert torques[-1] == 0.0 and controller.too_slow
    assert len(caplog.messages) == 1 and '100 Hz' in caplog.messages[0]
    for index in range(400):
        torques.append(answer(controller, 1.0 + 0.002 * index))
    assert torques[-1] != 0.0 and not controller.too_slow


def test_a_state_rate_about_the_lowest_one_gives_one_warning_per_second(caplog):
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    stamp, changes = 0.0, 0
    while stamp < 2.5:
        for period in (0.002, 0.004):
            for _ in range(11):  # more than half of the periods of the median
                before, stamp = controller.too_slow, stamp + period
                answer(controller, stamp)
                changes += before != controller.too_slow
    assert changes > 20 and len(caplog.messages) == 3
    answer(controller, 0.0)
    for index in range(20):
        answer(controller, 0.01 * index)
    assert 'time went back' in caplog.messages[3] and '100 Hz' in caplog.messages[4]


def test_after_a_low_state_rate_the_torque_starts_at_zero():
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    for index in range(100):
        answer(controller, 0.004 * index)
    assert controller.too_slow
    torques = [answer(controller, 0.4 + 0.002 * index) for index in range(200)]
    assert torques[0] == 0.0 and torques[-1] < -3.0 and not controller.too_slow
    assert max(abs(a - b) for a, b in zip(torques, torques[1:])) < 0.1


def test_after_retuning_for_a_low_state_rate_the_torque_starts_at_zero():
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    for index in range(100):
        answer(controller, 0.004 * index)
    controller.expected = Supervision(lowest_rate=100.0)
    controller.retune(ControlTuning(position_kp=30.0))
    torques = [answer(controller, 0.4 + 0.004 * index) for index in range(100)]
    assert torques[-1] < -2.0 and not controller.too_slow
    assert max(abs(a - b) for a, b in zip([0.0, *torques], torques)) < 0.1


def test_an_old_set_point_lets_the_pendulum_down_with_one_warning(caplog):
    controller = new_controller(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.HOLD, 1.0, 0.0))
    assert answer(controller, 0.4) > 0.0
    assert answer(controller, 0.6) < 0.0
    answer(controller, 0.7)
    assert controller.set_point == SetPoint(Mode.HOLD, 0.0, 0.0)
    assert len(caplog.messages) == 1 and 'lowered' in caplog.messages[0]
    controller.give(SetPoint(Mode.HOLD, 1.0, 0.71))
    assert answer(controller, 0.72) > 0.0


@pytest.mark.parametrize('stamp, reason', [
    (1.7e9, 'from_the_future'), (11.01, 'from_the_future'), (9.49, 'stale'), (1.0, 'stale')])
def test_stale_and_future_set_points_are_refused_and_change_nothing(stamp, reason):
    controller = new_controller(set_point_timeout=0.5)
    controller.take(at(10.0))
    with pytest.raises(MessageError) as caught:
        controller.give(SetPoint(Mode.HOLD, 1.0, stamp))
    assert caught.value.reason == reason and controller.set_point.mode is Mode.IDLE


@pytest.mark.parametrize('stamp', [11.0, 10.9, 9.5])
def test_a_set_point_may_be_a_second_ahead_and_as_old_as_the_timeout(stamp):
    controller = new_controller(set_point_timeout=0.5)
    controller.take(at(10.0))
    controller.give(SetPoint(Mode.HOLD, 1.0, stamp))
    assert controller.set_point.stamp == stamp


def test_the_rate_is_checked_from_the_eleventh_state_on():
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    assert not controller.too_slow
    for number in range(10):
        assert answer(controller, 0.01 * number) != 0.0
        assert controller.rate is None and not controller.too_slow
    assert answer(controller, 0.1) == 0.0 and controller.too_slow
    assert controller.rate == pytest.approx(100.0)


@pytest.mark.parametrize('lowest, slow', [(8.0 / 0.98, False), (8.1 / 0.98, True)])
def test_the_measured_rate_may_be_two_percent_too_low(lowest, slow):
    controller = new_controller(lowest_rate=lowest)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    for number in range(12):
        answer(controller, 0.125 * number)
    assert controller.too_slow == slow


def test_nothing_is_supervised_by_default(caplog):
    controller = new_controller()
    controller.give(SetPoint(Mode.HOLD, 1.0, 0.0))
    assert min(answer(controller, 1e3 * number) for number in range(1, 40)) > 0.0
    assert not caplog.messages


def test_the_time_is_zero_before_the_first_state():
    controller = new_controller()
    assert controller.time == 0.0
    controller.take(at(7.0))
    assert controller.time == 7.0


def test_a_set_point_is_followed_until_just_after_its_timeout(caplog):
    controller = new_controller(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.HOLD, 1.0, 1.0))
    assert answer(controller, 1.5) > 0.0 and answer(controller, 1.5 + 5e-7) > 0.0
    assert not caplog.messages
    assert answer(controller, 1.5 + 5e-6) < 0.0 and caplog.messages


def test_in_lockstep_a_state_waits_for_the_set_point_of_its_period():
    controller = new_controller(set_point_period=0.02)
    assert answer(controller, 0.0) is None
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    assert controller.answer() is not None
    assert answer(controller, 0.018) is not None
    assert answer(controller, 0.02) is None
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.02))
    assert controller.answer() is not None


def test_a_single_missing_state_at_the_start_is_not_a_low_rate(caplog):
    controller = new_controller(lowest_rate=275.0)
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    torques = [answer(controller, 0.002 * number) for number in (0, 2, 3, 4, 5, 6, 8, 9, 10, 11)]
    assert 0.0 not in torques and not caplog.messages and controller.rate is None


@pytest.mark.slow
@given(strategies.lists(strategies.sampled_from([1, 1, 1, 2, 3]), min_size=30, max_size=60))
def test_torque_depends_on_the_median_rate_of_the_last_states(gaps):
    controller, stamp, was_slow = new_controller(lowest_rate=275.0), 0.0, False
    controller.give(SetPoint(Mode.HOLD, 0.0, 0.0))
    for index, gap in enumerate(gaps):
        stamp += 0.002 * gap
        torque = answer(controller, stamp)
        if index >= 21:
            usual = sorted(gaps[index - 19:index + 1])
            slow = usual[9] + usual[10] > 2 * 500 / 275 / 0.98
            assert slow == controller.too_slow
            # After a period without torque, the first torque is zero.
            assert torque == 0.0 if slow else was_slow or torque != 0.0
        was_slow = controller.too_slow


def test_idle_does_not_expire_but_drive_does(caplog):
    controller = new_controller(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.IDLE, 0.0, 0.0))
    assert answer(controller, 9.0) == 0.0 and not caplog.messages
    controller.give(SetPoint(Mode.DRIVE, 3.0, 9.0))
    assert answer(controller, 9.4) > 0.0
    answer(controller, 9.6)
    assert controller.set_point == SetPoint(Mode.HOLD, 0.0, 9.0)


def test_each_set_point_timeout_is_logged_once(caplog):
    controller = new_controller(set_point_timeout=0.5)
    for begin in (0.0, 2.0):
        controller.give(SetPoint(Mode.HOLD, 1.0, begin))
        for number in range(20):
            answer(controller, begin + 0.1 * number)
    assert len(caplog.messages) == 2
    assert 'publish set-points at 4 Hz or more' in caplog.messages[0]


def test_a_set_point_before_the_first_state_may_have_any_stamp():
    controller = new_controller(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.HOLD, 1.0, 1e6))
    assert controller.set_point.value == 1.0


def test_in_lockstep_stamps_may_be_rounded_to_the_nanosecond():
    controller = new_controller(set_point_period=1.0 / 30.0)
    for period in range(1, 50):
        controller.give(SetPoint(Mode.HOLD, 0.0, round(period / 30.0, 9)))
        for state in (0.0, 1.0, 2.0):
            assert answer(controller, round((period + state / 3.0) / 30.0, 9)) is not None
    assert answer(controller, round(50 / 30.0, 9)) is None


def test_a_repeated_state_gives_the_same_torque_again():
    controller = new_controller(set_point_period=0.02)
    controller.give(SetPoint(Mode.DRIVE, 1.0, 0.0))
    first = answer(controller, 0.002)
    assert [answer(controller, 0.002) for _ in range(3)] == [first] * 3


def test_a_backward_time_jump_discards_the_set_point_and_accepts_new_ones(caplog):
    controller = new_controller(set_point_timeout=0.5)
    controller.give(SetPoint(Mode.HOLD, 1.0, 5.0))
    answer(controller, 5.0)
    assert answer(controller, 1.0) == 0.0
    assert controller.set_point.mode is Mode.IDLE and 'time went back' in caplog.messages[0]
    with pytest.raises(MessageError):
        controller.give(SetPoint(Mode.HOLD, 1.0, 5.02))
    controller.give(SetPoint(Mode.HOLD, 1.0, 1.0))
    assert answer(controller, 1.002) > 0.0
    assert controller.time == 1.002
