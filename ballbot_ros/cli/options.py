# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share, and their values."""
import argparse
import math
import sys
from typing import Any, Iterable

from ballbot_ros.errors import ConfigurationError

LAWS = ('free', 'held', 'velocity', 'voltage')
SLOPE_MAX_DEG = 80.0  # slope [degrees]


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add ``--robot``; `read_robot` loads it."""
    parser.add_argument('--robot', default='gimball', metavar='NAME',
                        help='name of a robot or a YAML file (default: %(default)s)')


def add_quiet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--quiet', action='store_true', help='print errors only')


def add_port(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--port', default='', metavar='PORT',
                        help='serial device, URL or CAN interface to use instead of the one in '
                        'the hardware file')


def add_overwrite(parser: argparse.ArgumentParser, file: bool = False) -> None:
    """Add ``--overwrite`` for a folder of results or one file."""
    parser.add_argument('--overwrite', action='store_true', help=(
        'replace an existing file' if file else
        'replace existing results; without it a new folder is used, and an --out that contains '
        'results is refused'))


def add_format(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--format', choices=('svg', 'png', 'both'), default='both',
                        help='format of the figures (default: %(default)s)')


def add_accuracy(parser: argparse.ArgumentParser, default: float, what: str) -> None:
    parser.add_argument('--accuracy', type=float, default=default, metavar='METRES',
                        help=f'largest error of {what} (default: %(default)s)')


def add_actuation(parser: argparse.ArgumentParser) -> None:
    """Add the control of the motor; `read_law` returns it."""
    parser.add_argument('--actuation', choices=LAWS, default='free',
                        help='control of the motor: free, no torque; held, the position '
                        'controller (PD, eq. 11) holds the pendulum at --angle-deg; velocity, the '
                        'velocity controller (PI, eq. 12); voltage, constant at --voltage '
                        '(default: %(default)s)')
    parser.add_argument('--angle-deg', type=float, metavar='DEGREES',
                        help='set angle of the pendulum: 0 down, 90 horizontal ahead '
                        '(default: 0)')
    parser.add_argument('--voltage', type=float, metavar='VOLTS',
                        help='voltage of the motor (default: that of steady rolling at each '
                        'speed)')


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add slopes and friction around the step; `read_site` returns them."""
    for where in ('before', 'behind'):
        parser.add_argument(f'--slope-{where}-deg', type=float, default=0.0, metavar='DEGREES',
                            help=f'slope of the ground {where} the step, positive uphill '
                            '(default: %(default)g)')
    for where, what in (('before', 'of the ground before the step'), ('edge', 'of the edge'),
                        ('behind', 'of the ground behind the step')):
        parser.add_argument(f'--friction-{where}', type=float, metavar='MU',
                            help=f"coefficient of friction {what} (default: the robot's)")


def add_rules(parser: argparse.ArgumentParser, over: str = 'edge') -> None:
    """Add the success criterion; `read_rules` returns it."""
    parser.add_argument('--attempts', choices=('first', 'any'), default='first',
                        help='which attempt counts: the first, or any within 5 s (default: '
                        '%(default)s)')
    parser.add_argument('--over', choices=('edge', 'clear'), default=over,
                        help='success criterion: centre past the edge, or clear of the edge by '
                        '--clearance (default: %(default)s)')
    parser.add_argument('--clearance', type=float, metavar='RADII',
                        help='distance of the centre beyond the edge with --over clear, in radii '
                        'of the ball (default: 0.25)')


def read_robot(arguments: argparse.Namespace) -> Any:
    """Return the robot; raise `ConfigurationError` for an unknown name or an error in its file."""
    from ballbot_ros.physics import load_robot
    return load_robot(arguments.robot)


def warn(arguments: argparse.Namespace, sentences: Iterable[str]) -> None:
    """Print plausibility warnings on standard error, unless quiet."""
    for sentence in () if getattr(arguments, 'quiet', False) else sentences:
        print(f'Warning: {sentence}', file=sys.stderr, flush=True)


def warn_speeds(arguments: argparse.Namespace, option: str, speeds: Iterable[float]) -> None:
    """Warn if the fastest of several speeds [m/s] is implausible."""
    from ballbot_ros.physics.model.robot import speed_warnings
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
        from ballbot_ros.physics.model.robot import angle_warnings
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
        if not abs(angle) <= SLOPE_MAX_DEG:
            raise ConfigurationError(
                f'--{option.replace("_", "-")} must be at least -{SLOPE_MAX_DEG:g} and at most '
                f'{SLOPE_MAX_DEG:g} degrees, got {angle:g}',
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
    """Add the workers of a parallel map."""
    parser.add_argument('--workers', type=int, metavar='N',
                        help='number of processes on this machine (default: one per core)')
    parser.add_argument('--dask', metavar='ADDRESS',
                        help='run on a Dask cluster: address of its scheduler, such as '
                        'tcp://host:8786')
