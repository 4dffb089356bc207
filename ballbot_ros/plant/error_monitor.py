# SPDX-License-Identifier: Apache-2.0
"""Error estimate of a running plant: a coarser solver runs in parallel with the same torques."""
import math

from ballbot_ros.physics.model.actuation import Actuator
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.model import Model


class ErrorMonitor:
    """
    Estimates the position error of a plant by its distance from a coarser run.

    `model` is that of the plant with a coarser solver, and `accuracy` the allowed error [m];
    `error` is the largest distance so far [m], and `accuracy_lost_at` the time at which the
    distance first exceeded the accuracy [s], infinite before.
    """

    def __init__(self, model: Model, start: State, accuracy: float):
        self._model, self._accuracy = model, accuracy
        self.reset(start)

    def reset(self, start: State) -> None:
        self._state = start
        self.error, self.accuracy_lost_at = 0.0, math.inf

    def advance(self, after: State, actuator: Actuator, steps: int) -> None:
        """
        Advance the coarser run by a number of solver steps and compare it with the plant's state.

        Raises `SimulationError` if the coarser run fails; its state is then unchanged.
        """
        coarse = self._model.advance(self._state, actuator, steps)
        self._state = coarse._replace(time=after.time)
        distance = math.hypot(after.x - coarse.x, after.y - coarse.y)
        self.error = max(self.error, distance)
        if self.accuracy_lost_at == math.inf and not distance <= self._accuracy:
            self.accuracy_lost_at = after.time
