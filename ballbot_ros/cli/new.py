# SPDX-License-Identifier: Apache-2.0
"""The verb ``new``: a commented template of a file, which loads unchanged."""
import argparse
from pathlib import Path
from shlex import quote
import textwrap
from typing import Any, Iterator, Mapping

from ballbot_ros.cli.options import add_overwrite, refuse_without
from ballbot_ros.cli.verb import DONE

# Kind -> description, options, and the command that uses the file.
KINDS: Mapping[str, tuple[str, tuple[str, ...], str]] = {
    'robot': ('the parameters of a robot', ('robot',), 'ballbot robots {file}'),
    'scene': ('a robot, a ground and the initial state', ('robot',), 'ballbot simulate {file}'),
    'hardware': ('the motor of a real robot', ('robot', 'protocol'),
                 'ballbot doctor --hardware {file}'),
    'experiment': ('a scene, the nodes and seeds', ('scene',), 'ballbot run {file}'),
    'tuning': ('gains of the controller', (),
               'ballbot run controller --ros-args -p tuning:={file}'),
    'floor': ('walls or a map, with steps, carpets and drops', (),
              'ballbot view {file}'),
    'decision': ('margins of the decision', (),
                 'ballbot run obstacle_decision --ros-args -p tuning:={file}')}
COLUMN, WIDTH = 32, 99  # first and last column of comments
SCALING = (
    ' The values are those of an existing robot. For a ball of another size change all of them, '
    'not only mass and radius: a robot with the same dynamics, larger by a factor s, at speeds '
    'larger by s^0.5, has lengths larger by s, masses by s^3, inertias by s^5, contact_stiffness '
    'by s^2, contact_damping by s^2.5, rolling_friction and joint_friction by s^4.5, '
    'slip_threshold by s^0.5 and torques of the motor by s^4; coefficients of friction and '
    'gravity remain unchanged.')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('kind', choices=tuple(KINDS), metavar='KIND', help='; '.join(
        f'{kind}: {what}' for kind, (what, _, _) in KINDS.items()))
    parser.add_argument('file', type=Path, metavar='FILE.yaml',
                        help='file to write; its name without the extension becomes the name')
    parser.add_argument('--robot', metavar='NAME', help='name or file of the robot of a '
                        'scene or hardware file, or of the robot whose parameters are copied into '
                        'a robot file (default: gimball)')
    parser.add_argument('--scene', metavar='NAME',
                        help='name or file of the scene of an experiment (default: doorstep)')
    parser.add_argument('--protocol', metavar='NAME', help='protocol of the drive of a '
                        'hardware file (default: odrive)')
    add_overwrite(parser, file=True)


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.cli import file_kinds
    from ballbot_ros.cli.output import check_new_file, YAML
    from ballbot_ros.config.files import relative
    from ballbot_ros.physics import load_robot, load_scene
    from ballbot_ros.results.files import write_text
    path, (_, takes, follow) = arguments.file, KINDS[arguments.kind]
    given = {}
    for option in ('robot', 'scene', 'protocol'):
        value = getattr(arguments, option)
        refuse_without(arguments, f'a kind other than {arguments.kind}', option in takes,
                       f'--{option}')
        if value is not None:
            if option != 'protocol':
                (load_robot if option == 'robot' else load_scene)(value)
            given[option] = value if arguments.kind == 'robot' else relative(value, path.parent)
    check_new_file(path, arguments.overwrite, 'FILE', YAML)
    sections = file_kinds.KINDS[arguments.kind](path.stem, **given)
    write_text(template(arguments.kind, sections), path)
    print(f'{path}: edit the values, then run: {follow.format(file=quote(str(path)))}')
    return DONE


def template(kind: str, sections: list[Any]) -> str:
    """Return the text of a file: the given values, and all other values as comments."""
    what = KINDS[kind][0]
    head = f'# {what[0].upper()}{what[1:]}. Units are SI. A commented line shows the default: ' \
        f'uncomment it to change the value.{SCALING if kind == "robot" else ""}'
    parts = [textwrap.fill(head, WIDTH, subsequent_indent='# ') + '\n']
    for section in sections:
        parts.append(section.text or ''.join(f'{line}\n' for line in _lines(section)))
    return ''.join(parts)


def _lines(section: Any) -> Iterator[str]:
    from ballbot_ros.config.files import yaml_of
    off = '' if section.given else '# '
    indent = '  ' if section.key else ''
    if section.key:
        yield from _commented(f'{off}{section.key}:', section.doc)
    for name, metadata in section.keys.items():
        value = section.given.get(name, metadata.get('default'))
        entry = f'{name}:' + ('' if value is None else f' {yaml_of(value)}')
        mark = '' if name in section.given else '# '
        start = f'{off}{indent}{entry}' if off else f'{indent}{mark}{entry}'
        yield from _commented(start, meaning(metadata))


def span(metadata: Mapping[str, Any]) -> str:
    """Return the allowed values, with the unit."""
    from ballbot_ros.config.fields import allowed
    if metadata['kind'] in (float, int):
        return allowed(metadata)
    if metadata['kind'] is bool:
        return 'true or false'
    return ', '.join(metadata.get('choices', ())) or 'text'


def meaning(metadata: Mapping[str, Any]) -> str:
    """Return allowed values and meaning."""
    return f'{span(metadata)}: {metadata["doc"]}'


def _commented(start: str, comment: str) -> Iterator[str]:
    words = textwrap.wrap(comment, WIDTH - COLUMN - 2)
    if len(start) >= COLUMN:
        yield start
        start = ''
    for word in words or ['']:
        yield f'{start:<{COLUMN}}# {word}' if word else start
        start = ''
