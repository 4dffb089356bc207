# SPDX-License-Identifier: Apache-2.0
"""The verb ``echo``: messages of a topic as they come."""
import argparse

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.running_graph import once, tell, tool
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add topic, form and end."""
    parser.add_argument('topic', metavar='TOPIC', help='topic to print')
    parser.add_argument('--once', action='store_true', help='end after the first message')
    parser.add_argument('--csv', action='store_true',
                        help='print the values of a message on one line, without their names')
    add_timeout(parser)


def add_timeout(parser: argparse.ArgumentParser) -> None:
    """Add after how long it ends."""
    parser.add_argument('--timeout', type=float, default=float('inf'), metavar='SECONDS',
                        help='end after this long (default: never)')


def check_timeout(arguments: argparse.Namespace) -> None:
    """Refuse a timeout that is no time."""
    if not arguments.timeout > 0.0:
        raise ConfigurationError(f'--timeout must be above 0 s, got {arguments.timeout:g}')


def run(arguments: argparse.Namespace) -> int:
    """Print until Ctrl-C; 1 if nothing came until the timeout."""
    check_timeout(arguments)
    topics = tool('topics')
    form = topics.as_csv if arguments.csv else topics.as_yaml
    shown = 0
    with tool('observer').Observer('echo') as observer:
        try:
            shown = topics.echo(
                observer, arguments.topic, lambda message: print(form(message), flush=True),
                arguments.once, arguments.timeout,
                once(f'waiting for a message on {arguments.topic} ...'))
        except KeyboardInterrupt:
            return DONE
    if not shown:
        tell(f'no message on {arguments.topic} within {arguments.timeout:g} s')
    return DONE if shown else FAILED
