# SPDX-License-Identifier: Apache-2.0
"""Joint states as bytes equal those of the middleware."""
import math
import struct
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from hypothesis import given, strategies
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.frames import JOINTS
from ballbot_ros.ros.message_bytes import (
    command_bytes, JointStateBytes, read, ReceivedJointState, subscribe_bytes)

numbers = strategies.floats(-1e100, 1e100)
BYTES = JointStateBytes()


def command(sec, nanosec, torque, frame=''):
    message = JointState(name=['pendulum'], effort=[torque])
    message.header.frame_id = frame
    message.header.stamp = Time(sec=sec, nanosec=nanosec)
    return message


def same(one, other):
    """Return whether two messages are equal to the bit, NaN included."""
    def content(message):
        stamp = message.header.stamp
        return (stamp.sec, stamp.nanosec, message.header.frame_id, list(message.name), [
            struct.pack(f'<{len(values)}d', *values)
            for values in (message.position, message.velocity, message.effort)])
    return content(one) == content(other)


@given(strategies.floats(0.0, 2.0**31 - 1.0), numbers, numbers, numbers, numbers, numbers)
def test_written_joint_states_equal_those_of_the_middleware(
        stamp, ball, joint, ball_rate, joint_rate, torque):
    readings = JointReadings(3.0, ball, joint, ball_rate, joint_rate)
    expected = JointState(
        name=list(JOINTS), position=[ball, joint], velocity=[ball_rate, joint_rate],
        effort=[0.0, torque])
    expected.header.stamp = to_time(stamp)
    assert deserialize_message(BYTES.of(stamp, readings, torque), JointState) == expected


def test_a_returned_message_does_not_change_with_the_next():
    first = BYTES.of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    copy = bytes(bytearray(first))
    BYTES.of(2.0, JointReadings(0.0, 6.0, 7.0, 8.0, 9.0), 10.0)
    assert first == copy


def test_the_frame_is_in_the_bytes():
    sent = JointStateBytes('one/base_link').of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    message = deserialize_message(sent, JointState)
    assert message.header.frame_id == 'one/base_link' and message.effort[1] == 5.0


def test_without_a_pendulum_there_is_one_joint():
    readings = JointReadings(0.0, 1.0, 0.0, 3.0, 0.0)
    message = deserialize_message(JointStateBytes('f', False).of(1.0, readings, 0.0), JointState)
    assert message.name == ['shell']
    assert [list(values) for values in (message.position, message.velocity, message.effort)] \
        == [[1.0], [3.0], [0.0]]


@given(numbers, strategies.integers(0, 2**31 - 1), strategies.integers(0, 10**9 - 1))
def test_written_commands_equal_those_of_the_middleware(torque, sec, nanosec):
    written = command_bytes(Time(sec=sec, nanosec=nanosec), torque)
    assert deserialize_message(written, JointState) == command(sec, nanosec, torque)


@given(numbers, numbers)
def test_a_command_of_a_robot_that_turns_has_torque_and_lean(torque, lean):
    message = deserialize_message(command_bytes(Time(sec=1), torque, lean), JointState)
    assert message.name == ['pendulum', 'lean'] and not message.velocity
    assert (message.position[1], message.effort[0]) == (lean, torque)


def test_no_bytes_follow_the_end_and_padding_is_zero():
    # The middleware would leave old memory in both: some readers of bags reject the first.
    one = command_bytes(Time(sec=1, nanosec=2), 3.0)
    assert one[22:24] == b'\0\0' and one[-8:] == struct.pack('<d', 3.0)
    other = JointStateBytes('base_link').of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    assert other[-8:] == struct.pack('<d', 5.0)


any_number = strategies.floats(width=64)
lists = strategies.lists(any_number, max_size=4)


@strategies.composite
def messages(draw):
    """Return joint states of all shapes, including inconsistent ones."""
    message = JointState(name=draw(strategies.lists(strategies.text(
        strategies.characters(codec='utf-8', exclude_characters='\0'), max_size=9), max_size=3)),
        position=draw(lists), velocity=draw(lists), effort=draw(lists))
    message.header.frame_id = draw(strategies.sampled_from(['', 'base_link', 'left/base_link']))
    message.header.stamp = Time(sec=draw(strategies.integers(-2**31, 2**31 - 1)),
                                nanosec=draw(strategies.integers(0, 2**32 - 1)))
    return message


@given(messages())
def test_reading_equals_reading_by_the_middleware(message):
    found = read(JointState, bytes(serialize_message(message)))
    assert isinstance(found, ReceivedJointState) and same(found, message)


def test_padding_bytes_are_ignored():
    gap = bytearray(serialize_message(command(1, 2, math.nan, 'frame')))
    # After 'frame' and its final zero, two bytes of padding precede the next number.
    gap[22:24] = b'xy'
    message = read(JointState, bytes(gap))
    assert isinstance(message, ReceivedJointState)
    assert message.header == ((1, 2), 'frame') and message.name == ('pendulum',)
    assert math.isnan(message.effort[0]) and message.position == message.velocity == ()


@given(strategies.binary(max_size=120))
def test_arbitrary_bytes_are_refused_or_read_as_by_the_middleware(data):
    for start in (b'', b'\0\1\0\0'):
        try:
            expected = deserialize_message(start + data, JointState)
        except (RuntimeError, ValueError) as error:
            with pytest.raises(type(error)):
                read(JointState, start + data)
        else:
            assert same(read(JointState, start + data), expected)


def test_big_endian_messages_are_left_to_the_middleware():
    data = b'\0\0\0\0' + struct.pack('>iIIB3xIIII', 7, 8, 1, 0, 0, 0, 0, 0)
    message = read(JointState, data)
    assert isinstance(message, JointState) and message.header.stamp.sec == 7


def test_a_node_logs_malformed_bytes_and_continues(make_node, spinner):
    taken, said = [], []
    node = make_node(Node, 'robot')
    publisher = create_publisher(node, 'joint_commands')
    subscribe_bytes(node, 'joint_commands', taken.append)
    node.get_logger = lambda: SimpleNamespace(warning=lambda text, **how: said.append(text))
    spinner.add(node)
    for data, arrived in ((b'\0\1\0\0', said), (command_bytes(Time(), 2.0), taken)):
        publisher.publish(data)
        spinner.until(lambda: arrived)
    assert [message.effort[0] for message in taken] == [2.0]
    assert len(said) == 1 and said[0].startswith('joint_commands refused: ')
