# SPDX-License-Identifier: Apache-2.0
"""The verb ``replay``: what the black box of the bridge has kept of a fault."""
import argparse
from pathlib import Path
from typing import Any

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.options import add_format, add_quiet
from ballbot_ros.cli.output import save_figure
from ballbot_ros.errors import ConfigurationError

LONGEST = 600.0  # that can be drawn [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the file and where numbers and figure go."""
    parser.add_argument('file', type=Path, metavar='FILE',
                        help='that the bridge wrote, in ~/.ros/ballbot by default; of a folder '
                        'the newest')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='write CSV files, the traffic as a capture, and the figure here')
    parser.add_argument('--before', type=float, default=5.0, metavar='SECONDS',
                        help='drawn before the fault (default: %(default)g)')
    add_format(parser)
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print what happened, and write what is asked for; 1 if the file is damaged."""
    if not 0.0 < arguments.before <= LONGEST:
        raise ConfigurationError(
            f'--before must be above 0 and at most {LONGEST:g} s, got {arguments.before:g}')
    path = newest(arguments.file)
    from ballbot_ros.results.black_box import read_black_box
    from ballbot_ros.results.black_box_wording import in_words, write_tables
    from ballbot_ros.results.files import check_writable
    if arguments.out is not None:
        check_writable(arguments.out / 'period.csv')
    recording = read_black_box(path)
    if not arguments.quiet:
        print(f'{path}\n\n{in_words(recording)}')
    if arguments.out is not None:
        files = [file.name for file in write_tables(recording, arguments.out)]
        files += draw(recording, arguments)
        if not arguments.quiet:
            print(f'\nWritten to {arguments.out}: {", ".join(files)}')
    return FAILED if recording.damage else DONE


def draw(recording: Any, arguments: argparse.Namespace) -> list[str]:
    """Write the figure and return the names of its files."""
    from ballbot_ros.figures.black_box import around_fault
    return save_figure(around_fault(recording, arguments.before), arguments.out, 'black_box',
                       arguments.format)


def newest(path: Path) -> Path:
    """Return a file, or the newest one in a folder; `ConfigurationError` if it has none."""
    if not path.is_dir():
        return path
    from ballbot_ros.bridge.black_box_file import ENDING
    files = sorted(path.glob(f'*{ENDING}'))
    if not files:
        raise ConfigurationError(
            f'{path}: holds no file of a black box (*{ENDING}); the bridge writes one after a '
            'fault, see its parameter black_box')
    return files[-1]
