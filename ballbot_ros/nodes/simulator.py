# SPDX-License-Identifier: Apache-2.0
"""The node ``simulator``: the ball robot, its sensors, and the time they live in."""
import math
import sys
import time
from typing import Any, List, Optional, Tuple

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from ballbot_ros.errors import ConfigurationError, MessageError, SimulationError
from ballbot_ros.physics.model import Solver
from ballbot_ros.physics.scene import load_scene
from ballbot_ros.plant import CommandGate, Pace, Plant, Sensor, Speedometer
from ballbot_ros.ros import diagnostics, qos
from ballbot_ros.ros.conversions import command_torque, to_seconds, to_time
from ballbot_ros.ros.endpoints import listen
from ballbot_ros.ros.lockstep import Allowance
from ballbot_ros.ros.outputs import Outputs
from ballbot_ros.ros.parameters import declare
from ballbot_ros.ros.run import run
from ballbot_ros.ros.settings import SimulatorSettings
from ballbot_ros.srv import Step

# A state is repeated this often while nobody answers it: subscribers may not be there yet [s].
REPEAT = 0.2
# Wall time that one callback may fill with simulation when going as fast as it goes [s].
BATCH = 0.002


class Simulator(Node):
    """Owns simulated time; see `SimulatorSettings` for what can be set."""

    def __init__(self, **kwargs: Any):
        """Load the scene and start (or wait, if paused)."""
        super().__init__('simulator', **kwargs)
        if self.get_parameter('use_sim_time').value:
            raise ConfigurationError(
                'use_sim_time must be false for the simulator: it makes the simulated time')
        self._settings = settings = declare(self, SimulatorSettings)
        scene = load_scene(settings.scene, settings.robot or None,
                           Solver(settings.method, settings.physics_step))
        self._plant = Plant(scene, settings.control_rate, settings.torque_limit or None,
                            settings.accuracy or None)
        self._gate = CommandGate(settings.command_timeout)
        self._allowance = Allowance(settings.start_paused)
        self._failure: Optional[SimulationError] = None
        self._answered = False
        self._asked = self._since = 0.0
        self._silent = True
        self._credit = 0
        self._speed = Speedometer()
        self._factor = factor = settings.real_time_factor
        self._pace = Pace(self._plant.period, factor) if factor > 0.0 else None
        self._outputs = Outputs(self, self._plant, Sensor(
            scene.model.terrain, settings.observation_reach, settings.observation_distance_sd,
            settings.observation_height_sd, settings.seed), settings)
        listen(self, JointState, 'joint_commands', self._on_command, qos.NEWEST)
        for name in ('pause', 'resume', 'reset'):
            self.create_service(Trigger, f'~/{name}', getattr(self, f'_on_{name}'))
        # In the group of all others a step that waits would keep out what it waits for.
        self.create_service(
            Step, '~/step', self._on_step, callback_group=ReentrantCallbackGroup())
        self._diagnostics = diagnostics.Diagnostics(self, 'simulation', self._health)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._ask()
        tick = (self._plant.period / factor if self._pace else
                REPEAT / 4 if settings.lockstep else BATCH / 4)
        self.create_timer(tick, self._tick, clock=self._steady)

    def _tick(self) -> None:
        """Let as much time pass as is due."""
        now = time.monotonic()
        self._speed.note(self._plant.time, now)
        if not self._allowance.running:
            return
        if self._settings.lockstep:
            if self._pace:
                self._credit = min(1, self._credit + self._pace.due(now))
            if not self._answered:
                self._insist(now)
            self._follow()
        elif self._pace:
            dropped = self._pace.dropped
            for _ in range(self._pace.due(now)):
                if self._allowance.running:  # a failure or the last step ends it in between
                    self._period()
            if self._pace.dropped > dropped and self._speed.factor < 0.98 * self._factor:
                self.get_logger().warning(
                    f'falling behind: real-time factor {self._speed.factor:.2f} instead of '
                    f'{self._factor:g}', throttle_duration_sec=2.0)
        else:
            while time.monotonic() - now < BATCH and self._allowance.running:
                self._period()

    def _follow(self) -> None:
        """In lockstep: run the period whose state has been answered, if its time has come."""
        if self._answered and self._allowance.running and (self._credit or not self._pace):
            self._credit = 0
            self._period()

    def _period(self) -> None:
        """Run one control period and tell its end."""
        now = self._plant.time
        if self._gate.expired(now) and not self._silent:
            self._silent = True
            self.get_logger().warning(
                f'no command for {self._settings.command_timeout:g} s at t = {now:.3f} s: '
                'torque is 0; is the controller running?')
        try:
            self._plant.advance(self._gate.torque(now))
        except SimulationError as error:
            self._failure = error
            self._allowance.pause()
            self.get_logger().fatal(f'{error}. Nothing is published until ~/reset.')
            self._diagnostics.publish()
            return
        self._allowance.spend()
        self._ask()

    def _ask(self, everything: bool = False) -> None:
        """Publish the state; in lockstep this asks for the command that answers it."""
        self._answered = False
        self._asked = self._since = time.monotonic()
        self._outputs.publish(everything)

    def _insist(self, now: float) -> None:
        """Repeat a state that nobody answers, and say so when it lasts."""
        if now - self._asked >= REPEAT:
            self._asked = now
            self._outputs.repeat()
        if now - self._since >= self._settings.lockstep_patience:
            self._gate.clear()
            self.get_logger().warning(
                f'no command answers the state of t = {self._plant.time:.3f} s: time stands '
                'still, torque is 0; is the controller running?', throttle_duration_sec=10.0)

    def _on_command(self, message: JointState) -> None:
        """Take a command; in lockstep the right one lets time go on."""
        try:
            torque = command_torque(message)
        except MessageError as error:
            self._gate.refuse(error.reason)
            return self._refused(error)
        try:
            self._gate.offer(torque, to_seconds(message.header.stamp), self._plant.time)
        except MessageError as error:
            return self._refused(error)
        self._silent = False
        if self._settings.lockstep and message.header.stamp == to_time(self._plant.time):
            self._answered = True
            self._follow()

    def _refused(self, error: MessageError) -> None:
        self.get_logger().warning(f'command refused: {error}', throttle_duration_sec=1.0)

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._allowance.pause()
        return self._done(response, f'paused at t = {self._plant.time:.3f} s')

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._failure is not None:
            response.message = f'{self._failure}; call ~/reset first'
            return response
        self._allowance.resume()
        self._since = time.monotonic()
        if self._pace:
            self._pace.restart(self._since)
        return self._done(response, f'running from t = {self._plant.time:.3f} s')

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._failure = None
        self._gate.clear()
        self._plant.reset()
        self._ask(everything=True)
        return self._done(response, 'back at the start of the scene; time goes on, now '
                          f't = {self._plant.time:.3f} s'
                          + (', paused' if self._allowance.paused else ''))

    @staticmethod
    def _done(response: Trigger.Response, message: str) -> Trigger.Response:
        response.success, response.message = True, message
        return response

    async def _on_step(self, request: Step.Request, response: Step.Response) -> Step.Response:
        """Advance a paused simulation by some periods."""
        if not self._allowance.paused or self._failure is not None:
            response.message = (f'{self._failure}; call ~/reset first' if self._failure
                                else 'not paused: call ~/pause first')
        else:
            done = self._allowance.step(max(1, request.periods))
            self._since = time.monotonic()
            if self._pace:
                self._pace.restart(self._since)
            response.success = bool(await done)
            response.message = '' if response.success else 'ended before all periods were run'
        response.time = to_time(self._plant.time)
        return response

    def _health(self) -> Tuple[bytes, str, dict]:
        """Return level, message and numbers for /diagnostics."""
        values = {
            'simulated_time': f'{self._plant.time:.3f}', 'scene': self._settings.scene,
            'real_time_factor': f'{self._speed.factor:.3f}',
            'periods_dropped': self._pace.dropped if self._pace else 0,
            'commands_accepted': self._gate.accepted,
            'commands_refused': sum(self._gate.refused.values()),
            'error_estimate': f'{self._plant.error_estimate:.1e}',
            **{f'refused_{reason}': number for reason, number in self._gate.refused.items()}}
        if self._failure is not None:
            return diagnostics.ERROR, str(self._failure), values
        if self._plant.lost_at < math.inf:
            return diagnostics.WARN, (
                f'the accuracy of {self._settings.accuracy:g} m holds up to '
                f't = {self._plant.lost_at:.3f} s only: the motion is chaotic'), values
        if self._allowance.paused:
            return diagnostics.OK, 'paused', values
        if self._gate.refused:
            return diagnostics.WARN, 'running; commands were refused', values
        return diagnostics.OK, 'running', values


def main(args: Optional[List[str]] = None) -> int:
    """Run the node."""
    return run(Simulator, args)


if __name__ == '__main__':
    sys.exit(main())
