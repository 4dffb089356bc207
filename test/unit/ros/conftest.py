# SPDX-License-Identifier: Apache-2.0
"""Nodes in the process of the test, on a domain without other nodes."""
import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter


@pytest.fixture(scope='session')
def context():
    """Return a ROS context."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
        context = Context()
        rclpy.init(context=context, domain_id=232)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture(autouse=True)
def ordinary_priority(monkeypatch):
    """Give no node real-time priority: it would be that of the whole test process."""
    monkeypatch.setattr('ballbot_ros.bridge.realtime.permits', lambda priority: False)


@pytest.fixture
def make_node(context):
    """Return a function that makes nodes with parameter overrides."""
    made = []

    def make(cls, *arguments, **overrides):
        node = cls(*arguments, context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in overrides.items()])
        made.append(node)
        return node
    yield make
    for node in made:
        node.destroy_node()
