# SPDX-License-Identifier: Apache-2.0
"""Without a subscriber no message is made, but a later repetition makes it."""
from nav_msgs.msg import Odometry
import pytest
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from ballbot_ros.msg import BallState
from ballbot_ros.nodes.simulator import outputs
from ballbot_ros.nodes.simulator.outputs import Outputs
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import Plant
from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import create_subscription

MADE = {'ball_state_message': BallState, 'odometry_message': Odometry}


@pytest.fixture
def run(make_node, monkeypatch):
    """Return outputs, their plant, a record of the messages made, and a node for subscriptions."""
    made = []
    for name in MADE:
        original = getattr(outputs, name)
        monkeypatch.setattr(outputs, name, lambda state, *rest, make=original, name=name: (
            made.append((name, state.time)), make(state, *rest))[1])
    plant = Plant(load_scene('flat'), 500.0)
    return (Outputs(make_node(Node, 'simulator'), plant, SimulatorSettings()), plant, made,
            make_node(Node, 'listener'))


@pytest.fixture
def listen(run, spinner):
    """Return a function that subscribes to a topic and returns a getter of its messages."""
    node = run[-1]
    spinner.add(node)

    def subscribe(kind, topic):
        found = []
        create_subscription(node, topic, found.append, kind, qos.STATE)
        spinner.until(lambda: node.count_publishers(topic))
        return lambda: spinner.until(lambda: found)
    return subscribe


def test_without_a_subscriber_no_message_is_made(run):
    published, plant, made, _ = run
    for _ in range(50):
        published.publish()
        plant.advance(0.0)
    published.publish(everything=True)
    assert not made


@pytest.mark.parametrize('kind, topic', [(BallState, 'ball_state'), (Odometry, 'odom')])
def test_a_message_is_made_only_for_a_subscriber(run, listen, kind, topic):
    published, plant, made, _ = run
    receive = listen(kind, topic)
    published.publish(everything=True)
    found = receive()
    assert [(MADE[name], stamp) for name, stamp in made] == [(kind, 0.0)]
    assert len(found) == 1


def test_a_message_that_was_not_made_is_repeated_with_its_stamp(run, listen):
    published, plant, made, _ = run
    published.publish(everything=True)
    for _ in range(3):  # odometry is due each fifth period
        plant.advance(0.0)
        published.publish()
    receive = listen(Odometry, 'odom')
    published.repeat()
    assert [one.header.stamp.nanosec for one in receive()] == [0]
    assert made[-1] == ('odometry_message', 0.0)


def test_a_subscriber_of_the_clock_receives_it(run, listen):
    published, plant, *_ = run
    receive = listen(Clock, '/clock')
    plant.advance(0.0)
    published.publish(everything=True)
    assert [(one.clock.sec, one.clock.nanosec) for one in receive()] == [(0, 2000000)]
