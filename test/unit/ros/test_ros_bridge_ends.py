# SPDX-License-Identifier: Apache-2.0
"""However a bridge ends, its last message reports its e-stop as engaged."""
import pytest
from rclpy.node import Node
from std_msgs.msg import Bool
from tiers import slow

from ballbot_ros.bridge.supervisor import StopReason
from ballbot_ros.nodes.bridge.node import Bridge
from ballbot_ros.ros import qos


@pytest.fixture
def bridge(make_node, tmp_path):
    """Return a bridge without a drive whose e-stop is released."""
    node = make_node(Bridge, autostart=False, black_box='', port=str(tmp_path / 'nowhere'))
    node._session.supervisor.reset(100.0)
    node._monitor()
    return node


@pytest.fixture
def received_late(make_node, spinner):
    """Return a function that returns the value that a new subscriber receives."""
    def receive():
        peer, received = make_node(Node, 'late'), []
        peer.create_subscription(Bool, 'e_stop', received.append, qos.LATCHED)
        spinner.add(peer)
        return spinner.until(lambda: received)[-1].data
    return receive


def test_a_released_e_stop_is_published_as_released(bridge, received_late):
    assert received_late() is False


@pytest.mark.parametrize('end', [*slow('shutdown', 'cleanup'), 'error'])
def test_after_shutdown_cleanup_and_an_error_the_e_stop_is_published_as_engaged(
        bridge, received_late, end):
    if end == 'error':
        def fail():
            raise RuntimeError('an unexpected error')
        bridge._session.configure = fail
        bridge.trigger_configure()
    else:
        getattr(bridge, f'on_{end}')(None)
    assert received_late() is True
    assert bridge._session.supervisor.e_stop.reason is StopReason.CLOSED
    bridge._monitor()
    assert received_late() is True
