# SPDX-License-Identifier: Apache-2.0
"""
One step of the Rosenbrock method Rodas5P, 5(4), in a frozen mode.

Linearly implicit and L-stable: stiff components (friction while the ball sticks, a hard contact)
are damped instead of limiting the step, and no iteration is needed that could fail.  A stage is
``((1 / (gamma h)) I - J) U_i = f(y + sum a_ij U_j) + sum c_ij U_j / h + h d_i f_t``, solved
by eliminating the coordinates: a 4 x 4 system in the velocities, factorised once per step.

Reference: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical
benchmarks within the Julia Differential Equations package, BIT Numer. Math. 63 (2023) 27.
"""
import math

import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.equations import turned_by
from ballbot_ros.physics.mechanics.jacobian import BALL, TIME, write_jacobian
from ballbot_ros.physics.mechanics.modes import (
    ContactMode, mode_accelerations, write_mode_motion_under)
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, COORDINATES, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import linear
from ballbot_ros.physics.solvers.linear import ALONE, invert, MOTION, sum_rows, WIDTH
from ballbot_ros.physics.solvers.values import EVALUATIONS, JACOBIAN, NOTHING, STABLE, Workspace

STAGES = 8
ORDER = 5
DAMPS = True
VELOCITIES = 4

GAMMA = 0.21193756319429014
OWN_START = 5  # the last stage with a separate start; each later one starts at the end of one
A = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0, 0.0, 0.0, 0.0, 0.0],
    [2.849394379747939, 0.45842242204463923, 0.0, 0.0, 0.0],
    [-6.954028509809101, 2.489845061869568, -10.358996098473584, 0.0, 0.0],
    [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641, 0.0],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
     0.030198172008377946]])
COUPLING = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-14.155112264123755, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-17.97296035885952, -2.859693295451294, 0.0, 0.0, 0.0, 0.0, 0.0],
    [147.12150275711716, -1.41221402718213, 71.68940251302358, 0.0, 0.0, 0.0, 0.0],
    [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306, 0.0, 0.0,
     0.0],
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
     -0.6610691825249471, 0.0, 0.0],
    [30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
     -19.097331116725623, -28.087943162872662, 0.0],
    [37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
     -40.06618937091002, -54.66780262877968, -9.48861652309627]])
NODES = np.array([0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716,
                  0.4288403609558664, 1.0, 1.0, 1.0])
BY_TIME = np.array([0.21193756319429014, -0.42387512638858027, -0.3384627126235924,
                    1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0])
CONTINUED = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722]])
# How the dense output is made of the stages: its last three coefficients.
CONTINUE = np.array([CONTINUED[0], CONTINUED[1] + CONTINUED[2], -CONTINUED[2]]).ravel()
# As `linear.sum_rows` takes them.
STARTS, COUPLINGS = A.ravel(), COUPLING.ravel()
COUPLED = STAGES - 1  # factors in a row of the latter


@compiled
def solve(right: int, out: int, work: Array) -> None:
    """Solve ``(I / scale - J) out = right`` for a motion; both are rows, see `linear`."""
    sum_rows(work, out, linear.ZERO, 1.0, work, right, linear.COLUMNS, MOTION)


@compiled
def begin_stage(stage: int, per_size: float, work: Array) -> None:
    """
    Write the start of a stage into END, and the terms of earlier ones in its right-hand side.

    Parameters
    ----------
    stage : int
        From 1.
    per_size : float
        One over the step [1/s].
    work : array
        See `rows`.

    """
    end, start, right, stages = linear.END, linear.START, linear.RIGHT, linear.STAGES
    # One branch per stage makes factors and row counts compile-time constants.
    if stage == 1:
        sum_rows(work, end, start, 1.0, STARTS, 1 * OWN_START, stages, 1)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 1 * COUPLED, stages, 1)
    elif stage == 2:
        sum_rows(work, end, start, 1.0, STARTS, 2 * OWN_START, stages, 2)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 2 * COUPLED, stages, 2)
    elif stage == 3:
        sum_rows(work, end, start, 1.0, STARTS, 3 * OWN_START, stages, 3)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 3 * COUPLED, stages, 3)
    elif stage == 4:
        sum_rows(work, end, start, 1.0, STARTS, 4 * OWN_START, stages, 4)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 4 * COUPLED, stages, 4)
    elif stage == 5:
        sum_rows(work, end, start, 1.0, STARTS, 5 * OWN_START, stages, 5)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 5 * COUPLED, stages, 5)
    elif stage == 6:
        sum_rows(work, end, end, 1.0, ALONE, 0, stages + 5 * WIDTH, 1)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 6 * COUPLED, stages, 6)
    elif stage == 7:
        sum_rows(work, end, end, 1.0, ALONE, 0, stages + 6 * WIDTH, 1)
        sum_rows(work, right, linear.ZERO, per_size, COUPLINGS, 7 * COUPLED, stages, 7)


@compiled
def add_motion(time: float, work: Array, system: System, mode: ContactMode) -> None:
    """Add the rates at the end of a stage to the right-hand side of the next."""
    motion, right = work[linear.END:linear.END + MOTION], linear.RIGHT
    trig = linear.PENDULUM_TRIG
    start = work[trig], work[trig + 1], work[trig + 2]
    turn, swing, along_x, along_y = mode_accelerations(time, motion, start, system, mode)
    work[right] += motion[BALL_RATE]
    if system.parameters.swing_inertia > 0.0:
        work[right + 1] += motion[PENDULUM_RATE]
    work[right + 2] += motion[VELOCITY_X]
    work[right + 3] += motion[VELOCITY_Y]
    work[right + 4] += turn
    work[right + 5] += swing
    work[right + 6] += along_x
    work[right + 7] += along_y


@compiled
def step(time: float, state: Array, size: float, ready: int, system: System,
         workspace: Workspace) -> tuple[float, int]:
    """Take one step; see the contract in `solvers`."""
    jacobian, work = workspace.jacobian, workspace.work
    if ready != JACOBIAN:
        start = turned_by(state[PENDULUM_ANGLE])
        push = write_jacobian(time, state, start[1:], system, workspace.mode, jacobian)
        trig = linear.PENDULUM_TRIG
        work[trig], work[trig + 1], work[trig + 2] = start
        write_mode_motion_under(time, state, start[1:], push, system, workspace.mode,
                                work[linear.F0:linear.F0 + MOTION])
        workspace.statistics[EVALUATIONS] += 2  # these rates, and the Jacobian
    timed = jacobian[BALL, TIME] != 0.0
    scale = GAMMA * size
    invert(jacobian, scale, work)
    for i in range(MOTION):
        work[linear.START + i] = work[linear.END + i] = state[i]
        work[linear.RIGHT + i] = work[linear.F0 + i]
    for stage in range(STAGES):
        row = linear.STAGES + WIDTH * stage
        if stage > 0:
            begin_stage(stage, 1.0 / size, work)
            add_motion(time + NODES[stage] * size, work, system, workspace.mode)
        if timed and BY_TIME[stage] != 0.0:
            for i in range(VELOCITIES):
                work[linear.RIGHT + COORDINATES + i] += size * BY_TIME[stage] * jacobian[i, TIME]
        solve(linear.RIGHT, row, work)
    last = linear.STAGES + WIDTH * (STAGES - 1)
    sum_rows(work, linear.ERROR, linear.ZERO, 1.0, ALONE, 0, last, 1)
    sum_rows(work, linear.END, linear.END, 1.0, ALONE, 0, last, 1)
    workspace.statistics[EVALUATIONS] += STAGES - 1
    return size / longest_stable(jacobian), JACOBIAN


@compiled
def end_step(_: Workspace) -> int:
    """Keep nothing: the rates at the end of the step are not known."""
    return NOTHING


@compiled
def longest_stable(jacobian: Array) -> float:
    """Return about the longest step that would be stable for the explicit method [s]."""
    decay = spring = 0.0
    for i in range(VELOCITIES):
        decay += jacobian[i, COORDINATES + i]
        spring += jacobian[i, i]
    return STABLE / max(abs(decay), math.sqrt(abs(spring)), 1e-6)


@compiled
def prepare_dense(_: float, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output, of order 4."""
    work = workspace.work
    sum_rows(work, linear.DENSE, linear.START, 1.0, ALONE, 0, linear.ZERO, 1)
    sum_rows(work, linear.DENSE + WIDTH, linear.END, -1.0, ALONE, 0, linear.START, 1)
    for item in range(3):
        sum_rows(work, linear.DENSE + WIDTH * (2 + item), linear.ZERO, 1.0, CONTINUE,
                 STAGES * item, linear.STAGES, STAGES)
