# SPDX-License-Identifier: Apache-2.0
"""
Measure the cost of optional model parts: the ratio of times with and without, per shipped scene.

    make bench ARGS='--only models --write'      # also updates docs/model.md

A time is the minimum of many alternating runs at the cheapest tolerance at which, as at all finer
ones, an error is achieved, relative to a run of the full model at 1e-13.
"""
from dataclasses import replace
import math
import time

import compiled
import documents
from kernel_call import Ours
import numpy as np
from precision_scenes import shipped

from ballbot_ros.config.files import shipped_files
from ballbot_ros.jit import compiled as compile_kernel
from ballbot_ros.physics.mechanics import contact
from ballbot_ros.physics.simulation.run import simulate
from ballbot_ros.physics.solvers.flight import has_closed_form

LEVELS = (1e-4, 1e-5, 1e-6)  # the errors at which times are compared [m]
REPEATS = 25
LOOKS = 200        # states of a run at which the contact search is timed
AT_REST = 1e-9     # largest swing of a pendulum at rest [rad]
COLUMNS = {'pendulum': 'pendulum', 'search': 'search for contacts', 'ledger': 'energy balance',
           'flight': 'steps in flight', 'all': 'all of them'}
# A massless pendulum, to time the pendulum equations for a robot without one.
WEIGHTLESS = {'pendulum_mass': 1e-9, 'pendulum_length': 0.05, 'pendulum_inertia': 1e-9}


@compile_kernel
def search_often(repeats, places, radius, ground, contacts):
    """Search repeatedly for the contacts at each position."""
    found = 0
    for _ in range(repeats):
        for row in range(len(places)):
            found += contact.find_contacts(
                places[row, 0], places[row, 1], radius, ground, contacts)
    return found


def search_time(case):
    """Return the time of one search for contacts along a run [s]."""
    run = simulate(replace(case.model, solver=replace(
        case.model.solver_in_use, method='adaptive', tolerance=1e-9)), case.start, case.actuation,
        case.duration, case.duration / LOOKS)
    places = np.column_stack([run['x'], run['y']])
    arguments = (places, case.model.robot.ball_radius, case.model.profile,
                 contact.contact_table(len(case.model.profile)))
    search_often(1, *arguments)
    least = math.inf
    for _ in range(REPEATS):
        begin = time.perf_counter()
        search_often(5, *arguments)
        least = min(least, time.perf_counter() - begin)
    return least / (5 * len(places)), run


def variants(case):
    """Return the variants of a case with optional model parts by name; `least` has none."""
    found = {'least': Ours(case), 'flight': Ours(case, flight=False),
             'ledger': Ours(case, ledger=True), 'all': Ours(case, False, True)}
    if not case.model.robot.has_pendulum:
        heavier = replace(case.model, robot=replace(case.model.robot, **WEIGHTLESS))
        found['pendulum'] = Ours(case._replace(model=heavier))
    return found


def least_times(case):
    """Return for each error the time of each variant [s], and the evaluations of `least`."""
    runs, found, calls = variants(case), [], 0
    end = Ours(case, flight=False)(1e-13)
    keeping = {name: compiled.kept(run, end, LEVELS) for name, run in runs.items()}
    for level in LEVELS:
        if all(table[level] for table in keeping.values()):
            picked = {name: (run, compiled.cheapest(run, keeping[name][level])[0])
                      for name, run in runs.items()}
            found.append(compiled.least_times(picked, math.inf))
            runs['least'](picked['least'][1])
            calls = runs['least'].evaluations()
    return found, calls


def found_in(case):
    """Return the time factor of each optional model part, or the reason for its absence."""
    times, calls = least_times(case)
    searching, run = search_time(case)

    def factor(name):
        # Tolerances are discrete, so a single error would be a noisy measure.
        return math.exp(sum(math.log(item[name] / item['least']) for item in times) / len(times))
    least, found = times[-1]['least'], {}
    if run.effort.flights > 0:
        found['flight'] = factor('flight')
    else:
        linear = has_closed_form(case.model.parameters, case.actuation.actuator(case.model.robot))
        found['flight'] = 'never flies' if linear else 'has no closed form'
    found['search'] = 1.0 + calls * searching / least
    found['ledger'] = factor('ledger')
    found['pendulum'] = factor('pendulum') if 'pendulum' in times[-1] else 'kept: it swings'
    if 'pendulum' not in times[-1] and np.ptp(run['pendulum_angle']) < AT_REST:
        found['pendulum'] = 'kept: it hangs still'
    # The search cannot be disabled.
    found['all'] = factor('all') + found['search'] - 1.0
    return found, least


def measure(scenes=None, write=False):
    table = {}
    for path in shipped_files('scenes'):
        if scenes is not None and path.stem not in scenes:
            continue
        found, least = found_in(shipped(path.stem))
        table[path.stem] = found, least
        yield f'{path.stem}: the least, {LEVELS[-1]:g} m', 'us', [1e6 * least], None
        for what, name in COLUMNS.items():
            if isinstance(found[what], float):
                yield f'{path.stem}: {name}', 'x', [found[what]], None
            else:
                yield f'{path.stem}: {name}: {found[what]}', '', [math.nan], None
    if write:
        write_table(table)


def write_table(table):
    """Write the factors to the document."""
    rows = [[f'`{scene}`', f'{1e6 * least:.3g}'] + [
        f'{value:.2f} x' if isinstance(value, float) else value
        for value in (found[what] for what in COLUMNS)] for scene, (found, least) in table.items()]
    documents.keep(left_out={scene: {'least': least, **found}
                             for scene, (found, least) in table.items()})
    documents.show('docs/model.md', 'left out', documents.table(
        ['scene', 'the least [us]', *COLUMNS.values()], rows))
