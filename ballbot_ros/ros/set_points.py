# SPDX-License-Identifier: Apache-2.0
"""Set-points from topics, for the nodes that run the laws."""
from collections import Counter
from functools import partial
import time
from typing import Any, Callable

from rclpy.node import Node

from ballbot_ros.clock import steady_time
from ballbot_ros.control import Authority, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.ros.cmd_vel import speed_set_point, SpeedSubscription
from ballbot_ros.ros.conversions import set_point
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.single_publisher import SinglePublisher

# A node whose set-points are followed holds authority for this long after its last one [s of wall
# time].
AUTHORITY_TIMEOUT = 0.5


class SetPoints:
    """
    Passes on the set-points of set_point and cmd_vel, and counts and logs refused ones.

    Each topic has one publisher, and one of the two at a time has authority over the robot, see
    `control.Authority`.  `give` takes a `SetPoint` with the stamp of its message, 0 for an
    unstamped one, and may raise `MessageError`; `refused` counts refusals by reason;
    `record_request` takes a `SetPoint` of a node without authority, which also requests motion.
    With `steers`, yaw rates are followed.  The executor pauses after each refused message [s].
    """

    def __init__(self, node: Node, give: Callable[[SetPoint], None], refused: Counter,
                 record_request: Callable[[SetPoint], None], steers: bool, pause: float = 0.0):
        self._node, self._give, self._refused = node, give, refused
        self._record_request, self.steers, self._pause = record_request, steers, pause
        self.authority = Authority(AUTHORITY_TIMEOUT)
        self._publishers = {
            topic: SinglePublisher(node, topic) for topic in ('set_point', 'cmd_vel')}
        create_subscription(node, 'set_point', partial(self._take, 'set_point', set_point))
        SpeedSubscription(node, partial(self._take, 'cmd_vel', speed_set_point))

    def _take(self, topic: str, convert: Callable[[Any, bool], SetPoint], message: Any) -> None:
        try:
            given = convert(message, self.steers)
            try:
                self.authority.check(self._publishers[topic].name(), steady_time())
            except MessageError:
                self._record_request(given)
                raise
            self._give(given)
        except MessageError as error:
            # In direct control, set-points are for a node controller, if there is one.
            if error.reason == 'direct' and self._node.count_subscribers(
                    self._node.resolve_topic_name(topic)) > 1:
                return
            self._refused[error.reason] += 1
            self._node.get_logger().warning(
                f'{topic} refused: {error}', throttle_duration_sec=1.0)
            time.sleep(self._pause)
