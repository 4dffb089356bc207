# SPDX-License-Identifier: Apache-2.0
"""The node ``simulator``: the ball robot, its sensors, and simulated time."""
import math
from typing import Any, List, Optional, Tuple, Union

from rclpy.node import Node
from rclpy.task import Future

from ballbot_ros.control import CommandGate
from ballbot_ros.errors import MessageError, RefusedError
from ballbot_ros.nodes.simulator.laws_inside import LawsInside
from ballbot_ros.nodes.simulator.outputs import Outputs
from ballbot_ros.nodes.simulator.scheduler import FollowedClock, Scheduler
from ballbot_ros.nodes.simulator.settings import plant_for, SimulatorSettings
from ballbot_ros.nodes.simulator.simulation_interfaces import serve
from ballbot_ros.ros import diagnostics
from ballbot_ros.ros.conversions import (
    command_torque, exact, lean_set_point, sec_nanosec, to_seconds, to_time)
from ballbot_ros.ros.endpoints import (
    change_period, create_service, create_trigger, create_wall_timer)
from ballbot_ros.ros.message_bytes import AnyJointState, subscribe_bytes
from ballbot_ros.ros.parameters import Commit, declare, refuse_sim_time
from ballbot_ros.ros.run import run
from ballbot_ros.ros.single_publisher import SinglePublisher
from ballbot_ros.srv import Step

NO_SIM_TIME = 'use_sim_time does not apply to the simulator, which publishes the clock'


class Simulator(Node):
    """Simulates a robot and publishes the clock; `SimulatorSettings` has its parameters."""

    def __init__(self, **kwargs: Any):
        super().__init__('simulator', **kwargs)
        if refuse_sim_time(self, NO_SIM_TIME):
            self.get_logger().warning(NO_SIM_TIME)
        self._settings = settings = declare(self, SimulatorSettings, self._prepare)
        self._plant = plant_for(settings)
        self._gate = CommandGate(settings.command_timeout)
        self._outputs = Outputs(self, self._plant, settings)
        self._diagnostics = diagnostics.Diagnostics(
            self, 'simulation', self._health, self._plant.model.robot.name,
            stamp=lambda: to_time(self._plant.time))
        self._laws = LawsInside(self, self._plant, settings) \
            if settings.control == 'onboard' else None
        follow = None if settings.publish_clock else FollowedClock(self, self._plant)
        self._scheduler = Scheduler(self._plant, self._laws or self._gate, self._outputs,
                                    settings, self.get_logger(), self._diagnostics.publish,
                                    follow)
        self._publisher = SinglePublisher(self, 'joint_commands')
        subscribe_bytes(self, 'joint_commands', self._on_command)
        for name, do in (('pause', self._pause), ('resume', self._resume), ('reset', self._reset)):
            create_trigger(self, f'~/{name}', do)
        create_service(self, Step, '~/step', self._on_step)
        serve(self, self._plant, self._scheduler, settings)
        self._timer = create_wall_timer(self, self._scheduler.interval, self._scheduler.tick)

    def _prepare(self, wanted: SimulatorSettings) -> Commit:
        steps = [self._outputs.prepare(wanted)]
        if self._laws is not None:
            steps.append(self._laws.prepare(self._settings, wanted))

        def commit() -> None:
            self._settings, self._gate.timeout = wanted, wanted.command_timeout
            self._plant.limit_torque(wanted.torque_limit or None)
            for step in steps:
                step()
            self._scheduler.follow(wanted)
            change_period(self._timer, self._scheduler.interval)
        return commit

    def _on_command(self, message: AnyJointState) -> None:
        """Process a command; in lockstep, the command for the present state advances time."""
        try:
            if self._laws is not None:
                raise MessageError(
                    'joint_commands are not followed while the laws run in the simulator: send '
                    'set_point or cmd_vel, or start the simulator with control:=direct',
                    'onboard', 'control')
            self._publisher.name()
            torque = command_torque(message, self._plant.steers)
            lean = lean_set_point(message)
        except MessageError as error:
            self._gate.refuse(error.reason)
            return self._refused(error)
        try:
            self._gate.offer(torque, to_seconds(message.header.stamp), self._plant.time, lean)
        except MessageError as error:
            return self._refused(error)
        self._scheduler.command_accepted(exact(message) == sec_nanosec(self._plant.time))

    def _refused(self, error: MessageError) -> None:
        self.get_logger().warning(f'command refused: {error}', throttle_duration_sec=1.0)

    def _pause(self) -> str:
        self._scheduler.pause()
        return f'paused at t = {self._plant.time:.3f} s'

    def _resume(self) -> str:
        self._scheduler.resume()
        return f'running from t = {self._plant.time:.3f} s'

    def _reset(self) -> str:
        self._scheduler.reset()
        return (f'at the start of the scene, t = {self._plant.time:.3f} s'
                + (', paused' if self._scheduler.paused else ''))

    def _on_step(self, request: Step.Request, response: Step.Response
                 ) -> Union[Step.Response, Future]:
        answer = Future()

        def finish(run: Future) -> None:
            response.success = bool(run.result())
            response.message = '' if response.success else 'ended before all periods were run'
            response.time = to_time(self._plant.time)
            answer.set_result(response)

        response.time = to_time(self._plant.time)
        try:
            self._scheduler.step(max(1, request.periods)).add_done_callback(finish)
        except RefusedError as error:
            response.message = str(error)
            return response
        return answer

    def _health(self) -> Tuple[bytes, str, dict]:
        values = {
            'simulated_time': f'{self._plant.time:.3f}',
            'scene': self._settings.floor or self._settings.scene,
            'real_time_factor': f'{self._scheduler.real_time_factor:.3f}',
            'periods_dropped': self._scheduler.dropped,
            'commands_accepted': self._gate.accepted,
            'error_estimate': f'{self._plant.error_estimate:.1e}',
            **diagnostics.refusals('commands', self._gate.refused)}
        if self._laws is not None:
            values.update(self._laws.values, set_points_refused=sum(self._laws.refused.values()))
        if self._scheduler.failure is not None:
            return diagnostics.ERROR, str(self._scheduler.failure), values
        if self._plant.accuracy_lost_at < math.inf:
            return diagnostics.WARN, (
                f'the accuracy of {self._settings.accuracy:g} m holds only up to '
                f't = {self._plant.accuracy_lost_at:.3f} s: the motion is chaotic'), values
        if self._scheduler.paused:
            return diagnostics.OK, 'paused', values
        if self._gate.refused:
            return diagnostics.WARN, 'running; commands were refused', values
        return diagnostics.OK, 'running', values


def main(args: Optional[List[str]] = None) -> int:
    return run(Simulator, args)
