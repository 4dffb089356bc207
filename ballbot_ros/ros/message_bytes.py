# SPDX-License-Identifier: Apache-2.0
"""
Joint states and IMU messages as serialised bytes: plain CDR, little-endian.

rclpy takes longer to convert a joint state to and from a Python object than the simulation of a
control period takes, and longer to convert the 37 numbers of an IMU message than the bridge takes
to use them.  So both are packed and unpacked here.  The middleware handles all other messages.
"""
import math
import struct
from typing import Any, Callable, NamedTuple, Optional, Sequence, Tuple, Type, Union

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.physics.model.state import State
from ballbot_ros.ros.conversions import sec_nanosec
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.frames import JOINTS, LATERAL, LEAN, PENDULUM
from ballbot_ros.ros.topics import message_class, TOPICS
from ballbot_ros.steering.model import LateralState

# The encapsulation header of little-endian CDR; alignment is relative to its end.
CDR = b'\0\1\0\0'
_STAMP, _COUNT = struct.Struct('<4xiI'), struct.Struct('<I')
# Numbers of an IMU message: orientation, turn rate and specific force, each with its covariance.
_NUMBERS = struct.Struct('<37d')


class Stamp(NamedTuple):
    """Equivalent of builtin_interfaces/Time."""

    sec: int
    nanosec: int


class Header(NamedTuple):
    """Equivalent of std_msgs/Header."""

    stamp: Stamp
    frame_id: str


class ReceivedJointState(NamedTuple):
    """Read-only equivalent of sensor_msgs/JointState."""

    header: Header
    name: Tuple[str, ...]
    position: Tuple[float, ...]
    velocity: Tuple[float, ...]
    effort: Tuple[float, ...]


class Vector3(NamedTuple):
    """Equivalent of geometry_msgs/Vector3."""

    x: float
    y: float
    z: float


class ReceivedImu(NamedTuple):
    """Read-only equivalent of sensor_msgs/Imu without the orientation."""

    header: Header
    angular_velocity: Vector3
    angular_velocity_covariance: Tuple[float, ...]
    linear_acceleration: Vector3
    linear_acceleration_covariance: Tuple[float, ...]


AnyJointState = Union[JointState, ReceivedJointState]
AnyImu = Union[Imu, ReceivedImu]


def read(kind: Type[Any], data: bytes) -> Any:
    """
    Decode a JointState or an Imu; the middleware decodes encodings other than this CDR.

    Raises `RuntimeError` or `ValueError` if the middleware cannot decode it either.
    """
    try:
        return _read_imu(data) if kind is Imu else _read_joint_state(data)
    except (struct.error, ValueError):
        return deserialize_message(data, kind)


def _read_imu(data: bytes) -> ReceivedImu:
    header, at = _read_header(data)
    numbers = _NUMBERS.unpack_from(data, at + (len(CDR) - at) % 8)
    return ReceivedImu(header, Vector3(*numbers[13:16]), numbers[16:25],
                       Vector3(*numbers[25:28]), numbers[28:])


def _read_joint_state(data: bytes) -> ReceivedJointState:
    header, at = _read_header(data)
    count, at = _count(data, at)
    names = []
    for _ in range(count):
        name, at = _text(data, at)
        names.append(name)
    numbers = []
    for _ in range(3):
        count, at = _count(data, at)
        if count:
            at += (len(CDR) - at) % 8
        numbers.append(struct.unpack_from(f'<{count}d', data, at))
        at += 8 * count
    return ReceivedJointState(header, tuple(names), *numbers)


def _read_header(data: bytes) -> Tuple[Header, int]:
    """Return the header of a message and the offset after it."""
    if data[:2] != CDR[:2]:
        raise ValueError('another encoding')
    frame, at = _text(data, _STAMP.size)
    return Header(Stamp(*_STAMP.unpack_from(data)), frame), at


def _count(data: bytes, at: int) -> Tuple[int, int]:
    """Return the number at an offset, and the offset after it."""
    at += -at % 4
    return _COUNT.unpack_from(data, at)[0], at + 4


def _text(data: bytes, at: int) -> Tuple[str, int]:
    size, at = _count(data, at)
    end = at + size - 1
    if data.find(0, at) != end:
        raise ValueError('a text does not end with its only zero')
    return data[at:end].decode(), end + 1


def subscribe_bytes(node: Node, topic: str, callback: Callable[[Any], None]) -> None:
    """Subscribe to joint states or IMU messages; unreadable bytes are logged."""
    kind = message_class(TOPICS[topic].type)

    def take(data: bytes) -> None:
        try:
            message = read(kind, data)
        except (RuntimeError, ValueError) as error:
            node.get_logger().warning(f'{topic} refused: {error}', throttle_duration_sec=1.0)
        else:
            callback(message)
    create_subscription(node, topic, take, raw=True)


class _Layout:
    """Encoder of joint states with fixed texts; `counts` are the lengths of the three arrays."""

    def __init__(self, frame: str, names: Sequence[str], counts: Sequence[int]):
        def text(value: str) -> bytes:
            content = value.encode() + b'\0'
            return _COUNT.pack(len(content)) + content + bytes(-len(content) % 4)
        self._texts = text(frame) + _COUNT.pack(len(names)) + b''.join(map(text, names))
        form = f'<{len(CDR)}siI{len(self._texts)}s'
        for count in counts:
            form += 'I'
            if count:
                form += f'{(len(CDR) - struct.calcsize(form)) % 8}x{count}d'
        self._pack = struct.Struct(form).pack

    def of(self, sec: int, nanosec: int, position: Sequence[float], velocity: Sequence[float],
           effort: Sequence[float]) -> bytes:
        return self._pack(CDR, sec, nanosec, self._texts, len(position), *position,
                          len(velocity), *velocity, len(effort), *effort)


class JointStateBytes:
    """Encoder of joint states: shell, pendulum and, with `steers`, lean, tilt and yaw."""

    def __init__(self, frame: str = '', has_pendulum: bool = True, steers: bool = False):
        self._steers, self._count = steers, 2 if has_pendulum else 1
        names = [*JOINTS[:self._count], *(LATERAL if steers else ())]
        self._layout = _Layout(frame, names, 3 * [len(names)])

    def of(self, stamp: float, readings: Union[JointReadings, State], torque: float,
           lateral: LateralState = LateralState()) -> bytes:
        """Return the bytes of a joint state at a ROS time [s], with a pendulum torque [N m]."""
        count = self._count
        angles = [readings.ball_angle, readings.joint_angle][:count]
        rates = [readings.ball_rate, readings.joint_rate][:count]
        efforts = [0.0, torque][:count]
        if self._steers:
            angles += lateral.lean, lateral.tilt, lateral.heading
            rates += lateral.lean_rate, lateral.tilt_rate, lateral.yaw_rate
            efforts += 0.0, 0.0, 0.0
        return self._layout.of(*sec_nanosec(stamp), angles, rates, efforts)


_STRAIGHT = _Layout('', [PENDULUM], (0, 0, 1))
_STEERING = _Layout('', [PENDULUM, LEAN], (2, 0, 2))


def command_bytes(stamp: Any, torque: float, lean: Optional[float] = None) -> bytes:
    """Return a torque [N m] and a lean [rad] as a command that answers the state with a stamp."""
    if lean is None:
        return _STRAIGHT.of(stamp.sec, stamp.nanosec, (), (), (torque,))
    return _STEERING.of(stamp.sec, stamp.nanosec, (math.nan, lean), (), (torque, math.nan))
