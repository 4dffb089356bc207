# SPDX-License-Identifier: Apache-2.0
"""
Go from model to model during a run: the full one, and flight in closed form.

Flight is entered where nothing touches and the law of the motor has a closed form, and left at
the touch.  It is exact, so that it changes nothing but the time that a run takes.
"""
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled, outlined
from ballbot_ros.physics.mechanics.equations import drive_torque, SIZE
from ballbot_ros.physics.mechanics.modes import find_mode
from ballbot_ros.physics.solvers.adaptive import (
    advance_adaptive, METHODS, NO_ROWS, REDUCIBLE, Scratch, Watch)
from ballbot_ros.physics.solvers.events import time_width
from ballbot_ros.physics.solvers.fixed_step import FINISHED
from ballbot_ros.physics.solvers.flight import (
    fly, has_closed_form, NO_TOUCH, spin_start, time_of_touch, within_limit)

# The models that a run can be in, and why one was entered, for the log.
WHOLE, FLYING = range(2)
BEGUN, LANDED, LIFTED = range(3)

SHORT_FLIGHT = 1e-6  # [s]
LOG_LINES = 400


@compiled
def note(log: Any, time: float, model: int, reason: int) -> None:
    """
    Note a change of the model in a log, an (n, 3) array of time, model and reason.

    Its first line holds the number of changes, of which so many are kept as there are lines, and
    the present model.
    """
    if log[0, 0] > 0.0 and log[0, 1] == model:
        return
    log[0, 0] += 1.0
    log[0, 1] = model
    line = int(log[0, 0])
    if line < len(log):
        log[line, 0], log[line, 1], log[line, 2] = time, model, reason


@compiled
def write_row(time: float, state: Any, motor: float, row: Any) -> None:
    """Fill a row of a trajectory."""
    row[0] = time
    for i in range(SIZE):
        row[1 + i] = state[i]
    row[1 + SIZE] = motor


@outlined
def advance_flying(time: float, state: Any, end: float, robot: Any, ground: Any, drive: Any,
                   out: Any, rows: Any, begin: float, interval: float, filled: int) -> tuple:
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
                      budget: int, method: int, log: Any) -> tuple:
    """
    Advance `state` in place with the simplest models that do, as `advance_adaptive` does.

    Parameters
    ----------
    log : (n, 3) array
        Gets time, model and reason of each change, see `note`.
    other parameters
        As of `advance_adaptive`.

    Returns
    -------
    time, step, filled, ending
        As of `advance_adaptive`.

    """
    begin, filled = time, 0
    flying = has_closed_form(robot, drive)
    why = BEGUN
    hopped = False  # just now: something else first, if only for a few steps
    while time < end:
        count = find_mode(time, state, robot, ground, drive, table, mode)
        before = time
        if count == 0 and flying and not hopped:
            time, filled = advance_flying(
                time, state, end, robot, ground, drive, probe, rows, begin, interval, filled)
            hopped = time - before < SHORT_FLIGHT
            if time > before:
                note(log, before, FLYING, LIFTED)
                why = LANDED
            continue
        note(log, time, WHOLE, why)
        time, step, filled, ending = advance_adaptive(
            time, state, end, tolerance, step, robot, ground, drive, table, work, probe, mode,
            kinds, items, rows, interval, tally, budget, method,
            Watch(begin, filled, flying and not hopped))
        hopped = False
        if ending != REDUCIBLE:
            return time, step, filled, ending
    return time, step, filled, FINISHED


class Switcher(Scratch):
    """
    The arrays that `advance_switching` works in.

    Attributes
    ----------
    log : (n, 3) array
        Since it was made; see `note`.

    """

    def __init__(self, vertices: int):
        """Allocate them once."""
        super().__init__(vertices)
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
            rows, interval, self.tally, limit, METHODS.index(model.solver.method), self.log)
        return found
