# SPDX-License-Identifier: Apache-2.0
"""
Compare our adaptive method with compiled solvers on the same compiled right-hand side.

    make bench ARGS='--only compiled'                          # all scenes, some minutes
    make bench ARGS='--only compiled --scenes near_critical,roll_60_s'
    make bench ARGS='--only compiled --write'                  # also updates the documents

The cost of an error is the time of the cheapest tolerance at which, as at all finer ones, the
error is achieved.  Runs of all solvers alternate; a time is the minimum of many runs, which is
robust on a busy machine.
"""
import math
import time

import compiled_cvode
import compiled_fortran
import compiled_liblsoda
import compiled_rates
import compiled_tables
from kernel_call import Ours
import kernels
import peers
from precision import LEVELS
from precision_scenes import cases

from ballbot_ros.physics.simulation.run import simulate

TOLERANCES = tuple(10.0**(-power / 3.0) for power in range(39, 5, -1))
FIRST_LOOKS, FIRST_LOOK = 40, 0.05  # trials of each tolerance at most, to choose one; of all [s]
REPEATS_MIN = 40  # repetitions
LEAST_TIME = 5.0  # of all repetitions: a host may be slow for seconds [s]
HOPELESS = 3.0    # ratio to the best time above which a solver is excluded


def solvers(case, rates):
    """Return the solvers of a case by name, as functions of a tolerance."""
    found = {'ours': Ours(case)}
    if compiled_fortran.ADDRESSES:
        for kind, name in ((2, 'LSODA'), (1, 'LSODA, Jacobian')):
            found[name] = compiled_fortran.lsoda(rates, case.duration, kind)
        for kind, name in ((22, 'DVODE BDF'), (21, 'DVODE BDF, Jacobian'), (10, 'DVODE Adams')):
            found[name] = compiled_fortran.dvode(rates, case.duration, kind)
        for name in ('dop853', 'dopri5'):
            found[name.upper()] = compiled_fortran.explicit(rates, case.duration, name)
    if compiled_liblsoda.LIBRARY:
        found['LSODA in C++'] = compiled_liblsoda.Liblsoda(rates, case.duration)
    if compiled_cvode.LIBRARIES:
        for method, name in ((compiled_cvode.BDF, 'BDF'), (compiled_cvode.ADAMS, 'Adams')):
            for slopes, which in ((False, ''), (True, ', Jacobian')):
                found[f'CVODE {name}{which}'] = compiled_cvode.Cvode(
                    rates, case.duration, method, slopes)
        found['CVODE Adams, fixed point'] = compiled_cvode.Cvode(
            rates, case.duration, compiled_cvode.ADAMS, newton=False)
    return found


def spent_by(run, tolerance):
    """Return the time of a run [s]."""
    begin = time.perf_counter()
    run(tolerance)
    return time.perf_counter() - begin


def kept(run, end, levels=LEVELS):
    """Return for each error the tolerances at which, as at all finer ones, it is achieved."""
    found, worst = {level: [] for level in levels}, 0.0
    for tolerance in TOLERANCES:  # from fine to coarse
        x, y = run(tolerance)
        error = math.hypot(x - end[0], y - end[1])
        if math.isfinite(error):
            worst = max(worst, error)
        elif worst > 0.0:
            break  # the finest tolerances may fail; too coarse ones end the search
        for level in levels:
            if worst <= level and math.isfinite(error):
                found[level].append((tolerance, run.evaluations()))
    return found


def cheapest(run, tolerances):
    """Return the fastest tolerance and its right-hand sides, after trials of each in turn."""
    tolerances = tolerances[-6:]  # the finest are never the fastest
    least, begin = dict.fromkeys(tolerances, math.inf), time.perf_counter()
    for repeat in range(FIRST_LOOKS):
        for item in tolerances:
            run(item[0])  # the first run with a tolerance initializes it
            least[item] = min(least[item], spent_by(run, item[0]))
        if repeat > 4 and time.perf_counter() - begin > FIRST_LOOK:
            break
    return min(least, key=least.get)


def least_times(runs, hopeless=HOPELESS):
    """Return the minimum time of each run over many alternating repetitions [s]."""
    least, begin = dict.fromkeys(runs, math.inf), time.perf_counter()
    for repeat in range(10**6):
        for name, (run, tolerance) in runs.items():
            if repeat > 5 and least[name] > hopeless * min(
                    value for key, value in least.items() if key != 'ours'):
                continue
            least[name] = min(least[name], *(spent_by(run, tolerance) for _ in range(3)))
        if repeat > REPEATS_MIN and time.perf_counter() - begin > LEAST_TIME:
            break
    return least


def measured(case, rates):
    """Yield error, and least time [s], tolerance and right-hand sides of each solver by name."""
    exact = simulate(case.model, case.start, case.actuation, case.duration,
                     accuracy=1e-9)
    end, found = (exact['x'][-1], exact['y'][-1]), solvers(case, rates)
    keeping = {name: kept(run, end) for name, run in found.items()}
    for level in LEVELS:
        chosen_by = {name: cheapest(found[name], table[level])
                     for name, table in keeping.items() if table[level]}
        least = least_times({name: (found[name], tolerance)
                             for name, (tolerance, _) in chosen_by.items()})
        yield level, {name: (least[name], *chosen_by[name]) for name in chosen_by}


def measure(scenes=None, write=False):
    found = {}
    for case in cases():
        if scenes is not None and case.name not in scenes:
            continue
        rates = compiled_rates.compiled_case(case)
        yield f'{case.name}: right-hand sides differ by', '1e-9', [
            1e9 * compiled_rates.largest_difference(case, rates)], 1.0
        for level, table in measured(case, rates):
            found[case.name, level] = table
            yield from rows(case.name, level, table)
            best = compiled_tables.best_peer(table)
            if best is not None and 'ours' in table:
                yield (f'{case.name}, {level:g} m: best, {best[0]}', 'x',
                       [best[1] / table['ours'][0]],
                       -compiled_tables.EACH_OF.get(case.name, compiled_tables.EACH))
    for level, values in compiled_tables.ratios(found).items():
        yield (f'best compiled peer / ours, {level:g} m, {len(values)} scenes', 'x',
               list(values.values()), -compiled_tables.MEDIAN)
    if not compiled_cvode.LIBRARIES:
        yield f'CVODE: not installed; {peers.HOW_TO_INSTALL}', '', [math.nan], None
    if not compiled_fortran.ADDRESSES:
        yield 'LSODA, DVODE: this SciPy has no Fortran to call', '', [math.nan], None
    if not compiled_liblsoda.LIBRARY:
        yield f'LSODA in C++: not built; {compiled_liblsoda.HOW_TO_BUILD}', '', [math.nan], None
    if write:
        compiled_tables.write(found, min(map(min, kernels.step_times().values())))


def rows(scene, level, table):
    """Yield the time of each solver, the fastest first."""
    for name, (spent, tolerance, calls) in sorted(table.items(), key=lambda item: item[1][0]):
        own = compiled_tables.OWN.get((scene, level)) if name == 'ours' else None
        yield (f'{scene}, {level:g} m: {name}, {calls} rhs, {tolerance:.0e}', 'us',
               [1e6 * spent], None if own is None else 1e6 * own)
