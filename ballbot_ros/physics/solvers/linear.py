# SPDX-License-Identifier: Apache-2.0
"""
Rows of numbers that an adaptive step works in, their sums, and the matrix of an implicit stage.

A row holds a motion (four coordinates, four velocities) or its change, and room for the energy
ledger behind it; all of them lie in one array, `Workspace.work`, each at its own place.  Their
sums are half of the work of a step.

An implicit stage solves ``(I / scale - J) out = right`` for a motion.  The coordinates follow the
velocities, so that with the Jacobian [A B] of the accelerations only ``W = I / scale - B - scale
A``, of four rows and columns, is inverted.  It has blocks of two: ball and pendulum turn, the
centre moves along x and y.
"""
from typing import Any

import numpy as np

from ballbot_ros.jit import COMPILED, compiled, outlined
from ballbot_ros.physics.model.state import COORDINATES
from ballbot_ros.physics.model.terrain import Array

MOTION = 8  # numbers of a motion
ALONE = np.array([1.0])  # the factor of a single row
WIDTH = 16  # of a row

(ZERO,   # nothing but zeros
 START,  # the motion at the begin of the step
 END,    # and at its end
 RIGHT,  # the right-hand side of a stage
 ERROR,  # the estimated error of the motion at the end
 PROBE,  # a state within the step
 F0,     # the rates at the begin; a stage of the explicit method
 STAGES,  # eight of them
 _, _, _, _, _, _, _,
 DENSE,  # five of them: coefficients of the dense output, see `dense.interpolate`
 _, _, _, _,
 COLUMNS,  # eight of them, of the matrix that solves a stage, see `invert`
 _, _, _, _, _, _, _,
 FACTORS,  # of a sum
 PENDULUM_TRIG,  # the pendulum angle at the begin and its direction, see `turned_by`
 ROWS) = (WIDTH * row for row in range(31))


def _sum_rows(work: Array, out: int, start: int, scale: float, factors: Array, first: int,
              rows: int, count: int) -> None:
    """
    Write ``start + sum(scale * factors[first + k] * row k)`` over `count` rows into `out`.

    The last row is added last: it has the longest latency.

    Parameters
    ----------
    work : array
        All rows.
    out, start, rows : int
        Offsets of the result, of the first summand, and of the first row.
    scale : float
    factors : array
    first : int
        Place of the first factor.
    count : int

    """
    for i in range(MOTION):
        total = work[start + i]
        for k in range(count):
            total += scale * factors[first + k] * work[rows + WIDTH * k + i]
        work[out + i] = total


if COMPILED:
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic

    HALF = 4  # numbers per SIMD operation
    VECTOR = ir.VectorType(ir.DoubleType(), HALF)
    ONCE = ('contract',)  # a product that is added may be rounded once

    def _spread(builder: Any, number: Any) -> Any:
        """Return a vector of equal numbers."""
        one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), number,
                                     ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), ir.Constant(
            ir.VectorType(ir.IntType(32), HALF), [0] * HALF))

    def _generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """
        Write the sums as vectors, first the coordinates, then the velocities.

        The compiler would not vectorize them, because the result may alias the summands.
        """
        work, out, start, scale, factors, first, rows, count = arguments
        data = context.make_array(signature.args[0])(context, builder, work).data
        weights = context.make_array(signature.args[4])(context, builder, factors).data

        def place(offset: Any, half: int) -> Any:
            at = builder.add(offset, ir.Constant(offset.type, HALF * half))
            return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())
        totals = [cgutils.alloca_once_value(builder, builder.load(place(start, half), align=8))
                  for half in range(2)]
        with cgutils.for_range(builder, count) as loop:
            weight = _spread(builder, builder.fmul(scale, builder.load(
                builder.gep(weights, [builder.add(first, loop.index)]))))
            row = builder.add(rows, builder.mul(loop.index, ir.Constant(rows.type, WIDTH)))
            for half, total in enumerate(totals):
                term = builder.fmul(weight, builder.load(place(row, half), align=8), flags=ONCE)
                builder.store(builder.fadd(builder.load(total), term, flags=ONCE), total)
        for half, total in enumerate(totals):
            builder.store(builder.load(total), place(out, half), align=8)
        return context.get_dummy_value()

    def _types(_: Any, work: Any, out: Any, start: Any, scale: Any, factors: Any, first: Any,
               rows: Any, count: Any) -> Any:
        """Return types of the compiled sums, and their code generator."""
        place = types.intp
        return types.void(work, place, place, types.float64, factors, place, place,
                          place), _generate

    sum_rows = intrinsic(_types)
else:
    sum_rows = _sum_rows


VELOCITIES = 4
INVERSE = COLUMNS + WIDTH * COORDINATES  # the columns of the velocities
CANCELLED = 1e-6  # of a determinant remains where its products nearly cancel: search for pivots

Block = tuple[float, float, float, float]  # two by two: a row, then the other


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
        All rows.

    """
    # Blocks: [turn, across; back, move].  With the inverse of move, m / d, the complement of turn
    # is (d turn - across m back) / d: so both divisions, which take long, go side by side.
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
            work[FACTORS + i] = scale * jacobian[i, j]
        column = COLUMNS + WIDTH * j
        sum_rows(work, column, ZERO, 1.0, work, FACTORS, INVERSE, VELOCITIES)
        work[column + j] += scale
