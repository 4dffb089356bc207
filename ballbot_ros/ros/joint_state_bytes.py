# SPDX-License-Identifier: Apache-2.0
"""Joint states as the bytes that go out: making messages costs more than sending them."""
import struct

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from ballbot_ros.control import JointReadings
from ballbot_ros.ros.conversions import JOINTS

# Numbers that stand nowhere else in the message, to see where each is.
SECONDS, NANOSECONDS = 0x5EC05EC1, 0x3A05EC02
POSITIONS, VELOCITIES, EFFORTS = (1.25e101, 1.25e102), (1.25e103, 1.25e104), (0.0, 1.25e105)


class JointStateBytes:
    """A serialised joint state of shell and pendulum; what changes is written in place."""

    def __init__(self, frame: str = ''):
        """Let the middleware serialise one message, and find its numbers in it."""
        self._buffer = bytearray(serialize_message(self._marked(frame)))
        self._stamp, self._positions, self._velocities, self._torque = (
            self._place(mark) for mark in (
                struct.pack('=iI', SECONDS, NANOSECONDS), struct.pack('=2d', *POSITIONS),
                struct.pack('=2d', *VELOCITIES), struct.pack('=d', EFFORTS[1])))

    @staticmethod
    def _marked(frame: str) -> JointState:
        message = JointState(name=JOINTS, position=POSITIONS, velocity=VELOCITIES, effort=EFFORTS)
        message.header.stamp = Time(sec=SECONDS, nanosec=NANOSECONDS)
        message.header.frame_id = frame
        return message

    def _place(self, mark: bytes) -> int:
        if self._buffer.count(mark) != 1:
            raise RuntimeError('this middleware serialises numbers otherwise: publish messages')
        return self._buffer.index(mark)

    def of(self, stamp: float, readings: JointReadings, torque: float) -> bytes:
        """
        Return the bytes of a joint state.

        Parameters
        ----------
        stamp : float
            ROS time [s].
        readings : JointReadings
        torque : float
            Of the pendulum motor [N m].

        """
        nanoseconds, buffer = round(stamp * 1e9), self._buffer
        struct.pack_into('=iI', buffer, self._stamp, *divmod(nanoseconds, 10**9))
        struct.pack_into('=2d', buffer, self._positions, readings.ball_angle,
                         readings.joint_angle)
        struct.pack_into('=2d', buffer, self._velocities, readings.ball_rate, readings.joint_rate)
        struct.pack_into('=d', buffer, self._torque, torque)
        return bytes(buffer)
