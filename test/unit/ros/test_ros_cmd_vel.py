# SPDX-License-Identifier: Apache-2.0
"""Speeds from any publisher; components that the speed law does not follow are refused."""
import math

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from refusals import refused

from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.ros.cmd_vel import DEAD_BAND, OTHER_COMPONENTS, speed_set_point
from ballbot_ros.ros.conversions import to_time


def stamped(twist):
    """Return a message with a stamp of 2.5 s."""
    message = TwistStamped(twist=twist)
    message.header.stamp, message.header.frame_id = to_time(2.5), 'base_link'
    return message


def test_both_types_give_the_forward_speed_and_any_stamp():
    twist = Twist()
    twist.linear.x = -0.4
    assert speed_set_point(stamped(twist), steers=False) == SetPoint(Mode.SPEED, -0.4, 2.5)
    assert speed_set_point(twist, steers=False) == SetPoint(Mode.SPEED, -0.4, 0.0)


@pytest.mark.parametrize('kind, axis, unit', OTHER_COMPONENTS)
@pytest.mark.parametrize('wrap', [stamped, lambda twist: twist])
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_unsupported_components_above_the_dead_band_refuse_the_message(
        kind, axis, unit, wrap, sign):
    twist = Twist()
    twist.linear.x = 0.4
    setattr(getattr(twist, kind), axis, sign * DEAD_BAND)
    assert speed_set_point(wrap(twist), steers=False).value == 0.4
    setattr(getattr(twist, kind), axis, sign * 0.02)
    with refused('other_axes', f'{kind}.{axis}') as caught:
        speed_set_point(wrap(twist), steers=False)
    assert f'{sign * 0.02:g} {unit}' in str(caught.value)
    assert ('steering' in str(caught.value)) == ((kind, axis) == ('angular', 'z'))


@pytest.mark.parametrize('kind, axis', [('linear', 'x'), ('linear', 'y'), ('angular', 'z')])
@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_refused_in_each_component(kind, axis, value):
    twist = Twist()
    setattr(getattr(twist, kind), axis, value)
    with refused('not_finite', error=MessageError):
        speed_set_point(twist, steers=False)
