# SPDX-License-Identifier: Apache-2.0
"""
One step of the embedded Runge-Kutta pair of Dormand and Prince, 5(4), in a frozen mode.

With its estimate of the local error and its continuous extension; see `adaptive` for the use.

Reference: E. Hairer, S. P. Noersett, G. Wanner, Solving Ordinary Differential Equations I,
sections II.4 to II.6 (DOPRI5).
"""
import math
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.equations import SIZE, VELOCITY_Y
from ballbot_ros.physics.mechanics.modes import mode_derivative
from ballbot_ros.physics.solvers.embedded import add_rows, BEGIN, DENSE, PROBE, RATES, STABLE

STAGES = 7  # of which the first is the row BEGIN of the work array, and the others follow it

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
def run_explicit_stages(time: float, state: Any, step: float, mode: Any, count: int, robot: Any,
                        ground: Any, drive: Any, table: Any, work: Any) -> float:
    """
    Compute all stages, the new state and its estimated error.

    Returns the step over the longest that is stable, about: the step times the rate of the
    fastest decay, seen from the last two stages, which are at the same time; over `STABLE`.
    """
    for stage in range(1, STAGES):
        if stage == STAGES - 1:
            for i in range(VELOCITY_Y + 1):
                work[RATES, i] = work[PROBE, i]
        for i in range(SIZE):
            work[PROBE, i] = state[i]
        add_rows(stage, A[stage], step, work, work[PROBE])
        mode_derivative(time + C[stage] * step, work[PROBE], mode, count, robot, ground, drive,
                        table, work[stage])
    apart = faster = 0.0
    for i in range(VELOCITY_Y + 1):
        apart += (work[PROBE, i] - work[RATES, i])**2
        faster += (work[STAGES - 1, i] - work[STAGES - 2, i])**2
    for i in range(SIZE):
        work[RATES, i] = 0.0
    add_rows(STAGES, ERROR, step, work, work[RATES])
    return step * math.sqrt(faster / apart) / STABLE if apart > 0.0 else 0.0


@compiled
def prepare_explicit_dense(state: Any, step: float, work: Any) -> None:
    """Compute the coefficients of the continuous extension, of order 4."""
    for i in range(SIZE):
        change = work[PROBE, i] - state[i]
        bend = step * work[BEGIN, i] - change
        last = 0.0
        for stage in range(STAGES):
            last += CONTINUE[stage] * work[stage, i]
        work[DENSE, i] = state[i]
        work[DENSE + 1, i] = change
        work[DENSE + 2, i] = bend
        work[DENSE + 3, i] = change - step * work[STAGES - 1, i] - bend
        work[DENSE + 4, i] = step * last
