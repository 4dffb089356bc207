# SPDX-License-Identifier: Apache-2.0
"""Nodes in the process of the test, on a domain without other nodes."""
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.parameter import Parameter

from ballbot_ros.ros.rclpy_compat import new_executor

TIMEOUT = 120.0  # on a busy machine [s]


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
    """Give no node real-time priority, which would apply to all tests of the process."""
    monkeypatch.setattr('ballbot_ros.bridge.realtime.permits', lambda priority: False)


@pytest.fixture
def make_node(context):
    """Return a function that makes nodes with parameter overrides."""
    made = []

    def make(cls, *arguments, namespace='', **overrides):
        node = cls(*arguments, context=context, namespace=namespace, parameter_overrides=[
            Parameter(name, value=value) for name, value in overrides.items()])
        made.append(node)
        return node
    yield make
    for node in made:
        node.destroy_node()


class Spinner:
    """An executor, and a wait that processes its callbacks."""

    def __init__(self, context):
        self.executor = new_executor(context)

    def add(self, *nodes):
        for node in nodes:
            self.executor.add_node(node)

    def until(self, condition, act=lambda: None):
        """Return the result of a condition once it is true; call `act` before each spin."""
        deadline = time.monotonic() + TIMEOUT
        while not (found := condition()):
            assert time.monotonic() < deadline
            act()
            self.executor.spin_once(timeout_sec=0.01)
        return found


@pytest.fixture
def spinner(context, make_node):
    """Return a `Spinner`, which ends before the nodes of the test."""
    spinner = Spinner(context)
    yield spinner
    spinner.executor.shutdown()
