# SPDX-License-Identifier: Apache-2.0
"""
The recipe of the paper: the trapezoidal rule with chosen steps, as Matlab's ode23t takes it.

An implicit method of order 2 that neither damps nor excites an undamped spring.  The step is
chosen by the third derivative, seen from the rates at three successive times, and is never
longer than a given one.  Kinks of the contact law are not located: as in the paper, small steps
take them as they come.

Reference: L. F. Shampine, M. W. Reichelt, J. A. Kierzenka, Solving index-1 DAEs in MATLAB and
Simulink, SIAM Review 41 (1999) 538-552, section 3.
"""
import math
from typing import Any

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.equations import derivative, is_finite, SIZE, X, Y
from ballbot_ros.physics.mechanics.jacobian import write_jacobian
from ballbot_ros.physics.mechanics.modes import find_mode
from ballbot_ros.physics.solvers.embedded import (
    BEGIN, DENSE, error_length, INVERSE, PROBE, RATES, SLOPES, SMALLEST_STEP, SPENT, STALLED,
    write_rows)
from ballbot_ros.physics.solvers.fixed_step import FINISHED, ground_height, NOT_FINITE, SUNK
from ballbot_ros.physics.solvers.rodas5p import invert, solve

# Rows of the work array, beside those of `embedded`.
PREVIOUS, RIGHT, CHANGE = 1, 2, 3

ITERATIONS = 8      # of Newton's method, before the step is shortened
CONVERGED = 0.01    # of the tolerance: the last change of an iteration
FIRST_STEP = 1e-6   # [s], as in table 1


@compiled
def iterate(time: float, state: Any, step: float, tolerance: float, robot: Any, ground: Any,
            drive: Any, table: Any, work: Any, tally: Any) -> bool:
    """
    Solve ``Y = y + h / 2 (f(y) + f(Y))`` for the probe row by simplified Newton iteration.

    Returns whether it converged; the row of rates is then f(Y).
    """
    slopes, inverse, half = work[SLOPES:INVERSE], work[INVERSE:], 0.5 * step
    invert(slopes, half, inverse)
    for i in range(SIZE):
        work[PROBE, i] = state[i] + step * work[BEGIN, i]
    for _ in range(ITERATIONS):
        derivative(time + step, work[PROBE], robot, ground, drive, table, work[RATES])
        tally[3] += 1
        for i in range(SIZE):
            work[RIGHT, i] = ((state[i] - work[PROBE, i]) / half + work[BEGIN, i]
                              + work[RATES, i])
        solve(slopes, half, inverse, work[RIGHT], work[CHANGE])
        for i in range(SIZE):
            work[PROBE, i] += work[CHANGE, i]
        if error_length(work[CHANGE], robot) <= CONVERGED * tolerance:
            derivative(time + step, work[PROBE], robot, ground, drive, table, work[RATES])
            tally[3] += 1
            return True
    return False


@compiled
def trapezoidal_error(step: float, before: float, robot: Any, work: Any) -> float:
    """
    Return the estimated local error, h^3 / 12 times the third derivative, as a length [m].

    Parameters
    ----------
    before : float
        Length of the step before [s]; 0 where there is none, and then the error is that of
        the method of Euler, to be on the safe side.

    """
    for i in range(SIZE):
        bend = (work[RATES, i] - work[BEGIN, i]) / step
        if before > 0.0:
            bend -= (work[BEGIN, i] - work[PREVIOUS, i]) / before
            work[CHANGE, i] = step**3 / 6.0 * bend / (step + before)
        else:
            work[CHANGE, i] = 0.5 * step * step * bend
    return error_length(work[CHANGE], robot)


@compiled
def prepare_hermite(state: Any, step: float, work: Any) -> None:
    """Compute the coefficients of the cubic through both states with their rates."""
    for i in range(SIZE):
        change = work[PROBE, i] - state[i]
        bend = step * work[BEGIN, i] - change
        work[DENSE, i] = state[i]
        work[DENSE + 1, i] = change
        work[DENSE + 2, i] = bend
        work[DENSE + 3, i] = change - step * work[RATES, i] - bend
        work[DENSE + 4, i] = 0.0


@compiled
def advance_trapezoidal(time: float, state: Any, end: float, tolerance: float, longest: float,
                        step: float, robot: Any, ground: Any, drive: Any, table: Any, work: Any,
                        probe: Any, mode: Any, rows: Any, interval: float, tally: Any,
                        budget: int) -> tuple:
    """
    Advance `state` in place from `time` to `end`, filling `rows` at equal intervals.

    Parameters
    ----------
    longest : float
        No step is longer [s].

    The other parameters, and what is returned, are those of `adaptive.advance_adaptive`.

    """
    begin, filled, before, known = time, 0, 0.0, False
    derivative(time, state, robot, ground, drive, table, work[BEGIN])
    tally[3] += 1
    step = FIRST_STEP if step <= 0.0 else step
    while time < end:
        if tally[3] >= budget:
            return time, step, filled, SPENT
        smallest = SMALLEST_STEP * max(1.0, abs(time))
        used = min(step, longest, end - time)
        if not known:
            count = find_mode(time, state, robot, ground, drive, table, mode)
            write_jacobian(time, state, mode, count, robot, ground, drive, table,
                           work[SLOPES:INVERSE])
            known = True
        error = math.inf
        if iterate(time, state, used, tolerance, robot, ground, drive, table, work, tally):
            error = trapezoidal_error(used, before, robot, work)
        if not error <= tolerance:
            # Where the iteration failed the error is unknown.
            step = used * (max(0.1, 0.9 * (tolerance / error)**(1.0 / 3.0))
                           if math.isfinite(error) else 0.25)
            tally[1] += 1
            if step < smallest:
                ending = STALLED if is_finite(work[PROBE]) else NOT_FINITE
                return time, step, filled, ending
            continue
        tally[0] += 1
        grow = 2.0 if error == 0.0 else min(2.0, 0.9 * (tolerance / error)**(1.0 / 3.0))
        step = max(step, used * grow) if used < step else used * grow
        prepare_hermite(state, used, work)
        reached = min(time + used, end)
        filled = write_rows(rows, filled, begin, interval, time, used, reached + smallest, drive,
                            work, probe)
        for i in range(SIZE):
            state[i] = work[PROBE, i]
            work[PREVIOUS, i] = work[BEGIN, i]
            work[BEGIN, i] = work[RATES, i]
        before, known = used, False
        time = end if end - reached < smallest else reached
        if state[Y] <= ground_height(ground, state[X]):
            return time, step, filled, SUNK
    return time, step, filled, FINISHED
