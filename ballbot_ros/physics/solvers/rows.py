# SPDX-License-Identifier: Apache-2.0
"""
Rows of numbers that an adaptive step works in, and their sums: half of what a step takes.

A row holds a motion (four coordinates, four velocities) or its change, and room for the energy
ledger behind it; all of them lie in one array, `Workspace.work`, each at its own place.
"""
from typing import Any

import numpy as np

from ballbot_ros.jit import COMPILED
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
 COLUMNS,  # eight of them, of the matrix that solves a stage, see `elimination`
 _, _, _, _, _, _, _,
 FACTORS,  # of a sum
 PENDULUM_TRIG,  # the pendulum angle at the begin and its direction, see `turned`
 ROWS) = (WIDTH * row for row in range(31))


def sum_rows(work: Array, out: int, start: int, scale: float, factors: Array, first: int,
             rows: int, count: int) -> None:
    """
    Write ``start + sum(scale * factors[first + k] * row k)`` over `count` rows into `out`.

    What the last row adds is added last: it is the one that has to be waited for.

    Parameters
    ----------
    work : array
        All rows.
    out, start, rows : int
        Places there: of the result, of what is added to, and of the first row.
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
        """Return types of the compiled sums, and what writes their code."""
        place = types.intp
        return types.void(work, place, place, types.float64, factors, place, place,
                          place), _generate

    sum_rows = intrinsic(_types)
