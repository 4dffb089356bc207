# SPDX-License-Identifier: Apache-2.0
"""The simulated robot, advanced one control period at a time."""
from dataclasses import replace
import math
from typing import Optional

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.mechanics import equations
from ballbot_ros.physics.simulation.accuracy import solvers_for
from ballbot_ros.physics.simulation.model import Model, State
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.simulate import steps_in


class Plant:
    """
    A scene whose motor takes a torque per control period.

    Time is the number of periods done times their length, so it carries no accumulated
    rounding; it goes on through a reset.

    Parameters
    ----------
    scene : Scene
        Its actuation is not used.
    control_rate : float
        [Hz]; a control period must be a whole number of solver steps.
    torque_limit : float, optional
        [N m]; that of the robot's motor if not given, none without a motor.
    accuracy : float, optional
        Chooses the solver by itself [m].  A shadow with a coarser one then runs along under
        the same torques, and how far the two are apart estimates the error.

    Attributes
    ----------
    error_estimate : float
        Largest distance between the two so far [m]; NaN without an accuracy.
    lost_at : float
        Time since which the accuracy does not hold any more [s], infinite while it does.

    Raises
    ------
    ConfigurationError
        If the period is not a whole number of steps.

    """

    def __init__(self, scene: Scene, control_rate: float, torque_limit: Optional[float] = None,
                 accuracy: Optional[float] = None):
        """Start at the start of the scene."""
        if not (control_rate > 0.0 and math.isfinite(control_rate)):
            raise ConfigurationError(f'control_rate must be above 0 Hz, got {control_rate!r}')
        self.model: Model = scene.model
        self._accuracy = math.nan if accuracy is None else accuracy
        self._shadow: Optional[Model] = None
        if accuracy is not None:
            coarse, fine = solvers_for(accuracy, scene.model.solver.step)
            self.model = replace(scene.model, solver=fine)
            self._shadow = replace(scene.model, solver=coarse)
        self.period = 1.0 / control_rate
        self._steps = steps_in(self.period, scene.model.solver.step,
                               f'a control period (control_rate {control_rate:g} Hz)')
        if torque_limit is None:
            motor = scene.model.robot.motor
            torque_limit = motor.maximum_torque if motor else 1e9
        self.torque_limit = torque_limit
        self._start = scene.start
        self.periods = 0
        self.torque = 0.0
        self.state = self._shade = self._start
        self.error_estimate = math.nan if accuracy is None else 0.0
        self.lost_at = math.inf
        # Compile now: the first control period must not wait for it.
        for model in (self.model, self._shadow):
            if model is not None:
                model.advance(self._start, equations.Drive(equations.TORQUE), 1)

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return self.periods * self.period

    def advance(self, torque: float) -> State:
        """
        Advance by one control period under a constant torque and return the new state.

        Parameters
        ----------
        torque : float
            At the pendulum [N m]; cut to the torque limit.

        Raises
        ------
        SimulationError
            If the run cannot go on; state and time stay at the last good ones.

        """
        cut = min(max(torque, -self.torque_limit), self.torque_limit)
        drive = equations.Drive(equations.TORQUE, cut, limit=self.torque_limit)
        after = self.model.advance(self.state, drive, self._steps)
        shade = self._shadow.advance(self._shade, drive, self._steps) if self._shadow else None
        self.periods += 1
        self.torque = cut if self.model.robot.has_pendulum else 0.0
        if shade is not None:
            self._shade = shade._replace(time=self.time)
            self._compare(after)
        self.state = after._replace(time=self.time)
        return self.state

    def _compare(self, after: State) -> None:
        """Note how far the shadow is away."""
        gap = math.hypot(after.x - self._shade.x, after.y - self._shade.y)
        self.error_estimate = max(self.error_estimate, gap)
        if self.lost_at == math.inf and not gap <= self._accuracy:
            self.lost_at = self.time

    def reset(self) -> State:
        """Go back to the start of the scene; time goes on."""
        self.state = self._shade = self._start._replace(time=self.time)
        self.torque = 0.0
        self.error_estimate = math.nan if self._shadow is None else 0.0
        self.lost_at = math.inf
        return self.state
