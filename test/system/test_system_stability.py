# SPDX-License-Identifier: Apache-2.0
"""The loop that the controller refuses diverges on real topics."""
from itertools import pairwise

import pytest
from sensor_msgs.msg import JointState

from ballbot_ros.control import load_tuning, Mode, PendulumController, SetPoint
from ballbot_ros.ros.conversions import readings
from ballbot_ros.ros.message_bytes import command_bytes


def hold(graph, gimball, rate, seconds):
    """Hold 30 degrees by law (11) without the check of stability; return the recorded values."""
    law = PendulumController(gimball, load_tuning('published'))
    law.give(SetPoint(Mode.HOLD, 0.5))
    torques, angles, states = [], [], []
    publisher = graph.node.create_publisher(JointState, 'joint_commands', 1)

    def answer(message):
        now = readings(message)
        if not states or message.header.stamp != states[-1].header.stamp:
            torques.append(law.torque(now))
            angles.append(now.pendulum_angle)
        states.append(message)
        publisher.publish(command_bytes(message.header.stamp, torques[-1]))

    graph.subscribe('joint_states', JointState, callback=answer)
    graph.start('simulator', scene='flat', lockstep=True, control_rate=rate,
                real_time_factor=0.0, start_paused=True)
    graph.wait_until_connected(states)
    graph.wait_for_time(states, graph.step(round(seconds * rate)))
    return torques, angles


def test_published_gains_oscillate_at_100_hertz(graph, gimball):
    torques, _ = hold(graph, gimball, 100.0, 1.0)
    late = torques[-50:]
    # Full torque in alternating directions, indefinitely.
    assert sum(abs(torque) == 4.0 for torque in late) > 15
    assert sum(before * after < 0.0 for before, after in pairwise(late)) > 15


def test_published_gains_settle_at_500_hertz(graph, gimball):
    torques, angles = hold(graph, gimball, 500.0, 1.0)
    assert max(map(abs, torques[-100:])) < 1.5
    assert angles[-1] == pytest.approx(0.5, abs=0.05)
    assert max(abs(after - before) for before, after in pairwise(torques[-100:])) < 0.01
