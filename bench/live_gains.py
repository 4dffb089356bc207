# SPDX-License-Identifier: Apache-2.0
"""Measure the effect of a change of gains on the period and torque of the running loop."""
from pathlib import Path
import tempfile
import time

import numpy as np
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from round_trip import joined
from sensor_msgs.msg import JointState

from ballbot_ros.demo.processes import NodeProcesses, own_domain
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import to_seconds

START_TIMEOUT = 120.0  # timeout for the start of the loop and for a change [s]
WINDOW = 6.0  # wall time without a change [s]
ANGLE = 0.5  # of the held pendulum [rad]
GAINS = (30.0, 40.0, 30.0)  # position_kp, one after the other [N m/rad]


class Bench(Node):
    """Hold the pendulum, change gains, and record each command."""

    def __init__(self):
        super().__init__('bench')
        self.commands = []  # wall time of arrival, stamp [s], torque [N m]
        self.create_subscription(JointState, 'joint_commands', self._note, qos.STATE)
        self._set_points = self.create_publisher(JointState, 'set_point', qos.LATEST)
        self.create_timer(0.05, lambda: self._set_points.publish(
            JointState(name=['pendulum'], position=[ANGLE])))
        self.client = self.create_client(SetParameters, 'controller/set_parameters')

    def _note(self, message):
        self.commands.append((time.perf_counter(), to_seconds(message.header.stamp),
                              message.effort[0]))

    def change(self, gain):
        """Request a gain; return the future of the response."""
        return self.client.call_async(SetParameters.Request(parameters=[
            Parameter('gains.position_kp', value=gain).to_parameter_msg()]))


def figures(commands):
    """Return p99 of the periods [ms], unanswered states [%], and the largest torque step [N m]."""
    pairs = list(zip(commands, commands[1:]))
    periods = [1e3 * (after[0] - before[0]) for before, after in pairs]
    states = round((commands[-1][1] - commands[0][1]) / 0.002)
    lost = 100.0 * max(0.0, 1.0 - len({stamp for _, stamp, _ in commands}) / (states + 1))
    return np.quantile(periods, 0.99), lost, max(abs(b[2] - a[2]) for a, b in pairs)


def watch():
    """Return the figures without and during changes, and the duration of each change [s]."""
    domain = own_domain()

    def spin_until(condition, timeout):
        deadline = time.perf_counter() + timeout
        while not condition() and time.perf_counter() < deadline:
            executor.spin_once(timeout_sec=0.05)

    with joined(domain, Bench) as (executor, node), tempfile.TemporaryDirectory() as folder, \
            NodeProcesses(Path(folder), domain) as nodes:
        nodes.start('simulator', {'scene': 'flat'})
        nodes.start('controller')
        spin_until(lambda: len(node.commands) > 1000 and node.client.service_is_ready(),
                   START_TIMEOUT)
        node.commands.clear()
        spin_until(lambda: False, WINDOW)
        quiet = figures(node.commands)
        node.commands.clear()
        took = []
        for gain in GAINS:
            start, answer = time.perf_counter(), node.change(gain)
            spin_until(answer.done, START_TIMEOUT)
            took.append(time.perf_counter() - start)
            refused = [one.reason for one in answer.result().results if not one.successful]
            if refused:
                raise RuntimeError(refused[0])
            spin_until(lambda: False, 0.5)  # until the gains are in effect
        return quiet, figures(node.commands), took


def measure():
    quiet, busy, took = watch()
    for number, (name, unit, target) in enumerate((
            ('p99 period', 'ms', 4.0), ('states without an answer', '%', None),
            ('largest step of torque', 'N m', 0.1))):
        yield f'loop at 500 Hz, {name}', unit, [quiet[number]], None
        yield f'while gains are checked and change, {name}', unit, [busy[number]], target
    yield 'from the request until they are in force', 's', took, None
