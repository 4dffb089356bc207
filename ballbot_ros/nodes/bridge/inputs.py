# SPDX-License-Identifier: Apache-2.0
"""Subscriptions and services of the motor bridge: commands, set-points, IMU, e-stop."""
from dataclasses import replace
import math
from time import sleep
from typing import Callable

from rclpy.node import Node

from ballbot_ros.bridge.session import Session
from ballbot_ros.control import Authority, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.imus.source import StampedReading
from ballbot_ros.nodes.bridge.motor import Clocks, imu_reading, MotorOutputs
from ballbot_ros.ros.conversions import command_torque, to_seconds
from ballbot_ros.ros.endpoints import create_trigger, RECEIVED_TIMEOUT, subscribe_e_stop
from ballbot_ros.ros.message_bytes import AnyImu, AnyJointState, subscribe_bytes
from ballbot_ros.ros.set_points import SetPoints
from ballbot_ros.ros.single_publisher import SinglePublisher

# A release is refused for this time after the e-stop engages [s]: it is less than a human
# reaction time, so the request was sent before.  Meanwhile the bridge receives its own e_stop
# message (later on a busy machine), which would engage the e-stop again after the release.
RELEASE_DELAY = 0.1
# Pause of the executor after a refused message [s]: it limits their processing to 500 per second,
# so that a flood does not delay the loop, which runs in another thread.  The subscriptions hold
# one message, so the middleware drops the others.
REFUSED_PAUSE = 0.002


class MotorInputs:
    """
    Passes messages to a session, and counts and logs those that are refused.

    `authority` is that over joint_commands, or over the set-points of the laws on board.
    """

    def __init__(self, node: Node, session: Session, clocks: Clocks,
                 outputs: MotorOutputs):
        self._outputs = outputs
        self._session, self._clocks, self._logger = session, clocks, node.get_logger()
        self._publisher, self._imu = (
            SinglePublisher(node, topic) for topic in ('joint_commands', 'imu'))
        self.imu_refused = 0
        self._received_at = -math.inf  # time of the last message of an engaged e-stop [s]
        subscribe_bytes(node, 'joint_commands', self.command)
        law = session.law
        set_points = SetPoints(node, self._give, session.set_points_refused,
                               law.record_request if law is not None else lambda _: None,
                               session.lateral is not None, REFUSED_PAUSE)
        self.authority = Authority(session.hardware.limits.command_timeout) \
            if law is None else set_points.authority
        if not session.hardware.imu_port.port:
            subscribe_bytes(node, 'imu', self._on_imu)
        subscribe_e_stop(node, self._on_e_stop)
        create_trigger(node, '~/engage_e_stop', self._engage)
        create_trigger(node, '~/release_e_stop', self._release)
        create_trigger(node, '~/clear_faults', session.clear_faults)

    def command(self, message: AnyJointState) -> None:
        """Check a joint command and pass it to the session."""
        torque = 0.0
        try:
            torque = command_torque(message)
            if self._session.law is None:
                self.authority.check(self._publisher.name(), self._session.clock())
        except MessageError as error:
            self._session.supervisor.record_request(torque, self._session.clock())
            self._session.supervisor.gate.refuse(error.reason)
            return self._refused('command', error)
        try:
            self._session.command(torque, self._clocks.steady(to_seconds(message.header.stamp)))
        except MessageError as error:
            self._refused('command', error)

    def _give(self, given: SetPoint) -> None:
        try:
            self._session.give(given if not given.stamp else replace(
                given, stamp=self._clocks.steady(given.stamp)))
        except MessageError as error:
            self._session.observer.refused('set-point', error)
            raise

    def imu(self, reading: StampedReading) -> None:
        """Pass on a reading of the sensor on the bridge's own port."""
        self._take_imu(lambda: ImuReading(
            reading.stamp, -reading.turn_rate[1], reading.force[0], reading.force[2]), 0.0)

    def _on_imu(self, message: AnyImu) -> None:
        def convert() -> ImuReading:
            self._imu.name()  # refuses several publishers
            return imu_reading(message, self._clocks)
        self._take_imu(convert)

    def _take_imu(self, convert: Callable[[], ImuReading], pause: float = REFUSED_PAUSE) -> None:
        try:
            self._session.imu(convert())
        except MessageError as error:
            self.imu_refused += 1
            self._refused('IMU reading', error, pause)

    def _refused(self, what: str, error: MessageError, pause: float = REFUSED_PAUSE) -> None:
        self._session.observer.refused(what, error)
        self._logger.warning(f'{what} refused: {error}', throttle_duration_sec=1.0)
        sleep(pause)

    def _on_e_stop(self, engaged: bool) -> None:
        """Engage the e-stop on request; only the service releases it."""
        if engaged:
            self._received_at = self._session.clock()
        if engaged and not self._session.supervisor.e_stop:
            self._session.engage('requested on the topic e_stop')

    def _engage(self) -> str:
        self._session.engage('requested by service')
        return 'the e-stop is engaged'

    def _release(self) -> str:
        engaged_at = self._outputs.engaged_at
        early = self._session.clock() - engaged_at < (
            RELEASE_DELAY if self._received_at >= engaged_at else RECEIVED_TIMEOUT)
        self._session.release(
            f'it engaged less than {RELEASE_DELAY:g} s ago, so this request may have been sent '
            'before; release again' if early else '')
        return 'the e-stop is released'
