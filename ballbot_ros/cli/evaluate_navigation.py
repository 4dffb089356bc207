# SPDX-License-Identifier: Apache-2.0
"""The verb ``evaluate-navigation``: drives to goals in random houses, in closed loop."""
import argparse
import json
from pathlib import Path
from time import perf_counter

from ballbot_ros.cli import options
from ballbot_ros.cli.output import resumable, watched
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import check_choice, count

NAME = 'navigation_evaluation'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_number(parser, '--goals', 'N', count(
        'number of goals with the first planner', default=1000, minimum=1))
    options.add_number(parser, '--compared', 'N', count(
        'number of goals with each other planner', default=200))
    parser.add_argument('--planners', default='run_up,wall,free', metavar='NAME,...',
                        help='run_up, wall (each step is a wall) and free (each step is free '
                        'floor) (default: %(default)s)')
    options.add_number(parser, '--only', 'N', count(
        'drive to goal N only, with the first planner, and print the result', default=None))
    options.add_seed(parser, 'the draw of all houses')
    options.add_workers(parser)
    parser.add_argument('--out', type=Path, default=Path(NAME), metavar='DIR',
                        help='folder for results and report (default: %(default)s)')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.results.files import check_writable, write_text
    from ballbot_ros.studies.navigation.evaluation import (
        NavigationEvaluation, page, PLANNERS, report, run_block, run_evaluation)
    from ballbot_ros.studies.parallel_map import worker_pool
    names = arguments.planners.split(',')
    for name in names:
        check_choice('planner', name, PLANNERS)
    evaluation = NavigationEvaluation(tuple(
        (name, arguments.compared if place else arguments.goals)
        for place, name in enumerate(names)), arguments.seed)
    if arguments.only is not None:
        row, = run_block(evaluation, names[0], arguments.only, arguments.only + 1)
        print(json.dumps(row, indent=1))
        return DONE
    check_writable(arguments.out / f'{NAME}.md')
    start = perf_counter()
    with resumable(arguments.out), \
            worker_pool(arguments.workers, arguments.dask) as (pool, workers):
        if arguments.dask is None:
            # Local workers inherit the kernels that this process has loaded.
            run_block(evaluation, 'wall', 0, 1)
        with watched(evaluation.size, arguments.quiet, 'driving', 'goals') as progress:
            rows = run_evaluation(evaluation, arguments.out, pool, workers, progress)
    figures = report(rows)
    write_text(json.dumps(figures, indent=1), arguments.out / f'{NAME}.json')
    command = (f'ballbot evaluate-navigation --goals {arguments.goals} --compared '
               f'{arguments.compared} --planners {arguments.planners} --seed {arguments.seed}')
    content = page(figures, arguments.seed, command)
    write_text(content, arguments.out / f'{NAME}.md')
    if not arguments.quiet:
        print(content)
        print(f'{arguments.out / NAME}.md and .json written after {perf_counter() - start:.0f} s')
    return DONE
