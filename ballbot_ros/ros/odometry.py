# SPDX-License-Identifier: Apache-2.0
"""The topics of odometry, of the robot description and, with tf2_msgs, of the transforms."""
import math
from typing import Any, Callable, List, Optional, Sequence, Tuple

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header, String

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.ros.conversions import to_time, yawed
from ballbot_ros.ros.endpoints import create_publisher, has_subscribers
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.urdf import AXIS, LEAN_AXIS, robot_description, TILT_AXIS
from ballbot_ros.steering.model import LateralState

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # outside a ROS 2 installation
    TFMessage = None


class OdometryTopics:
    """
    The topics ``odom`` and ``/tf``, and those that viewers need.

    Odometry is the pose of the base in the frame ``odom``.  The frames below the base are
    published by robot_state_publisher, or by this class in its place: ``robot_description``,
    ``/tf_static``, and on ``/tf`` the links that turn, also without odometry.  An ``odom_rate`` of
    0 in the settings disables odometry.  A robot that steers has joints of axle and pendulum.
    """

    def __init__(self, node: Node, robot: Robot, settings: Any, steers: bool):
        self.frames = Frames.of(settings)
        self._radius, self._has_pendulum = robot.ball_radius, robot.has_pendulum
        self._described, self._steers = settings.publish_description, steers
        self._node = node
        self._made: Optional[Publisher] = None
        self._odometry: Optional[Publisher] = None
        self._transforms: Optional[Publisher] = None
        if TFMessage is None:
            node.get_logger().info('tf2_msgs is not installed: no /tf')
        else:
            self._transforms = create_publisher(node, '/tf')
        if self._described:
            self._describe(node, robot, Frames.of(settings, prefixed=False))
        self.enable_odometry(settings.odom_rate > 0.0)

    def publish_map(self, stamp: float, pose: Tuple[float, float, float]) -> None:
        """Publish x, y, heading of ``odom`` on the map [m], [rad] at a time [s]."""
        if self._transforms is not None and self.frames.map and has_subscribers(self._transforms):
            x, y, heading = pose
            header = Header(stamp=to_time(stamp), frame_id=self.frames.map)
            self._transforms.publish(TFMessage(transforms=[_transform(
                header, self.frames.map, self.frames.odom, (x, y, 0.0), yawed(heading))]))

    def enable_odometry(self, enabled: bool) -> None:
        """Enable or disable publishing ``odom`` and its transform."""
        if enabled and self._made is None:  # never destroyed, as a loop may be publishing
            self._made = create_publisher(self._node, 'odom')
        self._odometry = self._made if enabled else None

    def _describe(self, node: Node, robot: Robot, names: Frames) -> None:
        # Referenced: otherwise the publisher is destroyed, and its latched messages with it.
        self._description = create_publisher(node, 'robot_description')
        self._description.publish(String(data=robot_description(
            robot, names, self._steers)))
        if TFMessage is not None:
            self._static = create_publisher(node, '/tf_static')
            header = Header()  # static transforms need no stamp
            self._static.publish(TFMessage(transforms=[
                _transform(header, self.frames.base, self.frames.footprint,
                           (0.0, 0.0, -self._radius)),
                _transform(header, self.frames.ball, self.frames.imu)]))

    def publish(self, make: Callable[[], Odometry], ball_angle: float, joint_angle: float,
                lateral: LateralState = LateralState()) -> None:
        """
        Publish the odometry of the centre of the ball that `make` returns, and its transforms.

        Each topic needs a subscriber.

        The angles are those of the joints ``shell`` and ``pendulum`` [rad].
        """
        odometry, transforms = (
            publisher if publisher is not None and has_subscribers(publisher) else None
            for publisher in (self._odometry, self._transforms))
        if odometry is None and transforms is None:
            return
        message = make()
        if odometry is not None:
            odometry.publish(message)
        if transforms is None:
            return
        moved = self._turned(message.header, ball_angle, joint_angle, lateral)
        if self._odometry is not None:
            at = message.pose.pose.position
            moved.insert(0, _transform(
                message.header, self.frames.odom, message.child_frame_id, (at.x, at.y, at.z),
                message.pose.pose.orientation))
        if moved:
            transforms.publish(TFMessage(transforms=moved))

    def _turned(self, header: Header, ball_angle: float, joint_angle: float,
                lateral: LateralState) -> List[TransformStamped]:
        """Return the transforms of the joints, if no other node publishes them."""
        if not self._described:
            return []
        frames = self.frames
        chain = [(frames.base, frames.ball, AXIS, ball_angle),
                 (frames.ball, frames.pendulum, AXIS, joint_angle)][:1 + self._has_pendulum]
        if self._steers:
            chain = [(frames.base, frames.axle, TILT_AXIS, lateral.tilt),
                     (frames.axle, frames.ball, AXIS, ball_angle),
                     (frames.ball, frames.carrier, AXIS, joint_angle),
                     (frames.carrier, frames.pendulum, LEAN_AXIS, lateral.lean)]
        return [_transform(header, parent, child, rotation=Quaternion(
            w=math.cos(0.5 * angle),
            **dict(zip('xyz', (math.sin(0.5 * angle) * part for part in axis)))))
                for parent, child, axis, angle in chain]


def _transform(header: Header, parent: str, child: str,
               translation: Sequence[float] = (0.0, 0.0, 0.0),
               rotation: Quaternion = Quaternion()) -> TransformStamped:
    """Return a transform of a translation [m] and a rotation."""
    return TransformStamped(
        header=Header(stamp=header.stamp, frame_id=parent), child_frame_id=child,
        transform=Transform(translation=Vector3(**dict(zip('xyz', map(float, translation)))),
                            rotation=rotation))
