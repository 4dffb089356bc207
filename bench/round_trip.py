# SPDX-License-Identifier: Apache-2.0
"""
Time the round trip of a joint state and a joint command through rclpy alone.

This is the lower bound of lockstep.  The messages are Python objects, or serialized bytes that are
not parsed, exchanged between two processes or within one.
"""
from contextlib import contextmanager
import subprocess
import sys
import time

from builtin_interfaces.msg import Time
import rclpy
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from ballbot_ros.demo.processes import own_domain
from ballbot_ros.ros.endpoints import create_publisher, create_subscription
from ballbot_ros.ros.frames import JOINTS
from ballbot_ros.ros.rclpy_compat import new_executor

WINDOW = 2.0  # [s]
REPEATS = 3


def state_message():
    """Return a joint state as the simulator publishes it."""
    message = JointState(name=JOINTS, position=[0.1, 0.2], velocity=[0.3, 0.4], effort=[0.0, 0.5])
    message.header.stamp, message.header.frame_id = Time(sec=1, nanosec=2000000), 'base_link'
    return message


def answering(name, input_topic, output_topic, make, raw):
    """Return a node that replies to each message and counts them."""
    node, ready = Node(name), bytes(serialize_message(make()))
    topic = create_publisher(node, output_topic)
    node.count = 0
    node.send = lambda: topic.publish(ready if raw else make())

    def answer(_):
        node.count += 1
        node.send()
    create_subscription(node, input_topic, answer, raw=raw)
    return node


def commander(raw):
    """Return a substitute for the controller."""
    return answering('commander', 'joint_states', 'joint_commands',
                     lambda: JointState(name=['pendulum'], effort=[0.5]), raw)


@contextmanager
def joined(domain, *makers):
    """Yield an executor and the nodes of `makers` on a ROS domain."""
    rclpy.init(domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    nodes, executor = [make() for make in makers], new_executor()
    for node in nodes:
        executor.add_node(node)
    try:
        yield executor, *nodes
    finally:
        for node in nodes:
            executor.remove_node(node)
            node.destroy_node()
        rclpy.try_shutdown()


def times_real_time(apart, raw):
    """Return the number of round trips in 2 ms, between two processes or within one."""
    domain, makers, other = own_domain(), [lambda: answering(
        'robot', 'joint_commands', 'joint_states', state_message, raw)], None
    if not apart:
        makers.append(lambda: commander(raw))
    with joined(domain, *makers) as (executor, node, *_):
        try:
            if apart:
                other = subprocess.Popen([sys.executable, __file__, str(domain), str(int(raw))])
            while not node.count:
                node.send()
                executor.spin_once(timeout_sec=0.2)
            spin(executor, 0.5)
            before, begin = node.count, time.perf_counter()
            spin(executor, WINDOW)
            return (node.count - before) / (time.perf_counter() - begin) / 500.0
        finally:
            if other is not None:
                other.kill()
                other.wait()


def spin(executor, duration):
    """Serve callbacks for a time [s]."""
    end = time.perf_counter() + duration
    while time.perf_counter() < end:
        executor.spin_once(timeout_sec=0.05)


def measure():
    for apart in (True, False):
        for raw in (False, True):
            yield (f'bare rclpy, {"bytes" if raw else "messages"}, '
                   f'{"two processes" if apart else "one process"}', 'x',
                   [times_real_time(apart, raw) for _ in range(REPEATS)], None)


def main():
    """Run the second process until it is killed."""
    with joined(int(sys.argv[1]), lambda: commander(sys.argv[2] == '1')) as (executor, _):
        while True:
            executor.spin_once(timeout_sec=1.0)


if __name__ == '__main__':
    main()
