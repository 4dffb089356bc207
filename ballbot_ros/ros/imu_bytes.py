# SPDX-License-Identifier: Apache-2.0
"""
IMU messages from serialised bytes, as `joint_state_bytes`.

rclpy takes longer to convert the 37 numbers of one to Python objects than the bridge to use them.
"""
import struct
from typing import Callable, NamedTuple, Tuple, Union

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import Imu

from ballbot_ros.ros.joint_state_bytes import CDR, Header, read_header, subscribe_bytes

# Orientation, turn rate and specific force, each with its covariance.
_NUMBERS = struct.Struct('<37d')


class Vector3(NamedTuple):
    """As geometry_msgs/Vector3."""

    x: float
    y: float
    z: float


class ReceivedImu(NamedTuple):
    """As sensor_msgs/Imu without the orientation, and read only."""

    header: Header
    angular_velocity: Vector3
    angular_velocity_covariance: Tuple[float, ...]
    linear_acceleration: Vector3
    linear_acceleration_covariance: Tuple[float, ...]


AnyImu = Union[Imu, ReceivedImu]


def read(data: bytes) -> AnyImu:
    """
    Return an IMU message; the middleware reads what is not plain, little-endian CDR.

    Raises `RuntimeError` or `ValueError` if the middleware cannot read it either.
    """
    try:
        header, at = read_header(data)
        numbers = _NUMBERS.unpack_from(data, at + (len(CDR) - at) % 8)
    except (struct.error, ValueError):
        message: Imu = deserialize_message(data, Imu)
        return message
    return ReceivedImu(header, Vector3(*numbers[13:16]), numbers[16:25],
                       Vector3(*numbers[25:28]), numbers[28:])


def subscribe_imu(node: Node, callback: Callable[[AnyImu], None]) -> Subscription:
    """Return a subscription to IMU messages; unreadable bytes are logged."""
    return subscribe_bytes(node, 'imu', read, callback)
