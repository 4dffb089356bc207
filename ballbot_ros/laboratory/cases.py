# SPDX-License-Identifier: Apache-2.0
"""A robot before a step, and the curve of the full model for it."""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.physics import highest_step
from ballbot_ros.physics.actuation import Actuation
from ballbot_ros.physics.crossing import held_at
from ballbot_ros.physics.model import Solver
from ballbot_ros.physics.robot import Robot
from ballbot_ros.physics.terrain import Array

# Speeds of the curves of Figs. 5, 6 and 8 [m/s].
SPEEDS: Array = np.linspace(0.2, 1.2, 21)

LEVEL = 0.5 * math.pi


class Case(NamedTuple):
    """A robot at a step, with its pendulum free or held."""

    robot: Robot
    actuation: Actuation = Actuation()
    pendulum_angle: float = 0.0  # absolute, at the first touch [rad]

    @property
    def held(self) -> bool:
        """Tell whether law (11) holds the pendulum."""
        return self.actuation.law == 'position'

    @property
    def swings(self) -> bool:
        """Tell whether there is a pendulum, and it is free."""
        return self.robot.has_pendulum and not self.held


def holding(robot: Robot, angle: float) -> Case:
    """Return a robot whose pendulum law (11) holds at an absolute angle [rad]."""
    return Case(robot, held_at(angle), angle)


def step_height(case: Case, speed: float, step: float = 1e-4) -> float:
    """
    Return the highest step by the full model [m].

    Parameters
    ----------
    case : Case
    speed : float
        Collision speed [m/s].
    step : float
        Of the integration [s].

    """
    return highest_step(case.robot, speed, case.actuation, case.pendulum_angle,
                        solver=Solver(step=step))


def step_heights(case: Case, speeds: Array, step: float = 1e-4) -> Array:
    """Return `step_height` at each speed [m]."""
    return np.array([step_height(case, speed, step) for speed in speeds.tolist()])
