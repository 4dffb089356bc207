# SPDX-License-Identifier: Apache-2.0
"""The demo over a serial line: an emulated drive, the bridge with its laws, the decision."""
from collections import deque
import math
import os
from pathlib import Path
import sys
import time
from typing import Any, Deque, Dict, List, Mapping

from rclpy.node import Node
from std_srvs.srv import Trigger

from ballbot_ros.bags.metadata import bag_metadata, BRIDGE
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.config.files import shipped_files
from ballbot_ros.demo.demo import CURVE, run_case, TOOL_TOPICS, TOPICS, TWO_STEPS
from ballbot_ros.demo.forked import import_nodes
from ballbot_ros.demo.prepare import prepare
from ballbot_ros.demo.processes import own_domain
from ballbot_ros.demo.recorded_graph import Actions, recorded_graph
from ballbot_ros.demo.timeline import Timeline
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.ros.endpoints import create_subscription

TUNING = BridgeSettings.tuning  # stable with a sample of delay and an estimated angle
MORE_TOPICS = ('imu', 'motor_status')
# Wall time between two calls of a service [s].
CALL_PERIOD = 0.3
# Timeout of a service that refuses repeatedly [s].
REFUSAL_TIMEOUT = 20.0


def run_hardware_demo(out: Path, protocol: str, firmware: str = '', serial_imu: bool = False,
                      quiet: bool = False, timeout: float = 60.0) -> int:
    """
    Run the demo with two steps, and the motor on an emulated serial port.

    The firmware is a generation, empty for the only or oldest one; with `serial_imu` a node imu
    reads the IMU from another serial port.  `timeout` limits the wall time without a new state,
    and that of the run [s].  Returns 0 if the robot crossed the first step and came to rest before
    the second, 1 if not.
    """
    # A separate file confirms the values that the emulated drive does not report.
    shipped = {path.stem for path in shipped_files('hardware')}
    name = f'gimball_{protocol}'
    hardware = load_hardware(f'{name}_emulated' if f'{name}_emulated' in shipped else name)

    def play(folder: Path, timeline: Timeline) -> List[str]:
        # Absolute, since nodes may run in another folder.
        link = str((folder / 'motor').resolve())
        imu = str((folder / 'imu').resolve()) if serial_imu else ''
        bridge = {'hardware': hardware.name, 'port': link, 'tuning': TUNING}
        decision = {'curve': CURVE, 'control_tuning': TUNING,
                    'largest_swing': hardware.limits.angle_limit}
        metadata = bag_metadata(BRIDGE, bridge, decision=decision)
        nodes: Dict[str, Mapping[str, Any]] = {
            'emulated_robot': {
                'hardware': hardware.name, 'firmware': firmware, 'scene': TWO_STEPS.scene,
                'link': link, 'imu_link': imu},
            **({'imu': {'port': imu}} if imu else {}),
            'bridge': bridge, 'obstacle_decision': decision}
        import_nodes(nodes)
        with recorded_graph(
                folder, (*TOPICS, *TOOL_TOPICS, *MORE_TOPICS), timeline, nodes, metadata,
                own_domain()) as graph:
            return graph.run(release_and_resume(graph.node), timeout, longest=timeout)

    prepare(('simulator', 'bridge', 'decision'))  # before any wait
    if not quiet:
        imu = ', its IMU on another serial line' if serial_imu else ''
        print(f'An emulated {f"{protocol} {firmware}".strip()} drive, '
              f'{hardware.connection.baud} baud{imu}; bridge and decision on ROS domain '
              f'{own_domain()}, in real time.', flush=True)
    code = run_case(out, TWO_STEPS, quiet, play)
    if code:
        print(f'  - {load_note()}', file=sys.stderr)
    return code


def release_and_resume(node: Node) -> Actions:
    """
    Perform the steps of an operator: release the e-stop, then resume the decision.

    Both services must be ready first: the preparation of the decision loads the machine, and a
    loop with motor power needs processor time.  An e-stop that engages by itself later ends the
    run, with its reason.
    """
    services = ('bridge/release_e_stop', 'obstacle_decision/resume')
    clients = [node.create_client(Trigger, service) for service in services]
    received: Deque[MotorStatus] = deque()
    # rclpy inspects the signature of a callback, and a builtin has none.
    create_subscription(node, 'motor_status', lambda message: received.append(message))
    while not all(client.service_is_ready() for client in clients):
        yield None
    done, called, refused_since = 0, -math.inf, math.inf
    while done < len(clients):
        while time.monotonic() <= called + CALL_PERIOD:
            yield None
        answer, called = clients[done].call_async(Trigger.Request()), time.monotonic()
        while not answer.done():
            yield None
        if answer.result().success:
            done += 1
            continue
        service, done = services[done], 0  # the e-stop may have engaged
        refused_since = min(refused_since, called)
        if time.monotonic() - refused_since > REFUSAL_TIMEOUT:
            yield f'{service} has refused for {REFUSAL_TIMEOUT:g} s: {answer.result().message}'
    received.clear()  # the e-stop was engaged at the start
    released = False  # a status with released e-stop has been received
    while True:
        while received:
            message = received.popleft()
            if released and message.e_stop:
                faults = f' ({", ".join(message.faults)})' if message.faults else ''
                yield f'the e-stop has engaged by itself: {message.e_stop}{faults}'
            released = released or not message.e_stop
        yield None


def load_note() -> str:
    """Return the system load, the cause of most failures in real time, or a hint."""
    load = os.getloadavg()[0]
    return (f'the load of this machine is {load:.1f} on {os.cpu_count()} processors, and a '
            'process that is not scheduled in time exceeds its watchdog: try again at a lower '
            'load' if load > (os.cpu_count() or 1) else 'see the log of the bridge')
