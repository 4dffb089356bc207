# SPDX-License-Identifier: Apache-2.0
"""The verb ``evaluate-decision``: evaluate the obstacle decision in closed loop."""
import argparse
from dataclasses import replace
import json
from pathlib import Path
from time import perf_counter
from typing import Any, Tuple

from ballbot_ros.cli import options
from ballbot_ros.cli.output import resumable, save_figure, watched
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import check_choice, count, quantity

NAME = 'decision_evaluation'  # of report and picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_number(parser, '--approaches', 'N', count(
        'number of approaches with the first planner', default=5000, minimum=1))
    options.add_number(parser, '--compared', 'N', count(
        'number of approaches with each other planner', default=1000))
    parser.add_argument('--planners', default=None, metavar='NAME,...',
                        help='planners to compare; targets apply to the first (default: all)')
    options.add_seed(parser, 'the draw of all approaches')
    options.add_workers(parser)
    parser.add_argument('--out', type=Path, default=Path('decision_evaluation'),
                        metavar='DIR', help='folder for results and report (default: %(default)s)')
    parser.add_argument('--kind', metavar='NAME',
                        help='use this kind of terrain for all approaches (default: all kinds)')
    parser.add_argument('--sensor', choices=('step', 'terrain', 'camera'),
                        help='use this sensor for all approaches whose terrain it can detect '
                        '(default: all three)')
    options.add_number(parser, '--searched', 'N', count(
        'number of approaches of the first planner for which crossings are searched for with the '
        'true robot', default=200))
    options.add_number(parser, '--crossable', 'N', count(
        'number of approaches with each planner to steps that most robots cross', default=160))
    options.add_number(parser, '--only', 'N', count(
        'run approach N only, and print its decisions with reasons; with --crossable 1, approach '
        'N to the steps that most robots cross', default=None))
    options.add_number(parser, '--every', 'SECONDS', quantity(
        's', 'longest simulated time between two lines of --only', default=0.5, above=0.0))
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    evaluation = read_evaluation(arguments)
    from ballbot_ros.decision import nominal_knowledge
    from ballbot_ros.decision.decider import warm_up
    from ballbot_ros.results.files import check_writable
    from ballbot_ros.studies.evaluation.evaluation import run_block, run_evaluation
    from ballbot_ros.studies.parallel_map import worker_pool
    if arguments.only is None:
        check_writable(arguments.out / f'{NAME}.md')
    start = perf_counter()
    with resumable(arguments.out), \
            worker_pool(arguments.workers, arguments.dask) as (pool, workers):
        if arguments.dask is None:
            # Local workers inherit the kernels that this process has loaded.
            warm_up(nominal_knowledge(), 'rollout')
            run_block(evaluation, evaluation.parts[0][0], 'drawn', 0, 1, False)
        evaluation = with_limits(arguments, evaluation, pool, workers)
        if arguments.only is not None:
            print_one(arguments, evaluation)
            return DONE
        with watched(evaluation.size, arguments.quiet, 'evaluating', 'approaches') as progress:
            rows = run_evaluation(evaluation, arguments.out, pool, workers, progress)
    write(arguments, evaluation, rows, perf_counter() - start)
    return DONE


def with_limits(arguments: argparse.Namespace, evaluation: Any, pool: Any,
                workers: int) -> Any:
    """Return the evaluation with the limits of its crossable steps, if it has such steps."""
    if not any(group == 'crossable' and count for _, group, count in evaluation.parts) or (
            arguments.only is not None and arguments.crossable != 1):
        return evaluation
    from ballbot_ros.decision import nominal_knowledge
    from ballbot_ros.studies.evaluation.search import KNOTS, limits_of_most
    with watched(len(KNOTS), arguments.quiet, 'searching for the limits of most robots:',
                 'run-ups', keeps=False) as progress:
        nominal = nominal_knowledge()
        return replace(evaluation, limits=limits_of_most(
            nominal.robot, nominal.control, arguments.out, pool, workers, progress))


def print_one(arguments: argparse.Namespace, evaluation: Any) -> None:
    """Print one approach with its decisions, for each planner."""
    from ballbot_ros.decision import nominal_knowledge
    from ballbot_ros.studies.evaluation.run import run_with_log
    group = 'crossable' if arguments.crossable == 1 else 'drawn'
    approach = evaluation.approach(group, arguments.only)
    for planner in dict.fromkeys(planner for planner, _, _ in evaluation.parts):
        lines, _ = run_with_log(approach, planner, nominal_knowledge(), arguments.every)
        print('\n'.join([f'planner {planner}', *lines]))


def write(arguments: argparse.Namespace, run_of: Any, rows: Any,
          spent: float) -> None:
    """Write report and figure, and print a summary."""
    from ballbot_ros.figures.evaluation import evaluation
    from ballbot_ros.results.files import write_text
    from ballbot_ros.studies.evaluation.page import page, summary
    from ballbot_ros.studies.evaluation.report import report
    counted = report(run_of, rows)
    write_text(json.dumps(counted, indent=1), arguments.out / f'{NAME}.json')
    values = {name: getattr(arguments, name) for name in (
        'approaches', 'compared', 'crossable', 'searched', 'seed', 'planners', 'kind', 'sensor')}
    command = ' '.join(['ballbot evaluate-decision', *(
        f'--{name} {value}' for name, value in values.items() if value is not None)])
    write_text(page(counted, command), arguments.out / f'{NAME}.md')
    save_figure(evaluation(counted), arguments.out / 'figures', NAME, 'png')
    if not arguments.quiet:
        print(summary(counted))
        print(f'{arguments.out / NAME}.md, .json and figures/{NAME}.png written after '
              f'{spent:.0f} s')


def read_evaluation(arguments: argparse.Namespace) -> Any:
    """Return the evaluation; raise `ConfigurationError` for unknown names."""
    from ballbot_ros.decision import PLANNERS
    from ballbot_ros.studies.evaluation.baselines import BASELINES
    from ballbot_ros.studies.evaluation.evaluation import Evaluation
    from ballbot_ros.studies.evaluation.terrains import KINDS
    planners = [*reversed(list(PLANNERS)), *BASELINES]
    names: Tuple[str, ...] = tuple(
        arguments.planners.split(',') if arguments.planners else planners)
    for name in names:
        check_choice('planner', name, planners)
    if arguments.kind is not None:
        check_choice('kind', arguments.kind, KINDS)
    parts = [(name, 'drawn', arguments.compared if place else arguments.approaches)
             for place, name in enumerate(names)]
    # The crossable steps come early: they are few.
    parts[1:1] = [(name, 'crossable', arguments.crossable) for name in names]
    return Evaluation(tuple(parts), arguments.seed, arguments.kind, arguments.sensor,
                      searched=arguments.searched)
