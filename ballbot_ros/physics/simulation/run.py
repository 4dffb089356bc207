# SPDX-License-Identifier: Apache-2.0
"""
Run a model from a state for a duration: `simulate`, to an accuracy unless a solver is given.

**To an accuracy**: a run is repeated with ever smaller tolerances of the adaptive method until two
successive runs agree to within the accuracy at all output times.  Their difference is the error of
the *coarser* of the two; the finer one is returned, so that the estimate errs on the safe side.
That holds if both runs have the same sequence of contacts.  Two runs with different numbers of
events of the contact law may agree by chance, as may runs whose contact is too stiff for the
tolerance; then a third run, by another method, must agree, too.  No run is coarser than required
to resolve friction and contact.  Motion with many bounces is chaotic: errors grow until no
tolerance suffices.  The `Assurance` of such a run states the time up to which the accuracy holds.

**With fixed steps**: for a constant cost, or the settings of the paper.  Fixed steps can be stable
and in energy balance, but still too long to be correct, for instance if a ball bounces too early.
Therefore such a run is compared with the adaptive method, which takes a small fraction of its
time, or, if that fails, with steps of half the length.
"""
from dataclasses import replace
import math
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.state import SIZE, State, X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.solver import (
    ACCURACY, check_work, failure, Integrator, LARGEST, Ledger, LEDGER_BOUND, out_of_balance,
    OutOfBalance, SMALLEST, Solver)
from ballbot_ros.physics.simulation.trajectory import Assurance, Effort, Trajectory
from ballbot_ros.physics.solvers.controller import MEMORY
from ballbot_ros.physics.solvers.values import FINISHED, Output, PAUSED, Status

# Rows per call into compiled code: progress is reported, and Ctrl-C handled, in between. The
# result does not depend on this number.
CHUNK = 500

# The tolerance applies to a step; errors grow by one or two orders of magnitude in a crossing.
FIRST_TOLERANCE = 1e-2  # times the accuracy, for the first, coarser run
REFINEMENT = 0.03
# Two runs may have the same error: they must agree more closely than the requested accuracy.
AGREEMENT_FACTOR = 0.1
# The tolerance resolves the slip threshold of friction and the penetration of the ball to these
# fractions: runs that do not resolve them share an error, even with different methods.  In a stiff
# contact, long implicit steps damp the vibration of the ball, which is below the penetration.
RESOLVED_SLIP, RESOLVED_PENETRATION = 0.3, 0.2
EARTH = 9.81  # [m/s2]: without weight, penetration results from impacts
# A run with a tolerance finer by `REFINEMENT` takes twice the work.  Above this ratio the steps
# are limited by rounding or by events that the coarser run has missed, not by the tolerance.
# Then a third, finer run must agree, too.
RUNAWAY = 5
# Maximum work of the confirming run, relative to the confirmed one.
CONFIRMING_WORK = 10
# Below this tolerance rounding errors dominate [m].
FINEST_TOLERANCE = 1e-14

# Maximum error of fixed-step runs, relative to the larger of radius and path.  Fixed steps have no
# error control; beyond this bound the result is a different motion.
STEP_BOUND = 0.08
CHECK = 0.1        # of that: the accuracy of the reference run
LEAST_WORK = 20_000  # minimum work budget of the reference run [right-hand sides]


class TooLongSteps(SimulationError):
    """A run with fixed steps is stable and in energy balance, but inaccurate."""


def simulate(model: Model, start: State, actuation: Actuation, duration: float,
             output_step: float = 1e-3, *, accuracy: Optional[float] = None,
             progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """
    Simulate a model.

    Parameters
    ----------
    model : Model
    start : State
        The time of the run continues from that of this state.
    actuation : Actuation
        Constant during the run.
    duration : float
        [s], rounded up to a whole number of output steps.
    output_step : float
        Time between samples [s]; a whole number of solver steps, if these are fixed.
    accuracy : float, optional
        Maximum error of the position of the centre at any sample [m]; then only `models` and the
        work budget of the model's solver apply, to each run.  By default the solver of the model
        is used unchanged; `ACCURACY` applies to a model without a solver.
    progress : callable, optional
        Called periodically with the simulated time since the start [s].  May raise
        KeyboardInterrupt to end the run early.

    Returns
    -------
    Trajectory
        The start is its first sample.  After a KeyboardInterrupt it ends early.  With an accuracy
        its ``assurance`` has the reached accuracy, and its ``effort`` counts all runs.

    Raises
    ------
    SimulationError
        If the run fails, or if fixed steps were too long; its attribute ``trajectory`` holds the
        samples until then.
    ConfigurationError
        If steps and durations are inconsistent, or the accuracy is out of range.

    """
    given = start, actuation, duration, output_step, progress
    if accuracy is not None or model.solver is None:
        return _to_accuracy(model, ACCURACY if accuracy is None else accuracy, *given)
    try:
        run = run_once(model, *given)
    except OutOfBalance as error:
        if model.solver.method != 'adaptive':
            raise
        # If the tolerance is coarser than the penetration, the ball may vibrate out of the ground
        # and back with explicit steps.  Implicit steps damp that.
        calm = run_once(
            replace(model, solver=replace(model.solver, method='implicit')), *given)
        tried = error.trajectory.effort if error.trajectory else Effort()
        run = replace(calm, model=model, effort=Effort(*map(sum, zip(tried, calm.effort))))
    complete = len(run) > output_steps(duration, output_step)
    if model.solver.fixed and complete:
        check_steps(run, actuation, duration, output_step)
    return run


def steps_in(duration: float, step: float, what: str) -> int:
    """
    Return the number of steps in a duration.

    Raises `ConfigurationError` if it is not a whole number; the message names the nearest valid
    durations.
    """
    steps = round(duration / step)
    if steps < 1 or abs(steps * step - duration) > 1e-6 * duration:
        below = max(1, int(duration / step))
        raise ConfigurationError(
            f'{what} must be a whole number of steps of {step:g} s, got {duration:g} s; '
            f'{below * step:g} s and {(below + 1) * step:g} s are', 'inconsistent', what)
    return steps


def output_steps(duration: float, output_step: float) -> int:
    """Return the number of output steps of a run, to which its duration is rounded up."""
    return int(np.ceil(duration / output_step - 1e-9))


def run_once(model: Model, start: State, actuation: Actuation, duration: float,
             output_step: float = 1e-3,
             progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """Run the solver of a model once; only the energy balance of the run is checked."""
    if not duration > 0.0 or not np.isfinite(duration):
        raise ConfigurationError(f'duration must be above 0 s and finite, got {duration!r}',
                                 'out_of_range', 'duration')
    solver = model.solver_in_use
    count = output_steps(duration, output_step)
    tick, every = output_step, 1
    if solver.fixed:
        tick, every = solver.step, steps_in(output_step, solver.step, 'output_step')
        check_work(solver, count * every)
    actuator = actuation.actuator(model.robot, start.time, start.joint_angle)
    vector = np.array(start[1:])
    model.check_start(start)
    rows = np.empty((1 + count, 2 + SIZE))
    rows[0] = [*start, model.torque(start, actuator)]
    end, status = start.time + count * every * tick, Status(FINISHED, start.time)
    integrator = Integrator(model.parameters, model.profile, solver)
    ledger = Ledger(model.parameters, model.profile, vector)

    def so_far(samples: int) -> Trajectory:
        return Trajectory(
            model, rows[:samples], Effort(*integrator.workspace.statistics[:5].tolist()))
    try:
        while True:
            before = status.filled
            status = integrator.advance(
                actuator, vector, status, end,
                Output(rows[1:], start.time, output_step, before + CHUNK))
            done = status.filled
            if status.outcome not in (FINISHED, PAUSED):
                error = failure(status.outcome, start.time + (done + 1) * output_step, vector,
                                solver)
                error.trajectory = so_far(1 + done)
                raise error
            missing, where = ledger.missing(rows[1 + before:1 + done, 1:-1])
            if missing > LEDGER_BOUND:
                bad = 1 + before + where
                balance = out_of_balance(float(rows[bad, 0]), missing, solver)
                balance.trajectory = so_far(bad)
                raise balance
            if progress is not None:
                progress(done * output_step)
            if status.outcome == FINISHED:
                break
    except KeyboardInterrupt:
        if status.filled == 0:
            raise
    return so_far(1 + status.filled)


def solvers_for(accuracy: float, step: float = 1e-4) -> tuple[Solver, Solver]:
    """
    Return the solvers of the first, coarser and of the second, finer run for an accuracy [m].

    Raises `ConfigurationError` if the accuracy is out of range.
    """
    if not SMALLEST <= accuracy <= LARGEST:
        raise ConfigurationError(
            f'accuracy must be at least {SMALLEST:g} m and at most {LARGEST:g} m, '
            f'got {accuracy!r}', 'out_of_range', 'accuracy')
    coarse = max(FINEST_TOLERANCE, FIRST_TOLERANCE * accuracy)
    fine = max(FINEST_TOLERANCE, REFINEMENT * coarse)
    return Solver('adaptive', step, coarse), Solver('adaptive', step, fine)


def _to_accuracy(model: Model, accuracy: float, start: State, actuation: Actuation,
                 duration: float, output_step: float,
                 progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """Simulate a model to an accuracy [m]."""
    runs = _Runs(model, start, actuation, duration, output_step, progress)
    robot, given = model.robot, model.solver_in_use
    detail = min(RESOLVED_SLIP * robot.slip_threshold * MEMORY,
                 RESOLVED_PENETRATION * robot.total_mass * EARTH / robot.contact_stiffness)
    first, solver = solvers_for(accuracy)
    finer = min(1.0, detail / first.tolerance)
    first, solver = (replace(item, work_budget=given.work_budget, models=given.models,
                             tolerance=max(FINEST_TOLERANCE, finer * item.tolerance))
                     for item in (first, solver))
    coarse, needed = runs.run(first), 1
    if coarse is not None and runs.interrupted:
        return coarse
    while True:
        fine, finest = runs.run(solver), solver.tolerance <= FINEST_TOLERANCE
        if coarse is not None and fine is not None:
            assured = _compare(coarse, fine, accuracy)
            same = finer == 1.0 and coarse.effort.events == fine.effort.events
            if _agree(assured) and not (same or finest):
                assured = runs.confirmed(fine, assured)
                # Two runs agreed by chance, which may happen again.
                needed = needed if _agree(assured) else 2
            if fine.effort.evaluations > RUNAWAY * coarse.effort.evaluations:
                needed = 2
            needed -= _agree(assured)
            if needed <= 0 or finest or runs.interrupted:
                return replace(fine, effort=runs.effort, assurance=assured._replace(
                    runs=runs.count))
        elif fine is not None and finest:
            raise SimulationError(
                start.time, 'the energy balance closes only at the finest tolerance: the accuracy '
                'cannot be verified',
                'use a larger slip_threshold, a softer contact_stiffness or softer gains',
                'unconfirmed', 'tolerance')
        coarse = fine
        solver = replace(solver, tolerance=max(FINEST_TOLERANCE, REFINEMENT * solver.tolerance))


class _Runs:
    """The runs of one model with several solvers, and their cost."""

    def __init__(self, model: Model, start: State, actuation: Actuation, duration: float,
                 output_step: float, progress: Optional[Callable[[float], None]]) -> None:
        self._model, self._given = model, (start, actuation, duration, output_step, progress)
        self.effort, self.count, self.interrupted = Effort(), 0, False

    def run(self, solver: Solver) -> Optional[Trajectory]:
        """Return a run, or None if its energy does not balance."""
        self.count += 1
        try:
            run = run_once(replace(self._model, solver=solver), *self._given)
        except OutOfBalance:
            # The position may be right, but only a finer run can confirm it.
            if solver.tolerance <= FINEST_TOLERANCE:
                raise
            return None
        self.effort = Effort(*map(sum, zip(self.effort, run.effort)))
        duration, output_step = self._given[2:4]
        self.interrupted = len(run) <= output_steps(duration, output_step)
        return run

    def confirmed(self, fine: Trajectory, assured: Assurance) -> Assurance:
        """Return the assurance of a run after comparison with another method."""
        solver = fine.model.solver_in_use
        # A flight without contact needs no evaluations.
        budget = min(solver.work_budget, max(1, CONFIRMING_WORK * fine.effort.evaluations))
        try:
            other = self.run(replace(solver, method='implicit', work_budget=budget))
        except SimulationError:
            other = None
        if other is None:
            return assured._replace(complete=False)
        again = _compare(other, fine, assured.accuracy)
        return again._replace(estimate=max(assured.estimate, again.estimate))


def centres(run: Trajectory) -> Array:
    """Return the centre at each sample, an (n, 2) array, without computing other columns."""
    where: Array = run.rows[:, 1 + X:1 + Y + 1]
    return where


def _agree(assured: Assurance) -> bool:
    """Return whether two runs agree closely enough."""
    return assured.complete and assured.estimate <= AGREEMENT_FACTOR * assured.accuracy


def _compare(coarse: Trajectory, fine: Trajectory, accuracy: float) -> Assurance:
    """Return the assurance that follows from the difference of two runs."""
    gap = _apart(coarse, fine)
    beyond = np.flatnonzero(~(gap <= accuracy))
    good = int(beyond[0]) if len(beyond) else len(gap)
    estimate = float(np.max(gap[:good])) if good else math.nan
    return Assurance(accuracy, estimate, float(fine.rows[max(good - 1, 0), 0]), good == len(fine),
                     fine.model.solver_in_use.tolerance, 2)


def check_steps(run: Trajectory, actuation: Actuation, duration: float,
                output_step: float) -> None:
    """
    Check that the fixed steps of a run were short enough; see `simulate` for the parameters.

    Raises `TooLongSteps` if the run is off by more than `STEP_BOUND`, or cannot be confirmed.
    """
    start, solver = run.state(0), run.model.solver_in_use
    path = float(np.sum(np.hypot(*np.diff(centres(run), axis=0).T)))
    bound = STEP_BOUND * max(run.model.robot.ball_radius, path)
    try:
        # Limited to about the work of the run.
        model = replace(run.model, solver=replace(solver, method='adaptive', work_budget=min(
            solver.work_budget, max(LEAST_WORK, run.effort.evaluations))))
        exact = _to_accuracy(model, min(max(CHECK * bound, SMALLEST), LARGEST), start, actuation,
                             duration, output_step)
        gap, horizon = _apart(run, exact), exact.assurance.horizon if exact.assurance else 0.0
        # Beyond the horizon the comparison is meaningless.
        gap = gap[run.rows[:len(gap), 0] <= horizon]
        remedy = f'{_shorter(solver.step)}, or the adaptive method'
    except SimulationError:
        # Too stiff for the adaptive method.  The error is at least proportional to the step:
        # halving the step removes at least half of it.
        gap = 2.0 * _apart(run, _halved(run, start, actuation, duration, output_step))
        remedy = (f'{_shorter(solver.step)}, a softer contact_stiffness or a larger '
                  'slip_threshold')
    beyond = np.flatnonzero(~(gap <= bound))
    if len(beyond):
        error = TooLongSteps(
            float(run.rows[beyond[0], 0]),
            f'steps of {solver.step:g} s are stable, but the ball is {gap[beyond[0]]:.3g} m from '
            'its position with shorter steps', remedy, 'inaccurate', 'step')
        error.trajectory = replace(run, rows=run.rows[:1 + int(beyond[0])])
        raise error


def _shorter(step: float) -> str:
    """Return the advice to use a step that is likely to be short enough."""
    return f'use a smaller step than {step:g} s (solver), for instance {0.05 * step:g} s'


def _apart(run: Trajectory, other: Trajectory) -> Array:
    """Return the distance between two runs at their common samples [m]."""
    count = min(len(run), len(other))
    gap: Array = np.hypot(*(centres(run)[:count] - centres(other)[:count]).T)
    return gap


def _halved(run: Trajectory, start: State, actuation: Actuation, duration: float,
            output_step: float) -> Trajectory:
    """Return the run with steps of half the length; raise `TooLongSteps` if it fails."""
    solver = run.model.solver_in_use
    half = replace(solver, step=0.5 * solver.step, work_budget=10**15)
    try:
        return run_once(replace(run.model, solver=half), start, actuation, duration,
                        output_step)
    except (SimulationError, ConfigurationError) as error:
        raise TooLongSteps(
            start.time, f'steps of {solver.step:g} s cannot be confirmed: with half of it {error}',
            _shorter(solver.step), 'unconfirmed', 'step') from error
