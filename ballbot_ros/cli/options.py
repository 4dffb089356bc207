# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, and the values that they stand for."""
import argparse
import math
import sys
from typing import Any, Iterable

from ballbot_ros.errors import ConfigurationError

LAWS = ('free', 'held', 'velocity', 'voltage')
STEEPEST = 80.0  # slope [degrees]


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add the robot; `read_robot` loads it."""
    parser.add_argument('--robot', default='gimball', metavar='NAME',
                        help='name of a robot or a YAML file (default: %(default)s)')


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """Add whether to print."""
    parser.add_argument('--quiet', action='store_true', help='print errors only')


def add_port(parser: argparse.ArgumentParser) -> None:
    """Add where the drive is."""
    parser.add_argument('--port', default='', metavar='PORT',
                        help='serial device, URL or CAN interface to use instead of the one in '
                        'the hardware file')


def add_overwrite(parser: argparse.ArgumentParser, file: bool = False) -> None:
    """Add whether results, a folder of them or one file, may be replaced."""
    parser.add_argument('--overwrite', action='store_true', help=(
        'replace the file if there is one' if file else
        'replace results that are there; without it a new folder is taken, and an --out with '
        'results in it is refused'))


def add_format(parser: argparse.ArgumentParser) -> None:
    """Add the format of figures."""
    parser.add_argument('--format', choices=('svg', 'png', 'both'), default='both',
                        help='format of the figures (default: %(default)s)')


def add_accuracy(parser: argparse.ArgumentParser, default: float, what: str) -> None:
    """Add the largest error of a height."""
    parser.add_argument('--accuracy', type=float, default=default, metavar='METRES',
                        help=f'largest error of {what} (default: %(default)s)')


def add_actuation(parser: argparse.ArgumentParser) -> None:
    """Add what the motor does; `read_law` returns it."""
    parser.add_argument('--actuation', choices=LAWS, default='free',
                        help='what the motor does: free, no torque; held, law (11) holds the '
                        'pendulum at --angle-deg; velocity, law (12) keeps the speed; voltage, '
                        'constant at --voltage (default: %(default)s)')
    parser.add_argument('--angle-deg', type=float, metavar='DEGREES',
                        help='angle at which the pendulum is held: 0 down, 90 level ahead '
                        '(default: 0)')
    parser.add_argument('--voltage', type=float, metavar='VOLTS',
                        help='voltage on the motor (default: the one that rolls the ball at each '
                        'speed)')


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add the ground around the step; `read_site` returns it."""
    for where in ('before', 'behind'):
        parser.add_argument(f'--slope-{where}-deg', type=float, default=0.0, metavar='DEGREES',
                            help=f'slope of the ground {where} the step, positive uphill '
                            '(default: %(default)g)')
    for where, what in (('before', 'of the ground before the step'), ('edge', 'of the edge'),
                        ('behind', 'of the ground behind the step')):
        parser.add_argument(f'--friction-{where}', type=float, metavar='MU',
                            help=f"coefficient of friction {what} (default: the robot's)")


def add_rules(parser: argparse.ArgumentParser, over: str = 'edge') -> None:
    """Add which attempts count, and where the ball is over; `read_rules` returns them."""
    parser.add_argument('--attempts', choices=('first', 'any'), default='first',
                        help='which attempt counts: the first, or any within 5 s (default: '
                        '%(default)s)')
    parser.add_argument('--over', choices=('edge', 'clear'), default=over,
                        help='what counts as over: the centre past the edge, or clear of the edge '
                        'by --clearance (default: %(default)s)')
    parser.add_argument('--clearance', type=float, metavar='RADII',
                        help='how far the centre must get beyond the edge with --over clear, in '
                        'radii of the ball (default: 0.25)')


def read_robot(arguments: argparse.Namespace) -> Any:
    """Return the robot; `ConfigurationError` names the nearest one, or what is wrong in it."""
    from ballbot_ros.physics import load_robot
    return load_robot(arguments.robot)


def warn(arguments: argparse.Namespace, questions: Iterable[str]) -> None:
    """Print what was hardly meant on standard error, unless it is to be quiet."""
    for question in () if getattr(arguments, 'quiet', False) else questions:
        print(f'Warning: {question}', file=sys.stderr, flush=True)


def warn_speeds(arguments: argparse.Namespace, option: str, speeds: Iterable[float]) -> None:
    """Question the fastest of several speeds [m/s]."""
    from ballbot_ros.results.plausibility import speed_warnings
    warn(arguments, speed_warnings(max(speeds, key=abs), option))


def read_law(arguments: argparse.Namespace) -> Any:
    """Return the actuation; `ConfigurationError` where angle or voltage is not of the law."""
    from ballbot_ros.crossing import held_at
    from ballbot_ros.physics import Actuation
    law = arguments.actuation
    for option, owner in (('angle_deg', 'held'), ('voltage', 'voltage')):
        if getattr(arguments, option) is not None and law != owner:
            raise ConfigurationError(
                f'--{option.replace("_", "-")} goes with --actuation {owner}, not {law}',
                'inconsistent', f'--{option.replace("_", "-")}')
    if law == 'held':
        angle = arguments.angle_deg or 0.0
        if not abs(angle) <= 180.0:
            raise ConfigurationError(
                f'--angle-deg must be at least -180 and at most 180 degrees, got {angle:g}',
                'out_of_range', '--angle-deg')
        from ballbot_ros.results.plausibility import angle_warnings
        warn(arguments, angle_warnings(angle))
        return held_at(math.radians(angle))
    if law == 'voltage':
        return Actuation(law, voltage=arguments.voltage or 0.0)
    return Actuation(law)


def read_site(arguments: argparse.Namespace) -> Any:
    """Return the ground; `ConfigurationError` for a slope or a friction out of range."""
    from ballbot_ros.crossing import Site
    for option in ('slope_before_deg', 'slope_behind_deg'):
        angle = getattr(arguments, option)
        if not abs(angle) <= STEEPEST:
            raise ConfigurationError(
                f'--{option.replace("_", "-")} must be at least -{STEEPEST:g} and at most '
                f'{STEEPEST:g} degrees, got {angle:g}',
                'out_of_range', f'--{option.replace("_", "-")}')
    return Site(math.radians(arguments.slope_before_deg), math.radians(arguments.slope_behind_deg),
                arguments.friction_before, arguments.friction_edge, arguments.friction_behind)


def read_rules(arguments: argparse.Namespace) -> Any:
    """Return the rules; `ConfigurationError` for a clearance that does not count."""
    from ballbot_ros.crossing import Rules
    if arguments.clearance is None:
        return Rules(arguments.attempts, over=arguments.over)
    if arguments.over != 'clear':
        raise ConfigurationError(
            f'--clearance goes with --over clear, not {arguments.over}',
            'inconsistent', '--clearance')
    return Rules(arguments.attempts, over=arguments.over, clearance=arguments.clearance)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add where a parallel map runs."""
    parser.add_argument('--workers', type=int, metavar='N',
                        help='number of processes on this machine (default: one per core)')
    parser.add_argument('--dask', metavar='ADDRESS',
                        help='run on a Dask cluster: address of its scheduler, such as '
                        'tcp://host:8786')
