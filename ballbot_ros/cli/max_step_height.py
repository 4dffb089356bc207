# SPDX-License-Identifier: Apache-2.0
"""The verb ``max-step-height``: how high a step the ball gets over, at one speed or many."""
import argparse
import math
from typing import List

from ballbot_ros.cli import options
from ballbot_ros.cli.command import DONE
from ballbot_ros.cli.output import print_json
from ballbot_ros.errors import ConfigurationError

MOST_SPEEDS = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add robot, speeds, actuation, ground and accuracy."""
    options.add_robot(parser)
    parser.add_argument('--speed', nargs='+', required=True, metavar='M/S',
                        help='of the centre when it touches the step: one, several, or ranges '
                        'such as 0.2:1.2:0.05 (first:last:stride)')
    options.add_actuation(parser)
    options.add_site(parser)
    options.add_attempts(parser)
    options.add_accuracy(parser, 5e-5, 'the height')
    parser.add_argument('--scan', type=int, default=24, metavar='N',
                        help='look at N heights on each side whether every lower step is '
                        'passed and no higher one; 0 not to (default: %(default)s)')
    parser.add_argument('--json', action='store_true',
                        help='print a list of objects with speed, height, error (SI)')


def run(arguments: argparse.Namespace) -> int:
    """Search and print."""
    speeds = read_speeds(arguments.speed)
    robot = options.read_robot(arguments)
    from ballbot_ros.crossing import actuation_for, max_step_heights
    found = max_step_heights(
        robot, speeds, actuation_for(robot, options.read_law(arguments)), scan=arguments.scan,
        accuracy=arguments.accuracy, site=options.read_site(arguments),
        rules=options.read_rules(arguments))
    if arguments.json:
        print_json([item._asdict() for item in found])
        return DONE
    print(f'{"speed":>8} {"highest step":>14} {"error":>10}')
    print(f'{"m/s":>8} {"mm":>14} {"mm":>10}')
    for item in found:
        doubts = []
        if item.monotone is False:
            doubts.append('not monotone: a lower step stops it, or it gets over a higher one')
        if item.error > arguments.accuracy:
            doubts.append('the accuracy asked for is out of reach')
        print(f'{item.speed:8.4g} {1e3 * item.height:14.4f} {1e3 * item.error:10.4f}   '
              f'{"; ".join(doubts)}'.rstrip())
    return DONE


def read_speeds(words: List[str]) -> List[float]:
    """
    Return the speeds that words such as ``0.5`` and ``0.2:1.2:0.05`` stand for [m/s].

    Raises
    ------
    ConfigurationError
        Naming the word and what is allowed.

    """
    speeds: List[float] = []
    for word in words:
        try:
            numbers = [float(part) for part in word.split(':')]
        except ValueError:
            numbers = []
        if len(numbers) not in (1, 3) or not all(math.isfinite(number) for number in numbers):
            raise ConfigurationError(
                f'--speed must be a number or first:last:stride [m/s], got {word!r}')
        if len(numbers) == 1:
            speeds.append(numbers[0])
            continue
        first, last, stride = numbers
        if not (stride > 0.0 and first <= last and (last - first) / stride < MOST_SPEEDS):
            raise ConfigurationError(
                f'--speed {word}: the stride must be above 0, the last not below the first, and '
                f'there must be at most {MOST_SPEEDS} speeds')
        # Rounded: 0.2 + 2 x 0.05 is to be 0.3.
        speeds += [round(first + number * stride, 12)
                   for number in range(int((last - first) / stride + 1e-9) + 1)]
    return speeds
