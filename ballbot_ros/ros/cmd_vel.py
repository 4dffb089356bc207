# SPDX-License-Identifier: Apache-2.0
"""Speeds on cmd_vel: geometry_msgs/TwistStamped or Twist."""
import math
from typing import Any, Callable, Optional, Union

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.endpoints import (
    create_publisher, create_subscription, create_wall_timer, wait_until_received)

TOPIC = 'cmd_vel'
TYPES = {'geometry_msgs/msg/TwistStamped': TwistStamped, 'geometry_msgs/msg/Twist': Twist}
# Period of the queries for the type that is published [s].
TYPE_PERIOD = 0.2
# The largest offset of a joystick at rest [m/s, rad/s].
DEAD_BAND = 0.01
# Only a robot that steers follows this component.
YAW_RATE = ('angular', 'z')
TURN_HINT = (' (turning requires a section steering in the robot file and, in the simulator, a '
             'floor)')
# Components that the speed law does not follow, with their units.
OTHER_COMPONENTS = (
    ('linear', 'y', 'm/s'), ('linear', 'z', 'm/s'), ('angular', 'x', 'rad/s'),
    ('angular', 'y', 'rad/s'), ('angular', 'z', 'rad/s'))


class SpeedSubscription:
    """
    Subscribes to speeds in the type that is published, TwistStamped while there is no publisher.

    A process can subscribe to a topic with only one type, so the type follows the graph.
    """

    def __init__(self, node: Node, callback: Callable[[Any], None]):
        self._node, self._callback = node, callback
        self._type: Any = TwistStamped
        self._subscription: Optional[Subscription] = create_subscription(
            node, TOPIC, callback, self._type)
        create_wall_timer(node, TYPE_PERIOD, self._follow_type)

    def _follow_type(self) -> None:
        published = {TYPES.get(info.topic_type)
                     for info in self._node.get_publishers_info_by_topic(
                         self._node.resolve_topic_name(TOPIC))}
        if len(published) == 1 and (kind := published.pop()) not in (None, self._type):
            self._type = kind
            self._node.get_logger().info(f'{TOPIC} is published as {kind.__name__}')
        if self._subscription is None:
            try:
                self._subscription = create_subscription(
                    self._node, TOPIC, self._callback, self._type)
            except RuntimeError:
                pass  # the other type is still in use; the next period tries again
        elif self._subscription.msg_type is not self._type:
            # The executor releases it before the next period.
            self._node.destroy_subscription(self._subscription)
            self._subscription = None


class SpeedPublisher:
    """Publishes speeds as Twist if all subscriptions have this type, else as TwistStamped."""

    def __init__(self, node: Node):
        self._node = node
        self._publisher = self._create()

    @property
    def followers(self) -> int:
        """Return the number of subscriptions."""
        return self._node.count_subscribers(self._node.resolve_topic_name(TOPIC))

    def publish(self, speed: float) -> None:
        """Publish a speed [m/s]; unstamped, so that its age counts from its arrival."""
        if self._publisher.msg_type is not self._type:
            self.close()
            self._publisher = self._create()
        message = self._publisher.msg_type()
        getattr(message, 'twist', message).linear.x = speed
        self._publisher.publish(message)

    def close(self) -> None:
        """Destroy the publisher after its last message is received."""
        wait_until_received(self._publisher)
        self._node.destroy_publisher(self._publisher)

    @property
    def _type(self) -> Any:
        names = {info.topic_type for info in
                 self._node.get_subscriptions_info_by_topic(self._node.resolve_topic_name(TOPIC))}
        return Twist if names == {'geometry_msgs/msg/Twist'} else TwistStamped

    def _create(self) -> Publisher:
        return create_publisher(self._node, TOPIC, self._type)


def speed_set_point(message: Union[Twist, TwistStamped], steers: bool) -> SetPoint:
    """
    Return the forward speed as a set-point of the speed law, with stamp 0 if it is unstamped.

    With `steers`, the set-point includes the yaw rate, which `steering.law` limits.  A message
    that also requests another motion is refused entirely: a robot that should turn around an
    obstacle must not drive straight into it.  Raises `MessageError` with reason ``not_finite``, or
    ``other_axes`` if a component that is not followed is above `DEAD_BAND`.
    """
    stamped = isinstance(message, TwistStamped)
    twist = message.twist if stamped else message
    for kind, axis, unit in OTHER_COMPONENTS:
        value = getattr(getattr(twist, kind), axis)
        if not math.isfinite(value):
            raise MessageError(f'{kind}.{axis} must be finite, got {value!r}',
                               'not_finite', f'{kind}.{axis}')
        if abs(value) > DEAD_BAND and not (steers and (kind, axis) == YAW_RATE):
            raise MessageError(
                f'{kind}.{axis} is {value:.3g} {unit}, and the speed law drives '
                f'straight ahead only{TURN_HINT if (kind, axis) == YAW_RATE else ""}; the '
                'message is ignored: send linear.x alone, with the other components within '
                f'{DEAD_BAND:g} of 0', 'other_axes', f'{kind}.{axis}')
    return SetPoint(Mode.SPEED, twist.linear.x,
                    to_seconds(message.header.stamp) if stamped else 0.0,
                    twist.angular.z if steers else 0.0)
