# SPDX-License-Identifier: Apache-2.0
"""Error estimate of a running plant: a coarser solver runs in parallel, under the same torques."""
import math

from ballbot_ros.physics.model.actuation import Actuator
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.model import Model


class ErrorMonitor:
    """
    Estimates the error of position of a plant by its distance to a coarser run.

    The model is that of the plant with a coarser solver, the accuracy the error allowed [m];
    `error` is the largest distance so far [m], and `accuracy_lost_at` the time since which the
    accuracy does not hold any more [s], infinite while it does.
    """

    def __init__(self, model: Model, start: State, accuracy: float):
        self._model, self._accuracy = model, accuracy
        self.reset(start)

    def reset(self, start: State) -> None:
        self._state = start
        self.error, self.accuracy_lost_at = 0.0, math.inf

    def advance(self, after: State, actuator: Actuator, steps: int) -> None:
        """
        Compare with the state of the plant after a number of solver steps of an actuation.

        Raises `SimulationError` if the coarser run fails; its state is unchanged then.
        """
        coarse = self._model.advance(self._state, actuator, steps)
        self._state = coarse._replace(time=after.time)
        distance = math.hypot(after.x - coarse.x, after.y - coarse.y)
        self.error = max(self.error, distance)
        if self.accuracy_lost_at == math.inf and not distance <= self._accuracy:
            self.accuracy_lost_at = after.time
