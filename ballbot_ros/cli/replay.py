# SPDX-License-Identifier: Apache-2.0
"""The verb ``replay``: run a bag again beside the model, or show what a black box has kept."""
import argparse
from pathlib import Path
from typing import Any

from ballbot_ros.cli.bags import is_bag
from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.options import add_format, add_overwrite, add_quiet
from ballbot_ros.cli.output import result_folder, save_figure
from ballbot_ros.cli.replay_bag import add_bag_options, BAG_OPTIONS, run_bag
from ballbot_ros.errors import ConfigurationError

LONGEST = 600.0  # that can be drawn [s]
BEFORE = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to replay and where numbers and figure go."""
    parser.add_argument('file', type=Path, metavar='FILE',
                        help='ROS 2 bag; or file of a black box, which the bridge writes to '
                        '~/.ros/ballbot (or that folder, for the newest)')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for numbers and figure (default: ballbot_output/replay_BAG '
                        'for a bag that is not identical, else nothing is written)')
    parser.add_argument('--before', type=float, metavar='SECONDS',
                        help='time before the fault to draw, of a black box (default: '
                        f'{BEFORE:g})')
    add_bag_options(parser)
    add_format(parser)
    add_overwrite(parser)
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Replay a bag or a black box, whichever it is."""
    if is_bag(arguments.file):
        if arguments.before is not None:
            raise ConfigurationError(f'--before goes with a black box; {arguments.file} is a bag')
        return run_bag(arguments)
    given = [f'--{name}' for name in BAG_OPTIONS if getattr(arguments, name)]
    if given:
        raise ConfigurationError(
            f'{given[0]} goes with a bag (a folder with metadata.yaml, a file ending in .mcap or '
            f'.db3); {arguments.file} is none')
    return run_black_box(arguments)


def run_black_box(arguments: argparse.Namespace) -> int:
    """Print what happened, and write what is asked for; 1 if the file is damaged."""
    before = BEFORE if arguments.before is None else arguments.before
    if not 0.0 < before <= LONGEST:
        raise ConfigurationError(
            f'--before must be above 0 and at most {LONGEST:g} s, got {before:g}')
    path = newest(arguments.file)
    from ballbot_ros.black_box.reader import read_black_box
    from ballbot_ros.black_box.wording import in_words, write_tables
    if arguments.out is not None:
        result_folder(arguments.out, arguments.out, ('period.csv', 'black_box.png',
                                                     'black_box.svg'), arguments.overwrite)
    recording = read_black_box(path)
    if not arguments.quiet:
        print(f'{path}\n\n{in_words(recording)}')
    if arguments.out is not None:
        files = [file.name for file in write_tables(recording, arguments.out)]
        files += draw(recording, before, arguments)
        if not arguments.quiet:
            print(f'\nWritten to {arguments.out}: {", ".join(files)}')
    return FAILED if recording.damage else DONE


def draw(recording: Any, before: float, arguments: argparse.Namespace) -> list[str]:
    """Write the figure and return the names of its files."""
    from ballbot_ros.figures.black_box import around_fault
    return save_figure(around_fault(recording, before), arguments.out, 'black_box',
                       arguments.format)


def newest(path: Path) -> Path:
    """Return a file, or the newest one in a folder; `ConfigurationError` if it has none."""
    if not path.is_dir():
        return path
    from ballbot_ros.black_box.file import ENDING
    files = sorted(path.glob(f'*{ENDING}'))
    if not files:
        raise ConfigurationError(
            f'{path}: holds no file of a black box (*{ENDING}), and no bag; the bridge writes one '
            'after a fault, see its parameter black_box')
    return files[-1]
