# SPDX-License-Identifier: Apache-2.0
"""
Accuracy as an input: how wrong the answer may be, in metres, instead of a step size.

A run is repeated with ever smaller tolerances of the adaptive method until two successive
runs agree to within the accuracy at all times that are kept.  Their difference is the error
of the *coarser* of the two; the finer one is returned, so that the estimate errs on the safe
side.

That holds where both saw the same motion.  Two runs that met another number of kinks of the
contact law did not, and may agree by chance; then a third, by another method, has to agree, too.
And no run is coarser than what friction and contact need to be seen at all.

Motion with many bounces is chaotic: errors grow until no tolerance helps.  Such a run is
said to be so, with the time up to which the promise holds.
"""
from dataclasses import replace
import math
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.state import State, X, Y
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.failures import OutOfBalance
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.simulate import simulate_once
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.simulation.trajectory import Assurance, Effort, Trajectory
from ballbot_ros.physics.solvers.controller import MEMORY

# The tolerance is one of a step; over a crossing errors grow by one or two orders.
FIRST_TOLERANCE = 1e-2  # times the accuracy, for the first, coarser run
REFINEMENT = 0.03
# Two runs may be wrong in the same way: they have to agree better than was asked for.
SAFETY = 0.1
# A tolerance is to resolve the slip at which friction sets in, and how deep the ball sinks in, by
# so much: two runs that cannot see these are wrong alike, whatever their methods.  In a hard
# contact the ball vibrates by less than it sinks in, which long implicit steps damp.
RESOLVED_SLIP, RESOLVED_PENETRATION = 0.3, 0.2
EARTH = 9.81  # [m/s2]: a ball without weight sinks in where it strikes
# A run with a tolerance finer by `REFINEMENT` takes twice the work.  Where it takes so much more,
# the tolerance is not what limits the steps: rounding is, or what the coarser run has missed.
# Then a still finer one has to agree, too.
RUNAWAY = 5
# Work of the run that confirms, over that of the one to be confirmed.
CONFIRMING_WORK = 10
# Below this, rounding is what is left [m].
FINEST_TOLERANCE = 1e-14

SMALLEST, LARGEST = 1e-9, 0.1  # that can be asked for [m]


def solvers_for(accuracy: float, step: float = 1e-4) -> tuple[Solver, Solver]:
    """
    Return the solvers of the first, coarser and of the second, finer run for an accuracy [m].

    Raises
    ------
    ConfigurationError
        If the accuracy is out of range.

    """
    if not SMALLEST <= accuracy <= LARGEST:
        raise ConfigurationError(
            f'accuracy must be at least {SMALLEST:g} m and at most {LARGEST:g} m, '
            f'got {accuracy!r}')
    coarse = max(FINEST_TOLERANCE, FIRST_TOLERANCE * accuracy)
    fine = max(FINEST_TOLERANCE, REFINEMENT * coarse)
    return Solver('adaptive', step, coarse), Solver('adaptive', step, fine)


def simulate_accurately(model: Model, start: State, actuation: Actuation, duration: float,
                        accuracy: float, output_step: float = 1e-3,
                        progress: Optional[Callable[[float], None]] = None) -> Trajectory:
    """
    Simulate a model to an accuracy.

    Parameters
    ----------
    accuracy : float
        Largest error of the position of the centre at any sample [m].
    model, start, actuation, duration, output_step, progress
        See `simulate`; of the solver of the model only `models` and its work budget, for each
        run, are used.

    Returns
    -------
    Trajectory
        Its ``assurance`` says what was reached, its ``effort`` counts all runs.

    Raises
    ------
    ConfigurationError
        If the accuracy is out of range.
    SimulationError
        See `simulate`.

    """
    runs = _Runs(model, start, actuation, duration, output_step, progress)
    first, solver = (replace(item, work_budget=model.solver.work_budget,
                             models=model.solver.models)
                     for item in _resolving(model, *solvers_for(accuracy)))
    coarse, needed = runs.run(first), 1
    while True:
        fine, finest = runs.run(solver), solver.tolerance <= FINEST_TOLERANCE
        if coarse is not None and fine is not None:
            assured = _compare(coarse, fine, accuracy)
            same = coarse.effort.events == fine.effort.events
            if _agree(assured) and not (same or finest):
                assured = runs.confirmed(fine, assured)
                # Two runs did agree by chance: here that happens, and may again.
                needed = needed if _agree(assured) else 2
            if fine.effort.evaluations > RUNAWAY * coarse.effort.evaluations:
                needed = 2
            needed -= _agree(assured)
            if needed <= 0 or finest:
                return replace(fine, effort=runs.effort, assurance=assured._replace(
                    runs=runs.count))
        elif fine is not None and finest:
            raise SimulationError(
                start.time, 'only the finest tolerance keeps the energy: nothing confirms the run',
                'use a larger slip_threshold, a softer contact_stiffness or softer gains')
        coarse = fine
        solver = replace(solver, tolerance=max(FINEST_TOLERANCE, REFINEMENT * solver.tolerance))


def _resolving(model: Model, first: Solver, second: Solver) -> tuple[Solver, Solver]:
    """Return the solvers, finer where they would not see how a robot slips or sinks in."""
    robot = model.robot
    detail = min(RESOLVED_SLIP * robot.slip_threshold * MEMORY,
                 RESOLVED_PENETRATION * robot.total_mass * EARTH / robot.contact_stiffness)
    finer = min(1.0, detail / first.tolerance)
    return (replace(first, tolerance=max(FINEST_TOLERANCE, finer * first.tolerance)),
            replace(second, tolerance=max(FINEST_TOLERANCE, finer * second.tolerance)))


class _Runs:
    """What `simulate_accurately` repeats, and what that costs."""

    def __init__(self, model: Model, start: State, actuation: Actuation, duration: float,
                 output_step: float, progress: Optional[Callable[[float], None]]) -> None:
        """Take what all runs have in common."""
        self._model, self._given = model, (start, actuation, duration, output_step, progress)
        self.effort, self.count = Effort(), 0

    def run(self, solver: Solver) -> Optional[Trajectory]:
        """Return a run, or nothing where its energy does not balance."""
        self.count += 1
        try:
            run = simulate_once(replace(self._model, solver=solver), *self._given)
        except OutOfBalance:
            # The position may be right, but nobody should have to trust it: look closer.
            if solver.tolerance <= FINEST_TOLERANCE:
                raise
            return None
        self.effort = Effort(*map(sum, zip(self.effort, run.effort)))
        return run

    def confirmed(self, fine: Trajectory, assured: Assurance) -> Assurance:
        """Return what is known of a run once another method was asked, too."""
        solver = fine.model.solver
        budget = min(solver.work_budget, CONFIRMING_WORK * fine.effort.evaluations)
        try:
            other = self.run(replace(solver, method='implicit', work_budget=budget))
        except SimulationError:
            other = None
        if other is None:
            return assured._replace(complete=False)
        again = _compare(other, fine, assured.accuracy)
        return again._replace(estimate=max(assured.estimate, again.estimate))


def centres(run: Trajectory) -> Array:
    """Return where the centre is at each sample, an (n, 2) array, with nothing else computed."""
    where: Array = run.rows[:, 1 + X:1 + Y + 1]
    return where


def _agree(assured: Assurance) -> bool:
    """Return whether two runs were close enough together to be trusted."""
    return assured.complete and assured.estimate <= SAFETY * assured.accuracy


def _compare(coarse: Trajectory, fine: Trajectory, accuracy: float) -> Assurance:
    """Return what the difference of two runs says about the error."""
    samples = min(len(coarse), len(fine))
    gap = np.hypot(*(centres(coarse)[:samples] - centres(fine)[:samples]).T)
    times = fine.rows[:samples, 0]
    beyond = np.flatnonzero(~(gap <= accuracy))
    good = int(beyond[0]) if len(beyond) else samples
    estimate = float(np.max(gap[:good])) if good else math.nan
    return Assurance(accuracy, estimate, float(times[max(good - 1, 0)]), good == len(fine),
                     fine.model.solver.tolerance, 2)
