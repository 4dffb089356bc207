# SPDX-License-Identifier: Apache-2.0
"""The demo through a serial line: an emulated drive, the bridge, controller and decision."""
import math
from pathlib import Path
import time
from typing import List, Optional

from rclpy.task import Future
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.demo.demo import CURVE, get_ready, perform, TOPICS, TWO_STEPS
from ballbot_ros.demo.processes import own_domain
from ballbot_ros.demo.recorded_graph import recorded_graph, RecordedGraph
from ballbot_ros.demo.timeline import Timeline
from ballbot_ros.msg import MotorStatus
from ballbot_ros.ros import qos

TUNING = 'gentle'  # gains that a sample of delay and an estimated angle leave stable
MORE_TOPICS = (('imu', Imu, qos.RECORD), ('motor_status', MotorStatus, qos.RECORD))
# Wall time between two requests to release the e-stop [s].
AGAIN = 0.3


def run_hardware_demo(out: Path, protocol: str, firmware: str = '', quiet: bool = False,
                      timeout: float = 60.0) -> int:
    """
    Let the robot meet two door-steps, its motor behind a serial line.

    Parameters
    ----------
    out : Path
        Folder for the bag, the picture and the logs.
    protocol : str
        Of the emulated drive.
    firmware : str
        Its generation; empty for the only or oldest one.
    quiet : bool
        Print only the verdict.
    timeout : float
        Wall time after which it is given up [s].

    Returns
    -------
    int
        0 if the robot crossed the first step and came to rest before the second, 1 if not.

    """
    hardware = load_hardware(f'gimball_{protocol}')

    def play(folder: Path, timeline: Timeline) -> List[str]:
        # Absolute: whoever opens it may be in another folder.
        link = str((folder / 'motor').resolve())
        with recorded_graph(folder, (*TOPICS, *MORE_TOPICS), timeline) as graph:
            graph.nodes.start('emulated_robot', {
                'hardware': hardware.name, 'firmware': firmware, 'scene': TWO_STEPS.scene,
                'link': link})
            graph.nodes.start('bridge', {
                'hardware': hardware.name, 'port': link, 'tuning': TUNING})
            graph.nodes.start('controller', {'tuning': TUNING, 'delay': 1})
            return graph.run(_Release(graph).poll, timeout, math.inf)

    get_ready(quiet)
    if not quiet:
        print(f'An emulated {f"{protocol} {firmware}".strip()} drive, '
              f'{hardware.connection.baud} baud; bridge, controller and decision on ROS domain '
              f'{own_domain()}, in real time.', flush=True)
    return perform(out, TWO_STEPS, quiet, play)


class _Release:
    """Asks the bridge to release the e-stop until it does, and starts the decision then."""

    def __init__(self, graph: RecordedGraph):
        self._graph = graph
        self._client = graph.node.create_client(Trigger, 'bridge/release_e_stop')
        self._answer: Optional[Future] = None
        self._next = 0.0
        self._done = False

    def poll(self) -> None:
        """Do what can be done now; to be called often."""
        if self._done:
            return
        if self._answer is not None and self._answer.done() and self._answer.result().success:
            self._done = True
            # Not before: the e-stop is not released while a command asks for torque.
            self._graph.nodes.start('obstacle_decision', {
                'curve': CURVE, 'control_tuning': TUNING})
        elif self._client.service_is_ready() and time.monotonic() > self._next:
            self._answer = self._client.call_async(Trigger.Request())
            self._next = time.monotonic() + AGAIN
