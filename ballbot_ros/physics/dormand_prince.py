# SPDX-License-Identifier: Apache-2.0
"""
One step of the embedded Runge-Kutta pair of Dormand and Prince, 5(4), in a frozen mode.

With its estimate of the local error and its continuous extension; see `adaptive` for the use.
"""
import math
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.dynamics import (
    BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, SIZE, VELOCITY_Y)
from ballbot_ros.physics.modes import mode_derivative

# Rows of the work array: seven stages, then the coefficients of the dense output.
STAGES = 7
DENSE = 7
PROBE = 12
ROWS = 13

# Coefficients of the pair; the last row of A is the solution of order 5 (first same as last).
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
    [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
    [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]])
C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
CONTINUE = np.array([
    -12715105075 / 11282082432, 0.0, 87487479700 / 32700410799, -10690763975 / 1880347072,
    701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423])


@compiled
def run_stages(time: float, state: Any, step: float, mode: Any, count: int, robot: Any,
               ground: Any, drive: Any, table: Any, work: Any) -> None:
    """Compute stages 2 to 7 from stage 1, and the new state into the probe row."""
    for stage in range(1, STAGES):
        for i in range(SIZE):
            total = 0.0
            for earlier in range(stage):
                total += A[stage, earlier] * work[earlier, i]
            work[PROBE, i] = state[i] + step * total
        mode_derivative(time + C[stage] * step, work[PROBE], mode, count, robot, ground, drive,
                        table, work[stage])


@compiled
def local_error(state: Any, step: float, robot: Any, work: Any) -> float:
    """
    Return the estimated local error as a length at the rim of the ball [m].

    Angles count with the radius; velocities with the time that a contact lasts, in which an
    error of velocity becomes one of position.
    """
    duration = math.sqrt(robot.mass / robot.stiffness)
    worst = 0.0
    for i in range(VELOCITY_Y + 1):
        total = 0.0
        for stage in range(STAGES):
            total += ERROR[stage] * work[stage, i]
        weight = duration if i >= BALL_RATE else 1.0
        if i in (BALL_ANGLE, PENDULUM_ANGLE, BALL_RATE, PENDULUM_RATE):
            weight *= robot.radius
        part = weight * abs(step * total)
        if not part < math.inf:
            return math.inf  # max() would lose a NaN
        worst = max(worst, part)
    return worst


@compiled
def prepare_dense(state: Any, step: float, work: Any) -> None:
    """Compute the coefficients of the continuous extension, of order 4."""
    for i in range(SIZE):
        change = work[PROBE, i] - state[i]
        bend = step * work[0, i] - change
        last = 0.0
        for stage in range(STAGES):
            last += CONTINUE[stage] * work[stage, i]
        work[DENSE, i] = state[i]
        work[DENSE + 1, i] = change
        work[DENSE + 2, i] = bend
        work[DENSE + 3, i] = change - step * work[STAGES - 1, i] - bend
        work[DENSE + 4, i] = step * last


@compiled
def interpolate(part: float, work: Any, out: Any) -> None:
    """Write the state at `part` (0 to 1) of the last step into `out`."""
    rest = 1.0 - part
    for i in range(SIZE):
        out[i] = work[DENSE, i] + part * (work[DENSE + 1, i] + rest * (
            work[DENSE + 2, i] + part * (work[DENSE + 3, i] + rest * work[DENSE + 4, i])))
