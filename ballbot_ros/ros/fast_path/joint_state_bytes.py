# SPDX-License-Identifier: Apache-2.0
"""
Joint states as serialised bytes.

Making messages of Python objects costs rclpy more than simulating and controlling.  All joint
states of one sender differ in their numbers only, so these are read and written in place.  The
middleware handles all other messages.
"""
import math
import struct
from typing import Any, Callable, Dict, NamedTuple, Optional, Sequence, Tuple, Union

from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.physics.model.state import State
from ballbot_ros.ros.conversions import sec_nanosec
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.frames import JOINTS, LATERAL, LEAN, PENDULUM
from ballbot_ros.steering.model import LateralState

# Of plain CDR, little-endian; within it, numbers are aligned from here on.
LITTLE_ENDIAN, PAYLOAD_OFFSET = b'\0\1', 4
STAMP = struct.Struct('<iI')
# Number of cached message layouts.
FORMS_MAX = 16


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


class Form:
    """
    Layout shared by joint states that differ only in their numbers.

    Parameters
    ----------
    data : bytes
        A serialised message.

    Attributes
    ----------
    numbers : tuple of (int, int)
        Where positions, velocities and efforts begin, and how many there are of each.
    end : int
        Where the message does.

    Raises
    ------
    ValueError, IndexError, struct.error
        If these are not the bytes of a joint state, in little-endian CDR.

    """

    def __init__(self, data: bytes):
        if data[:2] != LITTLE_ENDIAN:
            raise ValueError('not little-endian CDR')
        self._data, self._fixed, self._at = data, bytearray(len(data)), PAYLOAD_OFFSET + STAMP.size
        self._fixed[:2] = b'\xff\xff'
        self.frame = self._text()
        self.names = tuple(self._text() for _ in range(self._count()))
        self.numbers = tuple(self._block() for _ in range(3))
        self._length = len(data)
        if self._at > self._length:  # bytes after the end have no meaning
            raise ValueError('the message ends before its end')
        self.end = self._at
        self._mask = int.from_bytes(self._fixed, 'little')
        self._pattern = int.from_bytes(data, 'little') & self._mask
        form, at = f'<{PAYLOAD_OFFSET}xiI', PAYLOAD_OFFSET + STAMP.size
        for begin, count in self.numbers:
            if count:
                form, at = form + f'{begin - at}x{count}d', begin + 8 * count
        self._struct = struct.Struct(form)
        ends, begin = [], 2
        for _, count in self.numbers:
            ends.append((begin, begin + count))
            begin += count
        self._slices = tuple(slice(*pair) for pair in ends)

    def _take(self, size: int, alignment: int) -> bytes:
        """Return the next bytes as a key that is equal in all messages of this form."""
        begin = self._at + (PAYLOAD_OFFSET - self._at) % alignment
        self._at = begin + size
        if self._at > len(self._data):
            raise ValueError('the message ends before its end')
        self._fixed[begin:self._at] = b'\xff' * size
        return self._data[begin:self._at]

    def _count(self) -> int:
        return int.from_bytes(self._take(4, 4), 'little')

    def _text(self) -> str:
        return self._take(self._count(), 1)[:-1].decode()

    def _block(self) -> Tuple[int, int]:
        count = self._count()
        begin = self._at + (PAYLOAD_OFFSET - self._at) % 8 if count else self._at
        self._at = begin + 8 * count
        return begin, count

    def empty(self) -> bytearray:
        """Return a message of this form whose numbers and padding are zero."""
        return bytearray(self._pattern.to_bytes(self._length, 'little')[:self.end])

    def fits(self, data: bytes) -> bool:
        """Return whether a message differs from one of this form in its numbers only."""
        return len(data) == self._length \
            and int.from_bytes(data, 'little') & self._mask == self._pattern

    def read(self, data: bytes) -> ReceivedJointState:
        """Return the message of these bytes."""
        values = self._struct.unpack_from(data)
        position, velocity, effort = self._slices
        return ReceivedJointState(
            Header(Stamp(values[0], values[1]), self.frame), self.names,
            values[position], values[velocity], values[effort])


def same(one: AnyJointState, other: AnyJointState) -> bool:
    """Return whether two messages are equal to the bit, NaN included."""
    return (one.header.stamp.sec, one.header.stamp.nanosec, one.header.frame_id) == (
        other.header.stamp.sec, other.header.stamp.nanosec, other.header.frame_id) \
        and list(one.name) == list(other.name) and all(
            struct.pack(f'<{len(first)}d', *first) == struct.pack(f'<{len(second)}d', *second)
            for first, second in ((getattr(one, quantity), getattr(other, quantity))
                                  for quantity in ('position', 'velocity', 'effort')))


class JointStateReader:
    """Reads joint states: by the middleware if their form is new, otherwise in place."""

    def __init__(self) -> None:
        self._forms: Dict[int, Form] = {}  # by length

    def read(self, data: bytes) -> AnyJointState:
        """
        Return a message.

        Raises
        ------
        RuntimeError, ValueError
            If the middleware finds these bytes to be none.

        """
        form = self._forms.get(len(data))
        if form is not None and form.fits(data):
            return form.read(data)
        message: JointState = deserialize_message(data, JointState)
        form = form_of(data, message)
        if form is not None:
            if len(self._forms) >= FORMS_MAX:
                self._forms.clear()
            self._forms[len(data)] = form
        return message


def form_of(data: bytes, message: JointState) -> Optional[Form]:
    """Return the form of a message, None where it is not read as the middleware does."""
    try:
        form = Form(data)
        return form if same(form.read(data), message) else None
    except (ValueError, IndexError, struct.error):
        return None


def subscribe_joint_states(node: Node, topic: str, callback: Callable[[AnyJointState], None]
                           ) -> Subscription:
    """Return a subscription to joint states, which are read in place; other bytes are logged."""
    reader = JointStateReader()

    def take(data: bytes) -> None:
        try:
            message = reader.read(data)
        except (RuntimeError, ValueError) as error:
            node.get_logger().warning(f'{topic} refused: {error}', throttle_duration_sec=1.0)
        else:
            callback(message)
    return create_subscription(node, topic, take, raw=True)


class _Written:
    """A serialised message; its numbers are written in place."""

    def __init__(self, message: JointState):
        data = bytes(serialize_message(message))
        form = form_of(data, message)
        if form is None:
            raise RuntimeError('this middleware serialises numbers otherwise: publish messages')
        self._buffer, self._numbers = form.empty(), form.numbers

    def of(self, sec: int, nanosec: int, *numbers: Sequence[float]) -> bytes:
        """Return the bytes of a message of these positions, velocities and efforts."""
        buffer = self._buffer
        STAMP.pack_into(buffer, PAYLOAD_OFFSET, sec, nanosec)
        for (begin, count), values in zip(self._numbers, numbers):
            struct.pack_into(f'<{count}d', buffer, begin, *values)
        return bytes(buffer)


class JointStateBytes:
    """
    Joint states of shell and pendulum.

    Parameters
    ----------
    frame : str
    has_pendulum : bool
    steers : bool
        Whether lean, tilt and yaw follow, with an effort of 0.

    """

    def __init__(self, frame: str = '', has_pendulum: bool = True, steers: bool = False):
        self._steers = steers
        names = [*(JOINTS if has_pendulum else JOINTS[:1]), *(LATERAL if steers else ())]
        zeros = [0.0] * len(names)
        message = JointState(name=names, position=zeros, velocity=zeros, effort=zeros)
        message.header.frame_id = frame
        self._written, self._count = _Written(message), 2 if has_pendulum else 1

    def of(self, stamp: float, readings: Union[JointReadings, State], torque: float,
           lateral: LateralState = LateralState()) -> bytes:
        """
        Return the bytes of a joint state.

        Parameters
        ----------
        stamp : float
            ROS time [s].
        readings : JointReadings or State
        torque : float
            Of the pendulum motor [N m].
        lateral : LateralState, optional
            Of a robot that steers.

        """
        count = self._count
        angles = [readings.ball_angle, readings.joint_angle][:count]
        rates = [readings.ball_rate, readings.joint_rate][:count]
        efforts = [0.0, torque][:count]
        if self._steers:
            angles += lateral.lean, lateral.tilt, lateral.heading
            rates += lateral.lean_rate, lateral.tilt_rate, lateral.yaw_rate
            efforts += 0.0, 0.0, 0.0
        return self._written.of(*sec_nanosec(stamp), angles, rates, efforts)


class CommandBytes:
    """Joint commands for the pendulum; see `conversions.command_message`."""

    def __init__(self) -> None:
        self._straight = _Written(JointState(name=[PENDULUM], effort=[0.0]))
        self._steering = _Written(JointState(
            name=[PENDULUM, LEAN], position=[0.0, 0.0], effort=[0.0, 0.0]))

    def of(self, stamp: Any, torque: float, lean: Optional[float] = None) -> bytes:
        """Return the bytes of a command that answers the joint state of a stamp."""
        if lean is None:
            return self._straight.of(stamp.sec, stamp.nanosec, (), (), (torque,))
        return self._steering.of(stamp.sec, stamp.nanosec, (math.nan, lean), (),
                                 (torque, math.nan))
