# SPDX-License-Identifier: Apache-2.0
"""What the motor bridge hears: commands, the IMU, and requests about the e-stop."""
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_srvs.srv import Trigger

from ballbot_ros.bridge.session import Session
from ballbot_ros.errors import BallbotError, MessageError
from ballbot_ros.ros import qos
from ballbot_ros.ros.conversions import command_torque, to_seconds
from ballbot_ros.ros.endpoints import listen
from ballbot_ros.ros.motor import Clocks, imu_reading


class MotorInputs:
    """
    Hands messages on to a session, and counts and tells those that are refused.

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
        """Listen."""
        self._session, self._clocks, self._logger = session, clocks, node.get_logger()
        self.imu_refused = 0
        listen(node, JointState, 'joint_commands', self.command, qos.NEWEST)
        listen(node, Imu, 'imu', self._on_imu, qos.SENSOR)
        node.create_service(Trigger, '~/engage_e_stop', self._on_engage)
        node.create_service(Trigger, '~/release_e_stop', self.release)

    def command(self, message: JointState) -> None:
        """Take a joint command."""
        try:
            torque = command_torque(message)
        except MessageError as error:
            self._session.supervisor.refuse(error.reason)
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

    def _on_engage(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._session.engage('asked for by service')
        response.success, response.message = True, 'the e-stop is engaged'
        return response

    def release(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Release the e-stop, or say why not."""
        try:
            self._session.release()
            response.success, response.message = True, 'the e-stop is released'
        except BallbotError as error:
            response.message = str(error)
        return response
