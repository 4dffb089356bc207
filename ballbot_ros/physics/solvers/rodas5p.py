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
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.equations import COORDINATES, SIZE
from ballbot_ros.physics.mechanics.jacobian import TIME, write_jacobian
from ballbot_ros.physics.mechanics.modes import mode_derivative
from ballbot_ros.physics.solvers.embedded import (
    add_rows, BEGIN, DENSE, INVERSE, PROBE, RATES, SLOPES, STABLE)

STAGES = 8
FIRST = 1  # row of the work array that holds the first stage
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
def invert(slopes: Any, scale: float, inverse: Any) -> None:
    """
    Invert ``I / scale - B - scale A``, where [A B] are the slopes of the accelerations.

    Parameters
    ----------
    slopes : array
        See `jacobian.write_jacobian`.
    scale : float
        gamma h [s].
    inverse : (4, 12) array
        Filled with the inverse, and with what it makes of ``scale A``; the last four columns
        are room for the matrix itself.

    """
    size, room = VELOCITIES, 2 * VELOCITIES
    for i in range(size):
        for j in range(size):
            inverse[i, room + j] = -slopes[i, COORDINATES + j] - scale * slopes[i, j]
            inverse[i, j] = 0.0
            inverse[i, size + j] = scale * slopes[i, j]
        inverse[i, room + i] += 1.0 / scale
        inverse[i, i] = 1.0
    # Gauss and Jordan, with pivots; the first eight columns are the right-hand sides.
    for column in range(size):
        best = column
        for i in range(column + 1, size):
            if abs(inverse[i, room + column]) > abs(inverse[best, room + column]):
                best = i
        pivot = 1.0 / inverse[best, room + column]
        for j in range(room + size):
            kept = inverse[column, j]
            inverse[column, j] = pivot * inverse[best, j]
            if best != column:
                inverse[best, j] = kept
        for i in range(size):
            factor = inverse[i, room + column]
            if i != column:
                for j in range(room + size):
                    inverse[i, j] -= factor * inverse[column, j]


@compiled
def solve(slopes: Any, scale: float, inverse: Any, right: Any, out: Any) -> None:
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
        s = slopes[i - COORDINATES]
        out[i] = scale * (right[i] + s[0] * out[0] + s[1] * out[1] + s[2] * out[2]
                          + s[3] * out[3] + s[4] * out[4] + s[5] * out[5] + s[6] * out[6]
                          + s[7] * out[7])


@compiled
def run_implicit_stages(time: float, state: Any, step: float, mode: Any, count: int, robot: Any,
                        ground: Any, drive: Any, table: Any, work: Any, known: bool) -> None:
    """
    Compute all stages, the new state and its estimated error.

    Parameters
    ----------
    known : bool
        Whether the derivative of the rates is that of this state already, after a step that
        was refused.

    """
    slopes, inverse, stages = work[SLOPES:INVERSE], work[INVERSE:], work[FIRST:]
    if not known:
        write_jacobian(time, state, mode, count, robot, ground, drive, table, slopes)
    scale = GAMMA * step
    invert(slopes, scale, inverse)
    for i in range(SIZE):
        work[RATES, i] = work[BEGIN, i]
        work[PROBE, i] = state[i]
    for stage in range(STAGES):
        if stage > 0:
            if stage <= OWN_START:
                for i in range(SIZE):
                    work[PROBE, i] = state[i]
                add_rows(stage, A[stage], 1.0, stages, work[PROBE])
            else:
                for i in range(SIZE):
                    work[PROBE, i] += work[FIRST + stage - 1, i]
            mode_derivative(time + NODES[stage] * step, work[PROBE], mode, count, robot, ground,
                            drive, table, work[RATES])
            add_rows(stage, COUPLING[stage], 1.0 / step, stages, work[RATES])
        if BY_TIME[stage] != 0.0:
            for i in range(COORDINATES, SIZE):
                work[RATES, i] += step * BY_TIME[stage] * slopes[i - COORDINATES, TIME]
        solve(slopes, scale, inverse, work[RATES], work[FIRST + stage])
    for i in range(SIZE):
        work[RATES, i] = work[FIRST + STAGES - 1, i]
        work[PROBE, i] += work[RATES, i]


@compiled
def longest_stable(work: Any) -> float:
    """Return about the longest step that would be stable for the explicit method [s]."""
    decay = spring = 0.0
    for i in range(VELOCITIES):
        decay += work[SLOPES + i, COORDINATES + i]
        spring += work[SLOPES + i, i]
    return STABLE / max(abs(decay), math.sqrt(abs(spring)), 1e-6)


@compiled
def prepare_implicit_dense(state: Any, work: Any) -> None:
    """Compute the coefficients of the continuous extension, of order 4."""
    for i in range(SIZE):
        first = second = third = 0.0
        for stage in range(STAGES):
            part = work[FIRST + stage, i]
            first += CONTINUE[0, stage] * part
            second += CONTINUE[1, stage] * part
            third += CONTINUE[2, stage] * part
        work[DENSE, i] = state[i]
        work[DENSE + 1, i] = work[PROBE, i] - state[i]
        work[DENSE + 2, i] = first
        work[DENSE + 3, i] = second + third
        work[DENSE + 4, i] = -third
