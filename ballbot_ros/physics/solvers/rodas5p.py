# SPDX-License-Identifier: Apache-2.0
"""
One step of the Rosenbrock method Rodas5P, 5(4), in a frozen mode.

Linearly implicit and L-stable: stiff components (friction while the ball sticks, a stiff contact)
are damped instead of limiting the step, and there is no iteration that could fail.  A stage is
``((1 / (gamma h)) I - J) U_i = f(y + sum a_ij U_j) + sum c_ij U_j / h + h d_i f_t``, solved
by eliminating the coordinates.  Their rates are the velocities, so that with the Jacobian [A B] of
the accelerations only the 4 x 4 matrix ``W = I / scale - B - scale A`` is inverted, once per step.
It has 2 x 2 blocks: rotation of ball and pendulum, and motion of the centre along x and y.

Reference: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical
benchmarks within the Julia Differential Equations package, BIT Numer. Math. 63 (2023) 27.
"""
import math

import numpy as np

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import ContactMode
from ballbot_ros.physics.mechanics.equations import (
    angle_trig, AngleTrig, forced, System, unforced, write_motion)
from ballbot_ros.physics.mechanics.modes import (
    BALL, mode_accelerations, mode_torque, TIME, write_jacobian)
from ballbot_ros.physics.model.state import (
    BALL_RATE, COORDINATES, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y)
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.values import (
    ALONE, EVALUATIONS, JACOBIAN, MOTION, NOTHING, STABLE, sum_rows, WIDTH, Workspace)

STAGES = 8
DAMPS = True
VELOCITIES = 4

GAMMA = 0.21193756319429014
OWN_START = 5  # the last stage with a separate start; each later one starts where the last ended
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
# The last three coefficients of the dense output as sums of the stages.
CONTINUE = np.array([CONTINUED[0], CONTINUED[1] + CONTINUED[2], -CONTINUED[2]]).ravel()
# In the form for `values.sum_rows`.
STARTS, COUPLINGS = A.ravel(), COUPLING.ravel()
COUPLED = STAGES - 1  # factors in a row of the latter

INVERSE = values.COLUMNS + WIDTH * COORDINATES  # the columns of the velocities
CANCELLED = 1e-6  # relative determinant below which its products nearly cancel: use pivots

Block = tuple[float, float, float, float]  # 2 x 2, row by row


@compiled
def product(one: Block, other: Block) -> Block:
    """Return the product of two blocks."""
    a, b, c, d = one
    e, f, g, h = other
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h


@compiled
def adjugate(block: Block) -> tuple[Block, float, bool]:
    """Return determinant times inverse of a block, the determinant, and whether they are exact."""
    a, b, c, d = block
    determinant = a * d - b * c
    return ((d, -b, -c, a), determinant,
            abs(determinant) > CANCELLED * (abs(a * d) + abs(b * c)))


@compiled
def multiple(factor: float, block: Block) -> Block:
    """Return a multiple of a block."""
    return factor * block[0], factor * block[1], factor * block[2], factor * block[3]


@compiled
def block_of(jacobian: Array, scale: float, row: int, column: int) -> Block:
    """Return the block of W that starts at a row and a column."""
    own = 1.0 / scale if row == column else 0.0
    rates = COORDINATES + column
    return (own - jacobian[row, rates] - scale * jacobian[row, column],
            -jacobian[row, rates + 1] - scale * jacobian[row, column + 1],
            -jacobian[row + 1, rates] - scale * jacobian[row + 1, column],
            own - jacobian[row + 1, rates + 1] - scale * jacobian[row + 1, column + 1])


@compiled
def write_columns(upper: Block, lower: Block, scale: float, at: int, work: Array) -> None:
    """Write two columns of the inverse, each below `scale` times itself."""
    work[at + 4], work[at + 5], work[at + 6], work[at + 7] = (
        upper[0], upper[2], lower[0], lower[2])
    work[at], work[at + 1], work[at + 2], work[at + 3] = (
        scale * upper[0], scale * upper[2], scale * lower[0], scale * lower[2])
    at += WIDTH
    work[at + 4], work[at + 5], work[at + 6], work[at + 7] = (
        upper[1], upper[3], lower[1], lower[3])
    work[at], work[at + 1], work[at + 2], work[at + 3] = (
        scale * upper[1], scale * upper[3], scale * lower[1], scale * lower[3])


@outlined
def invert_with_pivots(jacobian: Array, scale: float, work: Array) -> None:
    """Write the columns of the inverse of W by Gauss-Jordan elimination of its transpose."""
    for j in range(VELOCITIES):
        row = INVERSE + WIDTH * j
        for i in range(VELOCITIES):
            work[row + i] = work[row + VELOCITIES + i] = 0.0
            work[row + MOTION + i] = -jacobian[i, COORDINATES + j] - scale * jacobian[i, j]
        work[row + j], work[row + VELOCITIES + j] = scale, 1.0
        work[row + MOTION + j] += 1.0 / scale
    for column in range(VELOCITIES):
        own, best = INVERSE + WIDTH * column, INVERSE + WIDTH * column
        for row in range(own + WIDTH, INVERSE + WIDTH * VELOCITIES, WIDTH):
            if abs(work[row + MOTION + column]) > abs(work[best + MOTION + column]):
                best = row
        pivot = 1.0 / work[best + MOTION + column]
        for i in range(MOTION + VELOCITIES):
            kept = work[own + i]
            work[own + i] = pivot * work[best + i]
            if best != own:
                work[best + i] = kept
        for row in range(INVERSE, INVERSE + WIDTH * VELOCITIES, WIDTH):
            factor = work[row + MOTION + column]
            if row != own:
                for i in range(MOTION + VELOCITIES):
                    work[row + i] -= factor * work[own + i]


@compiled
def invert(jacobian: Array, scale: float, work: Array) -> None:
    """
    Write the eight columns of the matrix that solves a stage into the rows values.COLUMNS.

    Parameters
    ----------
    jacobian : array
        See `modes.write_jacobian`.
    scale : float
        gamma h [s].
    work : array
        All rows, see `values`.

    """
    # Blocks: [turn, across; back, move].  With the inverse of move, m / d, the complement of turn
    # is (d turn - across m back) / d: so the two slow divisions can run in parallel.
    turn, across = block_of(jacobian, scale, 0, 0), block_of(jacobian, scale, 0, 2)
    back = block_of(jacobian, scale, 2, 0)
    moved, size, fine = adjugate(block_of(jacobian, scale, 2, 2))
    first, second = product(across, moved), product(moved, back)
    lost = product(across, second)
    turned, area, too = adjugate((size * turn[0] - lost[0], size * turn[1] - lost[1],
                                  size * turn[2] - lost[2], size * turn[3] - lost[3]))
    if fine and too:
        per_size, per_area = 1.0 / size, 1.0 / area
        down, right = product(second, turned), product(turned, first)
        more = multiple(per_size * per_area, product(down, first))
        write_columns(multiple(size * per_area, turned), multiple(-per_area, down), scale,
                      INVERSE, work)
        write_columns(multiple(-per_area, right),
                      (per_size * moved[0] + more[0], per_size * moved[1] + more[1],
                       per_size * moved[2] + more[2], per_size * moved[3] + more[3]), scale,
                      INVERSE + 2 * WIDTH, work)
    else:
        invert_with_pivots(jacobian, scale, work)
    for j in range(COORDINATES):
        for i in range(VELOCITIES):
            work[values.FACTORS + i] = scale * jacobian[i, j]
        column = values.COLUMNS + WIDTH * j
        sum_rows(work, column, values.ZERO, 1.0, work, values.FACTORS, INVERSE, VELOCITIES)
        work[column + j] += scale


@compiled
def solve(right: int, out: int, work: Array) -> None:
    """Solve ``(I / scale - J) out = right`` for a motion; both are rows, see `values`."""
    sum_rows(work, out, values.ZERO, 1.0, work, right, values.COLUMNS, MOTION)


@compiled
def add_motion(time: float, work: Array, start: AngleTrig, system: System,
               mode: ContactMode) -> None:
    """Add the rates at the end of a stage to the right-hand side of the next."""
    motion, right = work[values.END:values.END + MOTION], values.RIGHT
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
    start = angle_trig(state[PENDULUM_ANGLE])
    if ready != JACOBIAN:
        push = write_jacobian(time, state, start[1:], system, workspace.mode, jacobian)
        motor = mode_torque(time, state, start[1], system, workspace.mode)
        free, compliance = unforced(state, start[1:], motor, system.parameters)
        write_motion(state, forced(free, compliance, *push), system.parameters,
                     work[values.F0:values.F0 + MOTION])
        workspace.statistics[EVALUATIONS] += 2  # these rates, and the Jacobian
    timed = jacobian[BALL, TIME] != 0.0
    scale, per_size = GAMMA * size, 1.0 / size
    invert(jacobian, scale, work)
    for i in range(MOTION):
        work[values.START + i] = work[values.END + i] = state[i]
        work[values.RIGHT + i] = work[values.F0 + i]
    for stage in range(STAGES):
        row = values.STAGES + WIDTH * stage
        if stage > 0:
            if stage <= OWN_START:
                sum_rows(work, values.END, values.START, 1.0, STARTS, stage * OWN_START,
                         values.STAGES, stage)
            else:
                sum_rows(work, values.END, values.END, 1.0, ALONE, 0, row - WIDTH, 1)
            sum_rows(work, values.RIGHT, values.ZERO, per_size, COUPLINGS, stage * COUPLED,
                     values.STAGES, stage)
            add_motion(time + NODES[stage] * size, work, start, system, workspace.mode)
        if timed and BY_TIME[stage] != 0.0:
            for i in range(VELOCITIES):
                work[values.RIGHT + COORDINATES + i] += size * BY_TIME[stage] * jacobian[i, TIME]
        solve(values.RIGHT, row, work)
    last = values.STAGES + WIDTH * (STAGES - 1)
    sum_rows(work, values.ERROR, values.ZERO, 1.0, ALONE, 0, last, 1)
    sum_rows(work, values.END, values.END, 1.0, ALONE, 0, last, 1)
    workspace.statistics[EVALUATIONS] += STAGES - 1
    return size / longest_stable(jacobian), JACOBIAN


@compiled
def end_step(_: Workspace) -> int:
    """Keep nothing: the rates at the end of the step are not computed."""
    return NOTHING


@compiled
def longest_stable(jacobian: Array) -> float:
    """Estimate the longest stable step of the explicit method [s]."""
    decay = spring = 0.0
    for i in range(VELOCITIES):
        decay += jacobian[i, COORDINATES + i]
        spring += jacobian[i, i]
    return STABLE / max(abs(decay), math.sqrt(abs(spring)), 1e-6)


@compiled
def prepare_dense(_: float, workspace: Workspace) -> None:
    """Compute the coefficients of the dense output, of order 4."""
    work = workspace.work
    sum_rows(work, values.DENSE, values.START, 1.0, ALONE, 0, values.ZERO, 1)
    sum_rows(work, values.DENSE + WIDTH, values.END, -1.0, ALONE, 0, values.START, 1)
    for item in range(3):
        sum_rows(work, values.DENSE + WIDTH * (2 + item), values.ZERO, 1.0, CONTINUE,
                 STAGES * item, values.STAGES, STAGES)
