# SPDX-License-Identifier: Apache-2.0
"""A lifecycle node survives all requests, and starts by itself unless a request came first."""
import random

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.node import Node

from ballbot_ros.ros.lifecycle import FAILURE, ManagedNode, SUCCESS

# Transitions that a client may request, except shutdown, and invalid ones.
TRANSITIONS = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP,
               Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE,
               Transition.TRANSITION_DESTROY, Transition.TRANSITION_ON_CONFIGURE_SUCCESS, 99)


class Machine(ManagedNode):
    """A node that configures only with a drive."""

    drive = True

    def on_configure(self, state):
        return SUCCESS if self.drive else FAILURE


@pytest.fixture
def machine(make_node, spinner):
    """Return a node, and a function that requests a transition and returns its success."""
    node, peer = make_node(Machine, 'machine'), make_node(Node, 'peer')
    spinner.add(node, peer)
    client = peer.create_client(ChangeState, 'machine/change_state')
    assert client.wait_for_service(10.0)

    def ask(number, label=''):
        future = client.call_async(
            ChangeState.Request(transition=Transition(id=number, label=label)))
        spinner.until(future.done)
        return future.result().success
    return node, ask


def test_a_node_survives_three_hundred_random_transitions(machine):
    node, ask = machine
    choose = random.Random(1)
    assert 30 < sum(ask(choose.choice(TRANSITIONS)) for _ in range(300)) < 200
    assert node.state_label in ('unconfigured', 'inactive', 'active')
    assert not ask(0, 'no such label')


def test_a_refusal_names_the_possible_transitions(machine, capfd):
    node, ask = machine
    assert not ask(Transition.TRANSITION_ACTIVATE)
    assert ask(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert not ask(Transition.TRANSITION_CONFIGURE)
    printed = capfd.readouterr().err
    assert ('activate is not possible: the node is unconfigured, with the transitions '
            'configure, shutdown') in printed
    assert 'configure is not possible: the node is finalized, with the transitions none' \
        in printed


def test_a_node_starts_by_itself_as_soon_as_possible(machine):
    node, _ = machine
    node.drive = False
    node.autostart()
    assert node.state_label == 'unconfigured'
    node.drive = True
    node._try_start()
    assert node.state_label == 'active'


def test_a_partial_start_is_completed(machine):
    node, _ = machine
    assert node.trigger_configure() is SUCCESS
    assert node.start() and node.state_label == 'active'


@pytest.mark.parametrize('asked, left', [
    (Transition.TRANSITION_CONFIGURE, 'inactive'),
    (Transition.TRANSITION_UNCONFIGURED_SHUTDOWN, 'finalized')])
def test_a_request_for_a_state_ends_the_autostart(machine, asked, left):
    node, ask = machine
    node.drive = False
    node.autostart()
    node.drive = True
    assert ask(asked)
    node._try_start()
    assert node.state_label == left and node._retries.is_canceled()


def test_a_failed_request_does_not_end_the_autostart(machine):
    node, ask = machine
    node.drive = False
    node.autostart()
    assert not ask(Transition.TRANSITION_ACTIVATE)
    node.drive = True
    node._try_start()
    assert node.state_label == 'active'
