# SPDX-License-Identifier: Apache-2.0
"""Name, hardware ID and stamp of a diagnostic status."""
from types import SimpleNamespace

import pytest

from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import to_time


@pytest.fixture
def published(monkeypatch):
    """Return the messages published on /diagnostics."""
    found = []
    monkeypatch.setattr(diagnostics, 'create_publisher', lambda node, topic: (
        SimpleNamespace(publish=found.append)))
    return found


def test_two_robots_differ_in_name_and_hardware_id(make_node, published):
    for namespace, robot in (('left', 'gimball'), ('right', 'shellball')):
        make_node(Simulator, namespace=namespace, start_paused=True,
                  robot=robot)._diagnostics.publish()
    found = [array.status[0] for array in published]
    assert [one.hardware_id for one in found] == ['left/gimball', 'right/shellball']
    assert [one.name for one in found] == [
        'left/simulator: simulation', 'right/simulator: simulation']


def test_the_health_of_a_simulation_has_the_stamp_of_simulated_time(make_node, published):
    node = make_node(Simulator, start_paused=True, scene='flat')
    node._plant.advance(0.0)
    node._diagnostics.publish()
    assert published[-1].header.stamp == to_time(node._plant.time) == to_time(0.002)
