# SPDX-License-Identifier: Apache-2.0
"""The demo through a serial line: an emulated drive, the bridge, controller and decision."""
import os
from pathlib import Path
import time
from typing import Any, List

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.decision import load_curve
from ballbot_ros.demo.demo import (
    conclude, CURVE, ended_badly, ending_by_signal, SCENE, tell, TOPICS)
from ballbot_ros.demo.processes import NodeProcesses, own_domain, stay_here
from ballbot_ros.demo.story import Story
from ballbot_ros.msg import BallState, MotorStatus, StepDecision
from ballbot_ros.physics import load_scene
from ballbot_ros.plant.step_sensor import faces
from ballbot_ros.ros import qos
from ballbot_ros.ros.bag import BagRecorder
from ballbot_ros.ros.conversions import to_seconds, to_time
from ballbot_ros.ros.executor import new_executor

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
        Tell only the verdict.
    timeout : float
        Wall time after which it is given up [s].

    Returns
    -------
    int
        0 if the robot crossed the first step and came to rest before the second, 1 if not.

    """
    scene, domain = load_scene(SCENE), own_domain()
    hardware = load_hardware(f'gimball_{protocol}')
    out.mkdir(parents=True, exist_ok=True)
    story = Story(faces(scene.model.terrain), scene.model.robot, load_curve(CURVE),
                  (lambda *_: None) if quiet else tell)
    begun = time.monotonic()
    if not quiet:
        print(f'An emulated {f"{protocol} {firmware}".strip()} drive, '
              f'{hardware.connection.baud} baud; bridge, controller and decision on ROS domain '
              f'{domain}, in real time.\n', flush=True)
    with ending_by_signal():
        wrong = _Performance(out, story, domain, hardware.name, firmware, timeout).play()
    return conclude(out, scene, story, wrong, begun)


class _Performance:
    """One run of all nodes."""

    def __init__(self, out: Path, story: Story, domain: int, hardware: str, firmware: str,
                 timeout: float):
        self._out, self._story, self._domain = out, story, domain
        self._hardware, self._firmware, self._timeout = hardware, firmware, timeout
        self._begin = 0.0  # stamp of the first state, from which the story counts [s]

    def play(self) -> List[str]:
        """Return what went wrong on the way."""
        os.environ.update(stay_here(self._out / 'logs'))
        rclpy.init(domain_id=self._domain, signal_handler_options=SignalHandlerOptions.NO)
        node, executor = Node('ballbot_demo'), new_executor()
        executor.add_node(node)
        # Absolute: whoever opens it may be in another folder.
        link = str((self._out / 'motor').resolve())
        try:
            with BagRecorder(self._out / 'bag') as bag, \
                    NodeProcesses(self._out / 'logs', self._domain) as nodes:
                bag.subscribe(node, (*TOPICS, *MORE_TOPICS), {
                    'ball_state': self._on_ball, 'step_decision': self._on_decision})
                nodes.start('emulated_robot', {
                    'hardware': self._hardware, 'firmware': self._firmware, 'scene': SCENE,
                    'link': link})
                nodes.start('bridge', {
                    'hardware': self._hardware, 'port': link, 'tuning': TUNING})
                nodes.start('controller', {'tuning': TUNING, 'delay': 1})
                wrong = self._watch(node, executor, bag, nodes)
                codes = nodes.stop()
                bag.take_all()
                return wrong + [f'node {name} ended with code {code}, see {nodes.log(name)}'
                                for name, code in codes.items() if code]
        finally:
            executor.remove_node(node)
            node.destroy_node()
            rclpy.try_shutdown()

    def _watch(self, node: Node, executor: Executor, bag: BagRecorder,
               nodes: NodeProcesses) -> List[str]:
        release = node.create_client(Trigger, 'bridge/release_e_stop')
        answer, asked, deciding = None, 0.0, False
        deadline = time.monotonic() + self._timeout
        while self._story.rested is None:
            executor.spin_once(timeout_sec=0.1)
            bag.take_all()
            released = answer is not None and answer.done() and answer.result().success
            if released and not deciding:
                # Not before: the e-stop is not released to a controller that pushes already.
                nodes.start('obstacle_decision', {'curve': CURVE})
                deciding = True
            if not released and release.service_is_ready() and time.monotonic() > asked + AGAIN:
                answer, asked = release.call_async(Trigger.Request()), time.monotonic()
            wrong = ended_badly(nodes)
            if wrong:
                return wrong
            if time.monotonic() > deadline:
                return [f'given up after {self._timeout:g} s; where the machine was just too '
                        'slow, allow more (--timeout)']
        return []

    def _on_ball(self, data: bytes) -> None:
        message = deserialize_message(data, BallState)
        self._begin = self._begin or to_seconds(message.header.stamp)
        self._story.ball(self._counted(message))

    def _on_decision(self, data: bytes) -> None:
        self._story.decision(self._counted(deserialize_message(data, StepDecision)))

    def _counted(self, message: Any) -> Any:
        """Return a message whose stamp counts from the beginning."""
        message.header.stamp = to_time(
            max(0.0, to_seconds(message.header.stamp) - self._begin))
        return message
