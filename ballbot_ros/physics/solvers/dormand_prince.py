# SPDX-License-Identifier: Apache-2.0
"""
One step of the embedded Runge-Kutta pair of Dormand and Prince, 5(4), in a frozen mode.

With its estimate of the local error and its continuous extension; see `integrate` for the use.

Reference: E. Hairer, S. P. Noersett, G. Wanner, Solving Ordinary Differential Equations I,
sections II.4 to II.6 (DOPRI5).
"""
import math

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.modes import mode_derivative
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import SIZE, VELOCITY_Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.controller import STABLE
from ballbot_ros.physics.solvers.dense import add_rows
from ballbot_ros.physics.solvers.values import EVALUATIONS, Workspace

STAGES = 7

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
def step(time: float, state: Array, size: float, system: System, workspace: Workspace) -> float:
    """
    Take one step; see the contract in `solvers`.

    Returns the step over the longest that is stable, about: the step times the rate of the
    fastest decay, seen from the last two stages, which are at the same time; over `STABLE`.
    """
    stages, y_new, y_before = workspace.stages, workspace.y_new, workspace.probe
    for stage in range(1, STAGES):
        if stage == STAGES - 1:
            for i in range(VELOCITY_Y + 1):
                y_before[i] = y_new[i]
        for i in range(SIZE):
            y_new[i] = state[i]
        add_rows(stage, A[stage], size, stages, y_new)
        mode_derivative(time + C[stage] * size, y_new, system, workspace.mode, stages[stage])
    apart = faster = 0.0
    for i in range(VELOCITY_Y + 1):
        apart += (y_new[i] - y_before[i])**2
        faster += (stages[STAGES - 1, i] - stages[STAGES - 2, i])**2
    for i in range(SIZE):
        workspace.error[i] = 0.0
    add_rows(STAGES, ERROR, size, stages, workspace.error)
    workspace.statistics[EVALUATIONS] += STAGES - 1
    return size * math.sqrt(faster / apart) / STABLE if apart > 0.0 else 0.0


@compiled
def prepare_dense(state: Array, size: float, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output, of order 4."""
    stages, dense = workspace.stages, workspace.dense
    for i in range(SIZE):
        change = workspace.y_new[i] - state[i]
        bend = size * stages[0, i] - change
        last = 0.0
        for stage in range(STAGES):
            last += CONTINUE[stage] * stages[stage, i]
        dense[0, i] = state[i]
        dense[1, i] = change
        dense[2, i] = bend
        dense[3, i] = change - size * stages[STAGES - 1, i] - bend
        dense[4, i] = size * last
