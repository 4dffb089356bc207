# SPDX-License-Identifier: Apache-2.0
"""Delivery of messages: quality of service, late subscribers, namespaces."""
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from ballbot_ros.msg import BallState, StepDecision, TerrainObservation
from ballbot_ros.ros import qos

BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_subscribers_with_weaker_qos_receive_and_mismatches_are_logged_by_name(graph):
    received = {topic: graph.subscribe(topic, kind, BEST_EFFORT) for topic, kind in (
        ('joint_states', JointState), ('ball_state', BallState),
        ('terrain_observation', TerrainObservation), ('/clock', Clock))}
    graph.node.create_publisher(JointState, 'joint_commands', BEST_EFFORT)
    graph.subscribe('odom', Odometry, LATCHED)
    graph.start('simulator', scene='flat')
    graph.wait(lambda: all(received.values()), 'all messages arrive')
    graph.wait_for_log('simulator', '/simulator cannot receive /joint_commands from /test')
    graph.wait_for_log('simulator', '/test cannot receive /odom from /simulator')


def test_a_late_subscriber_still_receives_the_last_decision(graph):
    early = graph.subscribe('step_decision', StepDecision)
    graph.start('obstacle_decision')
    graph.start('simulator', start_paused=True)
    graph.wait_until_connected(early)
    assert graph.end('simulator') == 0
    late = graph.subscribe('step_decision', StepDecision, qos.LATCHED)
    graph.wait(lambda: late, 'the late subscriber receives it')
    # As text, because NaN is not equal to itself.
    assert list(map(str, late)) == list(map(str, early[-1:]))
    assert late[0].height > 0.0


def test_nodes_in_a_namespace_connect_and_share_the_global_clock(graph):
    place = ('--ros-args', '-r', '__ns:=/left')
    states = graph.subscribe('left/ball_state', BallState)
    clocks = graph.subscribe('/clock', Clock)
    graph.start('controller', *place)
    graph.start('obstacle_decision', *place)
    graph.start('simulator', *place)
    graph.wait(lambda: clocks and states and states[-1].velocity_x > 0.02, 'the ball is driven')
    names = dict(graph.node.get_topic_names_and_types())
    assert '/left/joint_states' in names and '/joint_states' not in names
    assert '/left/clock' not in names
    graph.wait(lambda: {'left/simulator', 'left/controller', 'left/obstacle_decision'}
               <= graph.statuses.keys(), 'all publish their health')
    assert graph.node.count_publishers('/left/step_decision') == 1
