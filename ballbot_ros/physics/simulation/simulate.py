# SPDX-License-Identifier: Apache-2.0
"""Run a model from a state for a while and keep what happens."""
from typing import Callable, Optional, Tuple

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.mechanics.equations import Drive
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.failures import (
    check_work, failure, Ledger, LEDGER_BOUND, out_of_balance)
from ballbot_ros.physics.simulation.model import Model, State
from ballbot_ros.physics.simulation.trajectory import Effort, Trajectory
from ballbot_ros.physics.solvers import adaptive, fixed_step
from ballbot_ros.physics.solvers.spans import read_log, Span
from ballbot_ros.physics.solvers.switching import Switcher

# Rows per call into compiled code: the progress is told, and Ctrl-C heard, in between.
CHUNK = 500


def steps_in(duration: float, step: float, what: str) -> int:
    """
    Return how many steps make up a duration.

    Raises
    ------
    ConfigurationError
        If it is not a whole number of them; the message names durations that are.

    """
    steps = round(duration / step)
    if steps < 1 or abs(steps * step - duration) > 1e-6 * duration:
        below = max(1, int(duration / step))
        raise ConfigurationError(
            f'{what} must be a whole number of steps of {step:g} s, got {duration:g} s; '
            f'{below * step:g} s and {(below + 1) * step:g} s are')
    return steps


def simulate(model: Model, start: State, actuation: Actuation, duration: float,
             output_step: float = 1e-3,
             progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """
    Simulate a model.

    Parameters
    ----------
    model : Model
    start : State
        Its time counts on.
    actuation : Actuation
        Held for the whole run.
    duration : float
        [s], rounded up to a whole number of output steps.
    output_step : float
        Time between samples [s]; a whole number of solver steps, where these are fixed.
    progress : callable, optional
        Called now and then with the simulated time since the start [s].  May raise
        KeyboardInterrupt to end the run early.

    Returns
    -------
    Trajectory
        The start is its first sample.  After a KeyboardInterrupt it ends early.

    Raises
    ------
    SimulationError
        If the run cannot go on; its attribute ``trajectory`` holds what there is.
    ConfigurationError
        If steps and durations do not fit together.

    """
    if not duration > 0.0 or not np.isfinite(duration):
        raise ConfigurationError(f'duration must be above 0 s and finite, got {duration!r}')
    run, spans = (_adaptive_run if model.solver.method in adaptive.METHODS else _fixed_run)(
        model, start.time, output_step)
    count = int(np.ceil(duration / output_step - 1e-9))
    if model.solver.method not in adaptive.METHODS:
        check_work(model, count * steps_in(output_step, model.solver.step, 'output_step'))
    drive = actuation.drive(model.robot, start.time, start.joint_angle)
    vector = np.array(start[1:])
    rows = np.empty((1 + count, 2 + equations.SIZE))
    rows[0] = [*start, equations.drive_torque(start.time, vector, drive)]
    done, effort = 0, Effort()
    ledger = Ledger(model, vector, contact.contact_table(len(model.profile)))
    try:
        while done < count:
            filled, ending, effort = run(
                done, vector, drive, rows[1 + done:1 + min(done + CHUNK, count)])
            done += filled
            if ending != fixed_step.FINISHED:
                error = failure(ending, start.time + (done + 1) * output_step, vector, model)
                error.trajectory = Trajectory(
                    model, rows[:1 + done], effort, spans=spans(rows[done, 0]))
                raise error
            missing, where = ledger.missing(rows[1 + done - filled:1 + done, 1:-1])
            if missing > LEDGER_BOUND:
                bad = 1 + done - filled + where
                balance = out_of_balance(float(rows[bad, 0]), missing, model)
                balance.trajectory = Trajectory(
                    model, rows[:bad], effort, spans=spans(rows[bad - 1, 0]))
                raise balance
            if progress is not None:
                progress(done * output_step)
    except KeyboardInterrupt:
        if done == 0:
            raise
    return Trajectory(model, rows[:1 + done], effort, spans=spans(rows[done, 0]))


# A run of rows: from row number, state (advanced in place), drive and rows to fill, to the
# number filled, how it ended, and the effort so far.
Run = Callable[[int, Array, Drive, Array], Tuple[int, int, Effort]]
# Which models a run has gone through up to a time [s].
Spans = Callable[[float], Tuple[Span, ...]]


def _fixed_run(model: Model, begin: float, output_step: float) -> Tuple[Run, Spans]:
    """Return a run with steps of one length."""
    step = model.solver.step
    every = steps_in(output_step, step, 'output_step')
    table, work = contact.contact_table(len(model.profile)), fixed_step.workspace()
    method = fixed_step.METHODS.index(model.solver.method)
    per_step = 4 if method == fixed_step.RK4 else 1

    def run(done: int, state: Array, drive: Drive, rows: Array) -> Tuple[int, int, Effort]:
        # Times are counted from the start, so that they carry no accumulated rounding.
        filled, ending = fixed_step.record_run(
            method, begin + done * every * step, state, step, every, model.numbers,
            model.profile, drive, table, work, rows)
        steps = (done + filled) * every
        return filled, ending, Effort(steps, 0, 0, per_step * steps)
    return run, _only_full(begin)


def _only_full(begin: float) -> Spans:
    """Return what a run says of its models that has the full one only."""
    return lambda end: (Span(begin, end, 'full', 'the run begins'),)


def _adaptive_run(model: Model, begin: float, output_step: float) -> Tuple[Run, Spans]:
    """Return a run with steps chosen by their error."""
    switching = model.solver.models != 'full' and model.solver.method != 'trapezoidal'
    scratch = (Switcher if switching else adaptive.Scratch)(len(model.profile))
    step, limit = 0.0, model.solver.work_budget

    def run(done: int, state: Array, drive: Drive, rows: Array) -> Tuple[int, int, Effort]:
        nonlocal step
        _, step, filled, ending = scratch.advance(
            model, drive, state, begin + done * output_step,
            begin + (done + len(rows)) * output_step, step, rows, output_step, limit)
        return filled, ending, Effort(*scratch.tally[:4].tolist())
    if isinstance(scratch, Switcher):
        log = scratch.log
        return run, lambda end: read_log(log, end)
    return run, _only_full(begin)


__all__ = ['CHUNK', 'simulate', 'SimulationError', 'steps_in']
