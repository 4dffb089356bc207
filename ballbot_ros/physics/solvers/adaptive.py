# SPDX-License-Identifier: Apache-2.0
"""
Adaptive integration that meets every kink of the contact law on purpose.

Steps are chosen by the estimated local error.  Each is taken with a frozen mode (see `modes`);
where the mode ends within the step, the end is located on the dense output and the next step
starts there in the new mode.  So the order holds through impacts, lift-offs and the onset of
slip, where a fixed step loses it.

Two methods of order 5 take turns.  The explicit one is the cheaper by far while accuracy limits
the step; where it is stability that does, because friction or a contact is stiff, an implicit,
L-stable one takes longer steps.  Which of the two is the case shows in the steps themselves:
a piece with a contact begins with implicit steps, which know from their Jacobian whether they are
worth it; and the last stages of the explicit method tell when it is at its limit, and then a step
of the other is tried now and then.
"""
import math
from typing import Any, NamedTuple, Optional

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.contact import contact_table, first_segment
from ballbot_ros.physics.mechanics.equations import is_finite, SIZE, VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.mechanics.jacobian import smooth_contacts
from ballbot_ros.physics.mechanics.modes import (
    features_within, find_mode, GEAR, mode_derivative, mode_table)
from ballbot_ros.physics.model.terrain import TANGENT_X, TANGENT_Y, VERTEX_X
from ballbot_ros.physics.solvers.dormand_prince import (
    prepare_explicit_dense, run_explicit_stages, STAGES)
from ballbot_ros.physics.solvers.embedded import (
    BEGIN, error_length, interpolate, PROBE, RATES, ROWS, SMALLEST_STEP, SPENT, STALLED,
    write_rows)
from ballbot_ros.physics.solvers.events import LOOKS, mode_end, time_width
from ballbot_ros.physics.solvers.fixed_step import FINISHED, ground_height, NOT_FINITE, SUNK
from ballbot_ros.physics.solvers.rodas5p import (
    longest_stable, prepare_implicit_dense, run_implicit_stages, STAGES as IMPLICIT_STAGES)
from ballbot_ros.physics.solvers.trapezoidal import advance_trapezoidal

# Which of the two methods: whichever is quicker, or always the same. Named, with the rule of
# `trapezoidal`, that only shares the room to work in.
AUTOMATIC, EXPLICIT, IMPLICIT = range(3)
METHODS = ('adaptive', 'explicit', 'implicit', 'trapezoidal')

REDUCIBLE = 5  # ending of a run that is watched: a simpler model will do

LONGEST_STEP = 0.25   # [s]: a motion that begins from nothing is not overlooked
LARGEST_WAY = 0.25    # of the radius per step, more on an empty floor: no feature is overlooked
FASTEST = 5.0         # growth of a step
FAR = 1e6             # radii: on an endless floor
HASTY = 1e-9          # [s] between events that rounding makes
PATIENCE = 20         # such events in a row, then ever longer steps over them
SOON, CROWD = 0.1, 3  # of the step; so many events in a row that soon, then shorter steps
STUCK = 1000          # events in a row without any time between them
FREE_FEATURES = 32    # of the ground that a right-hand side pays for; more cost work, too
AT_LIMIT = 0.6        # of the longest stable explicit step: it is stability that limits it
WORTH = 1.8           # explicit steps that an implicit one costs
FIRST_TRIAL, LAST_TRIAL = 2, 32  # explicit steps at their limit before an implicit one is tried


class Watch(NamedTuple):
    """What ends a run where a simpler model will do; see `switching`."""

    begin: float  # of the rows [s]
    filled: int  # of the rows, before
    flying: bool  # whether to end where the ball leaves the ground


@compiled
def clear_way(x: float, robot: Any, ground: Any) -> float:
    """Return how far along its ground the ball may move in a step, overlooking nothing [m]."""
    nearest = FAR * robot.radius
    segment = first_segment(ground, x)
    if segment > 0:
        nearest = x - ground[segment, VERTEX_X]
    if segment < len(ground) - 2:
        nearest = min(nearest, ground[segment + 1, VERTEX_X] - x)
    return max(LARGEST_WAY * robot.radius, 0.5 * (nearest - 2.0 * robot.radius))


@compiled
def time_for(way: float, speed: float, gravity: float) -> float:
    """Return the time that a way takes at least, for a ball that may fall meanwhile [s]."""
    speed = abs(speed) + 1e-3
    return 2.0 * way / (speed + math.sqrt(speed * speed + 2.0 * gravity * way))


@compiled
def step_limit(state: Any, way: float, count: int, robot: Any, ground: Any) -> float:
    """
    Return the longest step that overlooks nothing [s].

    Along its ground the ball may go as far as `way`; towards it a part of its radius only, and
    what does not touch the ground falls: a ball of a millimetre more than its radius in 20 ms.
    """
    segment = first_segment(ground, state[X])
    tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    along = state[VELOCITY_X] * tangent_x + state[VELOCITY_Y] * tangent_y
    across = state[VELOCITY_Y] * tangent_x - state[VELOCITY_X] * tangent_y
    near, falling = LARGEST_WAY * robot.radius, robot.gravity if count == 0 else 0.0
    return min(LONGEST_STEP, time_for(way, along, robot.gravity), time_for(near, across, falling))


@compiled
def advance_adaptive(time: float, state: Any, end: float, tolerance: float, step: float,
                     robot: Any, ground: Any, drive: Any, table: Any, work: Any, probe: Any,
                     mode: Any, kinds: Any, items: Any, rows: Any, interval: float,
                     tally: Any, budget: int, method: int = AUTOMATIC,
                     watch: Any = None) -> tuple:
    """
    Advance `state` in place from `time` to `end`, filling `rows` at equal intervals.

    Parameters
    ----------
    tolerance : float
        Local error of a step, see `local_error` [m].
    step : float
        First step to try [s]; 0 to choose.
    rows : (n, 15) array
        Row i is the state at ``time + (i + 1) * interval``; may be empty.
    tally : (5,) int array
        Steps taken, steps refused, events, right-hand sides, and the right-hand sides that
        looking at many features of the ground is worth; added to.
    budget : int
        Where the sum of the last two of these ends the run.
    method : int
        AUTOMATIC, EXPLICIT or IMPLICIT; where the implicit one cannot (a CORNER), the explicit
        one takes its place.
    watch : Watch, optional
        Whether to end where a simpler model will do.

    Returns
    -------
    time : float
        Reached [s].
    step : float
        To try next [s].
    filled : int
        Rows filled.
    ending : int
        FINISHED, NOT_FINITE, SUNK, STALLED or SPENT; REDUCIBLE if watched.

    """
    begin, filled, stuck, hasty, crowded = time, 0, 0, 0, 0
    if watch is not None:
        begin, filled = watch.begin, watch.filled
    count = find_mode(time, state, robot, ground, drive, table, mode)
    mode_derivative(time, state, mode, count, robot, ground, drive, table, work[BEGIN])
    tally[3] += 1
    # Whether steps are implicit: a run that goes on keeps the method that it had.  Explicit steps
    # at their limit, how many before a trial of the other, whether that is one; the last explicit
    # step; whether the Jacobian is known.
    gear = mode[len(mode) - 1]
    implicit = method == IMPLICIT or (
        method == AUTOMATIC and (gear[GEAR] == 1 if step > 0.0 else count > 0))
    if step <= 0.0:
        step = 1e-4
    strained, trial, trying, explicit_step, known = 0, FIRST_TRIAL, False, step, False
    while time < end:
        if tally[3] + tally[4] >= budget:
            return time, step, filled, SPENT
        smallest = SMALLEST_STEP * max(1.0, abs(time))
        way = clear_way(state[X], robot, ground)
        used = min(step, step_limit(state, way, count, robot, ground), end - time)
        smooth = method != EXPLICIT and (implicit or trying) and smooth_contacts(table, count)
        if smooth:
            run_implicit_stages(time, state, used, mode, count, robot, ground, drive, table, work,
                                known)
            tally[3] += IMPLICIT_STAGES - 1 + (0 if known else 1)
            known = True
        else:
            strain = run_explicit_stages(
                time, state, used, mode, count, robot, ground, drive, table, work)
            tally[3] += STAGES - 1
            strained += 1 if strain > AT_LIMIT else 0
        error = error_length(work[RATES], robot)
        if not error <= tolerance:
            # An error without bound: try much shorter.
            shrink = 0.9 * (tolerance / error)**0.2 if math.isfinite(error) else 0.1
            step = used * max(0.1, shrink)
            tally[1] += 1
            if trying:
                trying, step, trial = False, explicit_step, min(2 * trial, LAST_TRIAL)
            elif step < smallest:
                return time, step, filled, STALLED if math.isfinite(error) else NOT_FINITE
            continue
        tally[0] += 1
        known = False
        grow = FASTEST if error == 0.0 else min(FASTEST, 0.9 * (tolerance / error)**0.2)
        # A step cut short by the end, or by the limit, says little about the one to try.
        step = max(step, used * grow) if used < step else used * grow
        if smooth:
            prepare_implicit_dense(state, work)
            if method == AUTOMATIC:
                # While the step still grows as it may, nothing is known yet.
                implicit, trying = grow == FASTEST or step > WORTH * longest_stable(work), False
                gear[GEAR] = 1 if implicit else 0
                trial = FIRST_TRIAL if implicit else min(2 * trial, LAST_TRIAL)
                step = step if implicit else min(step, explicit_step)
        else:
            prepare_explicit_dense(state, used, work)
            if strained >= trial and method == AUTOMATIC:
                strained, trying, explicit_step = 0, True, step
                step *= 1.5 * WORTH
        first, behind = features_within(state[X], robot.radius + way, ground)
        tally[4] += (STAGES * count + LOOKS * (behind - first)) // FREE_FEATURES
        part = mode_end(time, used, mode, count, first, behind, robot, ground, drive, table,
                        work, probe, kinds, items)
        # A margin that changes by less than its rounding flickers: step over it.
        hasty = hasty + 1 if part * used < HASTY else 0
        if hasty > PATIENCE and part <= 1.0:
            push = time_width(time) * 2.0**min(hasty - PATIENCE, 40)
            part = max(part, min(1.0, push / used))
        reached = min(time + used, end) if part > 1.0 else time + part * used
        filled = write_rows(rows, filled, begin, interval, time, used, reached + smallest, drive,
                            work, probe)
        if part > 1.0:
            for i in range(SIZE):
                state[i] = work[PROBE, i]
                work[BEGIN, i] = work[STAGES - 1, i]
            if smooth:
                mode_derivative(reached, state, mode, count, robot, ground, drive, table,
                                work[BEGIN])
                tally[3] += 1
        else:
            interpolate(part, work, state)
            tally[2] += 1
        # Events soon after each other: a long step is not accurate enough to tell them apart.
        crowded = crowded + 1 if part < SOON else 0
        if crowded > CROWD:
            step = 0.5 * used
        stuck = stuck + 1 if part * used < smallest else 0
        if stuck > STUCK:
            return time, step, filled, STALLED
        if not is_finite(state):
            return reached, step, filled, NOT_FINITE
        time = end if end - reached < smallest else reached
        if state[Y] <= ground_height(ground, state[X]):
            return time, step, filled, SUNK
        if part <= 1.0:
            count = find_mode(time, state, robot, ground, drive, table, mode)
            mode_derivative(time, state, mode, count, robot, ground, drive, table, work[BEGIN])
            tally[3] += 1
            if method == AUTOMATIC and count > 0:
                # Explicit steps would shake a hard contact before they find it hard.
                implicit, explicit_step = True, step
        if watch is not None:
            if count == 0 and watch.flying and time < end:
                return time, step, filled, REDUCIBLE
    return time, step, filled, FINISHED


NO_ROWS = np.zeros((0, 2 + SIZE))


class Scratch:
    """
    The arrays that `advance_adaptive` works in.

    Parameters
    ----------
    vertices : int
        Of the profile.

    Attributes
    ----------
    tally : (5,) int array
        See `advance_adaptive`; since it was made.

    """

    def __init__(self, vertices: int):
        """Allocate them once."""
        self._table = contact_table(vertices)
        self._work: NDArray[np.float64] = np.zeros((ROWS, SIZE))
        self._probe: NDArray[np.float64] = np.zeros(SIZE)
        self._mode = mode_table(vertices)
        self._broken: NDArray[np.int64] = np.zeros((2, 4 * vertices + 8), dtype=np.int64)
        self.tally: NDArray[np.int64] = np.zeros(5, dtype=np.int64)

    def advance(self, model: Any, drive: Any, state: NDArray[np.float64], time: float,
                end: float, step: float = 0.0, rows: NDArray[np.float64] = NO_ROWS,
                interval: float = 1.0, limit: Optional[int] = None) -> tuple:
        """
        Advance `state` of a `Model` in place; see `advance_adaptive`.

        Its work budget is that of this call, unless a `limit` of the whole tally is given.
        """
        solver = model.solver
        if limit is None:
            limit = int(self.tally[3] + self.tally[4]) + solver.work_budget
        found: tuple
        if solver.method == 'trapezoidal':
            found = advance_trapezoidal(
                time, state, end, solver.tolerance, solver.step, step, model.numbers,
                model.profile, drive, self._table, self._work, self._probe, self._mode, rows,
                interval, self.tally, limit)
            return found
        found = advance_adaptive(
            time, state, end, solver.tolerance, step, model.numbers, model.profile, drive,
            self._table, self._work, self._probe, self._mode, self._broken[0], self._broken[1],
            rows, interval, self.tally, limit, METHODS.index(solver.method))
        return found
