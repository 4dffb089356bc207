# SPDX-License-Identifier: Apache-2.0
"""Timing of torques, stops and attempts to arm."""
import pytest

from ballbot_ros.bridge.drive_control import Pacer, TORQUE_INTERVAL_MAX
from ballbot_ros.drives.driver import STOP_PERIOD

PERIOD = 0.002
NEW = Pacer(PERIOD)


# Torques ----------------------------------------------------------------------------------

def test_the_first_torque_is_due_immediately():
    assert NEW.is_torque_due(0.0) and NEW.has_room(0.0)


def test_torque_is_repeated_after_one_and_a_half_periods_and_then_every_period():
    sent = NEW.commanded().sent_torque(10.0)
    assert not sent.is_torque_due(10.0 + PERIOD)
    assert sent.is_torque_due(10.0 + 1.51 * PERIOD)
    repeated = sent.sent_torque(10.0 + 1.51 * PERIOD)
    assert repeated.is_torque_due(10.0 + 1.52 * PERIOD)
    assert repeated.sent_torque(10.1).is_torque_due(10.1)


def test_a_command_ends_the_repetition():
    repeated = NEW.sent_torque(10.0).commanded().sent_torque(10.0 + PERIOD)
    assert not repeated.is_torque_due(10.0 + 2.0 * PERIOD)


def test_a_command_that_has_to_wait_is_due_at_the_next_tick_and_is_sent_once():
    sent = NEW.commanded().sent_torque(10.0)
    waiting = sent.commanded()
    assert waiting.is_torque_due(10.0 + PERIOD)
    assert not waiting.sent_torque(10.0 + PERIOD).is_torque_due(10.0 + 2.0 * PERIOD)


def test_a_burst_has_two_torques_and_the_average_is_one_per_period():
    pacer, sent = NEW, []
    for number in range(1000):
        now = 10.0 + 0.1 * number * PERIOD
        if pacer.has_room(now):
            pacer = pacer.commanded().sent_torque(now)
            sent.append(now)
    assert len(sent) == pytest.approx(100, abs=2)
    assert sum(now < 10.0 + 0.49 * PERIOD for now in sent) == 2  # and not three


def test_commands_after_a_late_one_are_sent_on_arrival():
    arrivals = [number + 0.2 for number in range(20)]
    arrivals[5] += 0.9  # the tick at 6 repeats the previous torque
    events = sorted([(at, 'command') for at in arrivals]
                    + [(float(number), 'tick') for number in range(20)])
    pacer, sent, waited = Pacer(1.0), [], []
    for now, event in events:
        if event == 'command':
            pacer = pacer.commanded()
            if not pacer.has_room(now):
                waited.append(now)
                continue
        elif not pacer.is_torque_due(now):
            continue
        pacer = pacer.sent_torque(now)
        sent.append(now)
    assert 6.0 in sent and waited == [6.2]
    assert sent[-12:] == pytest.approx(arrivals[-12:])


def test_torques_are_due_exactly_when_their_interval_ends():
    sent = Pacer(1.0).commanded().sent_torque(10.0)
    assert sent.is_torque_due(11.5) and not sent.is_torque_due(11.49)
    again = sent.commanded().sent_torque(10.0)
    assert again.has_room(10.5) and not again.has_room(10.49)


def test_unused_capacity_of_the_line_is_not_saved_up():
    later = NEW.commanded().sent_torque(10.0).commanded().sent_torque(20.0)
    assert later.has_room(20.0) and not later.commanded().sent_torque(20.0).has_room(20.0)


def test_decisions_are_never_further_apart_than_the_supervisor_expects():
    # A repetition is due at the first tick after one and a half periods.
    sent, ticks = NEW.commanded().sent_torque(10.0), [10.0 + 0.49 * PERIOD]
    while not sent.is_torque_due(ticks[-1]):
        ticks.append(ticks[-1] + PERIOD)
    assert ticks[-1] - 10.0 <= TORQUE_INTERVAL_MAX * PERIOD


# Stops and arming -------------------------------------------------------------------------

def test_a_stop_is_repeated_at_its_period():
    assert NEW.is_stop_due(0.0)
    sent = NEW.sent_stop(0.0)
    assert not sent.is_stop_due(0.99 * STOP_PERIOD) and sent.is_stop_due(STOP_PERIOD)


def test_a_stop_cancels_a_waiting_command():
    sent = NEW.commanded().sent_torque(10.0).commanded()
    assert not sent.sent_stop(10.0).is_torque_due(10.0)


def test_arming_is_tried_immediately_and_after_a_failure_three_tenths_of_a_second_later():
    assert NEW.may_arm(0.0)
    failed = NEW.not_armed(10.0)
    assert not failed.may_arm(10.299) and failed.may_arm(10.0 + 0.3)


# Trips ------------------------------------------------------------------------------------

def test_a_drive_that_trips_each_time_is_armed_again_after_increasing_pauses():
    pacer, now, pauses = NEW, 100.0, []
    for _ in range(9):
        tripped = pacer.tripped(now + 0.5, since=now)
        pauses.append(tripped.next_arm - now - 0.5)
        assert not tripped.may_arm(tripped.next_arm - 0.01)
        pacer, now = tripped, tripped.next_arm
    assert pauses == pytest.approx([0.3, 0.6, 1.2, 2.4, 4.8, 9.6, 19.2, 20.0, 20.0])
    assert pacer.sent_torque(now).commanded().pause == pacer.pause
    # A trip after a long time under power has another cause.
    assert pacer.tripped(now + 60.0, since=now).next_arm == pytest.approx(now + 60.3)
