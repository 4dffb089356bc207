# SPDX-License-Identifier: Apache-2.0
"""The verb ``max-step-height``: the maximum step height at one or many speeds."""
import argparse

from ballbot_ros.cli import options
from ballbot_ros.cli.options import METAVAR, read_numbers, VALUES_HELP
from ballbot_ros.cli.output import print_json
from ballbot_ros.cli.verb import DONE

# Fields of `MaxStepHeight` -> columns of all results; "height" is the height of a tried step.
COLUMNS = {'height': 'max_height'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_robot(parser)
    parser.add_argument('--speed', nargs='+', required=True, metavar=METAVAR,
                        help=f'collision speed, of the centre [m/s]: {VALUES_HELP}')
    options.add_actuation(parser)
    options.add_site(parser)
    options.add_rules(parser)
    options.add_accuracy(parser, 5e-5, 'the height')
    parser.add_argument('--scan', type=int, default=24, metavar='N',
                        help='number of heights to try below and above the result, to check that '
                        'the ball crosses every lower step and no higher one; 0 for none '
                        '(default: %(default)s)')
    parser.add_argument('--json', action='store_true',
                        help='print a JSON list of objects with speed, max_height, error (SI '
                        'units)')


def run(arguments: argparse.Namespace) -> int:
    speeds = read_numbers(arguments.speed, '--speed')
    robot = options.read_robot(arguments)
    options.warn_speeds('--speed', speeds)
    from ballbot_ros.crossing import actuation_for, max_step_heights
    from ballbot_ros.table import table
    found = max_step_heights(
        robot, speeds, actuation_for(robot, options.read_law(arguments)), scan=arguments.scan,
        accuracy=arguments.accuracy, site=options.read_site(arguments),
        rules=options.read_rules(arguments))
    if arguments.json:
        print_json([{COLUMNS.get(name, name): value for name, value in item._asdict().items()}
                    for item in found])
        return DONE
    rows = [('speed m/s', 'max. height mm', 'error mm', '')]
    for item in found:
        warnings = []
        if item.monotone is False:
            warnings.append('not monotone: the ball fails at a lower step or crosses a higher one')
        if item.error > arguments.accuracy:
            warnings.append('the requested accuracy cannot be achieved')
        rows.append((f'{item.speed:.4g}', f'{1e3 * item.height:.4f}', f'{1e3 * item.error:.4f}',
                     '; '.join(warnings)))
    print(table(rows))
    return DONE
