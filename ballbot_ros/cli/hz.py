# SPDX-License-Identifier: Apache-2.0
"""The verb ``hz``: how often messages of a topic come."""
import argparse

from ballbot_ros.cli.command import DONE, FAILED
from ballbot_ros.cli.echo import add_timeout, check_timeout
from ballbot_ros.cli.running_graph import once, tool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add topic and end."""
    parser.add_argument('topic', metavar='TOPIC', help='topic to watch')
    add_timeout(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the rate each second until Ctrl-C; 1 if nothing came until the timeout."""
    check_timeout(arguments)
    waiting = once(f'waiting for messages on {arguments.topic} ...')
    came = False
    rates = tool('topics').rates
    with tool('observer').Observer('hz') as observer:
        try:
            for sentence in rates(observer, arguments.topic, arguments.timeout, waiting):
                came = came or sentence is not None
                if sentence is None:
                    waiting()
                else:
                    print(sentence, flush=True)
        except KeyboardInterrupt:
            return DONE
    return DONE if came else FAILED
