# SPDX-License-Identifier: Apache-2.0
"""The verbs ``scenes`` and ``robots``: files of the package, and one robot in detail."""
import argparse
from operator import attrgetter
from pathlib import Path
import re
import shutil
import textwrap
from typing import Any, Iterator

from ballbot_ros.cli.verb import DONE, Verb
from ballbot_ros.errors import ConfigurationError

_SENTENCE = re.compile(r'(?<=[\w)])\.\s+(?=[A-Z])')


def describe(path: Path) -> str:
    """Return the first sentence of the comment at the start of a file."""
    words = []
    for line in path.read_text(encoding='utf-8').splitlines():
        if not line.startswith('#') or not line.strip('# '):
            break
        if 'SPDX-License-Identifier' not in line:
            words.append(line.lstrip('# '))
    return _SENTENCE.split(' '.join(' '.join(words).split()))[0].rstrip('.')


def print_list(kind: str) -> None:
    """Print name and description of each file of a kind, one file per line."""
    from ballbot_ros.config.files import shipped_files
    files = shipped_files(kind)
    width = max(len(path.stem) for path in files)
    # 200 for a pipe without COLUMNS: grep gets the whole line.
    left = shutil.get_terminal_size((200, 24)).columns - width - 2
    for path in files:
        text = textwrap.shorten(describe(path), max(left, 30), placeholder=' ...')
        print(f'{path.stem:<{width}}  {text}')


def add_scenes(parser: argparse.ArgumentParser) -> None:
    parser.epilog = 'Run one with "ballbot simulate NAME".'


def scenes(arguments: argparse.Namespace) -> int:
    print_list('scenes')
    return DONE


# Width of the column of notes [characters].
NOTE_WIDTH = 44


def add_robots(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('robot', nargs='?', metavar='NAME',
                        help='name or YAML file of the robot whose parameters are printed '
                        '(default: list the robots)')
    parser.add_argument('--urdf', action='store_true',
                        help='print the robot description instead: links, joints and shapes')


def robots(arguments: argparse.Namespace) -> int:
    if arguments.robot is None:
        if arguments.urdf:
            raise ConfigurationError(
                '--urdf needs the name of a robot, such as gimball', 'missing', 'NAME')
        print_list('robots')
        return DONE
    from ballbot_ros.physics.model.robot import load_robot
    robot = load_robot(arguments.robot)
    if arguments.urdf:
        from ballbot_ros.ros.urdf import robot_description
        print(robot_description(robot), end='')
    else:
        print_table(robot)
    return DONE


def print_table(robot: Any) -> None:
    """Print every parameter of a robot with unit, source, range and note, and its contact law."""
    from ballbot_ros.table import table
    rows = [['quantity', 'value', 'unit', 'source', 'range', 'note']]
    for *cells, note in _rows(robot):
        for line in textwrap.wrap(note, NOTE_WIDTH) or ['']:
            rows.append([*cells, line])
            cells = [''] * 5
    print(table(rows))
    print(f'\ncontact law: {robot.contact_law}')


def _rows(robot: Any) -> Iterator[tuple[str, str, str, str, str, str]]:
    """Yield the cells of each parameter, then those of derived values."""
    from ballbot_ros.physics.model.robot import MOTOR, ROBOT, STEERING
    described = {**ROBOT, **(MOTOR if robot.motor else {}),
                 **(STEERING if robot.steering else {})}
    for name, metadata in described.items():
        known = robot.provenance.get(name)
        bounds = ''
        if known is not None and known.low is not None:
            bounds = f'{known.low:g} to {known.high:g}'
        yield (name, f'{attrgetter(name)(robot):.6g}', metadata['unit'],
               known.source if known else 'not given', bounds,
               (known.note if known else '') or metadata['doc'])
    derived = [('total_mass', 'kg', 'M1 + M2'),
               ('static_penetration', 'm', 'penetration of the ball at rest on a level surface'),
               ('largest_gravity_torque', 'N m', 'gravity torque with the pendulum horizontal'),
               ('slope_limit', 'rad', 'steepest slope that the pendulum can hold')]
    if robot.contact_law == 'kelvin_voigt':
        derived += [('damping_ratio', '1', 'damping ratio of the ball on its contact spring'),
                    ('restitution', '1', 'speed after to speed before an unclamped bounce')]
    for name, unit, note in derived:
        yield name, f'{getattr(robot, name):.4g}', unit, 'derived', '', note


SCENES, ROBOTS = Verb(add_scenes, scenes), Verb(add_robots, robots)
