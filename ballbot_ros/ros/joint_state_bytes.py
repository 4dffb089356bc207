# SPDX-License-Identifier: Apache-2.0
"""
Joint states as serialised bytes: plain CDR, little-endian.

rclpy takes longer to convert a joint state to and from a Python object than a control period takes
to simulate, so these bytes are packed and unpacked here.  The middleware handles all other
messages.
"""
import math
import struct
from typing import Any, Callable, NamedTuple, Optional, Sequence, Tuple, Union

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.physics.model.state import State
from ballbot_ros.ros.conversions import sec_nanosec
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.frames import JOINTS, LATERAL, LEAN, PENDULUM
from ballbot_ros.steering.model import LateralState

# The encapsulation of little-endian CDR; alignment counts from its end.
CDR = b'\0\1\0\0'
_STAMP, _COUNT = struct.Struct('<4xiI'), struct.Struct('<I')


class Stamp(NamedTuple):
    """As builtin_interfaces/Time."""

    sec: int
    nanosec: int


class Header(NamedTuple):
    """As std_msgs/Header."""

    stamp: Stamp
    frame_id: str


class ReceivedJointState(NamedTuple):
    """As sensor_msgs/JointState, and read only."""

    header: Header
    name: Tuple[str, ...]
    position: Tuple[float, ...]
    velocity: Tuple[float, ...]
    effort: Tuple[float, ...]


AnyJointState = Union[JointState, ReceivedJointState]


def read(data: bytes) -> AnyJointState:
    """
    Return a joint state; the middleware reads what is not plain, little-endian CDR.

    Raises `RuntimeError` or `ValueError` if the middleware cannot read it either.
    """
    try:
        return _read(data)
    except (struct.error, ValueError):
        message: JointState = deserialize_message(data, JointState)
        return message


def _read(data: bytes) -> ReceivedJointState:
    header, at = read_header(data)
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


def read_header(data: bytes) -> Tuple[Header, int]:
    """Return the header of a message and the place after it; raises as `_read` does."""
    if data[:2] != CDR[:2]:
        raise ValueError('another encoding')
    frame, at = _text(data, _STAMP.size)
    return Header(Stamp(*_STAMP.unpack_from(data)), frame), at


def _count(data: bytes, at: int) -> Tuple[int, int]:
    """Return the number at a place, and the place after it."""
    at += -at % 4
    return _COUNT.unpack_from(data, at)[0], at + 4


def _text(data: bytes, at: int) -> Tuple[str, int]:
    size, at = _count(data, at)
    end = at + size - 1
    if data.find(0, at) != end:
        raise ValueError('a text does not end with its only zero')
    return data[at:end].decode(), end + 1


def subscribe_joint_states(node: Node, topic: str, callback: Callable[[AnyJointState], None]
                           ) -> Subscription:
    """Return a subscription to joint states; unreadable bytes are logged."""
    return subscribe_bytes(node, topic, read, callback)


def subscribe_bytes(node: Node, topic: str, convert: Callable[[bytes], Any],
                    callback: Callable[[Any], None]) -> Subscription:
    """Return a subscription that converts the bytes of a message; unreadable ones are logged."""
    def take(data: bytes) -> None:
        try:
            message = convert(data)
        except (RuntimeError, ValueError) as error:
            node.get_logger().warning(f'{topic} refused: {error}', throttle_duration_sec=1.0)
        else:
            callback(message)
    return create_subscription(node, topic, take, raw=True)


class _Layout:
    """Joint states that differ in stamp and numbers only; with counts of each kind of number."""

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
    """Joint states of shell and pendulum and, where it steers, of lean, tilt and yaw."""

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
    """Return a command for the pendulum that answers the joint state of a stamp."""
    if lean is None:
        return _STRAIGHT.of(stamp.sec, stamp.nanosec, (), (), (torque,))
    return _STEERING.of(stamp.sec, stamp.nanosec, (math.nan, lean), (), (torque, math.nan))
