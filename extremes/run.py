# SPDX-License-Identifier: Apache-2.0
"""
Run the simulator far outside the range of its robots, and classify each case.

    make extremes                                  # 20,000 cases, some minutes
    make extremes ARGS='--class slope --cases 500'
    make extremes ARGS='--only combined:17'        # repeats one case
    make extremes ARGS='--seed 5000000 --cases 200000 --resume FILE'  # resumable
    make extremes ARGS='--remedies 500'            # applies the remedies of 500 refusals
    make extremes ARGS=--cost                      # cost of the confirming runs
    make extremes ARGS=--maps                      # draws the maps of docs/extremes.md

The exit code is 1 if any case is wrong; 130 after Ctrl-C, which prints the completed cases.
"""
import argparse
import contextlib
from dataclasses import asdict
import itertools
import json
import multiprocessing
import os
from pathlib import Path
import random
import signal
import sys
import time
import warnings

if __name__ == '__main__':
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # while it loads, to end without a traceback

from cases import BY_NAME, CLASSES
from judge import CHAOTIC, GOOD, judge, REFUSED, UNCONFIRMED, Verdict, WRONG
from remedies import refusal, remedy, report as report_remedies

from ballbot_ros.errors import PlausibilityWarning

INTERRUPTED = 130  # exit code, as of the shell for a program that Ctrl-C ended
PARTS = 10  # progress lines of a complete run, if standard error is not a terminal


def main():
    """Run the requested cases; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    parser.add_argument('--cases', type=int, default=20_000, metavar='N', help='number of cases')
    parser.add_argument('--seed', type=int, default=0, metavar='S', help='first seed')
    parser.add_argument('--class', dest='only_class', choices=sorted(BY_NAME), metavar='NAME',
                        help=f'one class only: {", ".join(sorted(BY_NAME))}')
    parser.add_argument('--only', metavar='CLASS:SEED', help='repeat one case')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all results to this file')
    parser.add_argument('--resume', type=Path, metavar='FILE',
                        help='append every verdict to FILE immediately; skip the cases in it')
    parser.add_argument('--jobs', type=int, default=os.cpu_count(), metavar='N',
                        help='processes; default: one per core')
    parser.add_argument('--remedies', type=int, metavar='N',
                        help='apply the remedies of N refusals')
    parser.add_argument('--cost', action='store_true',
                        help='measure the cost of the confirming runs instead')
    parser.add_argument('--maps', action='store_true', help='draw the maps instead')
    arguments = parser.parse_args()
    if arguments.maps:
        from maps import draw_all
        draw_all(Path(__file__).resolve().parents[1] / 'docs' / 'figures')
        return 0
    if arguments.cost:
        from cost import report as report_cost
        report_cost()
        return 0
    if arguments.only:
        name, _, seed = arguments.only.partition(':')
        if name not in BY_NAME or not seed.isdigit():
            parser.error(f'--only takes CLASS:SEED, for instance slope:17, got {arguments.only}')
        compile_first()
        found = judge(name, int(seed))
        print(f'{name}:{seed}  {found.verdict}  {found.why}\n'
              f'energy residual {found.residual:.2g}, {found.seconds:.2f} s')
        return int(found.verdict == WRONG)
    jobs = listed(arguments.cases, arguments.only_class, arguments.seed)
    if arguments.remedies:
        tried = try_remedies(jobs, arguments.remedies, arguments.jobs)
        print(report_remedies(tried))
        return int(len(tried) < arguments.remedies or not all(item.setting for item in tried))
    verdicts = run_all(jobs, arguments.jobs, arguments.resume)
    print(table(verdicts))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps([asdict(item) for item in verdicts], indent=1))
    if len(verdicts) < len(jobs):
        print(f'ended after {len(verdicts)} of {len(jobs)} cases', file=sys.stderr)
        return INTERRUPTED
    return int(any(item.verdict == WRONG for item in verdicts))


def listed(cases, only_class, seed):
    """Return class and seed of each case, the longest first."""
    jobs = []
    for make, part in reversed(CLASSES.items()):
        if only_class in (None, make.__name__):
            count = part if part >= 1 else round(part * cases)
            if only_class is not None:
                count = cases
            jobs += [(make.__name__, seed + i) for i in range(count)]
    return jobs


def run_all(jobs, processes, kept=None):
    """Return the verdicts; Ctrl-C ends it with those there are, in the file `kept`, too."""
    verdicts, begin, pool = read_kept(kept, jobs), time.monotonic(), None
    done = {(item.name, item.seed) for item in verdicts}
    left = [job for job in jobs if job not in done]
    try:
        compile_first()
        pool = make_pool(processes)
        for found in pool.imap_unordered(work, left, 8 if len(left) > 1000 else 1):
            verdicts.append(found)
            if kept is not None:
                with kept.open('a') as file:
                    file.write(json.dumps(asdict(found)) + '\n')
            report(verdicts, len(jobs), time.monotonic() - begin)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # another one would interrupt the end
    finally:
        if pool is not None:
            pool.terminate()
            pool.join()
        if sys.stderr.isatty():
            print(file=sys.stderr)
    return sorted(verdicts, key=lambda item: (list(BY_NAME).index(item.name), item.seed))


def read_kept(kept, jobs):
    """Return the verdicts on these cases that a file holds."""
    if kept is None or not kept.exists():
        return []
    wanted, found, text = set(jobs), {}, kept.read_text()
    if not text.endswith('\n'):
        kept.write_text(text + '\n')  # a kill has cut its last line
    for line in text.splitlines():
        with contextlib.suppress(ValueError):
            item = Verdict(**json.loads(line))
            if (item.name, item.seed) in wanted:
                found[item.name, item.seed] = item
    return list(found.values())


def compile_first():
    """Compile once, before several processes do it at the same time and cases wait for it."""
    for name in ('slope', 'fixed', 'control_period'):
        work((name, 0))


def try_remedies(jobs, wanted, processes):
    """Return what became of the first refusals among all cases, in an order without meaning."""
    jobs = random.Random(0).sample(jobs, len(jobs))
    compile_first()
    with make_pool(processes) as pool:
        refused = list(itertools.islice(filter(None, pool.imap(refusal, jobs, 8)), wanted))
    # Another one: the first has all jobs in its queue.
    with make_pool(processes) as pool:
        return list(pool.imap(remedy, refused))


def make_pool(processes):
    """Return a pool that leaves Ctrl-C to this process, by which it is ended."""
    # Ignored from the first moment of each process: a terminal signals all of them.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return multiprocessing.get_context('spawn').Pool(processes, prepare)
    finally:
        signal.signal(signal.SIGINT, before)


def prepare():
    """Prepare a process: it leaves Ctrl-C to the first one, and its cases are implausible."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter('ignore', PlausibilityWarning)


def report(verdicts, total, seconds):
    """Say how far it has got: on one line to a person, else a line for each part."""
    done, person = len(verdicts), sys.stderr.isatty()
    if done % 50 and done != total if person else done * PARTS // total == (
            done - 1) * PARTS // total:
        return
    wrong = sum(item.verdict == WRONG for item in verdicts)
    line = f'{done} of {total} cases, {wrong} wrong, {seconds:.0f} s'
    print(f'\r{line} ' if person else line, end='' if person else '\n', file=sys.stderr,
          flush=True)


def work(job) -> Verdict:
    """Judge one case; what a process of the pool does."""
    return judge(*job)


def table(verdicts):
    """Return the table by class, and every wrong or unconfirmed case below it."""
    lines = [f'{"class":16}{"cases":>7}{"good":>7}{"chaotic":>9}{"refused":>9}'
             f'{"unconfirmed":>13}{"wrong":>7}{"residual":>14}{"slowest":>10}']
    for name in [*BY_NAME, 'all']:
        own = [item for item in verdicts if name in (item.name, 'all')]
        if own:
            numbers = [sum(item.verdict == kind for item in own)
                       for kind in (GOOD, CHAOTIC, REFUSED, UNCONFIRMED, WRONG)]
            lines.append(
                f'{name:16}{len(own):7}{numbers[0]:7}{numbers[1]:9}{numbers[2]:9}'
                f'{numbers[3]:13}{numbers[4]:7}'
                f'{max(item.residual for item in own):14.1e}'
                f'{max(item.seconds for item in own):8.2f} s')
    lines += [f'{kind} {item.name}:{item.seed}  {item.why}' for kind in (WRONG, UNCONFIRMED)
              for item in verdicts if item.verdict == kind]
    return '\n'.join(lines)


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        sys.exit(INTERRUPTED)
