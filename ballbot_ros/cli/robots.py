# SPDX-License-Identifier: Apache-2.0
"""The verb ``robots``: which there are, the numbers of one with their sources, or its URDF."""
import argparse
from operator import attrgetter
from typing import Any, Iterator

from ballbot_ros.errors import ConfigurationError

# The text of a column is cut to lines of this width.
NOTE_WIDTH = 44


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the optional name."""
    parser.add_argument('robot', nargs='?', metavar='NAME',
                        help='robot, a name or a YAML file, whose numbers are printed (default: '
                        'list the robots)')
    parser.add_argument('--urdf', action='store_true',
                        help='print the robot description instead: links, joints and shapes')


def run(arguments: argparse.Namespace) -> int:
    """List the robots, or print one: its numbers or its description."""
    from ballbot_ros.cli.listing import check_name, print_list
    if arguments.robot is None:
        if arguments.urdf:
            raise ConfigurationError('--urdf needs the name of a robot, such as gimball')
        print_list('robots')
        return 0
    check_name('robots', arguments.robot)
    from ballbot_ros.physics.model.robot import load_robot
    robot = load_robot(arguments.robot)
    if arguments.urdf:
        from ballbot_ros.ros.urdf import robot_description
        print(robot_description(robot), end='')
    else:
        print_table(robot)
    return 0


def print_table(robot: Any) -> None:
    """Print every number of a robot with unit, source, range and note."""
    from textwrap import wrap
    rows = [('quantity', 'value', 'unit', 'source', 'range', 'note'), *_rows(robot)]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    for row in rows:
        cells = [f'{cell:>{width}}' if column == 1 else f'{cell:<{width}}'
                 for column, (cell, width) in enumerate(zip(row, widths))]
        for number, note in enumerate(wrap(row[5], NOTE_WIDTH) or ['']):
            start = '  '.join(cells) if number == 0 else ' ' * (sum(widths) + 8)
            print(f'{start}  {note}'.rstrip())


def _rows(robot: Any) -> Iterator[tuple[str, str, str, str, str, str]]:
    """Yield the cells of each number, then those of what follows from them."""
    from ballbot_ros.physics.model.named_parameters import MOTOR, ROBOT
    for name, metadata in {**ROBOT, **(MOTOR if robot.motor else {})}.items():
        known = robot.provenance.get(name)
        bounds = ''
        if known is not None and known.low is not None:
            bounds = f'{known.low:g} to {known.high:g}'
        yield (name, f'{attrgetter(name)(robot):.6g}', metadata['unit'],
               known.source if known else 'not given', bounds,
               (known.note if known else '') or metadata['doc'])
    for name, unit, note in (
            ('total_mass', 'kg', 'M1 + M2'),
            ('static_penetration', 'm', 'how deep the ball rests in a level surface'),
            ('largest_gravity_torque', 'N m', 'of a level pendulum about the joint'),
            ('slope_limit', 'rad', 'steepest slope that the pendulum can hold'),
            ('damping_ratio', '1', 'of the ball on its contact spring'),
            ('restitution', '1', 'speed after a bounce over speed before')):
        yield name, f'{getattr(robot, name):.4g}', unit, 'follows', '', note
