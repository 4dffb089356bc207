# SPDX-License-Identifier: Apache-2.0
"""IMU messages read from bytes equal those of the middleware."""
from hypothesis import given, strategies
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu

from ballbot_ros.nodes.bridge.motor import Clocks, imu_reading
from ballbot_ros.ros.conversions import to_time
from ballbot_ros.ros.message_bytes import read, ReceivedImu

numbers = strategies.lists(strategies.floats(-1e100, 1e100), min_size=37, max_size=37)


def imu(values, frame='imu'):
    message = Imu(orientation_covariance=values[4:13], angular_velocity_covariance=values[16:25],
                  linear_acceleration_covariance=values[28:])
    message.header.stamp, message.header.frame_id = to_time(1234.5), frame
    for index, names in ((0, 'xyzw'), (13, 'xyz'), (25, 'xyz')):
        part = {0: message.orientation, 13: message.angular_velocity,
                25: message.linear_acceleration}[index]
        for name, value in zip(names, values[index:]):
            setattr(part, name, value)
    return message


@given(numbers, strategies.text('abc/', max_size=9))
def test_read_messages_equal_those_of_the_middleware(values, frame):
    message = imu(values, frame)
    found = read(Imu, serialize_message(message))
    assert isinstance(found, ReceivedImu)
    assert found.header.stamp == (1234, 500_000_000) and found.header.frame_id == frame
    for what in ('angular_velocity', 'linear_acceleration'):
        sent, received = getattr(message, what), getattr(found, what)
        assert received == (sent.x, sent.y, sent.z)
        assert list(getattr(found, f'{what}_covariance')) == list(
            getattr(message, f'{what}_covariance'))


def test_the_reading_equals_that_of_the_message(monkeypatch):
    monkeypatch.setattr(Clocks, '_ahead', 1000.0)
    message = imu([0.01 * number for number in range(37)])
    assert imu_reading(read(Imu, serialize_message(message)), Clocks()) == imu_reading(
        message, Clocks())


def test_truncated_bytes_are_refused():
    data = serialize_message(imu([0.0] * 37))
    for part in (b'', data[:3], data[:30]):
        with pytest.raises((RuntimeError, ValueError)):
            read(Imu, part)


def test_big_endian_is_left_to_the_middleware():
    data = bytearray(serialize_message(imu([0.0] * 37)))
    data[1] = 0
    with pytest.raises((RuntimeError, ValueError)):
        read(Imu, bytes(data))  # its lengths are little-endian, which the middleware refuses
