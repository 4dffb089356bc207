# SPDX-License-Identifier: Apache-2.0
"""A robot at a step, and its maximum step height by the full model."""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.crossing import max_step_height, max_step_heights
from ballbot_ros.crossing.rules import held_at, Rules, Site
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array

# Speeds of the curves of Figs. 5, 6 and 8 [m/s].
SPEEDS: Array = np.linspace(0.2, 1.2, 21, dtype=np.float64)

LEVEL = 0.5 * math.pi

ACCURACY = 2e-5  # of heights [m]


class Case(NamedTuple):
    """A robot at a step."""

    robot: Robot
    actuation: Actuation = Actuation()
    pendulum_angle: float = 0.0  # absolute, at the first touch [rad]
    site: Site = Site()
    rules: Rules = Rules()

    @property
    def held(self) -> bool:
        """Return whether law (11) holds the pendulum."""
        return self.actuation.law == 'position'

    @property
    def swings(self) -> bool:
        """Return whether there is a free pendulum."""
        return self.robot.has_pendulum and not self.held


def holding(robot: Robot, angle: float) -> Case:
    """Return a robot whose pendulum law (11) holds at an absolute angle [rad]."""
    return Case(robot, held_at(angle), angle)


def step_height(case: Case, speed: float, accuracy: float = ACCURACY) -> float:
    """Return the maximum step height by the full model at a speed [m/s], to an accuracy [m]."""
    return max_step_height(case.robot, speed, case.actuation, case.pendulum_angle, accuracy,
                           case.site, case.rules).height


def step_heights(case: Case, speeds: Array) -> Array:
    """Return `step_height` at each speed, computed as a batch [m]."""
    return np.array([item.height for item in max_step_heights(
        case.robot, speeds.tolist(), case.actuation, case.pendulum_angle, ACCURACY, case.site,
        case.rules)])
