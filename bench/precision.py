# SPDX-License-Identifier: Apache-2.0
"""
Work-precision benchmark of our solvers and those of SciPy and SUNDIALS.

The error is that of the end position relative to a run with an accuracy of 1e-9 m.  The time is
that of one warm run: one call of the compiled kernel for ours, of the solver function for others.
Runs are interleaved and repeated; ratios are of times within the same repetition.  With
``--write`` all curves are stored in docs/bench.json, from which figures.py draws.
"""
import math
from statistics import median

from curves import honest, time_at, timed
import documents
import kernels
import numpy as np
import peers
from precision_scenes import cases, with_solver

from ballbot_ros.errors import SimulationError
from ballbot_ros.physics import Actuation
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.simulation.run import simulate
from ballbot_ros.physics.simulation.solver import Integrator, METHODS
from ballbot_ros.physics.solvers.values import EVALUATIONS, FINISHED, Status

REPEATS = 3
LEVELS = (1e-4, 1e-6)  # errors at which times are compared [m]
ENOUGH = 1e-7          # a curve ends at this error [m]
LONGEST = 2.0          # or at this duration of a run [s]
STEPS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
TOLERANCES = tuple(10.0**-power for power in range(3, 14))


def integrator_of(model):
    """Return the integrator of a model."""
    return Integrator(model.parameters, model.profile, model.solver_in_use)


def fixed(case, method):
    """Return a function from step to end position and right-hand sides, for fixed steps."""
    model = case.model
    actuator = case.actuation.actuator(model.robot, 0.0, case.start.joint_angle)
    steps = {value: round(case.duration / value) for value in STEPS}
    integrators = {value: integrator_of(
        with_solver(model, method, case.duration / steps[value]))
                   for value in STEPS}

    def run(step):
        state = np.array(case.start[1:])
        integrators[step].advance(actuator, state, Status(FINISHED, 0.0), case.duration)
        return state[X], state[Y], steps[step] * METHODS[method].evaluations
    return run


def chosen(case, method):
    """Return the same function of a tolerance, for our methods with step size control."""
    # The step is the maximum for the trapezoidal rule.
    integrators = {value: integrator_of(
        with_solver(case.model, method, 1e-2, value))
                   for value in TOLERANCES}
    actuator = case.actuation.actuator(case.model.robot, 0.0, case.start.joint_angle)

    def run(tolerance):
        integrator, state = integrators[tolerance], np.array(case.start[1:])
        statistics = integrator.workspace.statistics
        statistics[:] = 0
        integrator.advance(actuator, state, Status(FINISHED, 0.0), case.duration)
        return state[X], state[Y], int(statistics[EVALUATIONS])
    return run


def solvers(case):
    """Return name, function and settings, from coarse to fine, of every solver of a scene."""
    found = [(name, fixed(case, name), STEPS) if method.fixed
             else (name, chosen(case, name), TOLERANCES) for name, method in METHODS.items()]
    ours = peers.compiled_rates(case)
    for method in peers.SCIPY:
        found.append((f'SciPy {method}', lambda value, method=method: peers.solve_scipy(
            method, ours, case, value), TOLERANCES))
    if peers.CVODE is not None:
        for method in ('BDF', 'Adams'):
            found.append((f'CVODE {method}', lambda value, method=method: peers.solve_cvode(
                method, ours, case, value), TOLERANCES))
    return found


def curves_of(case):
    """Return the work-precision curve of every solver on a scene, and the reference."""
    exact = simulate(case.model, case.start, case.actuation, case.duration,
                     accuracy=1e-9)
    end, curves, todo = (exact['x'][-1], exact['y'][-1]), {}, []
    for name, run, settings in solvers(case):
        curve = []
        run(settings[0])  # to warm up
        for setting in settings:
            spent, (x, y, calls) = timed(run, setting)
            error = math.hypot(x - end[0], y - end[1])
            curve.append({'setting': setting, 'error': error if error < math.inf else 1e9,
                          'calls': calls, 'times': [spent]})
            todo.append((run, curve[-1]))
            if error < ENOUGH or spent > LONGEST:
                break
        curves[name] = curve
    for _ in range(REPEATS - 1):
        for run, point in todo:
            point['times'].append(timed(run, point['setting'])[0])
    return curves, exact.assurance


def residual(case, curve, level):
    """Return the relative energy balance error at the tolerance for an error."""
    good = [setting for error, setting, _ in honest(curve) if error <= level]
    for setting in reversed(good):
        try:
            run = simulate(with_solver(case.model, 'adaptive', tolerance=setting), case.start,
                           case.actuation, case.duration)
        except SimulationError:  # the energy balance check refuses a run this coarse
            continue
        return float(np.max(np.abs(run.energy_residual))) / run.energy_in_play
    return math.nan


# Targets for our own time [us], and for the ratios of others to it.
OWN = {('near_critical', 1e-6): 100.0, ('near_critical', 1e-4): 20.0,
       ('roll_60_s', 1e-4): 1000.0}
TARGETS = {('SciPy LSODA', 1e-6): -50.0, ('SciPy LSODA', 1e-4): -50.0,
           ('CVODE BDF', 1e-6): -10.0, ('CVODE BDF', 1e-4): -10.0}


def measure(write=False):
    """Yield name, unit, values and target of each measurement; `write` stores them in docs/."""
    stored, ratios = {}, {}
    yield 'right-hand side, pendulum free', 'ns', [
        1e9 * value for value in kernels.right_hand_side(Actuation())], 40.0
    for case in cases():
        curves, assurance = curves_of(case)
        stored[case.name] = {'duration': case.duration, 'curves': curves,
                             'horizon': assurance.horizon, 'reference': assurance.estimate}
        if not assurance.complete:
            yield f'{case.name}: CHAOTIC, reference holds up to', 's', [assurance.horizon], None
        for level in LEVELS:
            ours = [time_at(curves['adaptive'], level, item) for item in range(REPEATS)]
            yield f'{case.name}: adaptive, {level:g} m', 'us', [
                1e6 * value for value in ours], OWN.get((case.name, level))
            yield f'{case.name}: adaptive, {level:g} m, times real time', 'x', [
                case.duration / value for value in ours], None
            for name, curve in curves.items():
                ratios.setdefault((name, level), {})[case.name] = [
                    time_at(curve, level, item) / ours[item] for item in range(REPEATS)]
        yield f'{case.name}: energy residual at 1e-6 m', '1e-9', [
            1e9 * residual(case, curves['adaptive'], 1e-6)], None
    yield from ratio_rows(ratios)
    if not write:
        return
    documents.keep(scenes=stored, ratios=[
        {'solver': name, 'error': level, 'scenes': table}
        for (name, level), table in ratios.items()])


def ratio_rows(ratios):
    """Yield the ratio of each solver's time to that of our adaptive method."""
    for (name, level), table in ratios.items():
        if name == 'adaptive':
            continue
        target = TARGETS.get((name, level))
        if 'near_critical' in table:  # spread over the repetitions
            yield (f'{name} / adaptive, {level:g} m, near_critical', 'x',
                   table['near_critical'], target)
        reached = [median(values) for values in table.values() if not math.isnan(values[0])]
        if reached:  # spread over the scenes
            yield (f'{name} / adaptive, {level:g} m, {len(reached)} of {len(table)} scenes',
                   'x', reached, target)
    if peers.CVODE is None:
        yield f'CVODE: not installed; {peers.HOW_TO_INSTALL}', '', [math.nan], None
