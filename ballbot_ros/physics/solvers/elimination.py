# SPDX-License-Identifier: Apache-2.0
"""
The matrix that solves an implicit stage, ``(I / scale - J) out = right``, for a motion.

The coordinates follow the velocities, so that with the Jacobian [A B] of the accelerations only
``W = I / scale - B - scale A``, of four rows and columns, is inverted.  It has blocks of two:
ball and pendulum turn, the centre moves along x and y.
"""
from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.model.state import COORDINATES
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import rows
from ballbot_ros.physics.solvers.rows import MOTION, sum_rows, WIDTH

VELOCITIES = 4
INVERSE = rows.COLUMNS + WIDTH * COORDINATES  # the columns of the velocities
CANCELLED = 1e-6  # of a determinant is left where its products all but cancel: look for pivots

Block = tuple[float, float, float, float]  # two by two: a row, then the other


@compiled
def product(one: Block, other: Block) -> Block:
    """Return the product of two blocks."""
    a, b, c, d = one
    e, f, g, h = other
    return a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h


@compiled
def inverse(block: Block) -> tuple[Block, bool]:
    """Return the inverse of a block, and whether it is one."""
    a, b, c, d = block
    determinant = a * d - b * c
    factor = 1.0 / determinant
    return ((factor * d, -factor * b, -factor * c, factor * a),
            abs(determinant) > CANCELLED * (abs(a * d) + abs(b * c)))


@compiled
def block_of(jacobian: Array, scale: float, row: int, column: int) -> Block:
    """Return a block of W that begins at a row and a column."""
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
    """Write the columns of the inverse of W by Gauss and Jordan, of its transpose."""
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
    Write the eight columns of the matrix that solves a stage into the rows COLUMNS.

    Parameters
    ----------
    jacobian : array
        See `jacobian.write_jacobian`.
    scale : float
        gamma h [s].
    work : array
        See `rows`.

    """
    # Blocks: [turn, across; back, move].
    across, back = block_of(jacobian, scale, 0, 2), block_of(jacobian, scale, 2, 0)
    moved, fine = inverse(block_of(jacobian, scale, 2, 2))
    first, second = product(across, moved), product(moved, back)
    turn, lost = block_of(jacobian, scale, 0, 0), product(across, second)
    turned, too = inverse((turn[0] - lost[0], turn[1] - lost[1], turn[2] - lost[2],
                           turn[3] - lost[3]))
    if fine and too:
        down, right = product(second, turned), product(turned, first)
        more = product(down, first)
        write_columns(turned, (-down[0], -down[1], -down[2], -down[3]), scale, INVERSE, work)
        write_columns((-right[0], -right[1], -right[2], -right[3]),
                      (moved[0] + more[0], moved[1] + more[1], moved[2] + more[2],
                       moved[3] + more[3]), scale, INVERSE + 2 * WIDTH, work)
    else:
        invert_with_pivots(jacobian, scale, work)
    for j in range(COORDINATES):
        for i in range(VELOCITIES):
            work[rows.FACTORS + i] = scale * jacobian[i, j]
        column = rows.COLUMNS + WIDTH * j
        sum_rows(work, column, rows.ZERO, 1.0, work, rows.FACTORS, INVERSE, VELOCITIES)
        work[column + j] += scale

