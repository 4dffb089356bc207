# SPDX-License-Identifier: Apache-2.0
"""Who sent a message, when messages do not say it."""
from types import SimpleNamespace

import pytest

from ballbot_ros.errors import MessageError
from ballbot_ros.ros import senders
from ballbot_ros.ros.senders import own_name, Senders


class Graph:
    """What a node tells of its graph."""

    def __init__(self):
        self.nodes = []

    def count_publishers(self, topic):
        return len(self.nodes)

    def get_publishers_info_by_topic(self, topic):
        return [SimpleNamespace(node_namespace='/', node_name=name) for name in self.nodes]

    def get_fully_qualified_name(self):
        return '/controller'


@pytest.fixture
def graph(monkeypatch):
    """Return a graph whose time only the test moves."""
    graph = Graph()
    graph.now = 100.0
    monkeypatch.setattr(senders, 'time', SimpleNamespace(monotonic=lambda: graph.now))
    return graph


def test_a_node_has_another_name_than_a_second_one_of_the_same_name(graph):
    assert own_name(graph) != own_name(graph)
    assert own_name(graph).startswith('/controller#')


def test_the_name_in_a_message_counts_whoever_else_publishes(graph):
    graph.nodes = ['a', 'b', 'c']
    assert Senders(graph, 'joint_commands').name('a#1') == 'a#1'


def test_a_frame_is_no_name(graph):
    graph.nodes = ['a', 'b']
    with pytest.raises(MessageError):
        Senders(graph, 'joint_commands').name('base_link')


def test_of_one_publisher_no_name_is_needed(graph):
    graph.nodes = ['a']
    assert Senders(graph, 'joint_commands').name('') == '/a'


@pytest.mark.parametrize('nodes', [[], ['_NODE_NAME_UNKNOWN_']])
def test_who_is_not_known_yet_has_no_name(graph, nodes):
    graph.nodes = nodes
    assert Senders(graph, 'joint_commands').name('') == ''


def test_several_without_a_name_are_refused_by_the_names_of_their_nodes(graph):
    found = Senders(graph, 'joint_commands')
    graph.nodes = ['a']
    found.name('')
    graph.nodes = ['a', 'b']
    graph.now += 0.03
    with pytest.raises(MessageError, match='/a and /b publish joint_commands') as raised:
        found.name('')
    assert raised.value.reason == 'no_name'
    graph.nodes = ['b']
    graph.now += 0.03
    assert found.name('') == '/b'
    graph.nodes = ['c']
    graph.now += 1.1
    assert found.name('') == '/c'


def test_one_without_a_name_is_known_beside_those_with_one(graph):
    found = Senders(graph, 'joint_commands')
    graph.nodes = ['a', 'b']
    assert found.name('a#1') == 'a#1'
    assert found.name('') not in ('', 'a#1')
    graph.now += 1.5  # the one with a name has not been there for long: who knows
    with pytest.raises(MessageError):
        found.name('')
