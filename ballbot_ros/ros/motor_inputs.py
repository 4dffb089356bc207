# SPDX-License-Identifier: Apache-2.0
"""What the motor bridge subscribes to and serves: commands, the IMU, and the e-stop."""
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState

from ballbot_ros.bridge.session import Session
from ballbot_ros.errors import MessageError
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import command_torque, to_seconds
from ballbot_ros.ros.endpoints import create_subscription, create_trigger
from ballbot_ros.ros.motor import Clocks, imu_reading


class MotorInputs:
    """
    Hands messages on to a session, and counts and logs those that are refused.

    Parameters
    ----------
    node : Node
    session : Session
    clocks : Clocks

    Attributes
    ----------
    imu_refused : int

    """

    def __init__(self, node: Node, session: Session, clocks: Clocks):
        """Create subscriptions and services."""
        self._session, self._clocks, self._logger = session, clocks, node.get_logger()
        self.imu_refused = 0
        create_subscription(node, JointState, 'joint_commands', self.command, qos.NEWEST)
        create_subscription(node, Imu, 'imu', self._on_imu, qos.SENSOR)
        create_trigger(node, '~/engage_e_stop', self._engage)
        create_trigger(node, '~/release_e_stop', self._release)

    def command(self, message: JointState) -> None:
        """Take a joint command."""
        try:
            torque = command_torque(message)
        except MessageError as error:
            self._session.supervisor.gate.refuse(error.reason)
            return self._refused(f'command refused: {error}')
        try:
            self._session.command(torque, self._clocks.steady(to_seconds(message.header.stamp)))
        except MessageError as error:
            self._refused(f'command refused: {error}')

    def _on_imu(self, message: Imu) -> None:
        try:
            self._session.imu(imu_reading(message, self._clocks))
        except MessageError as error:
            self.imu_refused += 1
            self._refused(f'IMU reading refused: {error}')

    def _refused(self, sentence: str) -> None:
        self._logger.warning(sentence, throttle_duration_sec=1.0)

    def _engage(self) -> str:
        self._session.engage('asked for by service')
        return 'the e-stop is engaged'

    def _release(self) -> str:
        self._session.release()
        return 'the e-stop is released'
