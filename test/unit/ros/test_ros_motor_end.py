# SPDX-License-Identifier: Apache-2.0
"""The last status of a bridge."""
from types import SimpleNamespace

import pytest
from rclpy.node import Node

from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.motor import Clocks, MotorOutputs
from ballbot_ros.ros import qos


@pytest.mark.parametrize('unconfirmed', ['', 'the stop was not confirmed: the cable is out'])
@pytest.mark.parametrize('state', [MotorStatus.STATE_OFF, MotorStatus.STATE_ENDED])
def test_the_last_status_is_received_and_names_an_unconfirmed_stop(
        make_node, spinner, state, unconfirmed):
    node, peer = make_node(Node, 'bridge'), make_node(Node, 'peer')
    received = []
    peer.create_subscription(MotorStatus, 'motor_status', received.append, qos.STATE)
    outputs = MotorOutputs(node, Clocks(), 10.0, 0.0)
    spinner.add(peer)
    spinner.until(lambda: node.count_subscribers('motor_status'))
    outputs.publish_end(state, SimpleNamespace(
        law=SimpleNamespace(),
        supervisor=SimpleNamespace(e_stop=EStop(StopReason.REQUESTED, 'asked for')),
        control=SimpleNamespace(unconfirmed=unconfirmed)))
    last, = spinner.until(lambda: received)
    assert (last.state, last.torque, last.e_stop, last.e_stop_reason) == (
        state, 0.0, 'asked for', 'requested')
    assert last.control == MotorStatus.CONTROL_ONBOARD
    assert list(last.warnings) == ([unconfirmed] if unconfirmed else [])
