# SPDX-License-Identifier: Apache-2.0
"""The verb ``compare-models``: where simpler models suffice, and the cost of each."""
import argparse
import math
from typing import Any

from ballbot_ros.cli.options import add_number, add_robot, read_robot, refuse_without
from ballbot_ros.cli.output import print_json, watched
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import quantity


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot(parser)
    parser.add_argument('--actuation', choices=('free', 'held'), default='free',
                        help='state of the pendulum: free, or held at --angle-deg '
                        '(default: %(default)s)')
    add_number(parser, '--angle-deg', 'DEGREES', quantity(
        'degrees', 'angle at which the pendulum is held: 0 down, 90 horizontal ahead (default: 0)',
        minimum=-180.0, maximum=180.0, optional=True))
    parser.add_argument('--json', action='store_true', help='print all heights as JSON')


def run(arguments: argparse.Namespace) -> int:
    refuse_without(arguments, '--actuation held', arguments.actuation == 'held', '--angle-deg')
    angle = arguments.angle_deg or 0.0
    robot = read_robot(arguments)
    from ballbot_ros.paper.cases import Case, holding, SPEEDS
    from ballbot_ros.paper.comparison import compare, count_heights
    case = holding(robot, math.radians(angle)) if arguments.actuation == 'held' \
        else Case(robot)
    case.actuation.actuator(robot)  # refuses an actuation that this robot does not support
    with watched(count_heights(case, len(SPEEDS)), arguments.json, 'computing',
                 'heights', keeps=False) as progress:
        found = compare(case, SPEEDS, progress)
    if arguments.json:
        print_json({'speeds': found.speeds.tolist(), 'models': [
            {'name': curve.name, 'source': curve.source, 'heights': curve.heights.tolist(),
             'cost': curve.cost} for curve in (found.full, *found.others)]})
    else:
        what = f'held at {angle:g} degrees' if case.held else 'free'
        print_table(found, f'{robot.name}, pendulum {what}' if robot.has_pendulum
                    else robot.name)
    return DONE


def print_table(found: Any, title: str) -> None:
    from ballbot_ros.paper.cases import ACCURACY
    from ballbot_ros.paper.comparison import DEVIATION_LEVELS, spans
    from ballbot_ros.table import table
    print(f'{title}: {len(found.speeds)} speeds from {found.speeds[0]:g} to '
          f'{found.speeds[-1]:g} m/s, full model to {1e3 * ACCURACY:g} mm\n')
    levels = (f'within {1e3 * level:g} mm at m/s' for level in DEVIATION_LEVELS)
    rows = [('model', 'source', *levels, 'largest deviation', 'cost of a height')]
    for curve in (found.full, *found.others):
        away = curve.heights - found.full.heights
        ranges = (spans(found.speeds, abs(away) <= level) for level in DEVIATION_LEVELS)
        worst = away[abs(away).argmax()]
        rows.append((curve.name, curve.source, *(', '.join(
            f'{low:.3g}' if low == high else f'{low:.3g} to {high:.3g}' for low, high in found_at)
            or 'none' for found_at in ranges),
            f'{1e3 * worst:+.1f} mm', f'{1e6 * curve.cost:.3g} us' if curve.cost < 1e-3
            else f'{1e3 * curve.cost:.3g} ms'))
    print(table(rows))
