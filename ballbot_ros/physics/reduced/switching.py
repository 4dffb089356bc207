# SPDX-License-Identifier: Apache-2.0
"""
Go from model to model during a run: whole, rolling, flight.

A model is entered where the state is one of its states to within a part of a threshold, and
left where its monitors say so; see `stepping`.  The threshold is a multiple of the tolerance of
the solver.  So the error of the models is treated like that of the steps: whoever compares runs
of two tolerances, as `simulate_accurately` does, measures both together, and for ever smaller
tolerances the full model is used throughout.
"""
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.adaptive import (
    advance_adaptive, METHODS, NO_ROWS, REDUCIBLE, Scratch, Watch)
from ballbot_ros.physics.dynamics import drive_torque, SIZE
from ballbot_ros.physics.embedded import SPENT
from ballbot_ros.physics.events import time_width
from ballbot_ros.physics.integrators import FINISHED
from ballbot_ros.physics.modes import find_mode
from ballbot_ros.physics.reduced.flight import (
    fly, has_closed_form, NO_TOUCH, spin_start, time_of_touch, within_limit)
from ballbot_ros.physics.reduced.stepping import (
    advance_slow, BEGUN, fits, FLYING, FULL, LANDED, LIFTED, note, ROLLING, ROOM, SETTLED, WHOLE,
    write_row)

# Thresholds of the models over the tolerance of the solver.
SHARE = 10.0
# Steps of the full model before another one is tried, doubled after each stretch that was short.
LEAST_WAIT, MOST_WAIT = 2, 64
SHORT = 4        # steps
SHORT_FLIGHT = 1e-6  # [s]
LOG_LINES = 400
FIRST_STEP = 1e-3  # [s]


@outlined
def advance_flying(time: float, state: Any, end: float, robot: Any, ground: Any, drive: Any,
                   room: Any, rows: Any, begin: float, interval: float, filled: int) -> tuple:
    """
    Advance a state without contact in place until it touches.

    Returns
    -------
    time : float
        Reached [s]; as it was where the motor might come to its limit.
    filled : int
        Rows that are filled now.

    """
    spin = spin_start(state, robot, drive)
    most = end - time
    wait = time_of_touch(state, most, 2.0 * time_width(time), spin, robot, ground)
    lasting = most if wait == NO_TOUCH else min(wait, most)
    if not within_limit(state, lasting, spin, robot, drive):
        return time, filled
    out = room[FULL]
    reached = end if wait == NO_TOUCH else time + lasting
    smallest = 1e-14 * max(1.0, abs(time))
    while filled < len(rows) and begin + (filled + 1) * interval <= reached + smallest:
        moment = begin + (filled + 1) * interval
        fly(state, min(moment - time, lasting), spin, robot, drive, out)
        write_row(moment, out, drive_torque(moment, out, drive), rows[filled])
        filled += 1
    fly(state, lasting, spin, robot, drive, out)
    for i in range(SIZE):
        state[i] = out[i]
    return reached, filled


@compiled
def advance_switching(time: float, state: Any, end: float, tolerance: float, step: float,
                      robot: Any, ground: Any, drive: Any, table: Any, work: Any, probe: Any,
                      mode: Any, kinds: Any, items: Any, rows: Any, interval: float, tally: Any,
                      budget: int, method: int, room: Any, log: Any, rolling: Any = None) -> tuple:
    """
    Advance `state` in place with the simplest models that do, as `advance_adaptive` does.

    Parameters
    ----------
    room : (ROOM, 13) array
        To work in.
    log : (n, 3) array
        Gets time, model and reason of each change, see `stepping.note`.
    rolling : (ROOM, 13) array, optional
        The room again, to roll without slip, too; without it what that needs is not compiled.
    other parameters
        As of `advance_adaptive`.

    Returns
    -------
    time, step, filled, ending
        As of `advance_adaptive`.

    """
    begin, filled, wait = time, 0, LEAST_WAIT
    threshold, slow_step = SHARE * tolerance, FIRST_STEP
    flying = has_closed_form(robot, drive)
    why = BEGUN
    rolled = hopped = False  # just now: something else first, if only for a few steps
    while time < end:
        count = find_mode(time, state, robot, ground, drive, table, mode)
        before = time
        rolls = False
        if count == 0 and flying and not hopped:
            time, filled = advance_flying(
                time, state, end, robot, ground, drive, room, rows, begin, interval, filled)
            hopped = time - before < SHORT_FLIGHT
            rolled = False
            if time > before:
                note(log, before, FLYING, LIFTED)
                why = LANDED
            continue
        if rolling is not None:
            rolls = not rolled and fits(
                time, state, mode, count, threshold, robot, ground, drive, room)
            if rolls:
                note(log, time, ROLLING, SETTLED)
                steps = tally[0]
                time, slow_step, filled, why = advance_slow(
                    time, state, end, tolerance, threshold, max(step, slow_step), robot, ground,
                    drive, table, work, mode, room, kinds, items, rows, begin, interval, filled,
                    tally, budget)
                wait = min(2 * wait, MOST_WAIT) if tally[0] - steps < SHORT else LEAST_WAIT
                rolled = True
                if tally[3] + tally[4] >= budget:
                    return time, step, filled, SPENT
        if not rolls:
            note(log, time, WHOLE, why)
            time, step, filled, ending = advance_adaptive(
                time, state, end, tolerance, step, robot, ground, drive, table, work, probe,
                mode, kinds, items, rows, interval, tally, budget, method,
                Watch(begin, filled, flying and not hopped, threshold, wait), rolling)
            rolled = hopped = False
            if ending != REDUCIBLE:
                return time, step, filled, ending
    return time, step, filled, FINISHED


class Switcher(Scratch):
    """
    The arrays that `advance_switching` works in.

    Attributes
    ----------
    log : (n, 3) array
        Since it was made; see `stepping.note`.

    """

    def __init__(self, vertices: int):
        """Allocate them once."""
        super().__init__(vertices)
        self._room: NDArray[np.float64] = np.zeros((ROOM, SIZE))
        self.log: NDArray[np.float64] = np.zeros((LOG_LINES, 3))

    def advance(self, model: Any, drive: Any, state: NDArray[np.float64], time: float,
                end: float, step: float = 0.0, rows: NDArray[np.float64] = NO_ROWS,
                interval: float = 1.0, limit: Optional[int] = None) -> tuple:
        """Advance `state` of a `Model` in place; see `Scratch.advance`."""
        if limit is None:
            limit = int(self.tally[3] + self.tally[4]) + model.solver.work_budget
        found: tuple = advance_switching(
            time, state, end, model.solver.tolerance, step, model.numbers, model.profile, drive,
            self._table, self._work, self._probe, self._mode, self._broken[0], self._broken[1],
            rows, interval, self.tally, limit, METHODS.index(model.solver.method),
            self._room, self.log, self._room if model.solver.models == 'reduced' else None)
        return found
