# SPDX-License-Identifier: Apache-2.0
"""
Write the results of compiled.py to docs/speed_and_accuracy.md and README.md.

    .venv/bin/python bench/compiled_tables.py      # from docs/bench.json
"""
import json
from statistics import median
import textwrap

import documents

DOCUMENT = 'docs/speed_and_accuracy.md'
OURS = 'ours'
LEVELS = {1e-4: '0.1 mm', 1e-6: '1 um'}
# Target ratios of the time of the best compiled peer to ours.
MEDIAN, EACH, EACH_OF = 5.0, 3.0, {'roll_60_s': 10.0}
OWN = {('near_critical', 1e-4): 30e-6, ('near_critical', 1e-6): 50e-6}  # [s]


def best_peer(table):
    """Return name and time of the fastest peer, None if no peer achieves the error."""
    peers = [(spent, name) for name, (spent, *_) in table.items() if name != OURS]
    return min(peers)[::-1] if peers else None


def ratios(found):
    """Return the ratio of the best peer's time to ours by error and scene."""
    table = {}
    for (scene, level), solvers in found.items():
        best = best_peer(solvers)
        if best is not None and OURS in solvers:
            table.setdefault(level, {})[scene] = best[1] / solvers[OURS][0]
    return table


def short(value):
    """Return a ratio with two digits."""
    return f'{value:.0f}' if value >= 10.0 else f'{value:.1f}' if value >= 1.0 else f'{value:.2f}'


def verdict(met):
    """Return the verdict on a target for a document."""
    return 'met' if met else '**missed**'


def target_rows(found):
    """Yield target, result and verdict."""
    for level, table in ratios(found).items():
        values = list(table.values())
        yield (f'{MEDIAN:g} x the best compiled peer at {LEVELS[level]}, median of '
               f'{len(values)} scenes',
               f'{short(median(values))} x ({short(min(values))} to {short(max(values))})',
               verdict(median(values) >= MEDIAN))
        others = {scene: value for scene, value in table.items() if scene not in EACH_OF}
        below, least = sum(value < EACH for value in others.values()), min(others, key=others.get)
        yield (f'{EACH:g} x in each scene at {LEVELS[level]}',
               f'{below} of {len(others)} below; least {short(others[least])} x, `{least}`',
               verdict(below == 0))
        for scene, wanted in EACH_OF.items():
            if scene in table:
                yield (f'{wanted:g} x in `{scene}` at {LEVELS[level]}', f'{short(table[scene])} x',
                       verdict(table[scene] >= wanted))
    for (scene, level), wanted in OWN.items():
        spent = found[scene, level][OURS][0]
        yield (f'`{scene}` at {LEVELS[level]}, {1e6 * wanted:g} us', f'{1e6 * spent:.3g} us',
               verdict(spent <= wanted))


def scene_rows(found):
    """Yield for each scene our time, the best peer and the ratio at each error."""
    for scene in dict.fromkeys(scene for scene, _ in found):
        line = [f'`{scene}`']
        for level in LEVELS:
            solvers = found[scene, level]
            ours, best = solvers.get(OURS), best_peer(solvers)
            line.append(f'{1e6 * ours[0]:.3g}' if ours else 'not reached')
            line.append(f'{1e6 * best[1]:.3g}, {best[0]}' if best else 'not reached')
            line.append(f'{short(best[1] / ours[0])} x' if ours and best else '')
        yield line


def solver_rows(found):
    """Yield per solver its median ratio to ours, the number of best times, and [ns] per call."""
    names = dict.fromkeys(name for table in found.values() for name in table)
    for name in names:
        line = [name]
        for level in LEVELS:
            tables = [table for (_, at), table in found.items() if at == level]
            over = [table[name][0] / table[OURS][0] for table in tables
                    if name in table and OURS in table]
            best = sum((best_peer(table) or [None])[0] == name for table in tables)
            line.append(f'{short(median(over))} ({short(min(over))} to {short(max(over))})'
                        if over else 'none')
            line.append(f'{len(over)} of {len(tables)}')
            line.append('' if name == OURS else best)
        each = [1e9 * table[name][0] / table[name][2] for table in found.values()
                if name in table and table[name][2] > 0]
        yield [*line, f'{median(each):.0f}' if each else '']


def bound_rows(found, cost):
    """
    Yield per scene the fewest right-hand sides of all solvers, their time, and the limit.

    The limit is the ratio of the best peer's time to that time, which an ideal solver would need
    with the fewest right-hand sides at `cost` [s] each and no overhead.
    """
    for scene in dict.fromkeys(scene for scene, _ in found):
        line = [f'`{scene}`']
        for level in LEVELS:
            solvers = found[scene, level]
            calls, name = min((item[2], name) for name, item in solvers.items() if item[2] > 0)
            best = best_peer(solvers)
            line += [f'{calls}, {name}', f'{1e6 * calls * cost:.3g}',
                     f'{short(best[1] / (calls * cost))} x' if best else '']
        yield line


def headline(found):
    """Return the headline of the README."""
    table = ratios(found)
    parts = [f'{short(median(values.values()))} times as long at {LEVELS[level]} (least '
             f'{short(min(values.values()))} in `{min(values, key=values.get)}`, most '
             f'{short(max(values.values()))} in `{max(values, key=values.get)}`)'
             for level, values in table.items()]
    return textwrap.fill(
        'Against compiled solvers on the same compiled right-hand side (LSODA, DVODE, DOP853, '
        f'DOPRI5, CVODE): the best of them takes {" and ".join(parts)}, as the median of '
        f'{len(next(iter(table.values())))} scenes at equal error.', 99)


def write(found, cost):
    """Store the results and the cost of a right-hand side in a step; update the documents."""
    documents.keep(cost=cost, compiled=[
        {'scene': scene, 'error': level, 'solvers': {
            name: dict(zip(('time', 'tolerance', 'calls'), values))
            for name, values in table.items()}} for (scene, level), table in found.items()])
    show(found, cost)


def show(found, cost):
    """Write the results to the documents."""
    documents.show(DOCUMENT, 'compiled targets', documents.table(
        ['target', 'reached', ''], target_rows(found)))
    documents.show(DOCUMENT, 'compiled scenes', documents.table(
        ['scene', 'ours, 0.1 mm [us]', 'best peer [us]', 'ratio', 'ours, 1 um [us]',
         'best peer [us]', 'ratio'], scene_rows(found)))
    documents.show(DOCUMENT, 'compiled solvers', documents.table(
        ['solver', 'over ours, 0.1 mm', 'scenes', 'best in', 'over ours, 1 um', 'scenes',
         'best in', 'ns per right-hand side'], solver_rows(found)))
    documents.show(DOCUMENT, 'compiled bounds', documents.table(
        ['scene', 'right-hand sides, 0.1 mm', 'at least [us]', 'limit',
         'right-hand sides, 1 um', 'at least [us]', 'limit'], bound_rows(found, cost)))
    documents.show('README.md', 'compiled', headline(found))


if __name__ == '__main__':
    stored = json.loads(documents.RESULTS.read_text())
    show({(item['scene'], item['error']): {
        name: tuple(values.values()) for name, values in item['solvers'].items()}
        for item in stored['compiled']}, stored['cost'])
