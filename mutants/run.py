# SPDX-License-Identifier: Apache-2.0
"""
Change the code a little, many times, and see whether the unit tests of its package notice.

    make mutants                                   # a sample of each package, some minutes
    make mutants ARGS='--package control --count 100 --seed 2'
    make mutants ARGS='--package drives --module vesc --count 0'    # all there are
    make mutants ARGS=--survivors                  # again, those that survived the last time

Ctrl-C prints what is done so far; the same command resumes there, for the outcomes are kept in
mutants/out as long as neither sources nor tests change.  A survivor wants a test, or an entry in
mutants/equivalents.yaml with the reason why no test can tell.  Fails if a package is below 90 %.
"""
import argparse
import fcntl
import json
import os
from pathlib import Path
import sys
import time

HERE = Path(__file__).resolve().parent
WANTED = 90.0  # per cent

# Each package: its folder, and the tests that guard it.  Nothing else knows where they are.
PACKAGES = {
    'bridge': ('ballbot_ros/bridge', ['test/unit/bridge']),
    'control': ('ballbot_ros/control', ['test/unit/control']),
    'estimation': ('ballbot_ros/estimation', ['test/unit/estimation']),
    'decision': ('ballbot_ros/decision', ['test/unit/decision']),
    'drives': ('ballbot_ros/drives', ['test/unit/drives']),
}
# Imported before the fork; nothing above may be imported by it.
PRELOADED = ['ballbot_ros.physics']


def read_arguments(argv=None):
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--package', action='append', help='one package only; may be repeated')
    parser.add_argument('--module', default='', help='only files whose path contains this')
    parser.add_argument('--count', type=int, default=40,
                        help='mutants of each package, 0 for all (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--survivors', action='store_true',
                        help='only those that survived the last time')
    parser.add_argument('--afresh', action='store_true', help='do not resume')
    parser.add_argument('--list', action='store_true', help='print the sample, run nothing')
    parser.add_argument('--root', type=Path, default=HERE.parent, help='another checkout')
    parser.add_argument('--out', type=Path, default=HERE / 'out')
    parser.add_argument('--equivalents', type=Path, default=HERE / 'equivalents.yaml')
    parser.add_argument('--table', help='other packages, as JSON: {name: [folder, [tests]]}')
    return parser.parse_args(argv)


class Tally:
    """The outcomes of one package."""

    def __init__(self, package, total):
        self.package, self.total, self.reasons = package, total, []
        self.outcomes = {'killed': 0, 'timeout': 0, 'equivalent': 0, 'survived': 0}
        self.survivors = []
        self._begin = time.monotonic()

    def note(self, mutant, outcome, killer=''):
        """Count one and show it."""
        self.outcomes[outcome] += 1
        if outcome == 'survived':
            self.survivors.append(mutant)
        done = sum(self.outcomes.values())
        print(f'{self.package} {done}/{self.total} {time.monotonic() - self._begin:.0f}s '
              f'{outcome:10} {mutant.path}:{mutant.number} {mutant.way}  '
              f'{killer.split("/")[-1]}', flush=True)

    def share(self):
        """Return the percentage killed of those that are not equivalent; None if none is."""
        killed = self.outcomes['killed'] + self.outcomes['timeout']
        judged = killed + self.outcomes['survived']
        return 100.0 * killed / judged if judged else None

    def row(self):
        """Return the row of the table."""
        share = self.share()
        killed = self.outcomes['killed'] + self.outcomes['timeout']
        return (f'{self.package:14}{sum(self.outcomes.values()):8}{killed:8}'
                f'{self.outcomes["equivalent"]:12}{self.outcomes["survived"]:10}'
                + ('       -' if share is None else f'{share:7.1f}%'))


def main():
    """Run what is asked for; return the exit code."""
    arguments = read_arguments()
    packages = json.loads(arguments.table) if arguments.table else PACKAGES
    for name in arguments.package or ():
        if name not in packages:
            sys.exit(f'no package {name!r}; there are: {", ".join(packages)}')
    import records
    import sample
    root, out = arguments.root.resolve(), arguments.out.resolve()
    chosen = {name: packages[name] for name in arguments.package or packages}
    if arguments.list:
        for name, (folder, _) in chosen.items():
            for mutant in sample.draw(root, name, folder, arguments.seed, arguments.count or None,
                                      arguments.module):
                print(mutant.told())
        return 0
    out.mkdir(parents=True, exist_ok=True)
    lock = (out / 'lock').open('w')
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(f'another run is under way in {out}')
    for threads in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ[threads] = '1'  # a process that forks must have no threads
    import runner
    tree = out / 'tree'
    runner.copy(root, tree)
    runner.preload(root, tree, PRELOADED)
    outcomes = records.Outcomes(out / 'outcomes.jsonl')
    equivalents = records.Equivalents(arguments.equivalents)
    tallies, unused, stopped = [], [], False
    try:
        for name, (folder, tests) in chosen.items():
            package = runner.Package(tree, folder, tests, out / 'work')
            unused += one(package, name, tests, sample, outcomes, equivalents, arguments, tallies)
    except KeyboardInterrupt:
        stopped = True
        print('\ninterrupted; the same command resumes here')
    return report(tallies, unused, stopped)


def one(package, name, tests, sample, outcomes, equivalents, arguments, tallies):
    """Run the mutants of one package; return the entries that hold for none."""
    draw = (package.tree, name, package.folder, arguments.seed)
    modules = {path.relative_to(package.tree / package.folder).as_posix()
               for path in (package.tree / package.folder).rglob('*.py')}
    again = outcomes.survived(name) if arguments.survivors else None
    count = None if arguments.survivors else arguments.count or None
    mutants = sample.draw(*draw, count, arguments.module, again)
    tally = Tally(name, len(mutants))
    tallies.append(tally)
    digest, left = package.digest(tests), []
    for mutant in mutants:
        known = None if arguments.afresh else outcomes.get(digest, mutant)
        if equivalents.reason(mutant, modules):
            tally.note(mutant, 'equivalent')
        elif known:
            tally.note(mutant, known, '(from before)')
        else:
            left.append(mutant)
    if left:
        print(f'{name}: {len(left)} mutants; first its tests without one', flush=True)
        for test in package.baseline():
            print(f'{name}: fails without a mutant, left out: {test}')

        def tell(mutant, outcome, killer, _):
            outcomes.add(digest, mutant, outcome, killer)
            tally.note(mutant, outcome, killer)
        package.run(left, arguments.jobs, tell)
    return equivalents.unused(name, sample.lines(package.tree, package.folder))


def report(tallies, unused, stopped):
    """Print the survivors and the table; return the exit code."""
    for tally in tallies:
        for mutant in tally.survivors:
            print('survived: ' + mutant.told())
    for entry in unused:
        print(f'equivalents.yaml: no such mutant: {entry}')
    print(f'{"package":14}{"mutants":>8}{"killed":>8}{"equivalent":>12}{"survived":>10}{"":8}')
    low = False
    for tally in tallies:
        low |= tally.share() is not None and tally.share() < WANTED
        print(tally.row())
    return 130 if stopped else 1 if low else 0


if __name__ == '__main__':
    sys.path.insert(0, str(HERE))
    sys.exit(main())
