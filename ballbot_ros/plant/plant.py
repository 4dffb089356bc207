# SPDX-License-Identifier: Apache-2.0
"""The simulated robot, advanced one control period at a time."""
from dataclasses import replace
import math
from typing import Optional, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.actuation import Actuator, applied_torque, TORQUE
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.run import solvers_for, steps_in
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.plant.error_monitor import ErrorMonitor
from ballbot_ros.steering.model import LateralState

STRAIGHT = LateralState()


class Plant:
    """
    A scene with one motor torque per control period, limited by the motor.

    It corresponds to Physics of dm_control; the caller provides Task and Environment (the time of
    each period, the torque, the measured and published values).  Guarantees:

    * `advance` runs exactly one period at one torque, or raises and changes nothing.
    * `state` is immutable, and the same torques from the same start give bit-identical states,
      independent of the clock.
    * `time` is the number of completed periods times their length, without accumulated rounding;
      `reset` restores the first state, and time continues.
    * `torque` is the applied torque: the command, limited by the speed-torque curve of the motor
      at the joint rate at the start of the period.

    The actuation of the scene is not used; `control_rate` is in Hz; `torque_limit` is a limit in
    addition to the motor's [N m]; `accuracy` [m] selects the solver and enables an `ErrorMonitor`.
    Raises `ConfigurationError` if a control period is not a whole number of solver steps.
    """

    def __init__(self, scene: Scene, control_rate: float, torque_limit: Optional[float] = None,
                 accuracy: Optional[float] = None):
        if not (control_rate > 0.0 and math.isfinite(control_rate)):
            raise ConfigurationError(f'control_rate must be above 0 Hz, got {control_rate!r}',
                                     'out_of_range', 'control_rate')
        self.model: Model = scene.model
        self._monitor: Optional[ErrorMonitor] = None
        if accuracy is not None:
            coarse, fine = solvers_for(accuracy, scene.model.solver_in_use.step)
            self.model = replace(scene.model, solver=fine)
            self._monitor = ErrorMonitor(
                replace(scene.model, solver=coarse), scene.start, accuracy)
        self.period = 1.0 / control_rate
        self._steps = steps_in(self.period, scene.model.solver_in_use.step,
                               f'a control period (control_rate {control_rate:g} Hz)')
        self._line = scene.model.robot.motor_line
        self.limit_torque(torque_limit)
        self._start = self.state = scene.start
        self.periods = 0
        self._warm_up()
        self.reset()

    def _warm_up(self) -> None:
        """Compile all kernels of a period and of its outputs in advance."""
        self.model.advance(self._start, Actuator(TORQUE), 1)
        if self._monitor:
            self._monitor.advance(self._start, Actuator(TORQUE), 1)
        applied_torque(0.0, 0.0, self._line, self.torque_limit)
        # At this position the ball touches the ground.
        floor = replace(self.model, terrain=Terrain.flat())
        pressed = State(y=self.model.robot.ball_radius - 1e-4)
        floor.touches(pressed)
        floor.energies(pressed)

    @property
    def lateral(self) -> LateralState:
        """Return the lateral state; in a scene, that of a straight drive."""
        return STRAIGHT

    @property
    def relative_pose(self) -> Tuple[float, float, float]:
        """Return x, y and heading in the frame of the start, ``odom`` [m], [rad]."""
        return self.state.x, 0.0, 0.0

    @property
    def steers(self) -> bool:
        """Return whether `advance` accepts a lean set-point."""
        return False

    def profile(self) -> Terrain:
        """Return the ground along the path; the same object until the ground changes."""
        return self.model.terrain

    def limit_torque(self, torque_limit: Optional[float]) -> None:
        """Set the torque limit [N m] from the next period on; None for the motor's limit only."""
        self.torque_limit = min(1e9 if torque_limit is None else torque_limit, self._line[-1])

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return self.periods * self.period

    @property
    def error_estimate(self) -> float:
        """Return the largest estimated position error so far [m], NaN without an accuracy."""
        return self._monitor.error if self._monitor else math.nan

    @property
    def accuracy_lost_at(self) -> float:
        """Return when the error first exceeded the accuracy [s], infinite before."""
        return self._monitor.accuracy_lost_at if self._monitor else math.inf

    def advance(self, torque: float, lean_set_point: float = 0.0) -> State:
        """
        Advance by one control period at a constant torque and return the new state.

        The torque at the pendulum [N m] is limited to the range of the motor, and to the torque
        limit; the lean set-point [rad] is 0 unless the robot `steers`.  Raises
        `ConfigurationError` for a lean set-point of a robot that does not steer, and
        `SimulationError` if the run fails; the last valid state and time are kept.
        """
        if lean_set_point and not self.steers:
            raise ConfigurationError(
                f'robot {self.model.robot.name!r} can only drive straight here: a lean needs a '
                'section steering in its file, and a floor', 'unsupported', 'steering')
        cut = applied_torque(
            float(torque), self.state.joint_rate, self._line, self.torque_limit)
        actuator = Actuator(TORQUE, cut, limit=self.torque_limit)
        after = self.model.advance(self.state, actuator, self._steps)
        after = after._replace(time=(self.periods + 1) * self.period)
        if self._monitor:
            self._monitor.advance(after, actuator, self._steps)
        self.periods += 1
        self.torque = cut if self.model.robot.has_pendulum else 0.0
        self.state = after
        return after

    @property
    def at_start(self) -> bool:
        """Return whether the state is that of the start, or of the last reset."""
        return self.periods == self._first_period

    def reset(self, time: bool = False) -> State:
        """Return to the start of the scene; if `time` is true, also to time 0."""
        if time:
            self.periods = 0
        self.put(self._start)
        self._first_period = self.periods
        return self.state

    def put(self, state: State) -> State:
        """Set the state of the robot; the time of the given state is ignored."""
        self.state, self.torque, self._first_period = state._replace(time=self.time), 0.0, -1
        if self._monitor:
            self._monitor.reset(self.state)
        return self.state
