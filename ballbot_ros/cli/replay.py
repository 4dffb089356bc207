# SPDX-License-Identifier: Apache-2.0
"""The verb ``replay``: compare a bag with the model, or show a black-box file."""
import argparse
import math
from pathlib import Path
from shlex import quote
import statistics
from typing import Any, NamedTuple, Optional

from ballbot_ros.bags.opener import is_bag
from ballbot_ros.cli.options import (
    add_format, add_number, add_overwrite, add_quiet, refuse_without)
from ballbot_ros.cli.output import figure_files, print_json, result_folder, save_figure
from ballbot_ros.cli.verb import DONE, FAILED
from ballbot_ros.config.fields import quantity
from ballbot_ros.errors import ConfigurationError

TIME_BEFORE_FAULT = 5.0  # [s]
# Sources of the torque; the choices of --by.
COMMANDS, TORQUES, SET_POINTS = 'commands', 'torques', 'set-points'
BAG_OPTIONS = ('--scene', '--robot', '--set', '--namespace', '--by', '--json')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('file', type=Path, metavar='FILE',
                        help='ROS 2 bag; or black-box file, which the bridge writes to '
                        '~/.ros/ballbot (or that folder, for the newest file)')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for numbers and figure (default: ballbot_output/replay_BAG '
                        'if the replay of a bag is not identical, otherwise none)')
    add_number(parser, '--before', 'SECONDS', quantity(
        's', 'time before the fault to draw, for a black box (default: '
        f'{TIME_BEFORE_FAULT:g})', above=0.0, maximum=600.0, optional=True))
    parser.add_argument('--scene', metavar='NAME',
                        help='scene that was run, a name or a YAML file (default: that of '
                        'the bag; flat for a real robot)')
    parser.add_argument('--robot', metavar='NAME',
                        help='robot that was run, a name or a YAML file (default: that of the bag '
                        'or the scene)')
    parser.add_argument('--set', action='append', metavar='NAME=VALUE',
                        help='parameter of the simulator that the bag lacks; may be repeated')
    parser.add_argument('--namespace', metavar='NAME',
                        help='namespace of the robot to replay, in a bag of several')
    parser.add_argument('--by', choices=(COMMANDS, TORQUES, SET_POINTS),
                        help='source of the torque: commands (joint_commands), torques '
                        '(joint_states), or set-points (set_point and cmd_vel, applied by the '
                        'onboard controllers)')
    parser.add_argument('--json', action='store_true', help='print the result for a bag as JSON')
    add_format(parser)
    add_overwrite(parser)
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.black_box.read import find_black_box
    path = find_black_box(arguments.file)
    bag = path is None and is_bag(arguments.file)
    refuse_without(arguments, f'a black box; {arguments.file} is a bag', not bag, '--before')
    refuse_without(
        arguments, 'a bag (a folder with metadata.yaml, a file ending in .mcap or .db3); '
        f'{arguments.file} is not one', bag, *BAG_OPTIONS)
    if bag:
        return run_bag(arguments)
    if path is None and arguments.file.is_dir():
        raise ConfigurationError(
            f'{arguments.file}: contains neither a black-box file nor a bag; the bridge writes '
            'a black-box file after a fault, see its parameter black_box', 'missing', 'FILE')
    return run_black_box(path or arguments.file, arguments)


def run_black_box(path: Path, arguments: argparse.Namespace) -> int:
    """Print the report and write the requested files; return 1 if the file is damaged."""
    before = TIME_BEFORE_FAULT if arguments.before is None else arguments.before
    from ballbot_ros.black_box.read import read_black_box
    from ballbot_ros.black_box.report import summary, write_tables
    if arguments.out is not None:
        result_folder(arguments.out, '', ('period.csv', *figure_files(['black_box'])),
                      arguments.overwrite)
    recording = read_black_box(path)
    if not arguments.quiet:
        print(f'{path}\n\n{summary(recording)}')
    if arguments.out is not None:
        from ballbot_ros.figures.black_box import around_fault
        files = [file.name for file in write_tables(recording, arguments.out)]
        files += save_figure(around_fault(recording, before), arguments.out, 'black_box',
                             arguments.format)
        if not arguments.quiet:
            print(f'\nWritten to {arguments.out}: {", ".join(files)}')
    return FAILED if recording.damage else DONE


class Replayed(NamedTuple):
    """Result of a replay; `identical` is None for a real robot."""

    words: str
    content: dict[str, Any]
    series: Any
    identical: Optional[bool]
    files: dict[str, Any] = {}  # for identify, by name


def difference_table(found: list[Any]) -> str:
    """Return the differences of all channels as a table."""
    from ballbot_ros.table import table
    return table([('channel', 'RMS', 'largest', 'unit', 'at', 'of its span', 'departs'), *((
        item.channel, f'{item.rms:.3g}', f'{item.largest:.3g}', item.unit, f'{item.when:.3f} s',
        f'{100.0 * item.largest / item.span:.1f} %' if item.span > 0.0 else '-',
        'never' if math.isnan(item.departs) else f'at {item.departs:.3f} s') for item in found)])


def parameters_of(arguments: argparse.Namespace, known: dict[str, Any]) -> Any:
    """Return the simulator parameters of a bag; raise `ConfigurationError` without a scene."""
    import yaml

    from ballbot_ros.nodes.simulator.settings import SimulatorSettings
    given = dict(known)
    for words in arguments.set or ():
        name, sign, text = words.partition('=')
        try:
            given[name] = yaml.safe_load(text)
        except yaml.YAMLError:
            sign = ''
        if not sign:
            raise ConfigurationError(
                f'--set takes NAME=VALUE, got {words!r}', 'wrong_type', '--set')
    given.update({name: getattr(arguments, name) for name in ('scene', 'robot')
                  if getattr(arguments, name)})
    if 'scene' not in given and not given.get('floor'):
        raise ConfigurationError(
            f'{arguments.file} does not name its scene: give --scene NAME or --set '
            'floor=NAME, and, if they are not the defaults, --robot NAME and --set NAME=VALUE for '
            'parameters of the simulator', 'missing', '--scene')
    return SimulatorSettings.from_mapping(given, 'parameters of the simulator')


def run_bag(arguments: argparse.Namespace) -> int:
    """Replay a bag, print and write results; return 1 if a simulated run deviates."""
    from ballbot_ros.bags.metadata import BagMetadata, BRIDGE
    from ballbot_ros.bags.recorded_run import read_run
    path = arguments.file
    bag = path.resolve()
    # For a bag that is called "bag", the name of its folder is used.
    name = bag.parent.name if bag.stem == 'bag' and bag.is_dir() else bag.stem
    folder = result_folder(arguments.out, f'replay_{name}', (
        'replay.json', 'scene.yaml', 'recording.csv', *figure_files(['replay'])),
        arguments.overwrite)
    run = read_run(path, arguments.namespace)
    metadata = BagMetadata.read(run.metadata)
    real = metadata.source == BRIDGE or not run.balls
    found: Replayed = (replay_robot if real else replay_simulator)(arguments, run, metadata)
    verbose = not (arguments.quiet or arguments.json)
    if verbose:
        print(f'{path}\n{found.words}')
    if arguments.json:
        print_json(found.content)
    if not found.identical or arguments.out is not None:
        files = write(found, folder, name, arguments.format)
        if verbose:
            print(f'\nWritten to {folder}: {", ".join(files)}')
            if 'scene.yaml' in files:
                inputs = (quote(str(folder / name)) for name in ('scene.yaml', 'recording.csv'))
                print('To fit the model to the recording, for instance: ballbot identify '
                      f'{" ".join(inputs)} --recorded-torque --estimate joint_friction '
                      'rolling_friction')
    return FAILED if found.identical is False else DONE


def write(found: Replayed, folder: Path, title: str, kind: str) -> list[str]:
    """Write numbers, figure and the input of `identify`; return the names of the files."""
    import yaml

    from ballbot_ros.bags.replay import UNITS
    from ballbot_ros.figures.residuals import departure_figure
    from ballbot_ros.results.files import write_columns, write_json, write_text
    write_json(found.content, folder / 'replay.json')
    files = ['replay.json']
    if found.series:
        figure = departure_figure(found.series, UNITS, f'{title}: recording and model')
        files += save_figure(figure, folder, 'replay', kind)
    if found.files:
        write_columns(found.files['recording.csv'], UNITS, folder / 'recording.csv')
        write_text('# The scene of a recording, for "ballbot identify".\n' + yaml.safe_dump(
            found.files['scene.yaml'], sort_keys=False), folder / 'scene.yaml')
        files += ['recording.csv', 'scene.yaml']
    return files


def replay_simulator(arguments: argparse.Namespace, run: Any, metadata: Any) -> Replayed:
    """Repeat the run, first by its commands, and report whether all states are identical."""
    import numpy as np

    from ballbot_ros.bags.replay import differences, rerun
    from ballbot_ros.nodes.simulator.settings import plant_for
    from ballbot_ros.physics import load_scene
    from ballbot_ros.results.summary import plain
    known = dict(metadata.parameters)
    if 'control_rate' not in known and len(run.stamps) > 2 and known.get('control') != 'onboard':
        steps = [after - before for before, after in zip(run.stamps, run.stamps[1:])]
        known['control_rate'] = round(1e9 / statistics.median(steps), 6)
    settings = parameters_of(arguments, known)
    try:
        scene = load_scene(settings.scene, settings.robot or None)
    except ConfigurationError as error:
        raise error.at(f'scene and robot of {arguments.file} (--scene and --robot replace them)') \
            from error
    remarks = differing(metadata, scene)
    robot = plant_for(settings).model.robot

    def again(by: str) -> Any:
        return rerun(plant_for(settings), run, source(by, run, settings, robot))
    sources = [arguments.by] if arguments.by else [SET_POINTS] if settings.control == 'onboard' \
        else [COMMANDS, TORQUES] if run.commands else [TORQUES]  # the best first
    found = [again(sources[0])]
    # With the motor torque a difference comes from the model, not from the timing of commands.
    if found[0].departure is not None:
        found += [again(by) for by in sources[1:]]
    best = max(found, key=lambda item: item.identical)
    world = f'floor {settings.floor}' if settings.floor else f'scene {settings.scene}'
    lines = [f'simulator, {world}, robot {robot.name}, '
             f'{settings.control_rate:g} Hz', *remarks]
    for item in found:
        lines += report_lines(item)
    series = {name: (np.array(list(values)), np.array(list(values.values())),
                     np.array([best.again[name][time] for time in values]))
              for name, values in best.recorded.items() if len(values) > 1}
    numbers = differences(series)
    if best.departure is not None and numbers:
        lines += ['', difference_table(numbers)]
    identical = best.departure is None and not best.ended
    content = plain({
        'identical': identical, 'remarks': remarks,
        'runs': [{'driven_by': item.what, 'states': item.states, 'identical': item.identical,
                  'applied': item.applied, 'filled': item.filled, 'resets': item.resets,
                  'ended': item.ended,
                  'departure': item.departure and vars(item.departure)} for item in found],
        'differences': [item._asdict() for item in numbers]})
    return Replayed('\n'.join(lines), content, series, identical)


def source(by: str, run: Any, settings: Any, robot: Any) -> Any:
    from ballbot_ros.bags.replay import Commands, Laws, MotorTorques
    from ballbot_ros.control import checked_controller, load_tuning, Supervision
    if by == SET_POINTS:
        return Laws(run, checked_controller(
            robot, load_tuning(settings.tuning), settings.control_rate, 0,
            Supervision(set_point_timeout=settings.set_point_timeout)))
    return Commands(run) if by == COMMANDS else MotorTorques(run)


def differing(metadata: Any, scene: Any) -> list[str]:
    """Return the differences from the inputs of the recording."""
    from ballbot_ros import __version__
    from ballbot_ros.results.digests import scene_digests
    here, lines = scene_digests(scene), []
    for name, what in (('scene', 'terrain, contact or start'),
                       ('robot', 'parameters of the robot')):
        there = metadata.digests.get(name, here[name])
        if there != here[name]:
            lines.append(f'{what} are not those of the recording: digest {here[name]} here, '
                         f'{there} there')
    if metadata.version not in ('', __version__):
        lines.append(f'recorded with version {metadata.version}, this is {__version__}')
    return lines


def report_lines(found: Any) -> list[str]:
    lines = [f'driven by {found.applied} {found.what}'
             + (f'; {found.filled} are missing, replaced by the motor torque'
                if found.filled else '')
             + (f'; {found.resets} resets' if found.resets else '')]
    if found.departure is None:
        lines.append(f'identical: {found.identical} states')
    else:
        first = found.departure
        lines.append(
            f'departs at t = {first.time:.3f} s, after {first.states} identical states: '
            f'{first.channel.replace("_", " ")} {first.recorded!r} in the recording, '
            f'{first.again!r} now; {found.identical} of {found.states} states are identical')
        if not first.states:
            lines.append('the replay starts at the start of the scene: record a simulator that is '
                         'paused (start_paused), or reset the simulator during the recording')
    if found.ended:
        lines.append(f'ended early: {found.ended}')
    return lines


def replay_robot(arguments: argparse.Namespace, run: Any, metadata: Any) -> Replayed:
    """Drive the model by the recorded torque, from the first recorded state, and compare."""
    from ballbot_ros.bags.replay import (
        commanded_torque, differences, driven_series, measured_columns, scene_content)
    from ballbot_ros.physics.simulation.scene import read_scene
    from ballbot_ros.results.summary import plain
    if arguments.set:
        raise ConfigurationError(
            f'--set is for a bag of the simulator; {arguments.file} is of a real robot',
            'wrong_kind', '--set')
    if arguments.by == SET_POINTS:
        raise ConfigurationError(
            '--by set-points is for a bag of the simulator with control:=onboard: the controllers '
            'of a real robot used its own state estimate; use torques', 'wrong_kind', '--by')
    robot = arguments.robot or robot_of(metadata, arguments)
    columns = measured_columns(run)
    by = arguments.by or ('torques' if 'pendulum_torque' in columns else COMMANDS)
    if by == COMMANDS:
        columns['pendulum_torque'] = commanded_torque(run, columns)
    elif 'pendulum_torque' not in columns:
        raise ConfigurationError(
            f'{arguments.file}: its joint_states have no effort; --by commands uses the '
            'commanded torque', 'missing', 'effort')
    content = scene_content(arguments.scene or 'flat', robot, columns)
    scene = read_scene(content, 'scene of the recording', 'recording')
    series = driven_series(scene, columns)
    numbers = differences(series)
    what = 'commanded torque' if by == COMMANDS else 'motor torque of joint_states'
    name = scene.model.robot.name
    words = (f'real robot, {len(columns["time"])} states in {columns["time"][-1]:.3f} s; the '
             f'model is {name} on {arguments.scene or "flat"}, from the first state, under the '
             f'{what}\n\n{difference_table(numbers)}')
    return Replayed(words, plain({
        'identical': None, 'driven_by': by, 'robot': name,
        'states': len(columns['time']), 'duration': float(columns['time'][-1]),
        'differences': [item._asdict() for item in numbers]}), series, None,
        {'recording.csv': columns, 'scene.yaml': content})


def robot_of(metadata: Any, arguments: argparse.Namespace) -> str:
    """Return the robot that the hardware file of a bridge names; empty for that of the scene."""
    hardware = metadata.parameters.get('hardware')
    if not hardware or arguments.scene:
        return ''
    from ballbot_ros.bridge.hardware_file import load_hardware
    return str(load_hardware(str(hardware)).robot)
