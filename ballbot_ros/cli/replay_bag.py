# SPDX-License-Identifier: Apache-2.0
"""Replay a bag: bit for bit where the simulator made it, beside the model where a robot did."""
import argparse
import math
from pathlib import Path
from typing import Any, NamedTuple, Optional

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.output import print_json, save_figure
from ballbot_ros.errors import ConfigurationError

BAG_OPTIONS = ('scene', 'robot', 'set', 'namespace', 'by', 'json')
# Where the torque comes from; the words of --by.
COMMANDS, TORQUES, SET_POINTS = 'commands', 'torques', 'set-points'


def add_bag_options(parser: argparse.ArgumentParser) -> None:
    """Add what a bag may not say itself."""
    parser.add_argument('--scene', metavar='NAME',
                        help='of a bag, what was run: name of a scene or a YAML file (default: '
                        'what the bag says; flat for a real robot)')
    parser.add_argument('--robot', metavar='NAME',
                        help='of a bag, the robot (default: that of the bag or the scene)')
    parser.add_argument('--set', action='append', metavar='NAME=VALUE',
                        help='of a bag, a parameter of its simulator that it does not say')
    parser.add_argument('--namespace', metavar='NAME', help='of a bag with several robots, which')
    parser.add_argument('--by', choices=(COMMANDS, TORQUES, SET_POINTS),
                        help='of a bag, what drives the model: joint_commands, what the motor '
                        'gave by joint_states, or set_point and cmd_vel through the laws on board')
    parser.add_argument('--json', action='store_true', help='of a bag, print the result as JSON')


class Outcome(NamedTuple):
    """What a replay found; `identical` is None where there is nothing to be identical with."""

    words: str
    content: dict[str, Any]
    series: Any
    identical: Optional[bool]
    files: dict[str, Any] = {}  # for identify, by name


def run_bag(arguments: argparse.Namespace) -> int:
    """Replay, print, and write what is worth it; 1 for a simulated run that departs."""
    from ballbot_ros.cli.bags import bag_opener
    from ballbot_ros.cli.replay_robot import replay_robot
    from ballbot_ros.cli.replay_simulator import replay_simulator
    from ballbot_ros.results.bag_metadata import BagMetadata, BRIDGE
    from ballbot_ros.results.files import check_writable
    from ballbot_ros.studies.recorded_run import read_run
    path = arguments.file
    bag = path.resolve()
    # A bag is often called "bag": the folder it is in says more.
    name = bag.parent.name if bag.stem == 'bag' and bag.is_dir() else bag.stem
    folder = arguments.out or Path('ballbot_output') / f'replay_{name}'
    check_writable(folder / 'replay.json')
    run = read_run(path, arguments.namespace, bag_opener())
    metadata = BagMetadata.read(run.metadata)
    real = metadata.source == BRIDGE or not run.balls
    found: Outcome = (replay_robot if real else replay_simulator)(arguments, run, metadata)
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
                print('To fit the model to it, for instance: ballbot identify '
                      f'{folder}/scene.yaml {folder}/recording.csv --recorded-torque --estimate '
                      'joint_friction rolling_friction')
    return FAILED if found.identical is False else DONE


def write(found: Outcome, folder: Path, title: str, kind: str) -> list[str]:
    """Write numbers, figure and what `identify` takes, and return the names of the files."""
    import json
    import yaml
    from ballbot_ros.figures.departures import departure_figure
    from ballbot_ros.results.files import write_columns, write_text
    from ballbot_ros.studies.departures import UNITS
    write_text(json.dumps(found.content, indent=2, allow_nan=False) + '\n',
               folder / 'replay.json')
    files = ['replay.json']
    if found.series:
        figure = departure_figure(found.series, UNITS, f'{title}: recording and model')
        files += save_figure(figure, folder, 'replay', kind)
    if found.files:
        write_columns(found.files['recording.csv'], {**UNITS, 'time': 's'},
                      folder / 'recording.csv')
        write_text('# The scene of a recording, for "ballbot identify".\n' + yaml.safe_dump(
            found.files['scene.yaml'], sort_keys=False), folder / 'scene.yaml')
        files += ['recording.csv', 'scene.yaml']
    return files


def table(found: list[Any]) -> str:
    """Return the differences of all channels as lines."""
    lines = [f'{"channel":<16}{"RMS":>11}{"largest":>11}       {"at":>8}   of its span   departs']
    for item in found:
        share = f'{100.0 * item.largest / item.span:.1f} %' if item.span > 0.0 else '-'
        departs = 'never' if math.isnan(item.departs) else f'at {item.departs:.3f} s'
        lines.append(f'{item.channel:<16}{item.rms:>11.3g}{item.largest:>11.3g} {item.unit:<6}'
                     f'{item.when:>6.3f} s   {share:>11}   {departs}')
    return '\n'.join(lines)


def parameters_of(arguments: argparse.Namespace, known: dict[str, Any]) -> Any:
    """
    Return the parameters of the simulator of a bag.

    Raises
    ------
    ConfigurationError
        If no scene is known, or a parameter is unknown or out of range.

    """
    import yaml
    from ballbot_ros.ros.settings import SimulatorSettings
    given = dict(known)
    for words in arguments.set or ():
        name, sign, text = words.partition('=')
        if not sign:
            raise ConfigurationError(f'--set takes NAME=VALUE, got {words!r}')
        given[name] = yaml.safe_load(text)
    given.update({name: getattr(arguments, name) for name in ('scene', 'robot')
                  if getattr(arguments, name)})
    if 'scene' not in given:
        raise ConfigurationError(
            f'{arguments.file} does not say which scene it is of: give it, --scene NAME, and '
            'where they are not the defaults --robot NAME and --set NAME=VALUE for parameters of '
            'the simulator')
    return SimulatorSettings.from_mapping(given, 'parameters of the simulator')
