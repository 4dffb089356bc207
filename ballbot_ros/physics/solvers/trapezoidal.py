# SPDX-License-Identifier: Apache-2.0
"""
The method of the paper: the trapezoidal rule with variable steps, as in Matlab's ode23t.

An implicit method of order 2 that neither damps nor excites an undamped spring.  The step is
chosen by the third derivative, estimated from the rates at three successive times, up to a given
maximum.  Kinks of the contact law are not located: as in the paper, small steps pass through
them.

Reference: L. F. Shampine, M. W. Reichelt, J. A. Kierzenka, Solving index-1 DAEs in MATLAB and
Simulink, SIAM Review 41 (1999) 538-552, section 3.
"""
import math

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.equations import angle_trig, derivative, is_finite, System
from ballbot_ros.physics.mechanics.modes import find_mode, write_jacobian
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import PENDULUM_ANGLE, SIZE
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.controller import (
    error_length, next_step, SAFETY, smallest_step, with_step)
from ballbot_ros.physics.solvers.dense import write_rows
from ballbot_ros.physics.solvers.rodas5p import invert, solve
from ballbot_ros.physics.solvers.values import (
    BUDGET_EXCEEDED, EVALUATIONS, FINISHED, MOTION, NOT_FINITE, outcome_of, Packed, packed, PAUSED,
    REJECTED, Status, STEP_TOO_SMALL, STEPS, unpack_call, WIDTH, Workspace)

PREVIOUS = values.STAGES  # the row of the rates at the start of the previous step

ITERATIONS = 8      # of Newton's method, before the step is shortened
CONVERGED = 0.01    # last change of the iteration, relative to the tolerance
FIRST_STEP = 1e-6   # [s], as in table 1
FASTEST_GROWTH = 2.0  # of a step
FAILED = 0.25       # ratio of the next step to one whose iteration failed


@compiled
def iterate(time: float, state: Array, step: float, tolerance: float, system: System,
            workspace: Workspace) -> bool:
    """
    Solve ``Y = y + h / 2 (f(y) + f(Y))`` for the new state by simplified Newton iteration.

    Returns whether it converged; the rates are then f(Y).
    """
    half, work = 0.5 * step, workspace.work
    y_new, rates, error = work[values.END:], work[values.RIGHT:], work[values.ERROR:]
    start = work[values.F0:]
    mode, statistics = workspace.mode, workspace.statistics
    invert(workspace.jacobian, half, work)
    for i in range(SIZE):
        y_new[i] = state[i] + step * start[i]
    for _ in range(ITERATIONS):
        derivative(time + step, y_new, system, mode, rates)
        statistics[EVALUATIONS] += 1
        for i in range(MOTION):
            rates[i] += (state[i] - y_new[i]) / half + start[i]
        solve(values.RIGHT, values.ERROR, work)
        for i in range(MOTION):
            y_new[i] += error[i]
        if error_length(error, system.parameters) <= CONVERGED * tolerance:
            derivative(time + step, y_new, system, mode, rates)
            statistics[EVALUATIONS] += 1
            for i in range(MOTION, SIZE):  # the ledger, which does not affect the motion
                y_new[i] = state[i] + half * (start[i] + rates[i])
            return True
    return False


@compiled
def local_error(step: float, before: float, parameters: Parameters,
                workspace: Workspace) -> float:
    """
    Return the estimated local error, h^3 / 12 times the third derivative, as a length [m].

    Parameters
    ----------
    before : float
        Length of the previous step [s]; 0 if there is none, and then the error is that of Euler's
        method, to be on the safe side.

    """
    work = workspace.work
    error, start, rates = work[values.ERROR:], work[values.F0:], work[values.RIGHT:]
    earlier = work[PREVIOUS:]
    for i in range(SIZE):
        bend = (rates[i] - start[i]) / step
        if before > 0.0:
            bend -= (start[i] - earlier[i]) / before
            error[i] = step**3 / 6.0 * bend / (step + before)
        else:
            error[i] = 0.5 * step * step * bend
    return error_length(error, parameters)


@compiled
def prepare_dense(state: Array, step: float, workspace: Workspace) -> None:
    """Compute the coefficients of the cubic through both states with their rates."""
    work = workspace.work
    start, rates = work[values.F0:], work[values.RIGHT:]
    y_new, dense = work[values.END:], work[values.DENSE:]
    for i in range(SIZE):
        change = y_new[i] - state[i]
        bend = step * start[i] - change
        dense[i] = state[i]
        dense[WIDTH + i] = change
        dense[2 * WIDTH + i] = bend
        dense[3 * WIDTH + i] = change - step * rates[i] - bend
        dense[4 * WIDTH + i] = 0.0


@compiled
def factor(error: float, tolerance: float) -> float:
    """Return the ratio of the next step to the last one, from the error."""
    return SAFETY * (tolerance / error)**(1.0 / 3.0)


@outlined
def advance(call: Packed) -> Packed:
    """Advance a state in place; see the contract in `solvers`."""
    status, end, state, system, options, output, workspace = unpack_call(call)
    statistics, work, tolerance = workspace.statistics, workspace.work, options.tolerance
    start, earlier = work[values.F0:], work[PREVIOUS:]
    rates, y_new = work[values.RIGHT:], work[values.END:]
    time, filled, controller, before = (
        status.time, status.filled, status.controller, status.before)
    outcome, known = FINISHED, False
    if not status.has_mode:
        derivative(time, state, system, workspace.mode, start)
        statistics[EVALUATIONS] += 1
        before = 0.0
    if controller.step <= 0.0:
        controller = with_step(controller, FIRST_STEP)
    while time < end and outcome == FINISHED:
        if filled >= output.pause or statistics[EVALUATIONS] >= options.budget:
            outcome = PAUSED if filled >= output.pause else BUDGET_EXCEEDED
            break
        smallest = smallest_step(time)
        used = min(controller.step, options.step, end - time)
        if not known:
            find_mode(time, state, system, workspace.mode)
            write_jacobian(time, state, angle_trig(state[PENDULUM_ANGLE])[1:], system,
                           workspace.mode, workspace.jacobian)
            known = True
        error = math.inf
        if iterate(time, state, used, tolerance, system, workspace):
            error = local_error(used, before, system.parameters, workspace)
        if not error <= tolerance:
            # If the iteration failed, the error is unknown.
            shrink = max(0.1, factor(error, tolerance)) if math.isfinite(error) else FAILED
            controller = with_step(controller, used * shrink)
            statistics[REJECTED] += 1
            if controller.step < smallest:
                outcome = STEP_TOO_SMALL if is_finite(y_new) else NOT_FINITE
                break
            continue
        statistics[STEPS] += 1
        grow = FASTEST_GROWTH if error == 0.0 else min(
            FASTEST_GROWTH, factor(error, tolerance))
        controller = with_step(controller, next_step(controller, used, grow))
        prepare_dense(state, used, workspace)
        reached = min(time + used, end)
        filled = write_rows(
            output, filled, time, used, reached + smallest, system.actuator, workspace)
        for i in range(SIZE):
            state[i] = y_new[i]
            earlier[i] = start[i]
            start[i] = rates[i]
        before, known = used, False
        time = end if end - reached < smallest else reached
        outcome = outcome_of(state, system.ground)
    return packed(Status(
        outcome, time, filled, controller, status.rate, True, status.ready, status.may_fly,
        before))
