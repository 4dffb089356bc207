# SPDX-License-Identifier: Apache-2.0
"""The verb ``identify``: estimate parameters of a robot from a recorded run."""
import argparse
from pathlib import Path
import shlex
from typing import Any, Iterator

from ballbot_ros.cli.options import add_out, add_quiet, warn
from ballbot_ros.cli.output import figure_files, print_json, result_folder, save_figure, watched
from ballbot_ros.cli.verb import DONE, FAILED, INTERRUPTED, print_error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('scene', metavar='SCENE',
                        help='scene of the recording: a name or a YAML file, with the best guess '
                        'of all parameters')
    parser.add_argument('data', type=Path, metavar='DATA',
                        help='measurements: a CSV, NPZ or Parquet file with columns such as '
                        '"time [s]" and "joint_angle [deg]", or a ROS 2 bag')
    parser.add_argument('--estimate', nargs='+', required=True, metavar='PARAMETER',
                        help='parameters to estimate: fields of the robot such as '
                        'joint_friction, or motor.NAME or initial.NAME')
    parser.add_argument('--channels', nargs='+', metavar='NAME',
                        help='channels of the recording to compare (default: all)')
    parser.add_argument('--recorded-torque', action='store_true',
                        help='apply the torque of the recording instead of the law of the scene')
    add_out(parser, 'identify_SCENE')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.figures.residuals import residual_figure
    from ballbot_ros.physics import load_scene
    from ballbot_ros.results.files import read_columns, READERS, write_json
    from ballbot_ros.studies.identification import FIT_COUNT, identify
    from ballbot_ros.studies.recording import Recording
    scene = load_scene(arguments.scene)
    if arguments.data.suffix.lower() in READERS:
        recording = Recording.of_columns(read_columns(arguments.data))
    else:
        from ballbot_ros.bags.recorded_run import read_run
        from ballbot_ros.bags.replay import measured_columns
        recording = Recording.of_columns(measured_columns(read_run(arguments.data)))
    if arguments.channels:
        recording = recording.only(arguments.channels)
    folder = result_folder(
        arguments.out, f'identify_{scene.name}',
        ('identify.json', *figure_files(['residuals'])), arguments.overwrite)
    with watched(FIT_COUNT, arguments.quiet or arguments.json, 'fitting:', 'fits') as progress:
        found = identify(scene, recording, arguments.estimate, arguments.recorded_torque, progress)
    content = content_of(found)
    write_json(content, folder / 'identify.json')
    figure = residual_figure(
        {name: (recording.channels[name][0], values) for name, values in found.residuals.items()},
        found.channels, f'{scene.name}: simulated minus measured',
        command_of(arguments))
    files = ['identify.json', *save_figure(figure, folder, 'residuals')]
    if arguments.json:
        print_json(content)
    elif not arguments.quiet:
        print_table(found)
        print(f'\nWritten to {folder}: {", ".join(files)}')
    warn(content['warnings'])
    poor = [name for name, item in found.channels.items() if item.verdict == 'poor']
    if poor:
        print_error(f'the model does not fit {", ".join(poor)}: no parameter is estimated; '
                    'check that the scene has the initial state and law of the recording')
        return FAILED
    if found.interrupted:
        print_error(f'interrupted; the best values so far are in {folder}')
        return INTERRUPTED
    return DONE


def command_of(arguments: argparse.Namespace) -> str:
    """Return the command that draws the figure again, for its caption."""
    words = ['ballbot', 'identify', arguments.scene, str(arguments.data), '--estimate',
             *arguments.estimate]
    if arguments.channels:
        words += ['--channels', *arguments.channels]
    return shlex.join(words + ['--recorded-torque'] * arguments.recorded_torque)


def content_of(found: Any) -> dict[str, Any]:
    """Return the result as JSON values."""
    from ballbot_ros.results.summary import plain
    from ballbot_ros.results.units import SI
    return {
        'estimates': [plain(item._asdict()) for item in found.estimates],
        'vague': found.vague, 'rivals': found.rivals,
        'channels': {name: {**plain(item._asdict()), 'unit': SI[name]}
                     for name, item in found.channels.items()},
        'warnings': list(warnings_of(found)), 'interrupted': found.interrupted,
        'singular_values': found.singular_values, 'simulations': found.runs}


def warnings_of(found: Any) -> Iterator[str]:
    """Yield warnings about the fit, a sentence per channel."""
    from ballbot_ros.results.units import SI
    for name, item in found.channels.items():
        unit = SI[name]
        if item.verdict == 'poor':
            yield (f'{name}: poor fit, residual RMS {item.residual_rms:.3g} {unit}, while the '
                   f'channel varies by {item.motion:.3g} {unit}')
        elif item.verdict == 'correlated':
            samples = len(found.residuals[name])
            yield (f'{name}: residuals are correlated (RMS {item.residual_rms:.3g} {unit}; '
                   f'effective sample size {samples / item.correlation:.0f} of {samples}): the '
                   'model is incomplete; the intervals are widened, and may still be too '
                   'narrow')


def print_table(found: Any) -> None:
    """Print parameters with their intervals, and those that are not identifiable."""
    from ballbot_ros.results.units import SI
    from ballbot_ros.table import table
    print(table([('parameter', 'guess', 'estimate', '95 % interval'), *(
        (item.name, f'{item.start:.5g}', f'{item.value:.5g}',
         f'{item.low:.7g} to {item.high:.7g} {item.unit}' if item.determined
         else 'not determined by these data') for item in found.estimates)]))
    for combination in found.vague:
        parts = ', '.join(f'{name} {part:+.2g}' for name, part in combination.items())
        print(f'not identifiable from these data: {parts} (relative changes, together)')
    for rival in found.rivals:
        parts = ', '.join(f'{name} {value:.5g}' for name, value in rival.items())
        print(f'other values that fit equally well: {parts}')
    print('residual RMS: ' + ', '.join(
        f'{name} {item.residual_rms:.3g} {SI[name]}'
        for name, item in found.channels.items()))
