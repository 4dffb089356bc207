# SPDX-License-Identifier: Apache-2.0
"""The verb ``outcomes``: logged attempts of a robot, and the parameters learned from them."""
import argparse
from pathlib import Path
from shlex import quote
from typing import Any, Optional, Sequence

from ballbot_ros.cli import options
from ballbot_ros.cli.output import check_new_file, watched
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import count
from ballbot_ros.errors import ConfigurationError

ACTIONS = {'list': 'print a line for each attempt',
           'learned': 'print the parameters of the robot before and after learning',
           'export': 'write all values as CSV or JSON',
           'reset': 'start a new log and keep this one as a backup',
           'show-learning': 'show learning on virtual robots that differ from the assumed one'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('action', choices=ACTIONS, help='; '.join(
        f'{name}: {what}' for name, what in ACTIONS.items()))
    parser.add_argument('file', nargs='?', type=Path, metavar='FILE',
                        help='outcome log of obstacle_decision (its parameter outcome_log)')
    options.add_robot(parser)
    parser.add_argument('--out', type=Path, metavar='FILE',
                        help='.csv or .json file that export writes (default: print CSV)')
    options.add_overwrite(parser, file=True)
    options.add_number(parser, '--robots', 'N', count(
        'number of robots of show-learning', default=24, minimum=1))
    options.add_number(parser, '--attempts', 'N', count(
        'attempts of each robot of show-learning', default=20, minimum=1))
    options.add_seed(parser, 'the draw of show-learning')
    options.add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    options.refuse_without(arguments, f'export, not {arguments.action}',
                           arguments.action == 'export', '--out', '--overwrite')
    if arguments.action == 'show-learning':
        return show_learning(arguments)
    if arguments.file is None:
        raise ConfigurationError(
            f'{arguments.action} needs a FILE: the parameter outcome_log of obstacle_decision '
            'names the log of the robot', 'missing', 'FILE')
    from ballbot_ros.config.files import check_file
    check_file(arguments.file, 'outcome log', 'FILE')
    if arguments.action == 'reset':
        return reset(arguments.file, arguments.quiet)
    outcomes = read(arguments.file)
    if arguments.action == 'export':
        return export(outcomes, arguments.out, arguments.overwrite)
    if arguments.action == 'learned':
        return print_learned(outcomes, options.read_robot(arguments))
    print_table(outcomes)
    return DONE


def read(path: Path) -> Sequence[Any]:
    """Return the outcomes of a log; raise `ConfigurationError` if it is refused."""
    from ballbot_ros.decision.learning.outcome_log import read_outcomes
    reading = read_outcomes(path)
    if reading.refusal:
        raise ConfigurationError(
            f'{reading.refusal}; "ballbot outcomes reset {quote(str(path))}" starts a new log and '
            'keeps this one', 'unreadable', 'FILE')
    return reading.outcomes


def print_table(outcomes: Sequence[Any]) -> None:
    """Print a row for each outcome, and the number of crossings."""
    from ballbot_ros.table import table
    rows = [('time', 'result', 'height', 'contact at', 'past at', 'predicted', 'plan')]
    for item in outcomes:
        rows.append((
            f'{item.stamp:.2f} s', item.result, f'{1e3 * item.height:.1f} mm',
            f'{item.touch_speed:.2f} m/s',
            '-' if item.passed_speed is None else f'{item.passed_speed:.2f} m/s',
            '-' if item.probability is None else f'{item.probability:.2f}',
            '-' if item.plan is None else item.plan.strategy.value))
    print(table(rows))
    over = sum(item.crossed for item in outcomes)
    print(f'{len(outcomes)} outcome{"s" * (len(outcomes) != 1)}, of which {over} crossed')


def export(outcomes: Sequence[Any], out: Optional[Path], overwrite: bool) -> int:
    """Write all numbers to a file, or as CSV to the terminal."""
    from ballbot_ros.results.files import write_json, write_text
    rows = [_flat(item) for item in outcomes]
    if out is None:
        print(_csv(rows), end='')
        return DONE
    check_new_file(out, overwrite, endings=('.csv', '.json'))
    if out.suffix.lower() == '.csv':
        write_text(_csv(rows), out)
    else:
        write_json(rows, out)
    return DONE


def _flat(outcome: Any) -> dict[str, Any]:
    """Return the values of an outcome and its plan by name; non-finite values as text."""
    from dataclasses import asdict
    import math
    values = asdict(outcome)
    plan = values.pop('plan') or {}
    values.update({f'plan.{name}': value for name, value in plan.items()})
    return {name: str(value) if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in values.items()}


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    import csv
    from io import StringIO
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = StringIO()
    writer = csv.DictWriter(text, names, lineterminator='\n')
    writer.writeheader()
    writer.writerows({name: getattr(value, 'value', value) for name, value in row.items()}
                     for row in rows)
    return text.getvalue()


def reset(path: Path, quiet: bool) -> int:
    """Rename a log to an unused name."""
    from ballbot_ros.decision.learning.outcome_log import move_away
    number = 1
    while (backup := path.with_name(f'{path.name}.{number}')).exists():
        number += 1
    move_away(path, backup)
    if not quiet:
        print(f'kept as {backup}; the next outcome starts a new log')
    return DONE


def print_learned(outcomes: Sequence[Any], robot: Any) -> int:
    """Print the assumed and the learned mean and deviation of each uncertain parameter."""
    from ballbot_ros.decision.learning.learner import learned
    from ballbot_ros.decision.learning.particles import Particles
    from ballbot_ros.decision.tuning import DecisionTuning
    from ballbot_ros.table import table
    foreign = [item for item in outcomes if item.robot != robot.digest]
    if foreign:
        raise ConfigurationError(
            f'the log is of a robot (digest {foreign[0].robot}) other than {robot.name} '
            f'({robot.digest}); name its file with --robot', 'inconsistent', '--robot')
    before = Particles.of(robot, DecisionTuning().height_bias_sd)
    after = learned(before, outcomes)
    print(table([('parameter', 'assumed', f'outcomes: {after.outcomes}'), *(
        (name, *(f'{item.mean(name):.4f} +- {item.deviation(name):.4f}'
                 for item in (before, after))) for name in before.names)]))
    return DONE


def show_learning(arguments: argparse.Namespace) -> int:
    """Print the predicted and observed success rates before and after learning."""
    from ballbot_ros.studies.learning import CASES, study, report_lines
    robot = options.read_robot(arguments)
    with watched(len(CASES) * arguments.robots, arguments.quiet, 'learning',
                 'robots', keeps=False) as progress:
        found = study(robot, arguments.robots, arguments.attempts, arguments.seed,
                      progress=progress)
    print('\n'.join(report_lines(found, arguments.attempts)))
    return DONE
