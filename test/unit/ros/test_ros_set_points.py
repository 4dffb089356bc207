# SPDX-License-Identifier: Apache-2.0
"""Two that ask for motion on board: one is followed, the other is told."""
from collections import Counter
import time

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.control import Mode
from ballbot_ros.ros.conversions import set_point_message, to_time
from ballbot_ros.ros.executor import new_executor
from ballbot_ros.ros.set_points import SetPoints

# What was asked for and is not followed.
overheard = []


@pytest.fixture
def robot(make_node, context):
    """Return what is followed, what is refused, two peers, and a function that lets time pass."""
    node, peers = make_node(Node, 'robot'), [make_node(Node, name) for name in 'ab']
    followed, refused = [], Counter()
    overheard.clear()
    inputs = SetPoints(node, followed.append, refused, overhear=overheard.append)
    executor = new_executor(context)
    for one in (node, *peers):
        executor.add_node(one)

    def until(condition, act):
        deadline = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < deadline
            act()
            executor.spin_once(timeout_sec=0.01)
    yield inputs, followed, refused, peers, until
    executor.shutdown()


def test_the_first_is_followed_until_it_is_silent_for_long_enough(robot):
    inputs, followed, refused, (a, b), until = robot
    angles = a.create_publisher(JointState, 'set_point', 1)
    speeds = b.create_publisher(TwistStamped, 'cmd_vel', 1)
    ask = [lambda: angles.publish(set_point_message(to_time(1.0), 0.25, '/a#1')),
           lambda: speeds.publish(TwistStamped())]
    until(lambda: followed, ask[0])
    until(lambda: refused['other_sender'] > 3, lambda: (ask[0](), ask[1]()))
    assert {one.mode for one in followed} == {Mode.HOLD}
    assert inputs.authority.holder == '/a#1'
    assert inputs.authority.contest.startswith('/b commands, too')
    # It asks for motion all the same, and no e-stop is released meanwhile.
    assert {one.mode for one in overheard} == {Mode.SPEED}
    until(lambda: followed[-1].mode is Mode.SPEED, ask[1])
    assert inputs.authority.holder == '/b'


def test_a_twist_without_a_stamp_is_followed_where_that_was_asked_for(make_node, context):
    node, peer = make_node(Node, 'robot'), make_node(Node, 'teleop')
    followed, refused, executor = [], Counter(), new_executor(context)
    SetPoints(node, followed.append, refused, 'twist')
    speeds = peer.create_publisher(Twist, 'cmd_vel', 1)
    executor.add_node(node)
    deadline, turn = time.monotonic() + 20.0, Twist()
    turn.angular.z = 0.5
    while not (followed and refused['other_axes']):
        assert time.monotonic() < deadline
        speeds.publish(turn if followed else Twist())
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    assert {(one.mode, one.value, one.stamp) for one in followed} == {(Mode.SPEED, 0.0, 0.0)}
