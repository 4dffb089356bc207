# SPDX-License-Identifier: Apache-2.0
"""The verb ``evaluate-decision``: prove the obstacle decision in closed loop."""
import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
import json
import multiprocessing
import os
from pathlib import Path
from time import perf_counter
from typing import Any, List, Tuple

from ballbot_ros.cli import options
from ballbot_ros.cli.command import DONE, INTERRUPTED, print_error
from ballbot_ros.cli.output import save_figure
from ballbot_ros.cli.sweep import follow
from ballbot_ros.errors import ConfigurationError

NAME = 'decision_evaluation'  # of report and picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which approaches, which planners, where to write."""
    parser.add_argument('--approaches', type=int, default=5000, metavar='N',
                        help='number of approaches with the first planner (default: %(default)s)')
    parser.add_argument('--compared', type=int, default=1000, metavar='N',
                        help='number of approaches with each other planner (default: %(default)s)')
    parser.add_argument('--planners', default=None, metavar='NAME,...',
                        help='planners to compare; the first is the one to be proven (default: '
                        'all)')
    parser.add_argument('--seed', type=int, default=0, metavar='N',
                        help='seed of the draw of all approaches (default: %(default)s)')
    parser.add_argument('--workers', type=int, default=None, metavar='N',
                        help='number of processes (default: one per core)')
    parser.add_argument('--out', type=Path, default=Path('decision_evaluation'),
                        metavar='DIR', help='folder for results and report (default: %(default)s)')
    parser.add_argument('--kind', metavar='NAME',
                        help='use this kind of ground for all approaches (default: all kinds)')
    parser.add_argument('--sensor', choices=('step', 'terrain'),
                        help='use this sensor for all approaches (default: both)')
    parser.add_argument('--required-probability', type=float, metavar='P',
                        help='probability of getting over that a crossing requires, instead of '
                        'the one in the decision tuning')
    parser.add_argument('--searched', type=int, default=1000, metavar='N',
                        help='number of approaches in which a way is looked for over what the '
                        'first planner did not cross (default: %(default)s)')
    parser.add_argument('--crossable', type=int, default=160, metavar='N',
                        help='number of approaches with each planner to steps that most robots '
                        'cross (default: %(default)s)')
    parser.add_argument('--only', type=int, metavar='N',
                        help='run approach N alone, and say what was decided when and why; with '
                        '--crossable 1, approach N to the steps that most robots cross')
    parser.add_argument('--every', type=float, default=0.5, metavar='SECONDS',
                        help='longest simulated time between two lines of --only (default: '
                        '%(default)s)')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the approaches, or one of them, and say what came of them."""
    campaign = read_campaign(arguments)
    from ballbot_ros.results.files import check_writable
    from ballbot_ros.studies.evaluation.campaign import FILE
    if arguments.only is None:
        check_writable(arguments.out / FILE)
    begin = perf_counter()
    number = arguments.workers or os.cpu_count() or 1
    pool = ProcessPoolExecutor(
        number, multiprocessing.get_context('fork'), follow, (os.getpid(),))
    try:
        if arguments.only is not None:
            show(arguments, campaign, pool)
            return DONE
        rows = run_all(arguments, campaign, pool, number)
    except KeyboardInterrupt:
        print_error(f'interrupted; the same command goes on with what is in {arguments.out}')
        return INTERRUPTED
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    write(arguments, campaign, rows, perf_counter() - begin)
    return DONE


def limits_for(arguments: argparse.Namespace, campaign: Any, pool: Any) -> Any:
    """Return the campaign with what it has to know for the crossable steps, if it has any."""
    if not any(group == 'crossable' and count for _, group, count in campaign.parts):
        return campaign
    from ballbot_ros.cli.progress import watched
    from ballbot_ros.studies.evaluation.crossable import limits_of_most
    believer = campaign.believer()
    with watched(1.0, arguments.quiet, 'searching what most robots cross:', 'in all',
                 keeps=False) as progress:
        return replace(campaign, limits=limits_of_most(
            *believer.names, arguments.out, pool, progress))


def show(arguments: argparse.Namespace, campaign: Any, pool: Any) -> None:
    """Print one approach with its decisions, for each planner."""
    from ballbot_ros.studies.evaluation.replay import replay
    group = 'crossable' if arguments.crossable == 1 else 'drawn'
    if group == 'crossable':
        campaign = limits_for(arguments, campaign, pool)
    for planner in dict.fromkeys(planner for planner, _, _ in campaign.parts):
        lines, _ = replay(campaign, planner, group, arguments.only, arguments.every)
        print('\n'.join([f'planner {planner}', *lines]))


def run_all(arguments: argparse.Namespace, campaign: Any, pool: Any, number: int) -> Any:
    """Run all approaches and return their rows."""
    from ballbot_ros.cli.progress import watched
    from ballbot_ros.studies.evaluation.campaign import run_campaign
    campaign = limits_for(arguments, campaign, pool)
    with watched(campaign.size, arguments.quiet, 'evaluating', 'approaches') as progress:
        return run_campaign(campaign, arguments.out, pool, number, progress)


def write(arguments: argparse.Namespace, campaign: Any, rows: Any, spent: float) -> None:
    """Write report and picture, and print what matters most."""
    from ballbot_ros.figures.evaluation import evaluation
    from ballbot_ros.results.files import write_text
    from ballbot_ros.studies.evaluation.page import page, summary
    from ballbot_ros.studies.evaluation.report import report
    counted = report(campaign, rows)
    write_text(json.dumps(counted, indent=1), arguments.out / f'{NAME}.json')
    command = ' '.join(['ballbot evaluate-decision', *spoken(arguments)])
    write_text(page(counted, command), arguments.out / f'{NAME}.md')
    save_figure(evaluation(counted), arguments.out / 'figures', NAME, 'png')
    if not arguments.quiet:
        print(summary(counted))
        print(f'{arguments.out / NAME}.md, .json and figures/{NAME}.png written after '
              f'{spent:.0f} s')


def spoken(arguments: argparse.Namespace) -> List[str]:
    """Return the options that decide what is run, as they are typed."""
    return [f'--{name} {getattr(arguments, name.replace("-", "_"))}' for name in (
        'approaches', 'compared', 'crossable', 'searched', 'seed', 'planners', 'kind', 'sensor',
        'required-probability') if getattr(arguments, name.replace('-', '_')) is not None]


def read_campaign(arguments: argparse.Namespace) -> Any:
    """Return what is to be run; `ConfigurationError` for what there is not."""
    from ballbot_ros.config.fields import suggestion
    from ballbot_ros.decision import PLANNERS
    from ballbot_ros.studies.evaluation.campaign import Campaign
    from ballbot_ros.studies.evaluation.grounds import KINDS
    from ballbot_ros.studies.evaluation.rules import RULES
    planners = [*reversed(list(PLANNERS)), *RULES]
    names: Tuple[str, ...] = tuple(
        arguments.planners.split(',') if arguments.planners else planners)
    for name, known in [(name, planners) for name in names] + (
            [(arguments.kind, list(KINDS))] if arguments.kind is not None else []):
        if name not in known:
            raise ConfigurationError(
                f'{name!r} is none of {", ".join(known)}{suggestion(name, known)}')
    for option in ('approaches', 'compared', 'crossable', 'searched', 'workers', 'only',
                   'seed'):
        value = getattr(arguments, option)
        if value is not None and value < (1 if option in ('approaches', 'workers') else 0):
            raise ConfigurationError(f'--{option} must not be {value}')
    parts = [(name, 'drawn', arguments.compared if place else arguments.approaches)
             for place, name in enumerate(names)]
    # The crossable steps come early: they are few.
    parts[1:1] = [(name, 'crossable', arguments.crossable) for name in names]
    return Campaign(tuple(parts), arguments.seed, arguments.kind, arguments.sensor,
                    arguments.required_probability, (), arguments.searched)
