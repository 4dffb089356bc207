# SPDX-License-Identifier: Apache-2.0
"""
Weigh flight in closed form against the full model alone: same scenes, same tolerance, no output.

A ratio is the time of the full model over that with it, of runs that alternate:
above 1 it saves time. The errors are those of the end position against the full model at 1e-13.
"""
import math
from time import perf_counter

import numpy as np
from precision_scenes import cases, with_solver

from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.simulation.integrator import Integrator
from ballbot_ros.physics.solvers.values import FINISHED, Status

REPEATS = 15
TOLERANCES = (1e-6, 1e-8)
CHOICES = ('auto',)


def integrator_of(case, tolerance, models):
    """Return what advances the model of a case."""
    model = with_solver(case.model, 'adaptive', tolerance=tolerance, models=models)
    return Integrator(model.parameters, model.profile, model.solver, models != 'full')


def end_of(case, integrator):
    """Return the end position of a run, and how long it took [s]."""
    actuator = case.actuation.actuator(case.model.robot, 0.0, case.start.joint_angle)
    state = np.array(case.start[1:])
    begin = perf_counter()
    integrator.advance(actuator, state, Status(FINISHED, 0.0), case.duration)
    return state[[X, Y]], perf_counter() - begin


def measure():
    """Yield name, unit, values and target of each measurement."""
    for case in cases():
        exact, _ = end_of(case, integrator_of(case, 1e-13, 'full'))
        for tolerance in TOLERANCES:
            integrators = {name: integrator_of(case, tolerance, name)
                           for name in ('full', *CHOICES)}
            times = {name: [] for name in integrators}
            errors = {}
            for repeat in range(REPEATS + 1):
                for name, integrator in integrators.items():
                    found, spent = end_of(case, integrator)
                    errors[name] = math.hypot(*(found - exact))
                    if repeat > 0:  # the first warms up
                        times[name].append(spent)
            for name in CHOICES:
                yield (f'{case.name}, {tolerance:g} m: full over {name}', 'x',
                       [full / spent for full, spent in zip(times['full'], times[name])], None)
            for name, error in errors.items():
                yield f'{case.name}, {tolerance:g} m: error, {name}', 'um', [1e6 * error], None
