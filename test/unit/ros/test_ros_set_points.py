# SPDX-License-Identifier: Apache-2.0
"""With two senders of set-points, one is followed and the other is refused."""
from collections import Counter
from functools import partial
import math
import time
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Twist, TwistStamped
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.control import Mode
from ballbot_ros.errors import MessageError
from ballbot_ros.nodes.bridge.inputs import REFUSED_PAUSE
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros.conversions import set_point, set_point_message, to_time
from ballbot_ros.ros.endpoints import create_publisher
from ballbot_ros.ros.message_bytes import command_bytes
from ballbot_ros.ros.rclpy_compat import new_executor
from ballbot_ros.ros.set_points import SetPoints

# Requests that are not followed.
unfollowed = []


@pytest.fixture
def robot(make_node, spinner):
    """Return inputs, followed set-points, refusal counts, two peers, and a function that spins."""
    node, peers = make_node(Node, 'robot'), [make_node(Node, name) for name in 'ab']
    followed, refused = [], Counter()
    unfollowed.clear()
    inputs = SetPoints(node, followed.append, refused, unfollowed.append, steers=False)
    spinner.add(node, *peers)
    return inputs, followed, refused, peers, spinner.until


def test_the_first_sender_is_followed_until_its_timeout(robot):
    inputs, followed, refused, (a, b), until = robot
    angles = a.create_publisher(JointState, 'set_point', 1)
    speeds = b.create_publisher(TwistStamped, 'cmd_vel', 1)
    ask = [lambda: angles.publish(set_point_message(to_time(1.0), 0.25)),
           lambda: speeds.publish(TwistStamped())]
    until(lambda: followed, ask[0])
    until(lambda: refused['other_sender'] > 3, lambda: (ask[0](), ask[1]()))
    assert {one.mode for one in followed} == {Mode.HOLD}
    assert inputs.authority.holder == '/a'
    assert inputs.authority.contest.startswith('/b commands')
    # Its requests for motion are still recorded, and inhibit a release of the e-stop.
    assert {one.mode for one in unfollowed} == {Mode.SPEED}
    until(lambda: followed[-1].mode is Mode.SPEED, ask[1])
    assert inputs.authority.holder == '/b'


@pytest.mark.parametrize('cls, parameters, refused, pauses', [
    (Bridge, {'autostart': False, 'black_box': '', 'port': '/dev/nowhere'},
     lambda node: node._session.set_points_refused, {REFUSED_PAUSE}),
    # The executor of these nodes also runs the laws, which a pause would delay.
    (Controller, {}, lambda node: node._refused, {0.0}),
    (Simulator, {'scene': 'flat', 'control': 'onboard'}, lambda node: node._laws.refused, {0.0})])
def test_a_flood_of_refused_set_points_pauses_only_the_bridge(
        make_node, spinner, monkeypatch, cls, parameters, refused, pauses):
    node, peer, slept = make_node(cls, **parameters), make_node(Node, 'peer'), []
    monkeypatch.setattr('ballbot_ros.ros.set_points.time', SimpleNamespace(sleep=slept.append))
    spinner.add(node, peer)
    angles, message = create_publisher(peer, 'set_point'), set_point_message(Time(), math.nan)
    spinner.until(lambda: refused(node)['not_finite'] > 3, lambda: angles.publish(message))
    assert len(slept) > 3 and set(slept) == pauses


def speed(kind, linear=0.0, angular=0.0):
    """Return a speed message of the given type."""
    message = kind()
    twist = message if kind is Twist else message.twist
    twist.linear.x, twist.angular.z = linear, angular
    return message


@pytest.mark.parametrize('kinds', [(Twist, TwistStamped), (TwistStamped, Twist)])
def test_speeds_are_followed_with_the_type_of_their_publisher(kinds, monkeypatch):
    # A topic has one type per process and context, so the publisher has its own context.
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    contexts = Context(), Context()
    for one in contexts:
        rclpy.init(context=one, domain_id=231)
    node, peer = (Node(name, context=one) for name, one in zip(('robot', 'teleop'), contexts))
    followed, refused, executor = [], Counter(), new_executor(contexts[0])
    SetPoints(node, followed.append, refused, unfollowed.append, steers=False)
    executor.add_node(node)
    deadline = time.monotonic() + 40.0
    for kind in kinds:
        speeds = peer.create_publisher(kind, 'cmd_vel', 1)
        followed.clear()
        refused.clear()
        while not (followed and refused['other_axes']):
            assert time.monotonic() < deadline
            speeds.publish(speed(kind, angular=0.5) if followed else speed(kind, linear=0.25))
            executor.spin_once(timeout_sec=0.01)
        assert {(one.mode, one.value, one.stamp) for one in followed} == {(Mode.SPEED, 0.25, 0.0)}
        peer.destroy_publisher(speeds)
    executor.shutdown()
    for one, context in zip((node, peer), contexts):
        one.destroy_node()
        rclpy.try_shutdown(context=context)


def test_two_publishers_of_a_topic_are_both_refused_and_named(robot):
    inputs, followed, refused, (a, b), until = robot
    message = set_point_message(to_time(1.0), 0.25)
    both = [one.create_publisher(JointState, 'set_point', 1) for one in (a, b)]
    until(lambda: refused['several_publishers'] > 3,
          lambda: [publisher.publish(message) for publisher in both])
    a.destroy_publisher(both[0])
    count = len(followed)
    until(lambda: len(followed) > count, lambda: both[1].publish(message))
    assert inputs.authority.holder == '/b'


def test_a_controller_follows_one_sender(make_node, spinner):
    controller, peers = make_node(Controller), [make_node(Node, name) for name in 'ab']
    spinner.add(controller, *peers)
    angles = create_publisher(peers[0], 'set_point')
    speeds = create_publisher(peers[1], 'cmd_vel')
    spinner.until(lambda: controller._refused['other_sender'], lambda: (
        angles.publish(set_point_message(to_time(0.0), 0.1)), speeds.publish(TwistStamped())))
    assert controller._set_points.authority.holder in ('/a', '/b')


def test_a_simulator_refuses_commands_of_two_publishers(make_node, spinner):
    simulator = make_node(Simulator, scene='flat', start_paused=True)
    peers = [make_node(Node, name) for name in 'ab']
    spinner.add(simulator, *peers)
    publishers = [create_publisher(peer, 'joint_commands') for peer in peers]
    spinner.until(lambda: simulator._gate.refused['several_publishers'], lambda: [
        publisher.publish(command_bytes(to_time(0.0), 1.0)) for publisher in publishers])
    accepted = simulator._gate.accepted
    for publisher in publishers:
        publisher.publish(command_bytes(to_time(0.0), 1.0))
    refused = sum(simulator._gate.refused.values())
    spinner.until(lambda: sum(simulator._gate.refused.values()) > refused)
    assert simulator._gate.accepted == accepted


def test_set_points_of_a_remapped_topic_are_left_to_its_other_subscriber(make_node, spinner):
    def give(given):
        raise MessageError('the laws are elsewhere', 'direct', 'control')
    node = make_node(partial(Node, cli_args=['--ros-args', '-r', 'set_point:=goal']), 'robot')
    refused, peer = Counter(), make_node(Node, 'peer')
    inputs = SetPoints(node, give, refused, unfollowed.append, steers=False)
    follow = partial(inputs._take, 'set_point', set_point, set_point_message(to_time(1.0), 0.25))
    follow()
    assert refused == {'direct': 1}
    peer.create_subscription(JointState, 'goal', unfollowed.append, 1)
    spinner.until(lambda: node.count_subscribers('goal') == 2)
    follow()
    assert refused == {'direct': 1}
