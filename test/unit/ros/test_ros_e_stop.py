# SPDX-License-Identifier: Apache-2.0
"""A stop request on the topic `e_stop` reaches every node for any QoS of its publisher."""
import time

import pytest
from rclpy.node import Node
from std_msgs.msg import Bool
from tiers import pairs

from ballbot_ros.bridge.session import Wanted
from ballbot_ros.errors import RefusedError
from ballbot_ros.nodes.bridge.inputs import RELEASE_DELAY
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros import qos
from ballbot_ros.ros.endpoints import mismatches

NODES = {
    Simulator: ({'control': 'onboard', 'start_paused': True},
                lambda node: node._laws._controller.e_stop),
    Controller: ({}, lambda node: node._controller.e_stop),
    ObstacleDecision: ({'planner': 'cubic'}, lambda node: node._standstill.engaged),
    Bridge: ({'autostart': False, 'black_box': '', 'port': '/dev/none'},
             lambda node: bool(node._session.supervisor.e_stop))}


@pytest.mark.parametrize('cls, profile', pairs(list(NODES), [qos.LATEST, qos.LATCHED]))
def test_a_stop_request_of_any_publisher_engages_the_e_stop(cls, profile, make_node, spinner):
    parameters, is_engaged = NODES[cls]
    node, person = make_node(cls, **parameters), make_node(Node, 'person')
    if cls is Bridge:
        node._session.supervisor.reset(100.0)
    publisher = person.create_publisher(Bool, 'e_stop', profile)
    spinner.add(node)
    assert not is_engaged(node)
    spinner.until(lambda: is_engaged(node), lambda: publisher.publish(Bool(data=True)))
    assert not mismatches(node)
    getattr(node, 'make_safe', lambda: None)()


def test_a_release_that_was_requested_before_the_e_stop_engaged_is_refused(make_node):
    node = make_node(Bridge, **NODES[Bridge][0])
    session, inputs, outputs = node._session, node._inputs, node._outputs
    session._wanted, session._inhibit = Wanted.ACTIVE, lambda: ('', '')
    time.sleep(1.1 * RELEASE_DELAY)
    inputs._on_e_stop(True)  # its own message from the start
    assert inputs._release() and not session.supervisor.e_stop
    outputs.publish_e_stop(False)
    session.engage('test')
    outputs.publish_e_stop(True)
    with pytest.raises(RefusedError):
        inputs._release()
    assert session.supervisor.e_stop.text == 'test'
    time.sleep(1.1 * RELEASE_DELAY)
    inputs._on_e_stop(True)  # its own message, which takes less time
    assert inputs._release() and not session.supervisor.e_stop
    session.close()
