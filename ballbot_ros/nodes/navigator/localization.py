# SPDX-License-Identifier: Apache-2.0
"""The pose on the map from /tf and odom, and the points of the laser scan on it."""
import math
from typing import Any, Optional, Tuple

from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.floors.floor import Point
from ballbot_ros.nodes.navigator.settings import NavigatorSettings
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.endpoints import create_subscription

MOST_POINTS = 120  # approximate number of points that are used of a scan

Pose = Tuple[float, float, float]


def heading_of(orientation: Any) -> float:
    """Return the yaw of a quaternion of any length [rad], NaN if all components are 0."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    if not any((x, y, z, w)):
        return math.nan
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


class Localization:
    """Subscribes to the transform from the map to odom, and to scan."""

    def __init__(self, node: Node, settings: NavigatorSettings):
        self._map, self._odom = settings.map_frame, settings.odom_frame
        self._log = node.get_logger()
        self._offset: Optional[Pose] = None if settings.localized else (0.0, 0.0, 0.0)
        self._scan: Optional[LaserScan] = None
        create_subscription(node, 'scan', self._on_scan)
        if not settings.localized:
            return
        try:
            for topic in ('/tf', '/tf_static'):
                create_subscription(node, topic, self._on_transforms)
        except ConfigurationError as error:
            node.get_logger().error(
                f'{error}; or set localized to false, if {self._odom} coincides with {self._map}')

    def _on_transforms(self, message: Any) -> None:
        for item in message.transforms:
            if (item.header.frame_id, item.child_frame_id) == (self._map, self._odom):
                move = item.transform.translation
                self._offset = move.x, move.y, heading_of(item.transform.rotation)

    def _on_scan(self, message: LaserScan) -> None:
        self._scan = message

    def on_map(self, x: float, y: float, heading: float) -> Optional[Pose]:
        """Transform a pose from odom to the map; return None before the first transform."""
        if self._offset is None:
            return None
        left, up, turn = self._offset
        return (left + math.cos(turn) * x - math.sin(turn) * y,
                up + math.sin(turn) * x + math.cos(turn) * y, heading + turn)

    def points(self, pose: Pose, base: str, since: float) -> Optional[Tuple[Point, ...]]:
        """
        Return the points of a new scan on the map [m]; None without one since a time [s].

        The pose is that of the frame `base`; a scan in another frame is refused.
        """
        scan, self._scan = self._scan, None
        if scan is None or to_seconds(scan.header.stamp) < since:
            return None
        if scan.header.frame_id != base:
            self._log.warning(
                f'scan refused: it must be in the frame {base!r}, the child_frame_id of odom, '
                f'got {scan.header.frame_id!r}', throttle_duration_sec=1.0)
            return None
        x, y, heading = pose
        step = max(1, len(scan.ranges) // MOST_POINTS)
        return tuple(
            (x + distance * math.cos(angle), y + distance * math.sin(angle))
            for number in range(0, len(scan.ranges), step)
            for distance in [float(scan.ranges[number])]
            for angle in [heading + scan.angle_min + number * scan.angle_increment]
            if math.isfinite(distance + angle) and scan.range_min <= distance < scan.range_max)
