# SPDX-License-Identifier: Apache-2.0
"""Incompatible endpoints are reported by node and mismatch, and the end of odometry."""
from types import SimpleNamespace

from geometry_msgs.msg import Twist
import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ballbot_ros.ros import endpoints
from ballbot_ros.ros.endpoints import mismatches, ODOMETRY_TIMEOUT, OdometryTimeout


@pytest.fixture
def pair(make_node):
    """Return two nodes."""
    return make_node(Node, 'robot'), make_node(Node, 'other')


def endpoint(name, kind):
    """Return information on an endpoint in another process; within one, types must agree."""
    return SimpleNamespace(node_name=name, node_namespace='/a', topic_type=kind,
                           qos_profile=QoSProfile(depth=1))


@pytest.mark.parametrize('published', ['Twist', 'TwistStamped'])
@pytest.mark.parametrize('own', ['robot', 'teleop', 'onlooker'])
def test_a_type_mismatch_is_reported_with_both_types(own, published):
    kinds = ['geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped']
    sent = f'geometry_msgs/msg/{published}'
    kinds.remove(sent)
    node = SimpleNamespace(
        get_name=lambda: own, get_namespace=lambda: '/a', publishers=[],
        subscriptions=[SimpleNamespace(topic_name='/a/cmd_vel')],
        get_publishers_info_by_topic=lambda topic: [endpoint('teleop', sent)],
        get_subscriptions_info_by_topic=lambda topic: [
            endpoint('robot', kinds[0]), endpoint('onlooker', sent)])
    assert mismatches(node) == ([] if own == 'onlooker' else [
        f'/a/robot cannot receive /a/cmd_vel from /a/teleop: it is published as {sent} and '
        f'subscribed to as {kinds[0]}'])


def test_a_profile_that_does_not_match_is_reported(pair, spinner):
    robot, other = pair
    robot.create_subscription(Twist, 'cmd_vel', print, 1)
    other.create_publisher(Twist, 'cmd_vel', QoSProfile(
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    found, = spinner.until(lambda: mismatches(robot))
    assert found.startswith('/robot cannot receive /cmd_vel from /other: ')
    assert {'best effort publisher', 'reliable subscription'} <= set(
        found.lower().partition(': ')[2].split(' and '))


def test_a_second_publisher_of_the_clock_names_the_first(pair, make_node, spinner):
    robot, other = pair
    robot.create_publisher(Clock, '/clock', 1)
    assert not mismatches(robot)
    other.create_publisher(Clock, '/clock', 1)
    found, = spinner.until(lambda: mismatches(robot))
    assert found.startswith('/other ') and 'publish_clock:=false' in found
    listener = make_node(Node, 'listener')
    listener.create_subscription(Clock, '/clock', print, 1)
    assert not mismatches(listener)


def test_a_pause_with_remapped_odometry_does_not_count_as_its_end(monkeypatch):
    monkeypatch.setattr(endpoints, 'create_wall_timer', lambda *_: None)
    publishers, ended = {'/arm/odom': 1}, []
    timeout = OdometryTimeout(SimpleNamespace(
        resolve_topic_name=lambda topic: f'/arm/{topic}',
        count_publishers=lambda topic: publishers.get(topic, 0),
        get_clock=lambda: SimpleNamespace(now=lambda: 5.0)), ended.append)
    for _ in range(2 * ODOMETRY_TIMEOUT):
        timeout._count()
    assert ended == []
    publishers.clear()
    for _ in range(ODOMETRY_TIMEOUT + 1):
        timeout._count()
    assert ended == [f'no odometry received for {ODOMETRY_TIMEOUT} s']
