# SPDX-License-Identifier: Apache-2.0
"""
Accuracy as an input: how wrong the answer may be, in metres, instead of a step size.

A run is repeated with ever smaller tolerances of the adaptive method until two successive
runs agree to within the accuracy at all times that are kept.  Their difference is the error
of the *coarser* of the two; the finer one is returned, so that the estimate errs on the safe
side.

Motion with many bounces is chaotic: errors grow until no tolerance helps.  Such a run is
said to be so, with the time up to which the promise holds.
"""
from dataclasses import replace
import math
from typing import Callable, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.failures import OutOfBalance
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.simulation.simulate import simulate
from ballbot_ros.physics.simulation.solver import Solver
from ballbot_ros.physics.simulation.trajectory import Assurance, Effort, Trajectory

# The tolerance is one of a step; over a crossing errors grow by one or two orders.
FIRST_TOLERANCE = 1e-2  # times the accuracy, for the first, coarser run
REFINEMENT = 0.03
# Two runs may be wrong in the same way: they have to agree better than was asked for.
SAFETY = 0.3
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
    def run(solver: Solver) -> Optional[Trajectory]:
        try:
            return simulate(replace(model, solver=solver), start, actuation, duration,
                            output_step, progress)
        except OutOfBalance:
            # The position may be right, but nobody should have to trust it: look closer.
            if solver.tolerance <= FINEST_TOLERANCE:
                raise
            return None

    first, solver = (replace(item, work_budget=model.solver.work_budget,
                             models=model.solver.models)
                     for item in solvers_for(accuracy))
    coarse = run(first)
    effort, runs = coarse.effort if coarse else Effort(), 1
    while True:
        fine, runs = run(solver), runs + 1
        if fine is not None:
            effort = Effort(*map(sum, zip(effort, fine.effort)))
        if coarse is not None and fine is not None:
            assured = _compare(coarse, fine, accuracy, solver.tolerance, runs)
            if (assured.complete and assured.estimate <= SAFETY * accuracy
                    or solver.tolerance <= FINEST_TOLERANCE):
                return replace(fine, effort=effort, assurance=assured)
        elif fine is not None and solver.tolerance <= FINEST_TOLERANCE:
            raise SimulationError(
                start.time, 'only the finest tolerance keeps the energy: nothing confirms the run',
                'use a larger slip_threshold, a softer contact_stiffness or softer gains')
        coarse = fine
        solver = replace(solver, tolerance=max(FINEST_TOLERANCE, REFINEMENT * solver.tolerance))


def _compare(coarse: Trajectory, fine: Trajectory, accuracy: float, tolerance: float,
             runs: int) -> Assurance:
    """Return what the difference of two runs says about the error."""
    samples = min(len(coarse), len(fine))
    gap = np.hypot(coarse['x'][:samples] - fine['x'][:samples],
                   coarse['y'][:samples] - fine['y'][:samples])
    times = fine['time'][:samples]
    beyond = np.flatnonzero(~(gap <= accuracy))
    good = int(beyond[0]) if len(beyond) else samples
    estimate = float(np.max(gap[:good])) if good else math.nan
    return Assurance(accuracy, estimate, float(times[max(good - 1, 0)]), good == len(fine),
                     tolerance, runs)
