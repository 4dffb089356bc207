# SPDX-License-Identifier: Apache-2.0
"""Commands that are followed, commands that are refused, and time that keeps its pace."""
import math

from hypothesis import given
from hypothesis import strategies as some
import pytest

from ballbot_ros.errors import ConfigurationError, MessageError
from ballbot_ros.plant import CommandGate, Pace, periods_per, Speedometer


def reason_of(gate, torque, stamp, now):
    with pytest.raises(MessageError) as caught:
        gate.offer(torque, stamp, now)
    return caught.value.reason


def test_the_newest_fresh_command_is_followed_until_its_timeout():
    gate = CommandGate(0.1)
    assert gate.torque(0.0) == 0.0 and not gate.expired(0.0)
    gate.offer(1.5, stamp=1.0, now=1.0)
    assert gate.torque(1.09) == 1.5 and not gate.expired(1.09)
    assert gate.torque(1.11) == 0.0 and gate.expired(1.11)


@pytest.mark.parametrize('torque, stamp, reason', [
    (math.nan, 1.0, 'not_finite'), (math.inf, 1.0, 'not_finite'), (1.0, 0.8, 'stale'),
    (1.0, math.nan, 'stale'), (1.0, 1.7e9, 'from_the_future'), (1.0, 0.95, 'out_of_order')])
def test_a_bad_command_is_refused_counted_and_leaves_the_good_one(torque, stamp, reason):
    gate = CommandGate(0.1)
    gate.offer(0.5, stamp=1.0, now=1.0)
    assert reason_of(gate, torque, stamp, now=1.0) == reason
    assert gate.refused == {reason: 1} and gate.accepted == 1
    assert gate.torque(1.0) == 0.5


def test_a_cleared_gate_gives_no_torque_and_keeps_its_counts():
    gate = CommandGate(0.1)
    gate.offer(0.5, stamp=1.0, now=1.0)
    gate.clear()
    assert gate.torque(1.0) == 0.0 and not gate.expired(9.0) and gate.accepted == 1


@pytest.mark.parametrize('timeout', [0.0, -1.0, math.nan, math.inf])
def test_a_gate_without_a_timeout_is_refused(timeout):
    with pytest.raises(ConfigurationError, match='command_timeout'):
        CommandGate(timeout)


@given(some.lists(some.floats(0.0, 0.05), max_size=60), some.floats(0.1, 10.0))
def test_time_never_runs_ahead_of_the_clock_and_nothing_is_lost_but_what_is_counted(gaps, factor):
    pace = Pace(0.002, factor, most=5)
    now, done = 100.0, pace.due(100.0)
    for gap in gaps:
        now += gap
        due = pace.due(now)
        assert 0 <= due <= 5
        done += due
    wanted = (now - 100.0) * factor / 0.002
    assert done + pace.dropped == pytest.approx(wanted, abs=1.0 + 1e-6 * wanted)
    assert done <= wanted + 1e-6


def test_after_a_pause_the_lost_time_is_not_caught_up():
    pace = Pace(0.002, 1.0)
    pace.restart(0.0)
    pace.due(0.1)
    pace.restart(50.0)
    dropped = pace.dropped
    assert pace.due(50.0041) == 2 and pace.dropped == dropped


def test_a_rate_that_does_not_fit_is_refused_with_two_that_do():
    assert periods_per(100.0, 500.0, 'odom_rate') == 5
    with pytest.raises(ConfigurationError, match='odom_rate .* 125 Hz and 166.667 Hz do'):
        periods_per(150.0, 500.0, 'odom_rate')
    with pytest.raises(ConfigurationError, match='whole number'):
        periods_per(1000.0, 500.0, 'odom_rate')


def test_the_real_time_factor_is_what_was_measured_not_what_was_asked_for():
    speed = Speedometer(window=1.0)
    for step in range(5):
        speed.note(simulated=0.3 * step, wall=0.6 * step)
    assert speed.factor == pytest.approx(0.5)
