# SPDX-License-Identifier: Apache-2.0
"""The node ``controller``: joint states and set-points in, pendulum torque out."""
from collections import Counter
from dataclasses import replace
import time
from typing import Any, List, Optional, Tuple

from builtin_interfaces.msg import Time
from rclpy.node import Node

from ballbot_ros.control import checked_controller, SetPoint
from ballbot_ros.errors import MessageError
from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import lateral_readings, readings
from ballbot_ros.ros.endpoints import (
    change_period, create_publisher, create_wall_timer, subscribe_e_stop, wait_until_received)
from ballbot_ros.ros.message_bytes import AnyJointState, command_bytes, subscribe_bytes
from ballbot_ros.ros.parameters import Commit, declare
from ballbot_ros.ros.retuning import prepare_laws
from ballbot_ros.ros.run import run
from ballbot_ros.ros.set_points import SetPoints
from ballbot_ros.steering import LateralState, law


class Controller(Node):
    """Runs laws (11) and (12) and the speed law; `ControllerSettings` has its parameters."""

    def __init__(self, **kwargs: Any):
        """Refuse an unstable loop, then wait for joint states."""
        super().__init__('controller', **kwargs)
        self._settings = settings = declare(self, ControllerSettings, self._prepare)
        self._robot = load_robot(settings.robot)
        self._controller = checked_controller(
            self._robot, *settings.loop, settings.supervision)
        self._received_at: Optional[float] = None  # time of the newest joint state [s]
        self._newest = self._answered = Time()
        self._torque = 0.0
        self._refused: Counter = Counter()
        self._lateral: Optional[LateralState] = None  # None for a robot that drives straight
        self._speed = 0.0
        self._commands = create_publisher(self, 'joint_commands')
        subscribe_bytes(self, 'joint_states', self._on_state)
        self._set_points = SetPoints(
            self, self._give, self._refused, self._controller.record_request, steers=False)
        subscribe_e_stop(self, self._on_e_stop)
        self._diagnostics = diagnostics.Diagnostics(
            self, 'pendulum', self._health, self._robot.name)
        self._timer = create_wall_timer(self, settings.state_timeout / 4, self._watch)
        lowest = self._controller.expected.lowest_rate
        self.get_logger().info(f'these gains need joint states at {lowest:.0f} Hz or more')

    def _prepare(self, wanted: ControllerSettings) -> Commit:
        hand_over = prepare_laws(
            self._controller, self._robot, self._settings.loop, wanted.loop, wanted.supervision)

        def commit() -> None:
            hand_over()
            self._settings = wanted
            change_period(self._timer, wanted.state_timeout / 4)
        return commit

    def _on_state(self, message: AnyJointState) -> None:
        """Process a joint state; the command that answers it carries its stamp."""
        try:
            found, lateral = readings(message), lateral_readings(message, self._robot)
        except MessageError as error:
            self._refused[error.reason] += 1
            self.get_logger().warning(
                f'joint_states refused: {error}', throttle_duration_sec=1.0)
            return
        self._lateral, self._set_points.steers = lateral, lateral is not None
        self._speed = -self._robot.ball_radius * found.ball_rate
        self._controller.take(found)
        self._newest = message.header.stamp
        if self._received_at is None:
            self.get_logger().info('joint states have arrived')
        self._received_at = time.monotonic()
        self._answer()

    def _give(self, given: SetPoint) -> None:
        """Pass on a set-point, stamped like the newest joint state if it has no stamp."""
        self._controller.give(
            given if given.stamp else replace(given, stamp=self._controller.time))
        self._answer()

    def _on_e_stop(self, engaged: bool) -> None:
        """Set the torque to 0 and drop the set-point while the e-stop is engaged."""
        self._controller.on_e_stop(engaged)
        if engaged and self._received_at is not None:
            self._command(0.0)
        self._diagnostics.publish()

    def _answer(self) -> None:
        """Publish the torque for the newest joint state, if the controller returns one."""
        torque = self._controller.answer()
        if torque is not None:
            self._answered = self._newest
            self._command(torque)

    def _command(self, torque: float) -> None:
        # The stamp is that of the last answered state: in lockstep, a zero torque of the
        # watchdog must not count as the command for a newer state.
        self._torque = torque
        lean = None
        if self._lateral is not None:
            lean = law(self._robot, self._lateral, self._speed,
                       self._controller.set_point.yaw_rate)
        self._commands.publish(command_bytes(self._answered, torque, lean))

    @property
    def _timed_out(self) -> bool:
        """Return whether joint states arrived and then stopped."""
        return self._received_at is not None \
            and time.monotonic() - self._received_at > self._settings.state_timeout

    def _watch(self) -> None:
        """Set the torque to 0 when joint states stop."""
        if self._settings.lockstep_set_point_period:
            return  # simulated time does not advance between states
        if self._timed_out and self._torque:
            self._command(0.0)
            self.get_logger().warning(
                f'no joint state for {self._settings.state_timeout:g} s: torque is 0; has the '
                'simulator or the bridge stopped?', throttle_duration_sec=1.0)
            self._diagnostics.publish()

    def make_safe(self) -> None:
        """Publish a final command with torque 0."""
        if self._received_at is not None:
            self._command(0.0)
            wait_until_received(self._commands)

    def _health(self) -> Tuple[bytes, str, dict]:
        now = self._controller.set_point
        values = {
            'mode': now.mode.value, 'set_value': f'{now.value:.4f}',
            'torque': f'{self._torque:.4f}', 'state_rate': f'{self._controller.rate or 0.0:.1f}',
            **diagnostics.refusals('messages', self._refused)}
        if self._received_at is None:
            return diagnostics.WARN, 'waiting for joint_states', values
        if self._timed_out:
            return diagnostics.WARN, 'joint_states stopped, torque is 0', values
        if self._controller.e_stop:
            return diagnostics.WARN, 'the e-stop is engaged, torque is 0', values
        if self._controller.too_slow:
            return diagnostics.ERROR, 'the rate of joint_states is too low, torque is 0', values
        if self._controller.overcome:
            return diagnostics.WARN, (
                'running; resistance exceeds the torque at the largest lean'), values
        if self._refused:
            return diagnostics.WARN, 'running; messages were refused', values
        return diagnostics.OK, 'running', values


def main(args: Optional[List[str]] = None) -> int:
    return run(Controller, args)
