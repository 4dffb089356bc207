# SPDX-License-Identifier: Apache-2.0
"""Messages of several topics are processed in the order of their stamps."""
from hypothesis import given, strategies as st
import pytest
from rclpy.serialization import serialize_message

from ballbot_ros.demo.recorded_graph import LONGEST_DELAY, MessagesInOrder
from ballbot_ros.msg import StepDecision

STATES, DECISIONS = 'ball_state', 'step_decision'


def message(stamp):
    found = StepDecision()
    found.header.stamp.sec, found.header.stamp.nanosec = divmod(stamp, 10**9)
    return serialize_message(found)


def take_all(messages):
    found = []
    while (taken := messages.take()) is not None:
        found.append(taken)
    return found


@pytest.mark.slow
@given(st.lists(st.booleans(), max_size=60), st.integers(1, 5))
def test_the_order_of_arrival_has_no_influence(arrivals, period):
    stamps = {STATES: list(range(0, 200, 10)), DECISIONS: list(range(0, 200, 10 * period))}
    due = sorted((stamp, topic) for topic in stamps for stamp in stamps[topic])
    messages, taken = MessagesInOrder(STATES, DECISIONS), []
    for state_next in arrivals + [True] * 20 + [False] * 20:
        topic = STATES if state_next else DECISIONS
        if stamps[topic]:
            messages.add(topic, message(stamps[topic].pop(0)))
            taken += take_all(messages)
    last = max(stamp for stamp, topic in due if topic == DECISIONS)
    expected = [(topic, message(stamp)) for stamp, topic in due if stamp <= last]
    assert taken == expected


def test_a_message_waits_for_the_other_topic():
    messages = MessagesInOrder(STATES, DECISIONS)
    messages.add(DECISIONS, message(0))
    assert messages.take() is None
    messages.add(STATES, message(0))
    assert [topic for topic, _ in take_all(messages)] == [STATES, DECISIONS]
    messages.add(STATES, message(10))
    assert messages.take() is None


def test_a_topic_that_has_ended_delays_the_other_one_for_a_bounded_time():
    messages = MessagesInOrder(STATES, DECISIONS)
    messages.add(DECISIONS, message(0))
    for stamp in (0, 10, LONGEST_DELAY):
        messages.add(STATES, message(stamp))
    assert len(take_all(messages)) == 2
    messages.add(STATES, message(LONGEST_DELAY + 10))
    assert [topic for topic, _ in take_all(messages)] == [STATES]
