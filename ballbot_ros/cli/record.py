# SPDX-License-Identifier: Apache-2.0
"""The verb ``record``: topics of the running graph into an MCAP bag."""
import argparse
from pathlib import Path
import time

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.running_graph import from_ros, tell, tool
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add topics, folder and end."""
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='topics to record')
    parser.add_argument('-a', '--all', action='store_true',
                        help='record all topics, also those that appear later')
    parser.add_argument('-o', '--output', type=Path, metavar='DIR',
                        help='new folder for the bag (default: bag_DATE_TIME)')
    parser.add_argument('-d', '--duration', type=float, default=float('inf'), metavar='SECONDS',
                        help='end after this long (default: at Ctrl-C)')


def run(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C; 1 if nothing came."""
    if arguments.all == bool(arguments.topics):
        raise ConfigurationError('name the topics to record, or give -a for all')
    if not arguments.duration > 0.0:
        raise ConfigurationError(f'--duration must be above 0 s, got {arguments.duration:g}')
    folder = arguments.output or Path(time.strftime('bag_%Y_%m_%d-%H_%M_%S'))
    recorder = from_ros('ballbot_ros.bags.record')
    recorder.check_new(folder)
    from ballbot_ros.results.files import check_writable
    check_writable(folder.parent / f'{folder.name}.mcap')
    with tool('observer').Observer('record') as observer:
        counts = recorder.record(observer, folder, arguments.topics, arguments.duration, tell)
    for topic, count in sorted(counts.items()):
        print(f'{count:8d}  {topic}')
    print(f'{sum(counts.values())} messages of {len(counts)} topics in {folder}')
    return DONE if counts else FAILED
