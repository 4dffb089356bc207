# SPDX-License-Identifier: Apache-2.0
"""
Kinds of files and the sections of each, for templates and for the tables of docs/files.md.

Keys, units, ranges, defaults and meanings are those of the classes that read the files.
"""
from dataclasses import dataclass, fields, MISSING, replace
from functools import partial
from typing import Any, Callable, Mapping, Sequence

from ballbot_ros.bridge.hardware_file import HardwareNames, load_hardware, SECTIONS, SET_ELSEWHERE
from ballbot_ros.config.fields import check_choice
from ballbot_ros.config.files import shipped_files
from ballbot_ros.control import ControlTuning
from ballbot_ros.decision import DecisionTuning
from ballbot_ros.drives import driver_class, DRIVES
from ballbot_ros.experiments.file import Experiment
from ballbot_ros.physics import Actuation, ContactOptions, load_robot, Solver
from ballbot_ros.physics.model.robot import Motor, Robot, Steering
from ballbot_ros.physics.simulation.scene import HUMAN, Initial, SceneFile

# Fields of `Actuation` that scene files express in other units.
NOT_FOR_PEOPLE = ('set_angle',)


@dataclass(frozen=True)
class Section:
    """A section of a file."""

    key: str  # of the section; empty for the top of the file
    # Name -> description of the allowed values, as `config.fields` declares it, with its default
    # (``'default'``) if it has one.
    keys: Mapping[str, Mapping[str, Any]]
    doc: str  # one sentence
    given: Mapping[str, Any]  # values that a template sets; the others are shown as comments
    text: str = ''  # YAML instead, for a section without a table of keys


def described(cls: Any, but: Sequence[str] = ()) -> dict[str, Mapping[str, Any]]:
    """Return the described fields of a class, each with its default if it has one."""
    return {item.name: {
        **item.metadata, **({} if item.default is MISSING else {'default': item.default})}
        for item in fields(cls) if 'kind' in item.metadata and item.name not in but}


def robot_file(name: str, robot: str = 'gimball') -> list[Section]:
    """Return the sections of a robot file, with the parameters of a robot."""
    known = load_robot(robot)
    return [Section('', described(Robot), '', {**_values(known), 'name': name}),
            Section('motor', described(Motor), 'the motor of the pendulum; may be left out',
                    _values(known.motor)),
            Section('steering', described(Steering),
                    'the lateral axis of the pendulum; a robot without it drives straight',
                    _values(known.steering))]


def _values(part: Any) -> dict[str, Any]:
    """Return the values of a part that differ from the defaults; empty for a missing part."""
    if part is None:
        return {}
    return {name: getattr(part, name) for name, metadata in described(type(part)).items()
            if getattr(part, name) != metadata.get('default', MISSING)}


TERRAIN = """\
terrain:
  - flat: {length: 1.0}
  - step: {height: 0.02}            # negative: step down
  - flat: {length: 2.0}
  # - slope: {length: 1.0, angle_deg: 3.0}       # or rise, in m
  # - threshold: {height: 0.02, width: 0.06, bevel: 0.015}
  # - cord: {diameter: 0.008}
  # - carpet: {thickness: 0.006, length: 1.0, friction: 0.4, edge_friction: 0.4}
"""


def scene_file(name: str, robot: str = 'gimball') -> list[Section]:
    parts = ('robot_changes', 'terrain', 'initial', 'actuation', 'solver', 'contact')
    top = described(SceneFile, parts)
    doc = {key: metadata['doc'] for key, metadata in described(SceneFile).items()}
    people = {key: declared.metadata for key, (declared, *_) in HUMAN.items()}
    return [
        Section('', {'robot': top['robot'], **top}, '', {'robot': robot, 'duration': 4.0}),
        Section('terrain', {}, doc['terrain'], {}, TERRAIN),
        Section('initial', described(Initial), doc['initial'], {'x': 0.3, 'speed': 0.8}),
        Section('actuation', {**described(Actuation, NOT_FOR_PEOPLE), **people}, doc['actuation'],
                {'law': 'free'}),
        Section('solver', described(Solver), doc['solver'], {}),
        Section('contact', described(ContactOptions), doc['contact'], {}),
        Section('robot_changes', {}, doc['robot_changes'], {},
                '# robot_changes: {ball_mass: 4.0}\n')]


def tuning_file(cls: Any, name: str) -> list[Section]:
    """Return the one section of a file of gains or margins, with the defaults of its class."""
    keys = described(cls)
    return [Section('', keys, '', {key: item['default'] for key, item in keys.items()})]


def hardware_file(name: str, robot: str = 'gimball', protocol: str = 'odrive') -> list[Section]:
    """
    Return the sections of a hardware file, with the values of a shipped one.

    For a drive that no shipped file has, they are those of the first one.
    """
    check_choice('--protocol', protocol, sorted(DRIVES))
    shipped = [load_hardware(path.stem) for path in shipped_files('hardware')]
    known = next((item for item in shipped if item.connection.protocol == protocol), None) \
        or replace(shipped[0], drive={}, connection=replace(
            shipped[0].connection, protocol=protocol,
            baud=max(driver_class(protocol).baud_rates)))
    own = described(driver_class(protocol).Options, tuple(SET_ELSEWHERE))
    parts = [Section('', described(HardwareNames), '', {'name': name, 'robot': robot})]
    for key, cls in SECTIONS.items():
        parts.append(Section(key, described(cls), _first_line(cls), _values(getattr(known, key))))
    given = {key: value for key, value in known.drive.items()
             if key in own and value != own[key].get('default', MISSING)}
    return [*parts, Section('drive', own, f'options of {protocol} only', given)]


def _first_line(cls: Any) -> str:
    """Return the first sentence of the docstring of a class, as a comment."""
    text = ' '.join(cls.__doc__.split('\n\n')[0].split()).rstrip('.')
    return f'{text[0].lower()}{text[1:]}'


def experiment_file(name: str, scene: str = 'doorstep') -> list[Section]:
    text = {
        'seeds': '[0, 1, 2]', 'simulator': '{terrain_rate: 50.0, terrain_height_sd: 0.002}',
        'controller': '{tuning: published}', 'obstacle_decision': '{curve: gimball_down}'}
    top = described(Experiment, tuple(text))
    docs = described(Experiment)
    lines = ''.join(f'# {docs[key]["doc"]}\n{key}: {value}\n' for key, value in text.items())
    return [Section('', top, '', {'scene': scene, 'duration': 4.0}),
            Section('nodes', {}, '', {}, lines)]


FLOOR = """\
# All coordinates are in m.
walls:
  size: [6.0, 5.0]       # of the map, whose lower left corner is (0, 0); its outline is a wall
  resolution: 0.05       # size of a cell
  thickness: 0.1
  lines:                 # polylines of walls; gaps are doors
    - [[0.0, 2.5], [2.5, 2.5]]
    - [[3.5, 2.5], [6.0, 2.5]]
# Instead of walls, a map of Nav2's map_server or of SLAM Toolbox, with a path from this file:
# map: my_map.yaml
features:
  # Lines. A step is higher on the left of its line, viewed from the first point to the last.
  - {kind: step, name: upper room, line: [[2.5, 2.5], [3.5, 2.5]], height: 0.02, height_sd: 0.001}
  # - {kind: threshold, line: [[2.5, 2.5], [3.5, 2.5]], height: 0.015, width: 0.06}
  # - {kind: cord, line: [[0.5, 0.5], [2.5, 0.5]], height: 0.006, width: 0.012}
  # - {kind: drop, line: [[5.0, 2.4], [5.0, 0.0]], height: 0.2}    # lower on the right of its line
  # Areas, given by their corners.
  # - {kind: carpet, polygon: [[1.0, 3.5], [2.0, 3.5], [2.0, 4.5], [1.0, 4.5]], height: 0.008}
  # - {kind: level, polygon: [[4.8, 3.4], [6.0, 3.4], [6.0, 5.0], [4.8, 5.0]], height: 0.08}
  # - {kind: ramp, polygon: [[3.6, 3.4], [4.8, 3.4], [4.8, 5.0], [3.6, 5.0]], height: 0.08,
  #    line: [[3.6, 4.2], [4.8, 4.2]]}       # from the foot to the top
  # - {kind: friction, polygon: [[0.5, 1.0], [1.5, 1.0], [1.5, 2.0], [0.5, 2.0]], friction: 0.1}
  # - {kind: keep_out, polygon: [[4.5, 0.5], [5.5, 0.5], [5.5, 1.5], [4.5, 1.5]]}
  # - {kind: stairs, polygon: [[4.5, 0.5], [5.5, 0.5], [5.5, 1.5], [4.5, 1.5]]}    # down
# Start of a simulated robot: x, y [m] and heading [degrees], counter-clockwise from +x. Default:
# the middle of the largest room.
start: [1.0, 1.0, 0.0]
# heights:               # of the ground under the features, in a 16-bit greyscale PNG
#   image: heights.png
#   resolution: 0.02     # size of a cell [m]
#   scale: 0.001         # height per unit of the pixel value [m]: millimetres here
#   offset: 0.0          # height at pixel value 0 [m]
#   origin: [0.0, 0.0]   # of the lower left corner [m]
"""


def floor_file(name: str) -> list[Section]:
    """Return the sections of a floor file: two rooms, with each kind of feature."""
    return [Section('', {}, '', {}, FLOOR)]


# Kind -> the function that returns its sections; `ballbot new` writes these.
KINDS: Mapping[str, Callable[..., list[Section]]] = {
    'robot': robot_file, 'scene': scene_file, 'hardware': hardware_file,
    'experiment': experiment_file, 'floor': floor_file,
    'tuning': partial(tuning_file, ControlTuning),
    'decision': partial(tuning_file, DecisionTuning)}
