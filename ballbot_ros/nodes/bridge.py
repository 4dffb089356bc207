# SPDX-License-Identifier: Apache-2.0
"""The node ``bridge``: joint commands to a real motor on a serial line, joint states back."""
from pathlib import Path
import sys
from typing import Any, Callable, List, Optional

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from ballbot_ros.bridge.connect import connector
from ballbot_ros.bridge.feasibility import check_feasible
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import load_tuning
from ballbot_ros.errors import BallbotError, DriveError
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.logs import DeferredLogs
from ballbot_ros.ros.motor import Clocks, MotorOutputs
from ballbot_ros.ros.motor_health import health
from ballbot_ros.ros.motor_inputs import MotorInputs
from ballbot_ros.ros.parameters import declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.settings import BridgeSettings

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
# Longest time that a thread keeps others from running [s].
SWITCH = 5e-4
# How often the loop is looked after [s], and a drive that was not there looked for.
LOOK_AFTER, START_AGAIN = 0.1, 1.0


class Bridge(LifecycleNode):
    """
    Drives a motor; see `BridgeSettings` for what can be set.

    The states are those of ros2_control: *configure* opens the line, finds the drive and checks
    its settings, and joint states flow; *activate* lets the motor have power, once the e-stop
    is released; *deactivate* takes the power; *cleanup* closes the line.
    """

    def __init__(self, **kwargs: Any):
        """Refuse a loop that cannot work, then wait for a transition or make it."""
        super().__init__('bridge', **kwargs)
        settings = declare(self, BridgeSettings)
        hardware = load_hardware(settings.hardware).at(settings.port, settings.baud)
        robot = load_robot(hardware.robot)
        check_feasible(hardware, robot, load_tuning(settings.tuning), settings.delay)
        self._hardware = hardware
        clocks = Clocks(self)
        self._logs = DeferredLogs('ballbot_ros.bridge')
        self._outputs = MotorOutputs(self, clocks, settings.status_rate)
        self._session = Session(hardware, robot, connector(
            hardware, Path(settings.capture) if settings.capture else None))
        self._loop: Optional[Loop] = None
        self._complaint = ''
        self.failure: Optional[DriveError] = None
        self._inputs = MotorInputs(self, self._session, clocks)
        self._diagnostics = diagnostics.Diagnostics(self, 'motor', lambda: health(
            self._session, self._loop, hardware, self._inputs.imu_refused))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(LOOK_AFTER, self._look_after, clock=steady)
        if settings.autostart:
            self._starting = self.create_timer(START_AGAIN, self._start, clock=steady)
            self._start()

    # Lifecycle

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the line, find the drive, check it, and start the loop."""
        try:
            identity, settings = self._session.configure()
        except BallbotError as error:
            if str(error) != self._complaint:  # said once, not every second
                self._complaint = str(error)
                self.get_logger().error(f'cannot configure: {error}')
            return FAILURE
        self.get_logger().info(
            f'{identity.in_words}, on {self._hardware.connection.port}; '
            + ', '.join(f'{item.name} {item.value}' for item in settings))
        self._loop = Loop(
            self._session, self._hardware.connection.loop_rate, self._outputs.publish)
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let the motor have power, once the e-stop is released."""
        if not self._done(self._session.activate):
            return FAILURE
        self.get_logger().info(
            'active; the e-stop is engaged, release it with: ros2 service call '
            f'{self.get_fully_qualified_name()}/release_e_stop std_srvs/srv/Trigger')
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take the power off the motor."""
        self._session.deactivate()
        self._session.engage('deactivated')
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the motor and close the line."""
        self.make_safe()
        return SUCCESS

    on_shutdown = on_error = on_cleanup

    def make_safe(self) -> None:
        """Stop the motor and close the line."""
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.end()
        self._session.close()
        self._logs.forward()

    def _start(self) -> None:
        if self.trigger_configure() is SUCCESS and self.trigger_activate() is SUCCESS:
            self._starting.cancel()

    def _look_after(self) -> None:
        """Log what the loop has logged, and end when it has ended."""
        self._logs.forward()
        self._outputs.publish_e_stop(bool(self._session.supervisor.e_stop))
        if self._loop is not None and self._loop.failure is not None:
            self.failure = DriveError('loop_failed', f'the loop ended: {self._loop.failure!r}')

    def _done(self, act: Callable[[], None]) -> bool:
        """Do something; log why it cannot be done, and return False then."""
        try:
            act()
        except BallbotError as error:
            self.get_logger().error(str(error))
            return False
        return True


def main(args: Optional[List[str]] = None) -> int:
    """Run the node."""
    # The loop must not wait long for a thread that computes: 5 ms is what Python would let it.
    sys.setswitchinterval(SWITCH)
    return run(Bridge, args)


if __name__ == '__main__':
    sys.exit(main())
