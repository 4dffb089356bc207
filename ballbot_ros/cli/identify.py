# SPDX-License-Identifier: Apache-2.0
"""The verb ``identify``: estimate numbers of a robot from a recorded run."""
import argparse
from pathlib import Path
import sys
from typing import Any

from ballbot_ros.cli.command import DONE
from ballbot_ros.cli.options import add_quiet
from ballbot_ros.cli.output import save_figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add scene, recording and what to estimate."""
    parser.add_argument('scene', metavar='SCENE',
                        help='what was run: name of a scene or a YAML file, with the best guess '
                        'of all numbers')
    parser.add_argument('data', type=Path, metavar='DATA',
                        help='what was measured: a CSV or NPZ file with columns such as "time '
                        '[s]" and "joint_angle [rad]", or a ROS 2 bag')
    parser.add_argument('--estimate', nargs='+', required=True, metavar='NUMBER',
                        help='fields of the robot, or motor. or initial. and a field of those')
    parser.add_argument('--channels', nargs='+', metavar='NAME',
                        help='compare only these (default: all that there are)')
    parser.add_argument('--recorded-torque', action='store_true',
                        help='apply the torque in the recording, not the law of the scene')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for the files (default: ballbot_output/identify_SCENE)')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Estimate, write the files and print the table."""
    import json
    from ballbot_ros.cli.listing import check_name
    from ballbot_ros.figures.residuals import residual_figure
    from ballbot_ros.physics import load_scene
    from ballbot_ros.results.files import check_writable, read_columns, write_text
    from ballbot_ros.results.summary import plain
    from ballbot_ros.studies.identification import identify
    from ballbot_ros.studies.recording import CHANNELS, Recording
    check_name('scenes', arguments.scene)
    scene = load_scene(arguments.scene)
    if arguments.data.suffix in ('.csv', '.npz'):
        recording = Recording.of_columns(read_columns(arguments.data))
    else:
        from ballbot_ros.cli.bags import bag_opener
        from ballbot_ros.studies.bag_reader import read_bag
        recording = read_bag(arguments.data, bag_opener())
    if arguments.channels:
        recording = recording.only(arguments.channels)
    folder = arguments.out or Path('ballbot_output') / f'identify_{scene.name}'
    check_writable(folder / 'identify.json')
    verbose = not (arguments.quiet or arguments.json)
    if verbose:
        print('fitting; some hundred simulations, Ctrl-C ends it', file=sys.stderr, flush=True)
    found = identify(scene, recording, arguments.estimate, arguments.recorded_torque)
    content = {
        'estimates': [plain(item._asdict()) for item in found.estimates],
        'vague': found.vague, 'rivals': found.rivals, 'noise': found.noise,
        'singular_values': found.singular_values, 'simulations': found.runs}
    text = json.dumps(content, indent=2, allow_nan=False)
    write_text(text + '\n', folder / 'identify.json')
    figure = residual_figure(
        {name: (recording.channels[name][0], values) for name, values in found.residuals.items()},
        CHANNELS, found.noise, f'{scene.name}: simulated less measured')
    files = ['identify.json', *save_figure(figure, folder, 'residuals')]
    if arguments.json:
        print(text)
    elif verbose:
        print_table(found)
        print(f'\nWritten to {folder}: {", ".join(files)}')
    return DONE


def print_table(found: Any) -> None:
    """Print numbers with their intervals, and what the data do not determine."""
    print(f'{"number":<24}{"guess":>12}{"estimate":>12}   95 % interval')
    for item in found.estimates:
        interval = f'{item.low:.5g} to {item.high:.5g} {item.unit}' if item.determined \
            else 'not determined by these data'
        print(f'{item.name:<24}{item.start:>12.5g}{item.value:>12.5g}   {interval}')
    for combination in found.vague:
        parts = ', '.join(f'{name} {part:+.2g}' for name, part in combination.items())
        print(f'nothing in the data shows a change of: {parts} (relative, together)')
    for rival in found.rivals:
        parts = ', '.join(f'{name} {value:.5g}' for name, value in rival.items())
        print(f'as good an explanation, far away: {parts}')
    print('scatter: ' + ', '.join(f'{name} {value:.3g}' for name, value in found.noise.items()))
