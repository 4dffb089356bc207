# SPDX-License-Identifier: Apache-2.0
"""Joint states as bytes are those of the message."""
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
from ballbot_ros.ros.conversions import command_message, to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.fast_path import joint_state_bytes
from ballbot_ros.ros.fast_path.joint_state_bytes import (
    CommandBytes, JointStateBytes, JointStateReader, ReceivedJointState, same,
    subscribe_joint_states)
from ballbot_ros.ros.frames import JOINTS

numbers = strategies.floats(-1e100, 1e100)
BYTES = JointStateBytes()


@given(strategies.floats(0.0, 2.0**31 - 1.0), numbers, numbers, numbers, numbers, numbers)
def test_written_joint_states_are_those_of_the_middleware(
        stamp, ball, joint, ball_rate, joint_rate,
                                                    torque):
    readings = JointReadings(3.0, ball, joint, ball_rate, joint_rate)
    expected = JointState(
        name=list(JOINTS), position=[ball, joint], velocity=[ball_rate, joint_rate],
        effort=[0.0, torque])
    expected.header.stamp = to_time(stamp)
    assert deserialize_message(BYTES.of(stamp, readings, torque), JointState) == expected


def test_a_message_that_was_handed_out_does_not_change_with_the_next():
    first = BYTES.of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    copy = bytes(bytearray(first))
    BYTES.of(2.0, JointReadings(0.0, 6.0, 7.0, 8.0, 9.0), 10.0)
    assert first == copy


def test_a_middleware_that_writes_numbers_otherwise_is_noticed(monkeypatch):
    monkeypatch.setattr(joint_state_bytes, 'serialize_message', lambda message: b'text')
    with pytest.raises(RuntimeError):
        JointStateBytes()


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
def test_written_commands_are_those_of_the_middleware(torque, sec, nanosec):
    stamp = Time(sec=sec, nanosec=nanosec)
    written = CommandBytes().of(stamp, torque)
    assert deserialize_message(written, JointState) == command_message(
        stamp, torque)


def test_nothing_comes_after_the_end_and_gaps_are_empty():
    # The middleware would leave in both what was in its memory: readers of bags mind the first.
    one = CommandBytes().of(Time(sec=1, nanosec=2), 3.0)
    assert one[22:24] == b'\0\0' and one[-8:] == struct.pack('<d', 3.0)
    other = JointStateBytes('base_link').of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    assert other[-8:] == struct.pack('<d', 5.0)


any_number = strategies.floats(width=64)
lists = strategies.lists(any_number, max_size=4)


@strategies.composite
def messages(draw):
    """Return joint states of all shapes, also such as do not fit together."""
    message = JointState(name=draw(strategies.lists(strategies.text(
        strategies.characters(codec='utf-8', exclude_characters='\0'), max_size=9), max_size=3)),
        position=draw(lists), velocity=draw(lists), effort=draw(lists))
    message.header.frame_id = draw(strategies.sampled_from(['', 'base_link', 'left/base_link']))
    message.header.stamp = Time(sec=draw(strategies.integers(-2**31, 2**31 - 1)),
                                nanosec=draw(strategies.integers(0, 2**32 - 1)))
    return message


@given(strategies.lists(messages(), min_size=1, max_size=6))
def test_reading_in_place_equals_reading_by_the_middleware(given_messages):
    reader = JointStateReader()
    for message in given_messages * 2:
        assert same(reader.read(bytes(serialize_message(message))), message)


def test_the_second_message_of_a_form_is_read_in_place_with_any_padding():
    def command(*numbers):
        message = command_message(Time(sec=numbers[0], nanosec=numbers[1]), numbers[2])
        message.header.frame_id = 'frame'
        return bytes(serialize_message(message))
    reader, data = JointStateReader(), command(1, 2, 3.0)
    assert isinstance(reader.read(data), JointState)
    # After 'frame' and its zero at 20 come two bytes up to the next number, which mean nothing.
    gap = bytearray(command(5, 6, math.nan))
    gap[22:24] = b'xy'
    again = reader.read(bytes(gap))
    assert isinstance(again, ReceivedJointState)
    assert again.header == ((5, 6), 'frame') and again.name == ('pendulum',)
    assert math.isnan(again.effort[0]) and again.position == again.velocity == ()


@pytest.mark.parametrize('change', [
    lambda one: setattr(one, 'name', ['pendulux']),
    lambda one: setattr(one.header, 'frame_id', 'other'),
    lambda one: (setattr(one, 'position', one.effort), setattr(one, 'effort', []))])
def test_a_message_of_the_same_length_and_another_form_is_not_taken_for_the_one_before(change):
    reader, message = JointStateReader(), command_message(Time(), 3.0)
    message.header.frame_id = 'frame'
    for _ in range(2):
        before = reader.read(bytes(serialize_message(message)))
    other = command_message(Time(), 3.0)
    other.header.frame_id = 'frame'
    change(other)
    assert same(before, message) and not same(message, other)
    assert same(reader.read(bytes(serialize_message(other))), other)


@given(strategies.binary(max_size=120))
def test_bytes_of_another_message_are_refused_or_read_as_the_middleware_does(data):
    reader = JointStateReader()
    for start in (b'', b'\0\1\0\0'):
        try:
            expected = deserialize_message(start + data, JointState)
        except (RuntimeError, ValueError) as error:
            with pytest.raises(type(error)):
                reader.read(start + data)
        else:
            for _ in range(2):
                assert same(reader.read(start + data), expected)


def test_big_endian_messages_are_left_to_the_middleware():
    data = b'\0\0\0\0' + struct.pack('>iIIB3xIIII', 7, 8, 1, 0, 0, 0, 0, 0)
    reader = JointStateReader()
    for _ in range(2):
        message = reader.read(data)
        assert isinstance(message, JointState) and message.header.stamp.sec == 7


def test_a_node_that_is_sent_nonsense_says_so_and_goes_on(make_node, spinner):
    taken, said = [], []
    node = make_node(Node, 'robot')
    publisher = create_publisher(node, 'joint_commands')
    subscribe_joint_states(node, 'joint_commands', taken.append)
    node.get_logger = lambda: SimpleNamespace(warning=lambda text, **how: said.append(text))
    spinner.add(node)
    for data, arrived in ((b'\0\1\0\0', said), (CommandBytes().of(Time(), 2.0), taken)):
        publisher.publish(data)
        spinner.until(lambda: arrived)
    assert [message.effort[0] for message in taken] == [2.0]
    assert len(said) == 1 and said[0].startswith('joint_commands refused: ')
