# SPDX-License-Identifier: Apache-2.0
"""The verb ``max-step-height``: how high a step the ball gets over, at one speed or many."""
import argparse
import math
import sys
from typing import Any, List

from ballbot_ros.cli.command import DONE
from ballbot_ros.errors import ConfigurationError

LAWS = ('free', 'held', 'velocity', 'voltage')
MOST_SPEEDS = 10_000
STEEPEST = 80.0  # slope [degrees]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add robot, speeds, actuation, ground and accuracy."""
    parser.add_argument('--robot', default='gimball', metavar='NAME',
                        help='name of a robot or a YAML file (default: %(default)s)')
    parser.add_argument('--speed', nargs='+', required=True, metavar='M/S',
                        help='of the centre when it touches the step: one, several, or ranges '
                        'such as 0.2:1.2:0.05 (first:last:stride)')
    add_drive(parser)
    add_site(parser)
    parser.add_argument('--accuracy', type=float, default=5e-5, metavar='METRES',
                        help='largest error of the height (default: %(default)s)')
    parser.add_argument('--scan', type=int, default=24, metavar='N',
                        help='look at N heights on each side whether every lower step is '
                        'passed and no higher one; 0 not to (default: %(default)s)')
    parser.add_argument('--json', action='store_true',
                        help='print a list of objects with speed, height, error (SI)')


def add_drive(parser: argparse.ArgumentParser) -> None:
    """Add what the motor does."""
    parser.add_argument('--actuation', choices=LAWS, default='free',
                        help='free; held at --angle by law (11); velocity law (12); open-loop '
                        'voltage (default: %(default)s)')
    parser.add_argument('--angle', type=float, metavar='DEGREES',
                        help='of the held pendulum, 0 down, 90 level ahead (default: 0)')
    parser.add_argument('--voltage', type=float, metavar='VOLTS',
                        help='on the motor (default: what rolls the ball at each speed)')


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add the ground, and which attempts count."""
    for where in ('before', 'behind'):
        parser.add_argument(f'--slope-{where}', type=float, default=0.0, metavar='DEGREES',
                            help=f'of the ground {where} the step, positive uphill')
    for where, what in (('before', 'of the ground before the step'), ('edge', 'of the edge'),
                        ('behind', 'of the ground behind the step')):
        parser.add_argument(f'--friction-{where}', type=float, metavar='MU',
                            help=f"coefficient {what} (default: the robot's)")
    add_attempts(parser)


def add_attempts(parser: argparse.ArgumentParser) -> None:
    """Add which attempts count."""
    parser.add_argument('--attempts', choices=('first', 'any'), default='first',
                        help='which count: the first, or any within 5 s (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Search and print."""
    speeds = read_speeds(arguments.speed)
    from ballbot_ros.cli.listing import check_name
    check_name('robots', arguments.robot)
    from ballbot_ros.crossing import max_step_heights
    from ballbot_ros.physics import load_robot
    robot = load_robot(arguments.robot)
    found = max_step_heights(
        robot, speeds, read_drive(arguments, robot), accuracy=arguments.accuracy,
        site=read_site(arguments), rules=read_rules(arguments), scan=arguments.scan)
    if arguments.json:
        import json
        json.dump([item._asdict() for item in found], sys.stdout, indent=2, allow_nan=False)
        print()
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


def read_drive(arguments: argparse.Namespace, robot: Any) -> Any:
    """
    Return a function from speed to actuation.

    Raises
    ------
    ConfigurationError
        For an angle or a voltage that does not belong to the law.

    """
    from ballbot_ros.crossing import drive_for
    return drive_for(robot, read_law(arguments))


def read_law(arguments: argparse.Namespace) -> Any:
    """
    Return the actuation, without what follows the speed.

    Raises
    ------
    ConfigurationError
        For an angle or a voltage that does not belong to the law.

    """
    from ballbot_ros.crossing import held_at
    from ballbot_ros.physics import Actuation
    law = arguments.actuation
    for option, owner in (('angle', 'held'), ('voltage', 'voltage')):
        if getattr(arguments, option) is not None and law != owner:
            raise ConfigurationError(f'--{option} goes with --actuation {owner}, not {law}')
    if law == 'held':
        return held_at(math.radians(arguments.angle or 0.0))
    if law == 'voltage':
        return Actuation(law, voltage=arguments.voltage or 0.0)
    return Actuation(law)


def read_site(arguments: argparse.Namespace) -> Any:
    """
    Return the ground around the step.

    Raises
    ------
    ConfigurationError
        For a slope or a friction out of range.

    """
    from ballbot_ros.crossing import Site
    for option in ('slope_before', 'slope_behind'):
        angle = getattr(arguments, option)
        if not abs(angle) <= STEEPEST:
            raise ConfigurationError(
                f'--{option.replace("_", "-")} must be at least -{STEEPEST:g} and at most '
                f'{STEEPEST:g} degrees, got {angle:g}')
    return Site(math.radians(arguments.slope_before), math.radians(arguments.slope_behind),
                arguments.friction_before, arguments.friction_edge, arguments.friction_behind)


def read_rules(arguments: argparse.Namespace) -> Any:
    """Return which attempts count."""
    from ballbot_ros.crossing import Rules
    return Rules(arguments.attempts)
