# SPDX-License-Identifier: Apache-2.0
"""
An inertial measurement unit inside the shell, in the plane of motion.

It rotates with the shell.  Its y axis is the axle of the joint, to the left (REP 103); its x axis
is forward and its z axis up when the shell stands at ball angle 0.  Angles of this package are
counter-clockwise positive with +x to the right, so the ball rate is *minus* the gyro's y::

    ball_rate = -angular_velocity.y      (turn_rate below)
    forward, upward = linear_acceleration.x, linear_acceleration.z

An accelerometer measures specific force: acceleration minus gravity, so at rest it reads
g upwards, and 0 in free fall.
"""
from dataclasses import dataclass
import math
from typing import Tuple

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.control.signals import refuse_not_finite
from ballbot_ros.jit import compiled


@dataclass(frozen=True)
class ImuMounting(Checked):
    """
    Position and orientation of the IMU in the shell.

    Away from the centre an IMU also measures the centripetal acceleration: 5 m/s2 at 0.2 m and
    5 rad/s.
    """

    imu_forward: float = quantity(
        'm', 'position of the IMU ahead of the ball centre, in the frame of the shell at ball '
        'angle 0', default=0.0, minimum=-10.0, maximum=10.0)
    imu_upward: float = quantity(
        'm', 'position of the IMU above the ball centre, in the same frame', default=0.0,
        minimum=-10.0, maximum=10.0)
    imu_angle: float = quantity(
        'rad', 'angle of the IMU relative to the shell, counter-clockwise positive; it only '
        'defines ball angle 0', default=0.0, minimum=-math.pi, maximum=math.pi)

    def at_centre(self, reading: 'ImuReading', turning: float) -> 'ImuReading':
        """
        Return the equivalent reading at the ball centre, in the axes of the shell.

        `turning` is its turn acceleration [rad/s2].
        """
        forward, upward = turned(reading.forward, reading.upward, self.imu_angle)
        square = reading.turn_rate**2
        return ImuReading(
            reading.stamp, reading.turn_rate,
            forward + self.imu_forward * square + self.imu_upward * turning,
            upward + self.imu_upward * square - self.imu_forward * turning, turning)


@dataclass(frozen=True)
class ImuReading:
    """
    One reading, in the frame of the IMU.

    Attributes
    ----------
    stamp : float
        [s]
    turn_rate : float
        Rate of the shell, counter-clockwise positive [rad/s].
    forward, upward : float
        Specific force along the x and z axes of the IMU [m/s2].
    turn_acceleration : float
        Derivative of the turn rate, from this and earlier readings [rad/s2]; 0 if unknown.

    Raises
    ------
    MessageError
        With reason ``not_finite``.

    """

    stamp: float
    turn_rate: float
    forward: float
    upward: float
    turn_acceleration: float = 0.0

    def __post_init__(self) -> None:
        """Raise `MessageError` for a value that is not finite."""
        refuse_not_finite('IMU reading', **vars(self))


@compiled
def turned(x: float, y: float, angle: float) -> Tuple[float, float]:
    """Return a vector rotated counter-clockwise by `angle` [rad]."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return x * cosine - y * sine, x * sine + y * cosine
