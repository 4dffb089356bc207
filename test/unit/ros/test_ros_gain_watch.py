# SPDX-License-Identifier: Apache-2.0
"""A planning node warns of other gains of the controller, and of time that goes back."""
import time

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.obstacle_decision.outputs import GainWatch


@pytest.fixture
def decision(make_node):
    """Return a node whose set-points /controller follows."""
    node = make_node(Node, 'decision')
    node.declare_parameter('control_tuning', 'published')
    make_node(Node, 'controller').create_subscription(
        JointState, 'set_point', lambda _: None, 1)
    return node


def event(node, **changed):
    return ParameterEvent(node=node, changed_parameters=[
        Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
        for name, value in changed.items()])


def test_other_gains_of_the_controller_are_logged_with_the_remedy(decision, capfd):
    watch = GainWatch(decision)
    watch.on_event(event('/controller', gains__position_kp=30.0))
    said = capfd.readouterr().err
    assert '/controller now uses other gains (gains.position_kp 30.0)' in said
    assert "control_tuning 'published'" in said
    watch.on_event(event('/controller', tuning='gentle', gains__position_kp=6.0))
    assert '(tuning gentle)' in capfd.readouterr().err


def test_irrelevant_parameter_events_are_not_logged(decision, capfd):
    watch = GainWatch(decision)
    watch.on_event(event('/left/controller', gains__position_kp=30.0))
    watch.on_event(event('/controller', state_timeout=0.2))
    watch.on_event(event('/controller', tuning='published', gains__position_kp=40.0))
    assert 'other gains' not in capfd.readouterr().err


def test_parameter_events_of_other_nodes_are_received(decision, make_node, spinner, monkeypatch):
    received = []
    monkeypatch.setattr(GainWatch, 'on_event', lambda _, message: received.append(message))
    GainWatch(decision)
    other = make_node(Node, 'other')
    other.declare_parameter('gains.position_kp', 40.0)
    spinner.add(decision)
    other.set_parameters([Parameter('gains.position_kp', value=30.0)])
    spinner.until(lambda: any(one.changed_parameters for one in received))
    assert [one.changed_parameters[0].name for one in received if one.changed_parameters] == [
        'gains.position_kp']


def test_time_that_repeatedly_goes_back_is_logged_at_most_once_a_second(make_node, capfd):
    node, start = make_node(ObstacleDecision, planner='cubic'), time.monotonic()
    for stamp in 20 * (2, 1):
        node._on_odometry(Odometry(header=Header(stamp=Time(sec=stamp))))
    assert 1 <= capfd.readouterr().err.count('time went back') <= 2.0 + time.monotonic() - start
    node.make_safe()
