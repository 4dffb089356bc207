# SPDX-License-Identifier: Apache-2.0
"""Speeds on cmd_vel: geometry_msgs/TwistStamped or, for those who send it, Twist."""
import math
from typing import Any, Mapping, Union

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.setting_fields import CMD_VEL_TYPES

# By the value of the parameter cmd_vel_type.
TYPES: Mapping[str, Any] = dict(zip(CMD_VEL_TYPES, (TwistStamped, Twist)))
# The topic of speeds.
TOPIC = 'cmd_vel'
# What a stick at rest sends still asks for no motion [m/s, rad/s].
NEGLIGIBLE = 0.01
# What one motor cannot do, with its unit.
OTHERS = (('linear', 'y', 'm/s'), ('linear', 'z', 'm/s'), ('angular', 'x', 'rad/s'),
          ('angular', 'y', 'rad/s'), ('angular', 'z', 'rad/s'))


def frame_id_of(message: Any) -> str:
    """Return the frame of a message, where senders put their names; empty for a Twist."""
    return message.header.frame_id if hasattr(message, 'header') else ''


def type_followed(node: Node) -> Any:
    """
    Return the type in which a speed reaches those who follow it; TwistStamped while nobody does.

    Where some take the one and some the other it is TwistStamped, which has a stamp and a name.
    """
    names = {info.topic_type for info in
             node.get_subscriptions_info_by_topic(node.resolve_topic_name(TOPIC))}
    return Twist if names == {'geometry_msgs/msg/Twist'} else TwistStamped


def speed_message(kind: Any, speed: float, name: str) -> Union[Twist, TwistStamped]:
    """Return a speed [m/s] as a message of a type, from a sender of a name where it has room."""
    message = kind()
    if kind is TwistStamped:
        message.header.frame_id = name
    (message.twist if kind is TwistStamped else message).linear.x = speed
    return message


def speed_set_point(message: Union[Twist, TwistStamped]) -> SetPoint:
    """
    Return the forward speed as a set-point of the speed law, stamped 0 where it has no stamp.

    A message that asks for more is refused as a whole: who wants to turn around something would
    not like to be driven straight into it.

    Raises
    ------
    MessageError
        With reason ``not_finite``, or ``other_axes`` if a turn, or speed in another direction than
        forward, is above `NEGLIGIBLE`.

    """
    stamped = isinstance(message, TwistStamped)
    twist = message.twist if stamped else message
    for kind, axis, unit in OTHERS:
        value = getattr(getattr(twist, kind), axis)
        if not math.isfinite(value):
            raise MessageError('not_finite', f'{kind}.{axis} must be finite, got {value!r}')
        if abs(value) > NEGLIGIBLE:
            raise MessageError(
                'other_axes', f'{kind}.{axis} is {value:.3g} {unit}, and the one motor of this '
                'robot drives straight ahead only; nothing of the message is followed: send '
                f'linear.x alone, and the rest within {NEGLIGIBLE:g} of 0')
    return SetPoint(Mode.SPEED, twist.linear.x,
                    to_seconds(message.header.stamp) if stamped else 0.0)
