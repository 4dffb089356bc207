# SPDX-License-Identifier: Apache-2.0
"""Replay a bag: bit for bit where the simulator made it, beside the model where a robot did."""
import argparse
from pathlib import Path

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.output import figure_files, print_json, result_folder, save_figure
from ballbot_ros.cli.replayed import COMMANDS, Replayed, SET_POINTS, TORQUES

BAG_OPTIONS = ('scene', 'robot', 'set', 'namespace', 'by', 'json')


def add_bag_options(parser: argparse.ArgumentParser) -> None:
    """Add what a bag may not say itself."""
    parser.add_argument('--scene', metavar='NAME',
                        help='scene that was run, a name or a YAML file (default: what the bag '
                        'says; flat for a real robot)')
    parser.add_argument('--robot', metavar='NAME',
                        help='robot that was run, a name or a YAML file (default: that of the bag '
                        'or the scene)')
    parser.add_argument('--set', action='append', metavar='NAME=VALUE',
                        help='parameter of the simulator that the bag does not say; may be '
                        'repeated')
    parser.add_argument('--namespace', metavar='NAME',
                        help='robot to replay from a bag with several')
    parser.add_argument('--by', choices=(COMMANDS, TORQUES, SET_POINTS),
                        help='what drives the model: commands, those on joint_commands; torques, '
                        'those of joint_states; set-points, set_point and cmd_vel through the '
                        'laws on board')
    parser.add_argument('--json', action='store_true', help='print the result for a bag as JSON')


def run_bag(arguments: argparse.Namespace) -> int:
    """Replay, print, and write what is worth it; 1 for a simulated run that departs."""
    from ballbot_ros.bags.metadata import BagMetadata, BRIDGE
    from ballbot_ros.bags.recorded_run import read_run
    from ballbot_ros.cli.bags import bag_opener
    from ballbot_ros.cli.replay_robot import replay_robot
    from ballbot_ros.cli.replay_simulator import replay_simulator
    path = arguments.file
    bag = path.resolve()
    # A bag is often called "bag": the folder it is in says more.
    name = bag.parent.name if bag.stem == 'bag' and bag.is_dir() else bag.stem
    folder = result_folder(arguments.out, Path('ballbot_output') / f'replay_{name}', (
        'replay.json', 'scene.yaml', 'recording.csv', *figure_files(['replay'])),
        arguments.overwrite)
    run = read_run(path, arguments.namespace, bag_opener())
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
                print('To fit the model to it, for instance: ballbot identify '
                      f'{folder}/scene.yaml {folder}/recording.csv --recorded-torque --estimate '
                      'joint_friction rolling_friction')
    return FAILED if found.identical is False else DONE


def write(found: Replayed, folder: Path, title: str, kind: str) -> list[str]:
    """Write numbers, figure and what `identify` takes, and return the names of the files."""
    import json

    import yaml

    from ballbot_ros.bags.departures import UNITS
    from ballbot_ros.figures.departures import departure_figure
    from ballbot_ros.results.files import write_columns, write_text
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
