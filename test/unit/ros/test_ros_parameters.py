# SPDX-License-Identifier: Apache-2.0
"""Parameters are refused with a helpful message, and converted only without loss."""
from dataclasses import dataclass, fields
import math

import pytest
from rclpy.node import Node
from refusals import refused

from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.ros.parameters import declare
from ballbot_ros.ros.settings import Settings


@dataclass(frozen=True)
class Example(Settings):
    """Some parameters."""

    gain: float = live(quantity('N m/rad', 'stiffness', default=2.0, minimum=0.0, maximum=10.0))
    ratio: float = live(quantity('1', 'ratio', default=1.0, above=0.0))
    steps: int = live(count('of a stair', default=3, maximum=9))
    loud: bool = live(flag('say it', default=False))
    method: str = live(text('how', default='rk4', choices=('rk4', 'euler')))
    robot: str = fixed('the world is built of it', text('its name', default='gimball'))
    version: str = text('a number as text', default='0.5')


def given(make_node, **overrides):
    """Return a node and its settings."""
    node = make_node(Node, 'example', **overrides)
    return node, declare(node, Example)


def test_defaults_are_declared_and_returned(make_node):
    node, settings = given(make_node)
    assert settings == Example()
    assert {item.name: node.get_parameter(item.name).value for item in fields(Example)} == {
        'gain': 2.0, 'ratio': 1.0, 'steps': 3, 'loud': False, 'method': 'rk4',
        'robot': 'gimball', 'version': '0.5'}


def test_an_integer_is_converted_to_a_float(make_node):
    node, settings = given(make_node, gain=5, ratio=2)
    assert settings == Example(gain=5.0, ratio=2.0)
    assert type(settings.gain) is float and type(node.get_parameter('gain').value) is float


@pytest.mark.parametrize('name, value, reason, names', [
    ('gian', 1.0, 'unknown_name', ("'gain'",)),
    ('Gain', 1.0, 'unknown_name', ("'gain'",)),
    ('zzz', 1.0, 'unknown_name', (
        'gain', 'loud', 'method', 'ratio', 'robot', 'steps', 'use_sim_time', 'version')),
    ('use_simtime', True, 'unknown_name', ("'use_sim_time'",)),
    ('qos_overrides./odom.publisher.depth', 1, 'unknown_name', ()),
    ('gain', 10.5, 'out_of_range', ('example', '0', '10 N m/rad', '10.5')),
    ('gain', -1, 'out_of_range', ('-1',)),
    ('gain', math.nan, 'not_finite', ('nan',)),
    ('gain', math.inf, 'not_finite', ('inf',)),
    ('gain', 'stiff', 'wrong_type', ("'stiff'",)),
    ('gain', True, 'wrong_type', ('True',)),
    ('gain', [1.0], 'wrong_type', ()),
    ('ratio', 0.0, 'out_of_range', ()),
    ('steps', 2.5, 'wrong_type', ('2.5',)),
    ('steps', 10, 'out_of_range', ('0', '9', '10')),
    ('loud', 1, 'wrong_type', ('1',)),
    ('loud', 'yes', 'wrong_type', ("'yes'",)),
    ('method', 4, 'wrong_type', ('4',)),
    ('method', 'rk5', 'not_a_choice', ('rk4, euler', "'rk4'"))])
def test_a_parameter_refused_at_the_start_is_named_with_value_and_range(
        make_node, name, value, reason, names):
    with refused(reason, name) as caught:
        given(make_node, **{name: value})
    assert all(one in str(caught.value) for one in (name, *names))


def test_a_real_motor_follows_no_set_point_indefinitely():
    with refused('out_of_range', 'set_point_timeout'):
        BridgeSettings(set_point_timeout=0.0)
