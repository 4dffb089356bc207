# SPDX-License-Identifier: Apache-2.0
"""The loop that the controller refuses diverges on real topics."""
from itertools import pairwise

import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ballbot_ros.control import load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros.conversions import readings
from ballbot_ros.ros.message_bytes import command_bytes


@pytest.fixture
def hold(spinner, make_node, gimball):
    """Return a function that holds 30 degrees by law (11) without the check of stability."""
    def run(rate, seconds):
        """Return torques and angles of the pendulum."""
        law = PendulumController(gimball, load_tuning('published'))
        law.give(SetPoint(Mode.HOLD, 0.5))
        torques, angles, stamps = [], [], [None]
        node = make_node(Node, 'law')
        publisher = node.create_publisher(JointState, 'joint_commands', 1)

        def answer(message):
            now = readings(message)
            if message.header.stamp != stamps[-1]:
                torques.append(law.torque(now))
                angles.append(now.pendulum_angle)
                stamps.append(message.header.stamp)
            publisher.publish(command_bytes(message.header.stamp, torques[-1]))

        node.create_subscription(JointState, 'joint_states', answer, 10)
        spinner.add(node, make_node(Simulator, scene='flat', lockstep=True, control_rate=rate,
                                    real_time_factor=0.0))
        spinner.until(lambda: len(torques) > seconds * rate)
        return torques, angles
    return run


def test_published_gains_oscillate_at_100_hertz(hold):
    torques, _ = hold(100.0, 1.0)
    late = torques[-50:]
    # Full torque in alternating directions, indefinitely.
    assert sum(abs(torque) == 4.0 for torque in late) > 15
    assert sum(before * after < 0.0 for before, after in pairwise(late)) > 15


def test_published_gains_settle_at_500_hertz(hold):
    torques, angles = hold(500.0, 1.0)
    assert max(map(abs, torques[-100:])) < 1.5
    assert angles[-1] == pytest.approx(0.5, abs=0.05)
    assert max(abs(after - before) for before, after in pairwise(torques[-100:])) < 0.01
