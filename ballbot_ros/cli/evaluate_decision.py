# SPDX-License-Identifier: Apache-2.0
"""The verb ``evaluate-decision``: prove the obstacle decision in closed loop."""
import argparse
from concurrent.futures import ProcessPoolExecutor
import multiprocessing
import os
from pathlib import Path
from time import perf_counter
from typing import Any, Tuple

from ballbot_ros.cli import options
from ballbot_ros.cli.command import DONE, INTERRUPTED, print_error
from ballbot_ros.cli.sweep import follow
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which approaches, which planners, where to write."""
    parser.add_argument('--approaches', type=int, default=5000, metavar='N',
                        help='of the first planner (default: %(default)s)')
    parser.add_argument('--compared', type=int, default=1000, metavar='N',
                        help='of each other planner (default: %(default)s)')
    parser.add_argument('--planners', default=None, metavar='NAME,...',
                        help='the first is the one to be proven (default: all)')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--workers', type=int, default=None, metavar='N',
                        help='processes (default: one per core)')
    parser.add_argument('--out', type=Path, default=Path('decision_evaluation'),
                        metavar='DIR', help='for results and report (default: %(default)s)')
    parser.add_argument('--kind', help='of ground, for all approaches')
    parser.add_argument('--sensor', choices=('step', 'terrain'), help='for all approaches')
    parser.add_argument('--required-probability', type=float, metavar='P',
                        help='other than the decision tuning says')
    parser.add_argument('--only', type=int, metavar='N',
                        help='run approach N alone, and say what was decided when and why')
    parser.add_argument('--every', type=float, default=0.5, metavar='SECONDS',
                        help='with --only: a line at least so often (default: %(default)s)')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the approaches, or one of them, and say what came of them."""
    campaign = read_campaign(arguments)
    if arguments.only is not None:
        from ballbot_ros.studies.evaluation.replay import replay
        for planner, _ in campaign.parts:
            lines, _ = replay(campaign, planner, arguments.only, arguments.every)
            print('\n'.join([f'planner {planner}', *lines]))
        return DONE
    from ballbot_ros.cli.progress import watched
    from ballbot_ros.studies.evaluation.campaign import run_campaign
    begin = perf_counter()
    number = arguments.workers or os.cpu_count() or 1
    pool = ProcessPoolExecutor(
        number, multiprocessing.get_context('fork'), follow, (os.getpid(),))
    try:
        with watched(campaign.size, arguments.quiet, 'evaluating', 'approaches') as progress:
            rows = run_campaign(campaign, arguments.out, pool, number, progress)
    except KeyboardInterrupt:
        print_error(f'interrupted; the same command goes on with what is in {arguments.out}')
        return INTERRUPTED
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    if not arguments.quiet:
        print_summary(campaign, rows, perf_counter() - begin)
    return DONE


def read_campaign(arguments: argparse.Namespace) -> Any:
    """Return what is to be run; `ConfigurationError` for what there is not."""
    from ballbot_ros.config.fields import suggestion
    from ballbot_ros.decision import PLANNERS
    from ballbot_ros.studies.evaluation.campaign import Campaign
    from ballbot_ros.studies.evaluation.grounds import KINDS
    names: Tuple[str, ...] = tuple(
        arguments.planners.split(',') if arguments.planners else reversed(list(PLANNERS)))
    for name, known in [(name, PLANNERS) for name in names] + (
            [(arguments.kind, KINDS)] if arguments.kind is not None else []):
        if name not in known:
            raise ConfigurationError(
                f'{name!r} is none of {", ".join(known)}{suggestion(name, known)}')
    for option in ('approaches', 'compared', 'workers', 'only', 'seed'):
        value = getattr(arguments, option)
        if value is not None and value < (1 if option in ('approaches', 'workers') else 0):
            raise ConfigurationError(f'--{option} must not be {value}')
    return Campaign(
        tuple((name, arguments.compared if place else arguments.approaches)
              for place, name in enumerate(names)),
        arguments.seed, arguments.kind, arguments.sensor, arguments.required_probability)


def print_summary(campaign: Any, rows: Any, spent: float) -> None:
    """Print what came of the approaches, by kind, and the numbers of those that went wrong."""
    for planner, _ in campaign.parts:
        mine = [row for row in rows if row['planner'] == planner]
        print(f'{planner}: {len(mine)} approaches')
        for kind in sorted({row['kind'] for row in mine}):
            of_kind = [row for row in mine if row['kind'] == kind]
            counts = {}
            for row in of_kind:
                counts[row['outcome']] = counts.get(row['outcome'], 0) + 1
            print(f'  {kind:10} ' + ', '.join(
                f'{count} {name}' for name, count in sorted(counts.items())))
        for outcome in ('fell', 'hit', 'ran away', 'raised'):
            bad = [str(row['number']) for row in mine if row['outcome'] == outcome]
            print(f'  {outcome}: {len(bad)}: {" ".join(bad[:25])}')
    print(f'in {spent:.0f} s')
