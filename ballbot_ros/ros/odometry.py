# SPDX-License-Identifier: Apache-2.0
"""Odometry as a message, and as a transform where tf2_msgs is installed."""
from typing import Any, Iterator, Optional, Tuple

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher

from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import create_publisher

try:
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the wheels; part of every ROS 2 installation
    TFMessage = None


class OdometryTopics:
    """The topics ``odom`` and, where there is tf2_msgs, ``/tf``."""

    def __init__(self, node: Node):
        """Create the publishers."""
        self._odometry = create_publisher(node, Odometry, 'odom', qos.STATE)
        self._transforms: Optional[Publisher] = None
        if TFMessage is None:
            node.get_logger().info('tf2_msgs is not installed: no /tf from odom to base_link')
        else:
            self._transforms = create_publisher(node, TFMessage, '/tf', qos.STATE)

    def messages(self, message: Odometry) -> Iterator[Tuple[Publisher, Any]]:
        """Yield what odometry is to be published as, and where."""
        yield self._odometry, message
        if self._transforms is not None:
            transform = TransformStamped(
                header=message.header, child_frame_id=message.child_frame_id)
            place, at = transform.transform.translation, message.pose.pose.position
            place.x, place.y, place.z = at.x, at.y, at.z
            yield self._transforms, TFMessage(transforms=[transform])
