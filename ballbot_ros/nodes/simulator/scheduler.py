# SPDX-License-Identifier: Apache-2.0
"""Runs the control periods of a simulation: in real time, at maximum speed, or in lockstep."""
import math
import time
from typing import Callable, Optional, Union

from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from ballbot_ros.control import CommandGate
from ballbot_ros.errors import RefusedError, SimulationError
from ballbot_ros.nodes.simulator.laws_inside import LawsInside
from ballbot_ros.nodes.simulator.outputs import Outputs
from ballbot_ros.nodes.simulator.settings import SimulatorSettings
from ballbot_ros.physics.model.state import State
from ballbot_ros.plant import Pace, Plant, Speedometer
from ballbot_ros.ros.conversions import to_seconds
from ballbot_ros.ros.endpoints import create_subscription
from ballbot_ros.ros.rclpy_compat import RcutilsLogger
from ballbot_ros.ros.run import CLOCK_TIMEOUT, CLOCK_WARNING_PERIOD

# Period at which an unanswered state is repeated: subscribers may not be discovered yet [s].
REPEAT_PERIOD = 0.2
# Wall time of one callback when the simulation runs as fast as possible [s].
BATCH_TIME = 0.002
# A larger lag behind a followed /clock is skipped: time jumps [s].  A smaller one is caught up
# with by at most this number of periods per call.
LAG_MAX = 1.0
PERIODS_MAX = 50
# Upper bound of the rounding of stamps to nanoseconds, as a fraction of a period.
STAMP_ROUNDING = 1e-4


class FollowedClock:
    """
    Counts the control periods that are due by /clock, in place of a `Pace`.

    The time of the plant starts at the first message, is never ahead of the newest one, and
    follows jumps of /clock, so that stamps have the common time of the graph.  `dropped` counts
    skipped periods.
    """

    def __init__(self, node: Node, plant: Plant):
        self._plant, self._logger = plant, node.get_logger()
        self._clock: Optional[float] = None
        self._joined = False
        self._waiting_since: Optional[float] = None
        self.dropped = 0
        create_subscription(node, '/clock', self._on_clock)

    def restart(self, now: float) -> None:
        """Synchronize with the clock again, for example after a pause."""
        self._joined = False

    def due(self, now: float) -> int:
        """Return the number of periods to run at `now` [s of wall time]."""
        if self._clock is None:
            self._wait(now)
            return 0
        there = math.floor(self._clock / self._plant.period + STAMP_ROUNDING)
        behind = there - self._plant.periods
        if not self._joined or not 0 <= behind * self._plant.period <= LAG_MAX:
            if self._joined:
                self.dropped += max(0, behind)
                self._logger.warning(
                    f'/clock is at {self._clock:.3f} s and this simulator at '
                    f'{self._plant.time:.3f} s: it follows this jump', throttle_duration_sec=1.0)
            self._plant.periods, self._joined = there, True
            return 0
        return min(behind, PERIODS_MAX)

    def _on_clock(self, message: Clock) -> None:
        self._clock = to_seconds(message.clock)

    def _wait(self, now: float) -> None:
        if self._waiting_since is None:
            self._waiting_since = now
        if now - self._waiting_since > CLOCK_TIMEOUT:
            self._logger.warning(
                'no /clock, and publish_clock is false: time is stopped; start the simulator '
                'that publishes /clock', throttle_duration_sec=CLOCK_WARNING_PERIOD)


class Scheduler:
    """
    Runs the control periods of a plant when they are due and publishes each new state.

    `gate` is the source of the torque; `clock` is given if another simulator publishes the time.
    When the simulation cannot continue, `failed` is called, and `failure` stops time until
    `reset`.
    """

    def __init__(self, plant: Plant, gate: Union[CommandGate, LawsInside], outputs: Outputs,
                 settings: SimulatorSettings, logger: RcutilsLogger,
                 failed: Callable[[], None], clock: Optional[FollowedClock] = None):
        self._plant, self._gate, self._outputs = plant, gate, outputs
        self._settings, self._logger, self._failed = settings, logger, failed
        self.left = 0 if settings.start_paused else None  # periods to run; None: unlimited
        self._steps: Optional[Future] = None
        self._clock = clock
        self._pace = self._new_pace(settings)
        self._speed = Speedometer()
        self._due = 0  # in lockstep, periods that are due and wait for their command
        self._expecting = False  # commands have arrived, so their timeout causes a warning
        self.failure: Optional[SimulationError] = None
        self._publish()

    @property
    def interval(self) -> float:
        """Return the period of calls of `tick` [s of wall time]."""
        if self._clock is not None:
            return self._plant.period
        if self._pace:
            return self._plant.period / self._settings.real_time_factor
        return REPEAT_PERIOD / 4 if self._settings.lockstep else BATCH_TIME / 4

    @property
    def paused(self) -> bool:
        """Return whether time is stopped until `resume` or `step`."""
        return self.left == 0

    @property
    def real_time_factor(self) -> float:
        """Return the measured factor, NaN before the first measurement."""
        return self._speed.factor

    @property
    def dropped(self) -> int:
        """Return the number of periods skipped because the machine was too slow."""
        return self._pace.dropped if self._pace else 0

    def tick(self) -> None:
        """Run the periods that are due now."""
        now = time.monotonic()
        self._speed.note(self._plant.time, now)
        if self.paused:
            return
        if self._settings.lockstep:
            if self._pace:
                self._due = min(1, self._due + self._pace.due(now))
            if not self._answered:
                self._wait(now)
            self._run_answered()
        elif self._pace:
            self._run_due(self._pace, now)
        else:
            while time.monotonic() - now < BATCH_TIME and not self.paused:
                self._run_period()

    def command_accepted(self, answer: bool) -> None:
        """Record a command; in lockstep, `answer` to the present state advances time."""
        self._expecting = True
        if answer:
            self._answered = True
            if self._settings.lockstep:
                self._run_answered()

    def follow(self, settings: SimulatorSettings) -> None:
        """Continue with new parameters."""
        before, self._settings = self._settings, settings
        if settings.real_time_factor != before.real_time_factor:
            dropped, self._pace = self.dropped, self._new_pace(settings)
            if isinstance(self._pace, Pace):
                self._pace.dropped = dropped
        if settings.real_time_factor != before.real_time_factor \
                or settings.lockstep != before.lockstep:
            self._due = 0
            self._restart()

    def _new_pace(self, settings: SimulatorSettings) -> Union[Pace, FollowedClock, None]:
        if self._clock is not None:
            return self._clock
        factor = settings.real_time_factor
        return Pace(self._plant.period, factor) if factor > 0.0 else None

    def pause(self) -> None:
        self._run_on(0)

    def resume(self) -> None:
        """Run without a limit; raise `RefusedError` after a failure."""
        self._start(None)

    def step(self, periods: int) -> Future:
        """
        Run some periods, then pause; return a future of whether all of them ran.

        Raises `RefusedError` after a failure, or while time is not stopped.
        """
        if self.failure is None and not self.paused:
            raise RefusedError('not paused: call ~/pause first', 'refused', 'simulation')
        self._start(periods)
        self._steps = Future()
        return self._steps

    @property
    def makes_time(self) -> bool:
        """Return whether this simulator, not another one, publishes the time."""
        return self._clock is None

    def reset(self, state: bool = True, time: bool = True) -> None:
        """
        Return to the start of the scene.

        `state` resets the robot, and clears failure and commands; `time` resets the simulated
        time, unless another simulator publishes it.
        """
        time = time and self.makes_time
        self._gate.clear()
        if state:
            self.failure = None
            self._plant.reset(time)
        elif time:
            self._plant.periods = 0
            self._plant.put(self._plant.state)
        self._restart()
        self._publish(everything=True)

    def put(self, state: State) -> None:
        self._plant.put(state)
        self._publish(everything=True)

    def _start(self, periods: Optional[int]) -> None:
        if self.failure is not None:
            raise RefusedError(f'{self.failure}; call ~/reset first', 'failed', 'simulation')
        self._run_on(periods)
        self._restart()

    def _run_on(self, periods: Optional[int]) -> None:
        """End unfinished steps, and set the number of periods to run; None: unlimited."""
        self._end_steps(False)
        self.left = periods

    def _end_steps(self, complete: bool) -> None:
        if self._steps is not None:
            self._steps.set_result(complete)
            self._steps = None

    def _restart(self) -> None:
        self._since, self._speed = time.monotonic(), Speedometer()  # a pause is not a delay
        if self._pace:
            self._pace.restart(self._since)

    def _run_due(self, pace: Union[Pace, FollowedClock], now: float) -> None:
        dropped, wanted = pace.dropped, self._settings.real_time_factor
        for _ in range(pace.due(now)):
            if not self.paused:  # a failure or the last step may have paused it
                self._run_period()
        # A followed clock sets the pace, and `FollowedClock` logs its jumps.
        if self.makes_time and pace.dropped > dropped and self._speed.factor < 0.98 * wanted:
            self._logger.warning(
                f'falling behind: real-time factor {self._speed.factor:.2f} instead of '
                f'{wanted:g}', throttle_duration_sec=2.0)

    def _run_answered(self) -> None:
        """In lockstep: run the period whose state has been answered, if it is due."""
        if self._answered and not self.paused and (self._due or not self._pace):
            self._due = 0
            self._run_period()

    def _run_period(self) -> None:
        now = self._plant.time
        if self._gate.expired(now) and self._expecting:
            self._expecting = False
            self._logger.warning(
                f'no command for {self._settings.command_timeout:g} s at t = {now:.3f} s: '
                'torque is 0; is the controller running?')
        try:
            self._plant.advance(self._gate.torque(now), self._gate.lean(now))
        except SimulationError as error:
            self.failure = error
            self.pause()
            self._logger.fatal(f'{error}. Nothing is published until ~/reset.')
            self._failed()
            return
        if self.left is not None:
            self.left -= 1
            if not self.left:
                self._end_steps(True)
        self._publish()

    def _publish(self, everything: bool = False) -> None:
        """Publish the state; in lockstep this requests the command that answers it."""
        self._answered = False
        self._published = self._since = time.monotonic()
        self._outputs.publish(everything)

    def _wait(self, now: float) -> None:
        """Repeat an unanswered state, and warn after the timeout."""
        if now - self._published >= REPEAT_PERIOD:
            self._published = now
            self._outputs.repeat()
        if now - self._since >= self._settings.lockstep_timeout:
            self._gate.clear()
            self._logger.warning(
                f'no command answers the state of t = {self._plant.time:.3f} s: time is '
                'stopped, torque is 0; is the controller running? (subscribers of joint_states: '
                f'{self._outputs.state_subscribers})', throttle_duration_sec=10.0)
