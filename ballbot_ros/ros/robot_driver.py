# SPDX-License-Identifier: Apache-2.0
"""Graph access of a keyboard driver: cmd_vel, the e-stop, and the state of the robot."""
import math
from typing import Any, Optional

from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from ballbot_ros.errors import MessageError
from ballbot_ros.ros import qos
from ballbot_ros.ros.cmd_vel import SpeedPublisher
from ballbot_ros.ros.conversions import DECISION_NAMES, readings
from ballbot_ros.ros.endpoints import create_publisher, create_subscription, subscribe_e_stop
from ballbot_ros.ros.graph import Observer


class RobotDriver:
    """Publishes cmd_vel, calls the e-stop services of a node, and keeps the latest messages."""

    def __init__(self, observer: Observer, node: str):
        self._observer = observer
        one = observer.node
        self._speeds = SpeedPublisher(one)
        self._clients = {verb: one.create_client(Trigger, f'{node}/{verb}')
                         for verb in ('engage_e_stop', 'release_e_stop')}
        self.speed: Optional[float] = None  # of the centre [m/s]; None before the first message
        self.pendulum: Optional[float] = None  # absolute angle [rad]
        self.decision = ''  # latest decision of obstacle_decision
        self.reply = ''  # latest response to an e-stop request
        self.e_stop: Optional[bool] = None  # None without a publisher
        self._e_stop: Any = None
        create_subscription(one, 'odom', lambda message: setattr(
            self, 'speed', message.twist.twist.linear.x), profile=qos.SENSOR)
        create_subscription(one, 'joint_states', self._on_joints, profile=qos.SENSOR)
        create_subscription(one, 'step_decision', lambda message: setattr(
            self, 'decision', DECISION_NAMES.get(message.decision, '?')))
        subscribe_e_stop(one, lambda engaged: setattr(self, 'e_stop', engaged))

    @property
    def followers(self) -> int:
        return self._speeds.followers

    def publish(self, speed: float) -> None:
        """Publish a speed [m/s]."""
        self._speeds.publish(speed)

    def last(self) -> None:
        """Publish speed 0, and wait until it is received."""
        self.publish(0.0)
        self._speeds.close()

    def engage(self) -> None:
        """Engage the e-stop by the service of the bridge, or by the topic without a bridge."""
        self._set('engage_e_stop', True)

    def release(self) -> None:
        """Release the e-stop; the bridge may refuse this with a reason."""
        self._set('release_e_stop', False)

    def _set(self, verb: str, engaged: bool) -> None:
        client = self._clients[verb]
        if client.service_is_ready():
            client.call_async(Trigger.Request()).add_done_callback(
                lambda done: setattr(self, 'reply', done.result().message))
            return
        if self._e_stop is None:
            self._e_stop = create_publisher(self._observer.node, 'e_stop')
        self._e_stop.publish(Bool(data=engaged))
        self.reply = f'no bridge: e-stop {"engaged" if engaged else "released"} by topic'

    def _on_joints(self, message: JointState) -> None:
        try:
            joints = readings(message)
        except MessageError:  # an empty ball has no pendulum
            return
        self.pendulum = math.remainder(joints.ball_angle + joints.joint_angle, math.tau)
