# SPDX-License-Identifier: Apache-2.0
"""Outputs of the navigator: commands, the plan, and markers of its crossings."""
import math
from typing import Any, List, Optional, Tuple

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, TwistStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.publisher import Publisher
from visualization_msgs.msg import Marker, MarkerArray

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.navigation import Route
from ballbot_ros.ros.conversions import set_point_message, yawed
from ballbot_ros.ros.endpoints import create_publisher, wait_until_received

COLOURS = {True: (0.1, 0.65, 0.25), False: (0.85, 0.5, 0.1)}  # crossing of high probability or not


def stamped_pose(frame: str, stamp: Time, x: float, y: float, heading: float) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id, message.header.stamp = frame, stamp
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation = yawed(heading)
    return message


def path_message(route: Optional[Route], frame: str, stamp: Time) -> Path:
    """Return a route as a path; empty without a route."""
    message = Path()
    message.header.frame_id, message.header.stamp = frame, stamp
    for segment in route.segments if route is not None else ():
        points: Tuple[Tuple[float, float], ...] = segment.points
        for one, two in zip(points, points[1:]):
            heading = math.atan2(two[1] - one[1], two[0] - one[0])
            if segment.direction < 0:
                heading += math.pi
            message.poses.append(stamped_pose(frame, stamp, *one, heading))
        message.poses.append(stamped_pose(frame, stamp, *points[-1], segment.heading))
    return message


class NavigationOutputs:
    """Publishes cmd_vel, set_point, plan and markers."""

    def __init__(self, node: Node, frame: str):
        """Create the publishers; poses are in a frame."""
        self._frame = frame
        self._speeds = create_publisher(node, 'cmd_vel')
        self._set_points = create_publisher(node, 'set_point')
        self._plans = create_publisher(node, 'plan')
        self._markers = create_publisher(node, 'markers')
        self._last: Optional[Tuple[Publisher, Any]] = None

    def repeat(self, stamp: Time) -> bool:
        """Publish the last command again, and return True, if it has this stamp."""
        if self._last is None or self._last[1].header.stamp != stamp:
            return False
        publisher, message = self._last
        publisher.publish(message)
        return True

    def command(self, stamp: Time, given: SetPoint) -> None:
        """Publish a speed, or the angle of a crossing, with a yaw rate."""
        if given.mode is Mode.SPEED:
            message = TwistStamped()
            message.header.stamp = stamp
            message.twist.linear.x, message.twist.angular.z = given.value, given.yaw_rate
            self._last = self._speeds, message
        else:
            self._last = self._set_points, set_point_message(stamp, given.value, given.yaw_rate)
        publisher, message = self._last
        publisher.publish(message)

    def rest(self, stamp: Time) -> None:
        """Publish a speed of 0 and wait until it is received."""
        self.command(stamp, SetPoint(Mode.SPEED))
        wait_until_received(self._speeds)

    def plan(self, route: Optional[Route], stamp: Time) -> None:
        """Publish the path, and an arrow for each crossing."""
        self._plans.publish(path_message(route, self._frame, stamp))
        clear = Marker(action=Marker.DELETEALL)
        clear.header.frame_id, clear.header.stamp = self._frame, stamp
        markers: List[Marker] = [clear]
        for number, segment in enumerate(route.segments if route is not None else ()):
            if segment.crossing is None:
                continue
            arrow = Marker(ns='crossing', id=number, type=Marker.ARROW, action=Marker.ADD)
            arrow.header = clear.header
            arrow.points = [Point(x=x, y=y, z=0.02) for x, y in segment.points]
            arrow.scale.x, arrow.scale.y = 0.05, 0.12
            arrow.pose.orientation.w = arrow.color.a = 1.0
            arrow.color.r, arrow.color.g, arrow.color.b = COLOURS[
                segment.crossing.probability >= 0.95]
            markers.append(arrow)
        self._markers.publish(MarkerArray(markers=markers))
