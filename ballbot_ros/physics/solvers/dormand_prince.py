# SPDX-License-Identifier: Apache-2.0
"""
One step of the embedded Runge-Kutta pair of Dormand and Prince, 5(4), in a frozen mode.

It includes the estimate of the local error and the continuous extension; `integrate` uses it.

Reference: E. Hairer, S. P. Noersett, G. Wanner, Solving Ordinary Differential Equations I,
sections II.4 to II.6 (DOPRI5).
"""
import math

import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.equations import angle_trig, AngleTrig, System, write_motion
from ballbot_ros.physics.mechanics.modes import (
    mode_accelerations, mode_derivative, smooth_contacts)
from ballbot_ros.physics.model.state import PENDULUM_ANGLE, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import (
    ALONE, EVALUATIONS, MOTION, NOTHING, RATES, STABLE, sum_rows, WIDTH, Workspace)

STAGES = 7
DAMPS = False

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
STARTS = A.ravel()  # in the form for `values.sum_rows`


@compiled
def write_rates(time: float, motion: int, out: int, start: AngleTrig, system: System,
                workspace: Workspace) -> None:
    """Write the rates of a motion, a row of the workspace, into another row."""
    work = workspace.work
    if smooth_contacts(workspace.mode):
        row = work[motion:motion + MOTION]
        found = mode_accelerations(time, row, start, system, workspace.mode)
        write_motion(row, found, system.parameters, work[out:out + MOTION])
    else:
        mode_derivative(time, work[motion:motion + SIZE], system, workspace.mode,
                        work[out:out + SIZE])


@compiled
def step(time: float, state: Array, size: float, ready: int, system: System,
         workspace: Workspace) -> tuple[float, int]:
    """
    Take one step; see the contract in `solvers`.

    The stiffness is the step times the rate of the fastest decay, estimated from the last two
    stages, which are at the same time, divided by `STABLE`.
    """
    work, last = workspace.work, values.F0 + WIDTH * (STAGES - 1)
    start = angle_trig(state[PENDULUM_ANGLE])
    for i in range(MOTION):
        work[values.START + i] = state[i]
    first = 0 if ready == NOTHING else 1
    for stage in range(first, STAGES):
        if stage == STAGES - 1:
            sum_rows(work, values.PROBE, values.END, 0.0, ALONE, 0, values.ZERO, 1)
        sum_rows(work, values.END, values.START, size, STARTS, (STAGES - 1) * stage, values.F0,
                 stage)
        write_rates(time + C[stage] * size, values.END, values.F0 + WIDTH * stage, start, system,
                    workspace)
    apart = faster = 0.0
    for i in range(MOTION):
        moved, changed = (work[values.END + i] - work[values.PROBE + i],
                          work[last + i] - work[last - WIDTH + i])
        apart += moved * moved
        faster += changed * changed
    sum_rows(work, values.ERROR, values.ZERO, size, ERROR, 0, values.F0, STAGES)
    workspace.statistics[EVALUATIONS] += STAGES - first
    stiffness = size * math.sqrt(faster / apart) / STABLE if apart > 0.0 else 0.0
    return stiffness, max(ready, RATES)


@compiled
def end_step(workspace: Workspace) -> int:
    """Make the last stage the first one of the next step."""
    last = values.F0 + WIDTH * (STAGES - 1)
    sum_rows(workspace.work, values.F0, values.ZERO, 1.0, ALONE, 0, last, 1)
    return RATES


@compiled
def prepare_dense(size: float, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output, of order 4."""
    work, dense = workspace.work, values.DENSE
    sum_rows(work, dense, values.START, 0.0, ALONE, 0, values.ZERO, 1)
    sum_rows(work, dense + WIDTH, values.END, -1.0, ALONE, 0, values.START, 1)
    # Curvature of the motion at the start, and at the end.
    sum_rows(work, dense + 2 * WIDTH, values.ZERO, size, ALONE, 0, values.F0, 1)
    sum_rows(work, dense + 2 * WIDTH, dense + 2 * WIDTH, -1.0, ALONE, 0, dense + WIDTH, 1)
    sum_rows(work, dense + 3 * WIDTH, dense + WIDTH, -size, ALONE, 0,
             values.F0 + WIDTH * (STAGES - 1), 1)
    sum_rows(work, dense + 3 * WIDTH, dense + 3 * WIDTH, -1.0, ALONE, 0, dense + 2 * WIDTH, 1)
    sum_rows(work, dense + 4 * WIDTH, values.ZERO, size, CONTINUE, 0, values.F0, STAGES)
