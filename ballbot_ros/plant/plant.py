# SPDX-License-Identifier: Apache-2.0
"""The simulated robot, advanced one control period at a time."""
import math
from typing import Optional

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import dynamics
from ballbot_ros.physics.model import Model, State
from ballbot_ros.physics.scene import Scene
from ballbot_ros.physics.simulation import steps_in


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

    Raises
    ------
    ConfigurationError
        If the period is not a whole number of steps.

    """

    def __init__(self, scene: Scene, control_rate: float, torque_limit: Optional[float] = None):
        """Start at the start of the scene."""
        if not (control_rate > 0.0 and math.isfinite(control_rate)):
            raise ConfigurationError(f'control_rate must be above 0 Hz, got {control_rate!r}')
        self.model: Model = scene.model
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
        self.state: State = self._start

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
        drive = dynamics.Drive(dynamics.TORQUE, cut, limit=self.torque_limit)
        after = self.model.advance(self.state, drive, self._steps)
        self.periods += 1
        self.torque = cut if self.model.robot.has_pendulum else 0.0
        self.state = after._replace(time=self.time)
        return self.state

    def reset(self) -> State:
        """Go back to the start of the scene; time goes on."""
        self.state = self._start._replace(time=self.time)
        self.torque = 0.0
        return self.state
