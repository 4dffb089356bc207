# SPDX-License-Identifier: Apache-2.0
"""Parameters: refused with a sentence that helps, converted only where nothing is lost."""
from dataclasses import dataclass, fields
import math

import pytest
from rclpy.node import Node
from refusals import refused

from ballbot_ros.config.fields import count, fixed, flag, live, quantity, text
from ballbot_ros.errors import ConfigurationError
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


def test_a_whole_number_is_a_float_too(make_node):
    node, settings = given(make_node, gain=5, ratio=2)
    assert settings == Example(gain=5.0, ratio=2.0)
    assert type(settings.gain) is float and type(node.get_parameter('gain').value) is float


@pytest.mark.parametrize('overrides, sayings', [
    ({'gian': 1.0}, ("'gian' is not a parameter of node example", "did you mean 'gain'?")),
    ({'Gain': 1.0}, ("did you mean 'gain'?",)),
    ({'zzz': 1.0}, ('known are gain, loud, method, ratio, robot, '
                    'start_type_description_service, steps, use_sim_time, version',)),
    ({'use_simtime': True}, ("did you mean 'use_sim_time'?",)),
    ({'qos_overrides./odom.publisher.depth': 1}, ('is not a parameter',)),
    ({'gain': 10.5}, ('node example: gain must be at least 0 and at most 10 N m/rad, got 10.5',)),
    ({'gain': -1}, ('at least 0', 'got -1')),
    ({'gain': math.nan}, ('got nan',)),
    ({'gain': math.inf}, ('got inf',)),
    ({'gain': 'stiff'}, ('gain must be a number', "got 'stiff'")),
    ({'gain': True}, ('gain must be a number', 'got True')),
    ({'gain': [1.0]}, ('gain must be a number',)),
    ({'ratio': 0.0}, ('ratio must be more than 0, got 0',)),
    ({'steps': 2.5}, ('steps must be a whole number, got 2.5',)),
    ({'steps': 10}, ('steps must be at least 0 and at most 9, got 10',)),
    ({'loud': 1}, ('loud must be true or false, got 1',)),
    ({'loud': 'yes'}, ("got 'yes'",)),
    ({'method': 4}, ('method must be text, got 4',)),
    ({'method': 'rk5'}, ('one of rk4, euler', "did you mean 'rk4'?")),
])
def test_refused_at_the_start_with_a_sentence_that_helps(make_node, overrides, sayings):
    with pytest.raises(ConfigurationError) as caught:
        given(make_node, **overrides)
    for saying in sayings:
        assert saying in str(caught.value)


def test_a_real_motor_follows_no_set_point_for_ever():
    with refused('out_of_range', 'set_point_timeout'):
        BridgeSettings(set_point_timeout=0.0)
