# SPDX-License-Identifier: Apache-2.0
"""
Options that several verbs share, and their values.

Options that accept several numbers have the same form in all verbs: ``0.5`` is one number,
``0.2,0.5,0.9`` are three, ``0.2:1.2:21`` are 21 evenly spaced numbers, including both ends.
``0.2:1.2`` is a range, for a design that draws its points.
"""
import argparse
import math
from pathlib import Path
import re
from typing import Any, Iterable, Sequence, Union
import warnings

from ballbot_ros.cli.output import OUTPUT
from ballbot_ros.config.fields import count, quantity
from ballbot_ros.config.optional import load_optional
from ballbot_ros.errors import ConfigurationError, PlausibilityWarning

LAWS = ('free', 'held', 'velocity', 'voltage')


def add_number(parser: argparse._ActionsContainer, option: str, metavar: str, declared: Any,
               *short: str) -> None:
    """Add a number, declared as in `config.fields`; `command.main` checks its range."""
    default, doc = declared.default, declared.metadata['doc']
    words = '' if default is None else ' (default: %(default)s)'
    action: Any = parser.add_argument(*short, option, type=declared.metadata['kind'],
                                      default=default, metavar=metavar, help=doc + words)
    action.declared = declared.metadata


def from_ros(module: str = 'ballbot_ros.ros.graph') -> Any:
    """Return a module that needs ROS; see `load_optional`."""
    return load_optional(
        module, 'ROS', 'source /opt/ros/jazzy/setup.bash and the workspace, or run "make setup" '
        'in a checkout and use .venv/bin/ballbot')


def refuse_without(arguments: argparse.Namespace, needed: str, holds: bool, *options: str) -> None:
    """Refuse `options` that were given, unless `holds`: without `needed` they have no effect."""
    for option in options:
        given = getattr(arguments, option[2:].replace('-', '_'))
        if not holds and given is not False and given not in (None, '', []):
            raise ConfigurationError(f'{option} requires {needed}', 'inconsistent', option)


def add_seed(parser: argparse.ArgumentParser, what: str) -> None:
    add_number(parser, '--seed', 'N', count(f'seed of {what}', default=0))


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add ``--robot``; `read_robot` loads it."""
    parser.add_argument('--robot', default='gimball', metavar='NAME',
                        help='name of a robot or a YAML file (default: %(default)s)')


def add_quiet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--quiet', action='store_true', help='print errors and warnings only')


def add_hardware(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--hardware', default='gimball_odrive', metavar='NAME',
                        help='name of a hardware file, or a YAML file (default: %(default)s)')


def add_port(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--port', default='', metavar='PORT',
                        help='serial device, URL or CAN interface to use instead of the one in '
                        'the hardware file')


def add_overwrite(parser: argparse.ArgumentParser, file: bool = False) -> None:
    """Add ``--overwrite`` for a folder of results or one file."""
    parser.add_argument('--overwrite', action='store_true', help=(
        'replace an existing file' if file else
        'replace existing results; otherwise a new folder is used, and an --out that contains '
        'results is refused'))


def add_out(parser: argparse.ArgumentParser, name: str) -> None:
    """Add ``--out`` and ``--overwrite`` of files in the folder `name` of `OUTPUT`."""
    parser.add_argument('--out', type=Path, metavar='DIR', help=(
        f'folder for the files (default: {OUTPUT / name}, or {name}_2, ... if it contains '
        'results)'))
    add_overwrite(parser)


def add_format(parser: argparse._ActionsContainer) -> None:
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
    add_number(parser, '--angle-deg', 'DEGREES', quantity(
        'degrees', 'set angle of the pendulum: 0 down, 90 horizontal ahead (default: 0)',
        minimum=-180.0, maximum=180.0, optional=True))
    parser.add_argument('--voltage', type=float, metavar='VOLTS',
                        help='voltage of the motor (default and 0: that of steady rolling at each '
                        'speed)')


def add_site(parser: argparse.ArgumentParser) -> None:
    """Add slopes and friction around the step; `read_site` returns them."""
    for where in ('before', 'behind'):
        add_number(parser, f'--slope-{where}-deg', 'DEGREES', quantity(
            'degrees', f'slope of the ground {where} the step, positive uphill (default: 0)',
            minimum=-80.0, maximum=80.0, optional=True))
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


def warn(sentences: Iterable[str]) -> None:
    """Print warnings on standard error, even with ``--quiet``; see `command.main`."""
    for sentence in sentences:
        warnings.warn(sentence, PlausibilityWarning, stacklevel=2)


def warn_speeds(option: str, speeds: Iterable[float]) -> None:
    """Warn if the fastest of several speeds [m/s] is implausible."""
    from ballbot_ros.physics.model.robot import speed_warnings
    warn(speed_warnings(max(speeds, key=abs), option))


def read_law(arguments: argparse.Namespace) -> Any:
    """Return the actuation; raise `ConfigurationError` for an option of another law."""
    from ballbot_ros.crossing import held_at
    from ballbot_ros.physics import Actuation
    law = arguments.actuation
    for option, owner in (('--angle-deg', 'held'), ('--voltage', 'voltage')):
        refuse_without(arguments, f'--actuation {owner}, not {law}', law == owner, option)
    if law == 'held':
        angle = arguments.angle_deg or 0.0
        from ballbot_ros.physics.model.robot import angle_warnings
        warn(angle_warnings(angle))
        return held_at(math.radians(angle))
    if law == 'voltage':
        return Actuation(law, voltage=arguments.voltage or 0.0)
    return Actuation(law)


def read_site(arguments: argparse.Namespace) -> Any:
    """Return the site; raise `ConfigurationError` for a friction out of range."""
    from ballbot_ros.crossing import Site
    return Site(math.radians(arguments.slope_before_deg or 0.0),
                math.radians(arguments.slope_behind_deg or 0.0), arguments.friction_before,
                arguments.friction_edge, arguments.friction_behind)


def read_rules(arguments: argparse.Namespace) -> Any:
    """Return the rules; raise `ConfigurationError` for a clearance without effect."""
    from ballbot_ros.crossing import Rules
    refuse_without(arguments, f'--over clear, not {arguments.over}', arguments.over == 'clear',
                   '--clearance')
    given = {} if arguments.clearance is None else {'clearance': arguments.clearance}
    return Rules(arguments.attempts, over=arguments.over, **given)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the workers of a parallel map."""
    place = parser.add_mutually_exclusive_group()
    add_number(place, '--workers', 'N', count(
        'number of processes on this machine (default: one per core)', default=None, minimum=1,
        maximum=1000))
    place.add_argument('--dask', metavar='ADDRESS',
                       help='run on a Dask cluster: address of its scheduler, such as '
                       'tcp://host:8786')


METAVAR = 'VALUES'
VALUES_HELP = 'a number, several as in 0.2,0.5, or FIRST:LAST:COUNT as in 0.2:1.2:21'
RANGE_COUNT_MAX = 100_000

Values = Union[list[float], tuple[float, float]]


def read_numbers(words: Sequence[str], option: str) -> list[float]:
    """Return the numbers of the words of an option; `ConfigurationError` for invalid words."""
    numbers: list[float] = []
    for word in words:
        values = read_values(word, option)
        if isinstance(values, tuple):
            raise ConfigurationError(
                f'{option} {word}: the count is missing: write {word}:COUNT, such as {word}:11',
                'missing', option)
        numbers += values
    return numbers


def read_values(word: str, option: str) -> Values:
    """
    Return the list of numbers of one word, or the tuple of both ends of ``low:high``.

    Raises `ConfigurationError` with the word and the allowed form; for a stride, also with the
    equivalent count.
    """
    parts = word.split(':') if ':' in word else word.split(',')
    # "0,8" would be read as 0 and 8, but is 0.8 in many languages; two values are "0.0,8".
    if re.fullmatch(r'-?0,[0-9]+', word) or ':' in word and re.search(r'[0-9],[0-9]', word):
        point = word.replace(',', '.')
        raise ConfigurationError(
            f'{option} {word}: a decimal comma; write {point}'
            + ('' if ':' in word else f', or {word.replace(",", ".0,")} for two values'),
            'decimal_comma', option)
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if not numbers or len(numbers) > 3 and ':' in word or not all(map(math.isfinite, numbers)):
        raise ConfigurationError(
            f'{option} must be {VALUES_HELP}; got {word!r}', 'wrong_type', option)
    if ':' not in word:
        return numbers
    first, last = numbers[:2]
    if not first < last:
        raise ConfigurationError(
            f'{option} {word}: LAST must be greater than FIRST', 'inconsistent', option)
    if len(numbers) == 2:
        return first, last
    if not (parts[2].strip().isdigit() and 2 <= numbers[2] <= RANGE_COUNT_MAX):
        raise ConfigurationError(
            f'{option} {word}: COUNT must be an integer from 2 to {RANGE_COUNT_MAX}, '
            f'got {parts[2]}{_as_count(first, last, numbers[2])}', 'out_of_range', option)
    # Rounded, so that 0.2 + 2 x 0.05 is 0.3.
    count = int(numbers[2])
    return [round(first + (last - first) * place / (count - 1), 12) for place in range(count)]


def _as_count(first: float, last: float, stride: float) -> str:
    """Return a hint of the form with a count for a stride; empty for an implausible count."""
    if not 0.0 < stride <= last - first:
        return ''
    count = (last - first) / stride
    whole = round(count)
    if abs(count - whole) > 1e-6 or whole + 1 > RANGE_COUNT_MAX:
        return ''
    return f'; for a stride of {stride:g} write {first:g}:{last:g}:{whole + 1}'
