# SPDX-License-Identifier: Apache-2.0
"""
One step of the Rosenbrock method Rodas5P, 5(4), in a frozen mode.

Linearly implicit and L-stable: what is stiff (friction while the ball sticks, a hard contact)
is damped instead of limiting the step, and no iteration is needed that could fail.  A stage is
``((1 / (gamma h)) I - J) U_i = f(y + sum a_ij U_j) + sum c_ij U_j / h + h d_i f_t``, solved
by eliminating the coordinates: a 4 x 4 system in the velocities, factorised once per step.

Reference: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical
benchmarks within the Julia Differential Equations package, BIT Numer. Math. 63 (2023) 27.
"""
import math

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.jacobian import TIME, write_jacobian
from ballbot_ros.physics.mechanics.modes import mode_derivative
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import COORDINATES, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.controller import STABLE
from ballbot_ros.physics.solvers.dense import add_rows
from ballbot_ros.physics.solvers.values import EVALUATIONS, Workspace

STAGES = 8
VELOCITIES = 4
DYNAMIC = COORDINATES + VELOCITIES

GAMMA = 0.21193756319429014
OWN_START = 5  # the last stage with a start of its own; each later one starts where one ends
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
CONTINUE = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
     0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
     20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
     -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722]])


@compiled
def invert(jacobian: Array, scale: float, inverse: Array) -> None:
    """
    Invert ``I / scale - B - scale A``, where [A B] is the Jacobian of the accelerations.

    Parameters
    ----------
    jacobian : array
        See `jacobian.write_jacobian`.
    scale : float
        gamma h [s].
    inverse : (4, 12) array
        Filled with the inverse, and with what it makes of ``scale A``; the last four columns
        hold the matrix itself.

    """
    size, behind = VELOCITIES, 2 * VELOCITIES
    for i in range(size):
        for j in range(size):
            inverse[i, behind + j] = -jacobian[i, COORDINATES + j] - scale * jacobian[i, j]
            inverse[i, j] = 0.0
            inverse[i, size + j] = scale * jacobian[i, j]
        inverse[i, behind + i] += 1.0 / scale
        inverse[i, i] = 1.0
    # Gauss and Jordan, with pivots; the first eight columns are the right-hand sides.
    for column in range(size):
        best = column
        for i in range(column + 1, size):
            if abs(inverse[i, behind + column]) > abs(inverse[best, behind + column]):
                best = i
        pivot = 1.0 / inverse[best, behind + column]
        for j in range(behind + size):
            kept = inverse[column, j]
            inverse[column, j] = pivot * inverse[best, j]
            if best != column:
                inverse[best, j] = kept
        for i in range(size):
            factor = inverse[i, behind + column]
            if i != column:
                for j in range(behind + size):
                    inverse[i, j] -= factor * inverse[column, j]


@compiled
def solve(jacobian: Array, scale: float, inverse: Array, right: Array, out: Array) -> None:
    """Solve ``(I / scale - J) out = right`` for a whole state vector, see `invert`."""
    r0, r1, r2, r3 = right[0], right[1], right[2], right[3]
    r4, r5, r6, r7 = right[4], right[5], right[6], right[7]
    for i in range(VELOCITIES):
        u = inverse[i]
        rate = (u[0] * r4 + u[1] * r5 + u[2] * r6 + u[3] * r7
                + u[4] * r0 + u[5] * r1 + u[6] * r2 + u[7] * r3)
        out[COORDINATES + i] = rate
        out[i] = scale * (right[i] + rate)
    for i in range(DYNAMIC, SIZE):
        s = jacobian[i - COORDINATES]
        out[i] = scale * (right[i] + s[0] * out[0] + s[1] * out[1] + s[2] * out[2]
                          + s[3] * out[3] + s[4] * out[4] + s[5] * out[5] + s[6] * out[6]
                          + s[7] * out[7])


@compiled
def step(time: float, state: Array, size: float, system: System, workspace: Workspace,
         known: bool) -> None:
    """
    Take one step; see the contract in `solvers`.

    Parameters
    ----------
    known : bool
        Whether the Jacobian is that of this state already, after a step that was rejected.

    """
    jacobian, inverse, rates, y_new = (
        workspace.jacobian, workspace.inverse, workspace.rates, workspace.y_new)
    stages = workspace.stages[1:]
    if not known:
        write_jacobian(time, state, system, workspace.mode, jacobian)
        workspace.statistics[EVALUATIONS] += 1
    scale = GAMMA * size
    invert(jacobian, scale, inverse)
    for i in range(SIZE):
        rates[i] = workspace.stages[0, i]
        y_new[i] = state[i]
    for stage in range(STAGES):
        if stage > 0:
            if stage <= OWN_START:
                for i in range(SIZE):
                    y_new[i] = state[i]
                add_rows(stage, A[stage], 1.0, stages, y_new)
            else:
                for i in range(SIZE):
                    y_new[i] += stages[stage - 1, i]
            mode_derivative(time + NODES[stage] * size, y_new, system, workspace.mode, rates)
            add_rows(stage, COUPLING[stage], 1.0 / size, stages, rates)
        if BY_TIME[stage] != 0.0:
            for i in range(COORDINATES, SIZE):
                rates[i] += size * BY_TIME[stage] * jacobian[i - COORDINATES, TIME]
        solve(jacobian, scale, inverse, rates, stages[stage])
    for i in range(SIZE):
        workspace.error[i] = stages[STAGES - 1, i]
        y_new[i] += workspace.error[i]
    workspace.statistics[EVALUATIONS] += STAGES - 1


@compiled
def longest_stable(jacobian: Array) -> float:
    """Return about the longest step that would be stable for the explicit method [s]."""
    decay = spring = 0.0
    for i in range(VELOCITIES):
        decay += jacobian[i, COORDINATES + i]
        spring += jacobian[i, i]
    return STABLE / max(abs(decay), math.sqrt(abs(spring)), 1e-6)


@compiled
def prepare_dense(state: Array, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output, of order 4."""
    stages, dense = workspace.stages[1:], workspace.dense
    for i in range(SIZE):
        first = second = third = 0.0
        for stage in range(STAGES):
            value = stages[stage, i]
            first += CONTINUE[0, stage] * value
            second += CONTINUE[1, stage] * value
            third += CONTINUE[2, stage] * value
        dense[0, i] = state[i]
        dense[1, i] = workspace.y_new[i] - state[i]
        dense[2, i] = first
        dense[3, i] = second + third
        dense[4, i] = -third
