# SPDX-License-Identifier: Apache-2.0
"""The plant and law (11) for one approach, run in compiled code; see `control.periods`."""
import math
from typing import Tuple

import numpy as np

from ballbot_ros.control.periods import advance_periods, Script
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.failures import failure
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, FINISHED, NO_OUTPUT, Options, Workspace)

PERIOD = 0.002  # of control [s]
SOLVER = Solver('adaptive', tolerance=1e-7)
BUDGET = 50_000_000  # right-hand sides of one approach

# A face is steeper than this, and at least so high: what is less is no obstacle.
STEEP, LEAST = math.tan(math.radians(25.0)), 0.005  # [1], [m]


class ClosedLoop:
    """
    A ball under law (11), whose set angle is held for some control periods.

    Parameters
    ----------
    robot : Robot
        As it truly is.
    terrain : Terrain
    nominal : Robot
        As the controller believes it to be.
    gains : ControlTuning
    speed, pendulum_angle : float
        At x = 0 [m/s], [rad].

    Attributes
    ----------
    model : Model
    watched : (n, 7) array
        The pieces of the faces; columns as in `control.periods`.

    """

    def __init__(self, robot: Robot, terrain: Terrain, nominal: Robot, gains: ControlTuning,
                 speed: float, pendulum_angle: float, x: float = 0.0):
        """Put the ball on the ground, rolling."""
        self.model = Model(robot, terrain, solver=SOLVER)
        self._vector = np.array(self.model.at_rest(x, speed, pendulum_angle)[1:])
        gravity = nominal.largest_gravity_torque if gains.gravity_compensation else 0.0
        self._drive = (gains.position_kp, gains.position_kd, gravity, gains.torque_limit,
                       *robot.motor_line)
        self.watched = watched_pieces(terrain)
        self._system = (self.model.parameters[:], self.model.profile)
        self._options = Options(SOLVER.tolerance, SOLVER.step, AUTOMATIC, BUDGET, False)[:]
        self._workspace = Workspace.of(len(self.model.profile)).plain
        self.periods = 0
        self.torque = 0.0

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return self.periods * PERIOD

    @property
    def state(self) -> State:
        """Return the state."""
        return State(self.time, *self._vector.tolist())

    def advance(self, set_angle: float, periods: int) -> None:
        """Advance by some periods under one set angle [rad]; see `follow`."""
        self.follow((set_angle, 0.0, 0.0, math.inf, math.inf, 0.0), periods)

    def follow(self, script: Script, periods: int) -> None:
        """
        Advance by some periods with set angles by a script, see `control.periods`.

        Raises
        ------
        SimulationError
            If the run cannot go on.

        """
        outcome, done, self.torque = advance_periods((
            (self.periods, periods, PERIOD), script, self._drive, self._system, self._options,
            self._vector, self.watched, NO_OUTPUT[:], self._workspace))
        self.periods += done
        if outcome != FINISHED:
            raise failure(outcome, self.time, self._vector, SOLVER)


def watched_pieces(terrain: Terrain) -> Array:
    """Return the straight pieces of all faces as `control.periods` watches them."""
    pieces = [(*one, *other, 0.0, 0.0, 0.0) for face in terrain.faces(STEEP, LEAST)
              for one, other in zip(face[:-1].tolist(), face[1:].tolist())]
    return np.array(pieces).reshape(-1, 7)


def true_faces(terrain: Terrain) -> Tuple[Tuple[float, float, float, float], ...]:
    """Return x and y of the left end, width and height of each face, from left to right [m]."""
    return tuple((float(face[0, 0]), float(face[0, 1]), float(face[-1, 0] - face[0, 0]),
                  float(face[-1, 1] - face[0, 1])) for face in terrain.faces(STEEP, LEAST))
