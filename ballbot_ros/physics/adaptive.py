# SPDX-License-Identifier: Apache-2.0
"""
Adaptive integration that meets every kink of the contact law on purpose.

The embedded Runge-Kutta pair of Dormand and Prince, 5(4), chooses its steps by the estimated
local error.  Each step is taken with a frozen mode (see `modes`); where the mode ends within
the step, the end is located on the dense output and the next step starts there in the new
mode.  So the order holds through impacts, lift-offs and the onset of slip, where a fixed step
loses it.

Reference: E. Hairer, S. P. Noersett, G. Wanner, Solving Ordinary Differential Equations I,
sections II.4 to II.6 (DOPRI5).
"""
import math
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.contact import contact_table
from ballbot_ros.physics.dormand_prince import (
    interpolate, local_error, prepare_dense, PROBE, ROWS, run_stages, STAGES)
from ballbot_ros.physics.dynamics import drive_torque, SIZE, VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.integrators import FINISHED, ground_height, NOT_FINITE, SUNK
from ballbot_ros.physics.modes import (
    broken, features_within, find_mode, margin_of, mode_derivative, mode_table)

# A run can end like this, too: the step has become too small, or the work budget is used up.
STALLED, SPENT = 3, 4

LARGEST_STEP = 0.02   # [s]: no swing of the pendulum is overlooked
LARGEST_WAY = 0.25    # of the radius per step: no feature of the ground is overlooked
MOST_ENDS = 64        # located within one look; of more, an early one will do
LOOKS = 4             # times within a step at which the mode is checked
SMALLEST_STEP = 1e-14  # [s], relative to times above 1 s
HASTY = 1e-9          # [s] between events that rounding makes
PATIENCE = 20         # such events in a row, then ever longer steps over them
STUCK = 1000          # events in a row without any time between them
FREE_FEATURES = 32    # of the ground that a right-hand side pays for; more cost work, too


@compiled
def time_width(time: float) -> float:
    """Return how closely an event is located [s]: to rounding, for long runs."""
    return max(1e-13, 4e-16 * time)


@compiled
def locate(kind: int, item: int, low: float, high: float, time: float, step: float, mode: Any,
           count: int, robot: Any, ground: Any, drive: Any, table: Any, work: Any,
           probe: Any) -> float:
    """
    Return the part of the step at which a margin has just become negative.

    Regula falsi, Illinois variant, on the dense output; ends on the far side of the zero, so
    that the next mode differs.
    """
    interpolate(low, work, probe)
    at_low = margin_of(kind, item, time + low * step, probe, mode, count, robot, ground, drive,
                       table)
    interpolate(high, work, probe)
    at_high = margin_of(kind, item, time + high * step, probe, mode, count, robot, ground,
                        drive, table)
    width = time_width(time) / step
    for _ in range(60):
        if high - low <= width:
            break
        if at_low > 0.0 and at_high < 0.0:
            part = low + (high - low) * at_low / (at_low - at_high)
            # Aim a little beyond the zero, to close the bracket from both sides.
            part = min(max(part + 0.25 * width, low + 0.25 * width), high - 0.25 * width)
        else:
            part = 0.5 * (low + high)
        interpolate(part, work, probe)
        margin = margin_of(kind, item, time + part * step, probe, mode, count, robot, ground,
                           drive, table)
        if margin > 0.0:
            low, at_low, at_high = part, margin, 0.5 * at_high
        else:
            high, at_high, at_low = part, margin, 0.5 * at_low
    return high


@compiled
def mode_end(time: float, step: float, mode: Any, count: int, first: int, behind: int,
             robot: Any, ground: Any, drive: Any, table: Any, work: Any, probe: Any, kinds: Any,
             items: Any) -> float:
    """
    Return the part of the step at which the mode ends, 2 if it does not.

    A margin may have come and gone before the one that a look finds: a ball lands on a segment
    and rolls over its end.  So what has been located is looked at again, from just before.
    """
    for look in range(1, LOOKS + 1):
        before, part = (look - 1) / LOOKS, look / LOOKS
        ending = 2.0
        for _ in range(MOST_ENDS):
            if part <= before:
                break
            interpolate(part, work, probe)
            found = broken(time + part * step, probe, mode, count, first, behind, robot, ground,
                           drive, table, kinds, items)
            if found == 0:
                break
            ending = part
            for index in range(found):
                ending = min(ending, locate(
                    kinds[index], items[index], before, part, time, step, mode, count, robot,
                    ground, drive, table, work, probe))
            part = ending - 4.0 * time_width(time) / step
        if ending < 2.0:
            return ending
    return 2.0


@compiled
def step_limit(state: Any, robot: Any) -> float:
    """Return the longest step that overlooks nothing [s]."""
    way = LARGEST_WAY * robot.radius
    speed = math.hypot(state[VELOCITY_X], state[VELOCITY_Y]) + 1e-3
    # A ball falls on the way: one of a millimetre falls more than its radius in 20 ms.
    return min(LARGEST_STEP,
               2.0 * way / (speed + math.sqrt(speed * speed + 2.0 * robot.gravity * way)))


@compiled
def advance_adaptive(time: float, state: Any, end: float, tolerance: float, step: float,
                     robot: Any, ground: Any, drive: Any, table: Any, work: Any, probe: Any,
                     mode: Any, kinds: Any, items: Any, rows: Any, interval: float,
                     tally: Any, budget: int) -> tuple:
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

    Returns
    -------
    time : float
        Reached [s].
    step : float
        To try next [s].
    filled : int
        Rows filled.
    ending : int
        FINISHED, NOT_FINITE, SUNK, STALLED or SPENT.

    """
    begin, filled, stuck, hasty = time, 0, 0, 0
    count = find_mode(time, state, robot, ground, drive, table, mode)
    mode_derivative(time, state, mode, count, robot, ground, drive, table, work[0])
    tally[3] += 1
    if step <= 0.0:
        step = 1e-4
    while time < end:
        if tally[3] + tally[4] >= budget:
            return time, step, filled, SPENT
        smallest = SMALLEST_STEP * max(1.0, abs(time))
        limit = step_limit(state, robot)
        used = min(step, limit, end - time)
        run_stages(time, state, used, mode, count, robot, ground, drive, table, work)
        tally[3] += STAGES - 1
        error = local_error(state, used, robot, work)
        if not error <= tolerance:
            # An error without bound: try much shorter.
            shrink = 0.9 * (tolerance / error)**0.2 if math.isfinite(error) else 0.1
            step = used * max(0.1, shrink)
            tally[1] += 1
            if step < smallest:
                return time, step, filled, STALLED if math.isfinite(error) else NOT_FINITE
            continue
        tally[0] += 1
        grow = 5.0 if error == 0.0 else min(5.0, 0.9 * (tolerance / error)**0.2)
        # A step cut short by the end, or by the limit, says little about the one to try.
        step = max(step, used * grow) if used < step else used * grow
        prepare_dense(state, used, work)
        first, behind = features_within(
            state[X], robot.radius + LARGEST_WAY * robot.radius, ground)
        tally[4] += (STAGES * count + LOOKS * (behind - first)) // FREE_FEATURES
        part = mode_end(time, used, mode, count, first, behind, robot, ground, drive, table,
                        work, probe, kinds, items)
        # A margin that changes by less than its rounding flickers: step over it.
        hasty = hasty + 1 if part * used < HASTY else 0
        if hasty > PATIENCE and part <= 1.0:
            push = time_width(time) * 2.0**min(hasty - PATIENCE, 40)
            part = max(part, min(1.0, push / used))
        reached = min(time + used, end) if part > 1.0 else time + part * used
        while filled < len(rows) and begin + (filled + 1) * interval <= reached + smallest:
            moment = begin + (filled + 1) * interval
            interpolate(min((moment - time) / used, 1.0), work, probe)
            rows[filled, 0] = moment
            for i in range(SIZE):
                rows[filled, 1 + i] = probe[i]
            rows[filled, 1 + SIZE] = drive_torque(moment, probe, drive)
            filled += 1
        if part > 1.0:
            for i in range(SIZE):
                state[i] = work[PROBE, i]
                work[0, i] = work[STAGES - 1, i]
        else:
            interpolate(part, work, state)
            tally[2] += 1
        stuck = stuck + 1 if part * used < smallest else 0
        if stuck > STUCK:
            return time, step, filled, STALLED
        total = 0.0
        for i in range(VELOCITY_Y + 1):
            total += state[i]
        if not math.isfinite(total):
            return reached, step, filled, NOT_FINITE
        time = end if end - reached < smallest else reached
        if state[Y] <= ground_height(ground, state[X]):
            return time, step, filled, SUNK
        if part <= 1.0:
            count = find_mode(time, state, robot, ground, drive, table, mode)
            mode_derivative(time, state, mode, count, robot, ground, drive, table, work[0])
            tally[3] += 1
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
        if limit is None:
            limit = int(self.tally[3] + self.tally[4]) + model.solver.work_budget
        found: tuple = advance_adaptive(
            time, state, end, model.solver.tolerance, step, model.numbers, model.profile, drive,
            self._table, self._work, self._probe, self._mode, self._broken[0], self._broken[1],
            rows, interval, self.tally, limit)
        return found
