# SPDX-License-Identifier: Apache-2.0
"""
Run the benchmarks, and print results and targets.

    make bench                       # everything, some minutes
    make bench ARGS='--only kernels'
    make bench ARGS='--only compiled --scenes near_critical,roll_60_s'
    make bench ARGS='--json out.json'
    make bench ARGS='--only precision --write'   # also updates docs/bench.json

Each part is a module whose `measure` yields name, unit, values and target of each measurement; a
negative target is a lower bound.  A missed target is printed as missed and is not a failure.
"""
import argparse
import importlib
import json
import os
from pathlib import Path
import platform
from statistics import median
import sys

PARTS = ('kernels', 'first_compile', 'search', 'sweep', 'loop', 'wire', 'flood', 'accuracy',
         'precision', 'compiled', 'models', 'estimate', 'bridge', 'black_box', 'decision',
         'navigation', 'view', 'live_gains')
# Run only on request: each takes ten minutes.
EXTRA = ('loop_faults', 'faults')
# Measured scene by scene.
BY_SCENE = ('compiled', 'models')
# They change the documents only with --write.
WRITING = (*BY_SCENE, 'precision')


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--only', choices=PARTS + EXTRA, help='measure one part only')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the numbers here, too')
    parser.add_argument('--scenes', metavar='NAME,...', type=lambda text: text.split(','),
                        help='of those parts that compare solvers, these only')
    parser.add_argument('--write', action='store_true',
                        help='write the results into the documents, too')
    arguments = parser.parse_args()
    for given, parts, option in ((arguments.scenes, BY_SCENE, '--scenes'),
                                 (arguments.write, WRITING, '--write')):
        if given and arguments.only not in parts:
            parser.error(f'{option} requires --only with one of {", ".join(parts)}')
    if arguments.scenes and arguments.write:
        parser.error('--write requires all scenes: leave out --scenes')
    here = Path(__file__).resolve().parent
    sys.path[:0] = [str(here), str(here.parent / 'test' / 'oracles')]
    load = os.getloadavg()[0]
    print(f'Python {platform.python_version()}, {os.cpu_count()} cores, load {load:.1f} at the '
          f'start{": busy, expect poor figures" if load > 0.5 else ""}\n')
    print(f'{"":52}{"median":>9}{"least":>9}{"most":>9}      target')
    results = []
    for part in PARTS if arguments.only is None else (arguments.only,):
        measure = importlib.import_module(part).measure
        for name, unit, values, target in (
                measure(arguments.scenes, arguments.write) if part in BY_SCENE
                else measure(arguments.write) if part in WRITING else measure()):
            results.append({'name': name, 'unit': unit, 'values': values, 'target': target})
            print(row(name, unit, values, target), flush=True)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps({'load': load, 'results': results}, indent=1))


def row(name, unit, values, target):
    """Return one line of the table."""
    text = f'{name:52}{median(values):9.2f}{min(values):9.2f}{max(values):9.2f} {unit:3}'
    if target is None:
        return text
    met = median(values) <= target if target > 0.0 else median(values) >= -target
    return f'{text} {"<=" if target > 0.0 else ">="} {abs(target):g}: ' \
           f'{"met" if met else "MISSED"}'


if __name__ == '__main__':
    main()
