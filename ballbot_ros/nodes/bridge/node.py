# SPDX-License-Identifier: Apache-2.0
"""The node ``bridge``: a real motor on a serial line, and its control laws."""
from typing import Any, List, Optional

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from ballbot_ros.bridge.loop import Loop
from ballbot_ros.errors import BallbotError, ConfigurationError, DriveError
from ballbot_ros.msg import MotorStatus
from ballbot_ros.nodes.bridge.health import health
from ballbot_ros.nodes.bridge.inputs import MotorInputs
from ballbot_ros.nodes.bridge.motor import Clocks, MotorOutputs
from ballbot_ros.nodes.bridge.robot_outputs import RobotOutputs
from ballbot_ros.nodes.bridge.service_manager import ServiceManager
from ballbot_ros.nodes.bridge.session_setup import LOGGER, new_session, prepare_session
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.nodes.imu.publisher import ImuOutput
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.endpoints import create_wall_timer
from ballbot_ros.ros.frames import Frames
from ballbot_ros.ros.lifecycle import FAILURE, ManagedNode, SUCCESS
from ballbot_ros.ros.logs import DeferredLogs
from ballbot_ros.ros.parameters import Commit, declare, refuse_sim_time
from ballbot_ros.ros.run import run

NO_SIM_TIME = ('use_sim_time must be false for the bridge: a motor runs in real time; start its '
               'controllers without it, too')
MONITOR_PERIOD = 0.1  # period of the checks of the loop [s]


class Bridge(ManagedNode):
    """
    Drives a motor; `BridgeSettings` has its parameters.

    The states are those of ros2_control: *configure* opens the line, finds the drive and checks
    its settings, and publishes joint states; *activate* permits motor power, once the e-stop
    is released; *deactivate* disables it; *cleanup* closes the line.
    """

    def __init__(self, **kwargs: Any):
        """Refuse an infeasible loop, then wait for a transition or, with autostart, trigger it."""
        super().__init__('bridge', **kwargs)
        if refuse_sim_time(self, NO_SIM_TIME):
            raise ConfigurationError(NO_SIM_TIME, 'inconsistent', 'use_sim_time')
        self._settings = settings = declare(self, BridgeSettings, self._prepare)
        self._logs = DeferredLogs(LOGGER)
        self._session = new_session(self, settings)
        self._scheduling = settings.scheduling.prepared()
        self._hardware = self._session.hardware
        clocks = Clocks()
        self._outputs = MotorOutputs(
            self, clocks, settings.status_rate, settings.joint_state_period,
            Frames.of(settings).base)
        self._robot_outputs = RobotOutputs(self, self._session, clocks, settings)
        self._loop: Optional[Loop] = None
        self._service = ServiceManager()
        self._last_error = ''
        self.failure: Optional[BallbotError] = None
        self._inputs = MotorInputs(self, self._session, clocks, self._outputs)
        self._imu = ImuOutput(
            self, self._hardware.imu_port, Frames.of(settings).imu, self._inputs.imu
        ) if self._hardware.imu_port.port else None
        self._diagnostics = diagnostics.Diagnostics(self, 'motor', lambda: health(
            self._session, self._loop, self._inputs.imu_refused, self._inputs.authority),
            self._session.robot.name)
        create_wall_timer(self, MONITOR_PERIOD, self._monitor)
        if settings.autostart:
            self.autostart()

    def _prepare(self, wanted: BridgeSettings) -> Commit:
        hand_over = prepare_session(self._session, self._settings, wanted)

        def commit() -> None:
            hand_over()
            self._outputs.publish_at(wanted.status_rate, wanted.joint_state_period)
            self._robot_outputs.publish_odometry_at(wanted)
            self._settings = wanted
        return commit

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            identity, settings = self._session.configure()
        except BallbotError as error:
            if str(error) != self._last_error:  # logged once, not every second
                self._last_error = str(error)
                self.get_logger().error(
                    f'cannot configure: {error}; to diagnose it: ballbot doctor --hardware '
                    f'{self._settings.hardware} --port {self._hardware.connection.port}')
            return FAILURE
        self.get_logger().info(
            f'{identity.in_words}, on {self._hardware.connection.port}; '
            + ', '.join(f'{item.name} {item.value}' for item in settings))
        self._loop = Loop(
            self._session, self._hardware.connection.loop_rate, self._outputs.publish,
            self._robot_outputs.publish, self._service.beat, scheduling=self._scheduling)
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            self._session.activate()
        except BallbotError as error:
            self.get_logger().error(str(error))
            return FAILURE
        self._service.ready()
        self.get_logger().info(
            'active; the e-stop is engaged, release it with: ros2 service call '
            f'{self.get_fully_qualified_name()}/release_e_stop std_srvs/srv/Trigger')
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._session.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._close()
        self._outputs.publish_end(MotorStatus.STATE_OFF, self._session)
        return SUCCESS

    on_shutdown = on_error = on_cleanup

    def make_safe(self) -> None:
        """Stop the motor, close the line, and notify the service manager."""
        self._service.stopping()
        self._close()
        if self._imu is not None:
            self._imu.end()
        self._outputs.publish_end(MotorStatus.STATE_ENDED, self._session)

    def _close(self) -> None:
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.end()
        self._session.close()
        self._logs.forward()

    def _monitor(self) -> None:
        """Forward the log of the loop, and end the node after a failure of loop or IMU."""
        self._logs.forward()
        self._outputs.publish_e_stop(bool(self._session.supervisor.e_stop))
        if self._loop is not None and self._loop.failure is not None:
            self.failure = DriveError(f'the loop ended: {self._loop.failure!r}',
                                      'loop_failed', 'drive')
        if self._imu is not None:
            self.failure = self.failure or self._imu.failure
        self._service.notify(self._session, self._loop, self.failure)


def main(args: Optional[List[str]] = None) -> int:
    return run(Bridge, args)
