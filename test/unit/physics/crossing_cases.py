# SPDX-License-Identifier: Apache-2.0
"""Crossings for single attempts from Python."""
import numpy as np

from ballbot_ros.crossing import Rules, Site
from ballbot_ros.crossing.attempt import Crossing, set_height, VERTICES
from ballbot_ros.physics import Actuation, ContactOptions
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import SIZE
from ballbot_ros.physics.solvers.values import NO_OUTPUT, Workspace


def ground_of(site, robot, height):
    """Return the ground of an attempt at a step of some height [m]."""
    ground = site.grounds(robot, 1)[0]
    set_height(ground, height)
    return ground


def crossing_of(robot, speed, actuation=Actuation(), site=Site(), rules=Rules()):
    """Return a crossing with its own work arrays."""
    return Crossing(
        rules.course(speed, actuation.start_angle),
        System(Parameters.of(robot, ContactOptions()), site.grounds(robot, 1)[0],
               actuation.actuator(robot)),
        10**8, np.zeros(SIZE), np.zeros(SIZE), NO_OUTPUT, Workspace.of(VERTICES),
        np.zeros(2, dtype=np.int64), np.zeros(1))
