# SPDX-License-Identifier: Apache-2.0
"""The pose on the map from /tf and odom, and the points of the laser scan on it."""
from functools import partial
import math
from typing import Any, Dict, Optional, Tuple

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import LaserScan

from ballbot_ros.errors import ConfigurationError, MessageError
from ballbot_ros.floors.floor import Point
from ballbot_ros.nodes.navigator.settings import NavigatorSettings
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.endpoints import create_subscription, ODOMETRY_TIMEOUT
from ballbot_ros.steering.model import moved_to

MOST_POINTS = 120  # approximate number of points that are used of a scan

Pose = Tuple[float, float, float]


def heading_of(orientation: Any) -> float:
    """Return the yaw of a quaternion of any length [rad], NaN if all components are 0."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    ahead, aside = w * w + x * x - y * y - z * z, 2.0 * (w * z + x * y)
    return math.atan2(aside, ahead) if x * x + y * y + z * z + w * w else math.nan


def rotation_of(orientation: Any) -> NDArray[np.float64]:
    """Return the rotation matrix of a quaternion of any length, NaN if all components are 0."""
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    square = x * x + y * y + z * z + w * w
    factor = 2.0 / square if square else math.nan
    return np.array([
        [1.0 - factor * (y * y + z * z), factor * (x * y - w * z), factor * (x * z + w * y)],
        [factor * (x * y + w * z), 1.0 - factor * (x * x + z * z), factor * (y * z - w * x)],
        [factor * (x * z - w * y), factor * (y * z + w * x), 1.0 - factor * (x * x + y * y)]])


class Localization:
    """Subscribes to the transforms from the map to odom and to the laser, and to scan."""

    def __init__(self, node: Node, settings: NavigatorSettings):
        self._map, self._odom = settings.map_frame, settings.odom_frame
        self._log = node.get_logger()
        self._localized = settings.localized
        self._offset: Optional[Pose] = None if settings.localized else (0.0, 0.0, 0.0)
        self._valid_until = math.inf  # of the offset [s]
        self._mounts: Dict[str, Any] = {}  # static transforms by their child frames
        self._scan: Optional[LaserScan] = None
        create_subscription(node, 'scan', self._on_scan)
        try:
            create_subscription(node, '/tf_static', self._on_static)
            if settings.localized:
                create_subscription(
                    node, '/tf', partial(self._on_transforms, ODOMETRY_TIMEOUT))
        except ConfigurationError as error:
            if settings.localized:
                self._log.error(f'{error}; or set localized to false, if {self._odom} coincides '
                                f'with {self._map}')

    def _on_static(self, message: Any) -> None:
        self._mounts.update((item.child_frame_id, item) for item in message.transforms)
        if self._localized:
            self._on_transforms(math.inf, message)

    def _on_transforms(self, lifetime: float, message: Any) -> None:
        for item in message.transforms:
            if (item.header.frame_id, item.child_frame_id) == (self._map, self._odom):
                move = item.transform.translation
                self._offset = move.x, move.y, heading_of(item.transform.rotation)
                self._valid_until = to_seconds(item.header.stamp) + lifetime

    def check(self, now: float) -> None:
        """Raise `MessageError` if the transform from the map is too old at a time [s]."""
        if now > self._valid_until:
            raise MessageError(
                f'the transform from {self._map} to {self._odom} on /tf is '
                f'{now - self._valid_until + ODOMETRY_TIMEOUT:.1f} s old, more than '
                f'{ODOMETRY_TIMEOUT} s: check the localisation, or publish a transform that does '
                'not change on /tf_static', 'stale', '/tf')

    def _on_scan(self, message: LaserScan) -> None:
        self._scan = message

    def on_map(self, x: float, y: float, heading: float) -> Optional[Pose]:
        """Transform a pose from odom to the map; return None before the first transform."""
        if self._offset is None:
            return None
        left, up, turn = self._offset
        return (*moved_to((left, up), turn, x, y), heading + turn)

    def points(self, pose: Pose, base: str, since: float) -> Optional[Tuple[Point, ...]]:
        """
        Return the points of a new scan on the map [m]; None without one since a time [s].

        The pose is that of the frame `base`; a scan in a frame without a static transform from it
        is refused, and so is one whose transform is not finite or has a quaternion of zeros.
        """
        scan, self._scan = self._scan, None
        if scan is None or to_seconds(scan.header.stamp) < since:
            return None
        mount = self._mount(base, scan.header.frame_id)
        if mount is None or not all(np.isfinite(part).all() for part in mount):
            self._log.warning(
                f'scan refused: no valid static transform from {base!r}, the child_frame_id of '
                f'odom, to {scan.header.frame_id!r}; publish it on /tf_static',
                throttle_duration_sec=1.0)
            return None
        x, y, heading = pose
        chosen = slice(None, None, max(1, len(scan.ranges) // MOST_POINTS))
        distance = np.array(scan.ranges, float)[chosen]
        angle = scan.angle_min + np.arange(len(scan.ranges))[chosen] * scan.angle_increment
        seen = (scan.range_min <= distance) & (distance < scan.range_max) \
            & np.isfinite(distance + angle)
        distance, angle = distance[seen], angle[seen]
        turn, place = mount
        ahead, left = turn[:2, :2] @ (distance * np.cos(angle), distance * np.sin(angle)) \
            + place[:2, None]
        points = np.column_stack((
            x + math.cos(heading) * ahead - math.sin(heading) * left,
            y + math.sin(heading) * ahead + math.cos(heading) * left))
        return tuple(map(tuple, points[np.isfinite(points).all(axis=1)].tolist()))

    def _mount(self, base: str, frame: str
               ) -> Optional[Tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return rotation and position [m] of a frame in the frame `base`, None if unknown."""
        turn, place = np.eye(3), np.zeros(3)
        for _ in range(len(self._mounts) + 1):
            if frame == base:
                return turn, place
            if frame not in self._mounts:
                return None
            item = self._mounts[frame]
            rotation, move = rotation_of(item.transform.rotation), item.transform.translation
            turn, place = rotation @ turn, rotation @ place + (move.x, move.y, move.z)
            frame = item.header.frame_id
        return None  # the transforms form a cycle
