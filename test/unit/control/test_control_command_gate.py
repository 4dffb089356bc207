# SPDX-License-Identifier: Apache-2.0
"""The command gate passes only finite, recent commands in the order of their stamps."""
import math

from hypothesis import given, strategies
import pytest

from ballbot_ros.control import CommandGate
from ballbot_ros.errors import MessageError

TIMEOUT = 0.1


def gate_with(torque, stamp):
    gate = CommandGate(TIMEOUT)
    gate.offer(torque, stamp, stamp)
    return gate


def refusal(gate, *offer):
    """Return the reason of a refused offer."""
    with pytest.raises(MessageError) as caught:
        gate.offer(*offer)
    return caught.value.reason


def test_without_a_command_there_is_no_torque():
    gate = CommandGate(TIMEOUT)
    assert gate.torque(0.0) == 0.0
    assert not gate.expired(1e9)  # without a command, none can expire


def test_the_newest_command_applies_until_its_timeout():
    gate = gate_with(1.5, 2.0)
    assert gate.torque(2.0) == gate.torque(2.0999) == 1.5
    assert gate.torque(2.1001) == 0.0
    assert gate.expired(2.1001) and not gate.expired(2.0999)
    gate.offer(-0.5, 2.05, 2.11)
    assert gate.torque(2.11) == -0.5 and gate.accepted == 2


@pytest.mark.parametrize('ahead', [0.0, 0.02, 0.049])
def test_a_stamp_ahead_of_the_clock_does_not_extend_a_command(ahead):
    gate = CommandGate(TIMEOUT)
    gate.offer(1.5, 2.0 + ahead, 2.0)
    assert gate.torque(2.0999) == 1.5
    assert gate.expired(2.1001) and gate.torque(2.1001) == 0.0


@pytest.mark.parametrize('torque', [math.nan, math.inf, -math.inf])
def test_a_torque_that_is_not_finite_is_refused(torque):
    assert refusal(gate_with(1.0, 2.0), torque, 2.0, 2.0) == 'not_finite'


@pytest.mark.parametrize('stamp, reason', [
    (1.899, 'stale'), (0.0, 'stale'), (-1e300, 'stale'), (math.nan, 'stale'),
    (-math.inf, 'stale'), (2.051, 'from_the_future'), (1.8e9, 'from_the_future'),
    (math.inf, 'from_the_future')])
def test_stale_and_future_stamps_are_refused(stamp, reason):
    assert refusal(CommandGate(TIMEOUT), 1.0, stamp, 2.0) == reason


def test_an_older_stamp_is_refused_and_an_equal_one_is_accepted():
    gate = gate_with(1.0, 2.0)
    gate.offer(2.0, 2.0, 2.01)
    assert refusal(gate, 3.0, 1.998, 2.01) == 'out_of_order'
    assert gate.torque(2.01) == 2.0


def test_each_refusal_is_counted_by_reason_and_keeps_the_command():
    gate = gate_with(1.0, 2.0)
    for torque, stamp in ((math.nan, 2.0), (math.inf, 2.0), (1.0, 1.0), (1.0, 3.0), (1.0, 1.99)):
        refusal(gate, torque, stamp, 2.0)
    gate.refuse('wrong_length')
    assert gate.refused == {'not_finite': 2, 'stale': 1, 'from_the_future': 1,
                            'out_of_order': 1, 'wrong_length': 1}
    assert gate.torque(2.0) == 1.0 and gate.accepted == 1


def test_clear_removes_the_command_and_keeps_the_counts():
    gate = gate_with(1.0, 2.0)
    refusal(gate, math.nan, 2.0, 2.0)
    gate.clear()
    assert gate.torque(2.0) == 0.0 and not gate.expired(9.0)
    assert gate.accepted == 1 and gate.refused == {'not_finite': 1}
    gate.offer(0.5, 1.95, 2.0)  # older than the removed command
    assert gate.torque(2.0) == 0.5


anything = strategies.floats(allow_nan=True, allow_infinity=True)


@given(strategies.lists(strategies.tuples(
    anything, strategies.one_of(anything, strategies.floats(0.0, 1.0))), max_size=20))
def test_the_torque_is_finite_and_recent_for_any_sequence_of_offers(offers):
    gate, good = CommandGate(TIMEOUT), 0.0
    for index, (torque, stamp) in enumerate(offers):
        now = 0.05 * index
        try:
            gate.offer(torque, stamp, now)
            good = stamp
        except MessageError as error:
            assert error.reason in gate.refused
        applied = gate.torque(now)
        assert math.isfinite(applied)
        assert applied == 0.0 or now - good <= TIMEOUT
    assert gate.accepted + sum(gate.refused.values()) == len(offers)
