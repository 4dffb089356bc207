# SPDX-License-Identifier: Apache-2.0
"""Set-points as they come by topic, for whatever runs the laws inside."""
from collections import Counter
import time
from typing import Any, Callable

from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.control import Authority, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.ros.cmd_vel import frame_id_of, speed_set_point, TYPES
from ballbot_ros.ros.conversions import set_point
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.senders import Senders

# Whose set-points are followed is free to others after this silence [s of wall time].
SILENT = 0.5


class SetPoints:
    """
    Hands on what comes on set_point and cmd_vel, and counts and logs what is refused.

    One sender at a time has authority over both topics, see `control.Authority`.

    Parameters
    ----------
    node : Node
    give : callable
        Takes a `SetPoint` stamped as its message, 0 where that was not; raises `MessageError`.

    refused : Counter
        Where they are counted by reason.
    cmd_vel_type : str
        One of `cmd_vel.TYPES`.
    overhear : callable
        Is told of a `SetPoint` of a sender that is not followed: motion is asked for all the same.

    """

    def __init__(self, node: Node, give: Callable[[SetPoint], None], refused: Counter,
                 cmd_vel_type: str = 'twist_stamped',
                 overhear: Callable[[SetPoint], None] = lambda _: None):
        """Subscribe."""
        self._node, self._give, self._refused = node, give, refused
        self._overhear = overhear
        self.authority = Authority(SILENT)
        self._senders = {topic: Senders(node, topic) for topic in ('set_point', 'cmd_vel')}
        create_subscription(node, 'set_point', self._on_set_point)
        create_subscription(node, 'cmd_vel', self._on_cmd_vel, TYPES[cmd_vel_type])

    def _on_set_point(self, message: JointState) -> None:
        self._take('set_point', set_point, message)

    def _on_cmd_vel(self, message: Any) -> None:
        self._take('cmd_vel', speed_set_point, message)

    def _take(self, topic: str, convert: Callable[[Any], SetPoint], message: Any) -> None:
        try:
            given = convert(message)
            self._check(topic, message, given)
            self._give(given)
        except MessageError as error:
            # In direct control they are meant for a node controller, if there is one.
            if error.reason == 'direct' and self._node.count_subscribers(topic) > 1:
                return
            self._refused[error.reason] += 1
            self._node.get_logger().warning(
                f'{topic} refused: {error}', throttle_duration_sec=1.0)

    def _check(self, topic: str, message: Any, given: SetPoint) -> None:
        """Refuse what comes from another sender than the one in authority."""
        try:
            self.authority.check(
                self._senders[topic].name(frame_id_of(message)), time.monotonic())
        except MessageError:
            self._overhear(given)
            raise
