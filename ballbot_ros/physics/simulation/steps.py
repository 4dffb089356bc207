# SPDX-License-Identifier: Apache-2.0
"""
Steps of one length can be stable, in balance, and yet too long to be right: this finds out.

The energy ledger bounds nonsense; a ball that bounces a little too early keeps its energy and is
soon somewhere else.  So a run with such steps is held against the adaptive method, which takes a
small part of its time; where that one cannot go on, against steps of half the length.
"""
from dataclasses import replace
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.accuracy import (
    centres, LARGEST, simulate_accurately, SMALLEST)
from ballbot_ros.physics.simulation.failures import OutOfBalance
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.simulate import output_steps, simulate_once
from ballbot_ros.physics.simulation.trajectory import Effort, Trajectory
from ballbot_ros.physics.solvers.registry import METHODS

# What steps of one length may be off, of the radius or of the path, whichever is more.  They
# promise no accuracy; but beyond this the run is of another motion.
STEP_BOUND = 0.08
CHECK = 0.1        # of that: the accuracy of the run that they are held against
LEAST_WORK = 20_000  # right-hand sides for that run, where the other one took fewer


class TooLongSteps(SimulationError):
    """A run is stable and in balance, and yet somewhere else."""


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
        If the run cannot go on, or if steps of one length were too long to be right; its
        attribute ``trajectory`` holds what there is.
    ConfigurationError
        If steps and durations do not fit together.

    """
    given = start, actuation, duration, output_step, progress
    try:
        run = simulate_once(model, *given)
    except OutOfBalance as error:
        if model.solver.method != 'adaptive':
            raise
        # Where the tolerance is coarser than the ball sinks in, explicit steps may shake it out of
        # its ground and in again.  Implicit ones damp that.
        calm = simulate_once(
            replace(model, solver=replace(model.solver, method='implicit')), *given)
        tried = error.trajectory.effort if error.trajectory else Effort()
        run = replace(calm, model=model, effort=Effort(*map(sum, zip(tried, calm.effort))))
    complete = len(run) > output_steps(duration, output_step)
    if METHODS[model.solver.method].fixed and complete:
        check_steps(run, actuation, duration, output_step)
    return run


def check_steps(run: Trajectory, actuation: Actuation, duration: float,
                output_step: float) -> None:
    """
    Look whether steps of one length were short enough.

    Parameters
    ----------
    run : Trajectory
        What they led to.
    actuation, duration, output_step
        See `simulate`.

    Raises
    ------
    TooLongSteps
        If the run is off by more than `STEP_BOUND`, or if nothing confirms it.

    """
    start, solver = run.state(0), run.model.solver
    path = float(np.sum(np.hypot(*np.diff(centres(run), axis=0).T)))
    bound = STEP_BOUND * max(run.model.robot.ball_radius, path)
    try:
        exact = _adaptive(run, start, actuation, duration, output_step, CHECK * bound)
        gap, horizon = _apart(run, exact), exact.assurance.horizon if exact.assurance else 0.0
        # From the horizon on nobody knows.
        gap = gap[run.rows[:len(gap), 0] <= horizon]
        remedy = f'{_shorter(solver.step)}, or the adaptive method'
    except SimulationError:
        # Too stiff for it.  The error goes with the step, or faster: half of it is what halving
        # the step takes away.
        gap = 2.0 * _apart(run, _halved(run, start, actuation, duration, output_step))
        remedy = (f'{_shorter(solver.step)}, a softer contact_stiffness or a larger '
                  'slip_threshold')
    beyond = np.flatnonzero(~(gap <= bound))
    if len(beyond):
        error = TooLongSteps(
            float(run.rows[beyond[0], 0]),
            f'steps of {solver.step:g} s are stable, but the ball is {gap[beyond[0]]:.3g} m from '
            'where shorter ones have it', remedy)
        error.trajectory = replace(run, rows=run.rows[:1 + int(beyond[0])])
        raise error


def _shorter(step: float) -> str:
    """Advise a step [s] that is likely to be short enough: errors go with it, or faster."""
    return (f'use a smaller step than {step:g} s (solver), for instance '
            f'{0.05 * step:g} s')


def _apart(run: Trajectory, other: Trajectory) -> Array:
    """Return the distance of two runs at the samples that both have [m]."""
    count = min(len(run), len(other))
    gap: Array = np.hypot(*(centres(run)[:count] - centres(other)[:count]).T)
    return gap


def _adaptive(run: Trajectory, start: State, actuation: Actuation, duration: float,
              output_step: float, accuracy: float) -> Trajectory:
    """Return the run of the adaptive method, within about the work that the run took."""
    work = min(run.model.solver.work_budget, max(LEAST_WORK, run.effort.evaluations))
    model = replace(run.model, solver=replace(
        run.model.solver, method='adaptive', work_budget=work))
    return simulate_accurately(model, start, actuation, duration,
                               min(max(accuracy, SMALLEST), LARGEST), output_step)


def _halved(run: Trajectory, start: State, actuation: Actuation, duration: float,
            output_step: float) -> Trajectory:
    """
    Return the run with steps of half the length.

    Raises
    ------
    TooLongSteps
        If there is none.

    """
    solver = run.model.solver
    half = replace(solver, step=0.5 * solver.step, work_budget=10**15)
    try:
        return simulate_once(replace(run.model, solver=half), start, actuation, duration,
                             output_step)
    except (SimulationError, ConfigurationError) as error:
        raise TooLongSteps(
            start.time, f'nothing confirms steps of {solver.step:g} s: with half of it {error}',
            _shorter(solver.step)) from error


__all__ = ['check_steps', 'simulate', 'STEP_BOUND', 'TooLongSteps']
