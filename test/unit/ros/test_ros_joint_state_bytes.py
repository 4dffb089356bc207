# SPDX-License-Identifier: Apache-2.0
"""Joint states as bytes are those of the message."""
from hypothesis import given, strategies
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.ros import joint_state_bytes
from ballbot_ros.ros.conversions import JOINTS, to_time
from ballbot_ros.ros.joint_state_bytes import JointStateBytes

numbers = strategies.floats(-1e100, 1e100)
BYTES = JointStateBytes()


@given(strategies.floats(0.0, 2.0**31 - 1.0), numbers, numbers, numbers, numbers, numbers)
def test_what_goes_out_is_what_the_message_would_be(stamp, ball, joint, ball_rate, joint_rate,
                                                    torque):
    readings = JointReadings(3.0, ball, joint, ball_rate, joint_rate)
    expected = JointState(name=JOINTS, position=[ball, joint], velocity=[ball_rate, joint_rate],
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
    with pytest.raises(RuntimeError, match='serialises numbers otherwise'):
        JointStateBytes()


def test_the_frame_is_in_the_bytes():
    sent = JointStateBytes('one/base_link').of(1.0, JointReadings(0.0, 1.0, 2.0, 3.0, 4.0), 5.0)
    message = deserialize_message(sent, JointState)
    assert message.header.frame_id == 'one/base_link' and message.effort[1] == 5.0
