# SPDX-License-Identifier: Apache-2.0
"""
The closed loop of one approach in compiled code.

Law (11) is sampled and held, the motor follows its torque-speed line, the plant is the full model.
The results are bit-identical to those of a `plant.Plant` under a `PendulumController`, but all
periods between two observations are one call into compiled code.
"""
import math
from typing import Tuple

import numpy as np

from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.jit import compiled, unlocked
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.actuation import Actuator, applied_torque, position_torque, TORQUE
from ballbot_ros.physics.model.robot import Parameters, Robot
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, State, VELOCITY_X, X, Y)
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.solver import failure, Solver
from ballbot_ros.physics.solvers.integrate import integrate
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, FINISHED, NO_OUTPUT, Options, Output, Packed, status_at, unpack_workspace,
    Workspace)
from ballbot_ros.studies.evaluation.terrains import FACE_HEIGHT, FACE_SLOPE

PERIOD = 0.002  # of control [s]
SOLVER = Solver('adaptive', tolerance=1e-7)
BUDGET = 50_000_000  # evaluations of the right-hand side in one approach

# Number of the first period, number of periods, length of a period [s].
Span = Tuple[int, int, float]
# Set angle [rad], gain on the speed error [rad s/m], set speed [m/s], largest set angle [rad];
# position [m] from which another set angle [rad] applies.
Script = Tuple[float, float, float, float, float, float]
# Gains of law (11), gravity torque and torque limit; then the four of `Robot.motor_line`.
Drive = Tuple[float, float, float, float, float, float, float, float]

# Columns of the watched pieces, a row for each straight piece of a face: both ends [m], whether
# the ball touches it, horizontal speed towards it and period number at the last touch [m/s].
AX, AY, BX, BY, TOUCHED, TOUCH_SPEED, TOUCH_PERIOD = range(7)

SEPARATION = 0.03  # the next contact is a new one if the ball was farther away than this [m]


# Periods, set angles, law and motor, system, options, state (13,), watched pieces (n, 7), output
# without rows, workspace.
Call = Tuple[Span, Script, Drive, Tuple[Tuple[float, ...], Array],
             Tuple[float, float, int, int, bool, bool], Array, Array,
             Tuple[Array, float, float, int], Packed]


@compiled
def gap_to(piece: Array, x: float, y: float) -> Tuple[float, bool]:
    """Return the distance of a point to a face piece [m], and whether it is on the lower side."""
    along_x, along_y = piece[BX] - piece[AX], piece[BY] - piece[AY]
    share = ((x - piece[AX]) * along_x + (y - piece[AY]) * along_y) / (
        along_x * along_x + along_y * along_y)
    share = min(max(share, 0.0), 1.0)
    near_x, near_y = piece[AX] + share * along_x, piece[AY] + share * along_y
    below = x < piece[BX] if along_y > 0.0 else x > piece[AX]
    return math.hypot(near_x - x, near_y - y), below


@compiled
def watch_touches(watched: Array, before: float, state: Array, radius: float, period: int) -> None:
    """Record the pieces of faces that the ball touches from below, and the touch speeds."""
    for row in range(len(watched)):
        piece = watched[row]
        gap, below = gap_to(piece, state[X], state[Y])
        if gap > radius + SEPARATION:
            piece[TOUCHED] = 0.0
            continue
        towards = before if piece[BY] > piece[AY] else -before
        if gap <= radius and below and towards > 0.0 and piece[TOUCHED] == 0.0:
            piece[TOUCHED] = 1.0
            piece[TOUCH_SPEED] = towards
            piece[TOUCH_PERIOD] = period


@compiled
def scripted_angle(state: Array, script: Script) -> float:
    """Return the set angle of the pendulum [rad]."""
    angle, gain, speed, lean, swing_position, swing_angle = script
    if state[X] >= swing_position:
        return swing_angle
    missing: float = speed - state[VELOCITY_X]
    return min(max(angle + gain * missing, -lean), lean)


@unlocked
def advance_periods(call: Call) -> Tuple[int, int, float]:
    """
    Advance a state in place by a number of control periods.

    Returns FINISHED, or the reason for a failure, see `solvers.values`; the number of finished
    periods; and the torque in the last one [N m].
    """
    span, script, drive, packed, solving, state, watched, rows, arrays = call
    first, count, period = span
    kp, kd, gravity_torque, most, stall, back, supply, maximum = drive
    parameters, ground = Parameters(*packed[0]), packed[1]
    options, output = Options(*solving), Output(*rows)
    workspace = unpack_workspace(arrays)
    torque = 0.0
    for number in range(first, first + count):
        requested = position_torque(state[PENDULUM_ANGLE], state[PENDULUM_RATE],
                                    scripted_angle(state, script), kp, kd, gravity_torque)
        torque = applied_torque(requested, state[PENDULUM_RATE] - state[BALL_RATE],
                                (stall, back, supply, maximum), most)
        system = System(parameters, ground,
                        Actuator(TORQUE, torque, 0.0, 0.0, 0.0, maximum, 0.0, 0.0))
        before = state[VELOCITY_X]
        after = integrate(status_at(number * period, FINISHED, 0), number * period + period, state,
                          system, options, output, workspace)
        if after.outcome != FINISHED:
            return after.outcome, number - first, torque
        watch_touches(watched, before, state, parameters.radius, number + 1)
    return FINISHED, count, torque


class ClosedLoop:
    """
    A ball under law (11), whose set angle is held for a number of control periods.

    The true robot starts at x with a speed [m/s] and a pendulum angle [rad]; the controller
    assumes the nominal one.  `watched` has the straight pieces of the faces, (n, 7), with the
    columns `AX` to `TOUCH_PERIOD`.
    """

    def __init__(self, robot: Robot, terrain: Terrain, nominal: Robot, gains: ControlTuning,
                 speed: float, pendulum_angle: float, x: float = 0.0):
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
        return State(self.time, *self._vector.tolist())

    def advance(self, set_angle: float, periods: int) -> None:
        """Advance by a number of periods under one set angle [rad]."""
        self.follow((set_angle, 0.0, 0.0, math.inf, math.inf, 0.0), periods)

    def follow(self, script: Script, periods: int) -> None:
        """
        Advance by a number of periods with the set angles of a script.

        Raises `SimulationError` if the run fails.
        """
        outcome, done, self.torque = advance_periods((
            (self.periods, periods, PERIOD), script, self._drive, self._system, self._options,
            self._vector, self.watched, NO_OUTPUT[:], self._workspace))
        self.periods += done
        if outcome != FINISHED:
            raise failure(outcome, self.time, self._vector, SOLVER)


def watched_pieces(terrain: Terrain) -> Array:
    """Return the straight pieces of all faces as `advance_periods` watches them."""
    pieces = [(*one, *other, 0.0, 0.0, 0.0) for face in terrain.faces(FACE_SLOPE, FACE_HEIGHT)
              for one, other in zip(face[:-1].tolist(), face[1:].tolist())]
    return np.array(pieces).reshape(-1, 7)


def balanced_angle(robot: Robot, slope: float) -> float:
    """Return the pendulum angle of a ball that rolls steadily on a slope [rad]."""
    share = robot.total_mass * robot.ball_radius * math.sin(slope) / robot.pendulum_moment
    return math.asin(min(max(share, -1.0), 1.0))
