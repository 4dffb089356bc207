# SPDX-License-Identifier: Apache-2.0
"""The publisher of commands is found in the graph, and two publishers are refused."""
from types import SimpleNamespace

import pytest
from rclpy.node import Node
from refusals import refused

from ballbot_ros.errors import MessageError
from ballbot_ros.msg import StepObservation
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.ros import single_publisher
from ballbot_ros.ros.single_publisher import RESTART_TIME, SinglePublisher


class Graph:
    """The publishers of one topic as seen by a node."""

    def __init__(self):
        self.nodes, self.now, self.queries = [], 100.0, 0

    def resolve_topic_name(self, topic):
        return f'/arm/{topic}'  # remapped, unlike the queries

    def get_fully_qualified_name(self):
        return '/observer'

    def count_publishers(self, topic):
        return len(self.nodes) if topic.startswith('/arm/') else 0

    def get_publishers_info_by_topic(self, topic):
        self.queries += 1
        return [SimpleNamespace(node_namespace='/', node_name=name)
                for name in self.nodes[:self.count_publishers(topic)]]


@pytest.fixture
def graph(monkeypatch):
    """Return a graph with a simulated clock."""
    graph = Graph()
    monkeypatch.setattr(single_publisher, 'time', SimpleNamespace(monotonic=lambda: graph.now))
    return graph


def test_the_only_publisher_is_named(graph):
    graph.nodes = ['a']
    found = SinglePublisher(graph, 'joint_commands')
    for _ in range(10):
        assert found.name() == '/a'
        graph.now += 0.05
    assert graph.queries == 1  # the count of publishers, which is cheaper, has not changed


@pytest.mark.parametrize('nodes', [[], ['_NODE_NAME_UNKNOWN_']])
def test_a_publisher_that_is_not_discovered_yet_has_no_name(graph, nodes):
    graph.nodes = nodes
    assert SinglePublisher(graph, 'joint_commands').name() == ''


def test_two_publishers_are_refused_by_name_until_one_ends(graph):
    found = SinglePublisher(graph, 'joint_commands')
    graph.nodes = ['a']
    found.name()
    graph.nodes = ['a', 'b']
    graph.now += 0.03
    with refused('several_publishers', '/arm/joint_commands', MessageError) as caught:
        found.name()
    assert str(caught.value).startswith('/a and /b publish /arm/joint_commands')
    graph.nodes = ['b']
    graph.now += 0.03
    assert found.name() == '/b'
    graph.nodes = ['c']
    graph.now += 1.1
    assert found.name() == '/c'


@pytest.mark.parametrize('killed', ['a', '_NODE_NAME_UNKNOWN_'])
def test_a_node_that_is_killed_and_restarted_is_followed(graph, killed):
    found = SinglePublisher(graph, 'joint_commands')
    graph.nodes = ['a', killed]  # the killed one is in the graph until its lease ends
    for _ in range(3):
        assert found.name() == '/a'
        graph.now += 0.3 * RESTART_TIME
    graph.now += 0.2 * RESTART_TIME
    with refused('several_publishers', '/arm/joint_commands'):
        found.name()


def test_a_second_publisher_is_refused_once_its_node_is_discovered(graph):
    found = SinglePublisher(graph, 'joint_commands')
    graph.nodes = ['a', '_NODE_NAME_UNKNOWN_']
    assert found.name() == '/a'
    graph.nodes = ['a', 'b']
    graph.now += 0.03
    with refused('several_publishers', '/arm/joint_commands', MessageError) as caught:
        found.name()
    assert str(caught.value).startswith('/a and /b publish /arm/joint_commands')


def test_a_second_publisher_with_the_name_of_the_observing_node_is_refused_immediately(graph):
    found = SinglePublisher(graph, 'joint_commands')
    graph.nodes = ['observer']
    assert found.name() == '/observer'
    graph.nodes = ['observer', 'observer']
    graph.now += 0.03
    with refused('several_publishers', '/arm/joint_commands', MessageError):
        found.name()


def test_a_decision_uses_no_observations_of_two_nodes_and_names_both(make_node, monkeypatch):
    monkeypatch.setattr(single_publisher, 'COUNT_PERIOD', 0.0)
    decision, answers = make_node(ObstacleDecision, planner='cubic'), []
    decision._decider.observe = answers.append
    decision._on_observation('step_observation', StepObservation())
    assert len(answers) == 1
    sensors = [make_node(Node, name) for name in ('sensor_1', 'sensor_2')]
    for sensor in sensors:
        sensor.create_publisher(StepObservation, 'step_observation', 1)
    while decision.count_publishers('step_observation') < 2:
        pass
    message = StepObservation()
    message.header.stamp.sec = 1
    decision._on_observation('step_observation', message)
    assert len(answers) == 1
    assert '/sensor_1 and /sensor_2' in decision._health()[1]
    decision.make_safe()
