# SPDX-License-Identifier: Apache-2.0
"""What the verbs ``engage-e-stop`` and ``release-e-stop`` do."""
import argparse

from ballbot_ros.cli.command import DONE, FAILED, print_error
from ballbot_ros.cli.running_graph import tool
from ballbot_ros.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add whose e-stop, and how long is waited for it."""
    parser.add_argument('--node', default='bridge', metavar='NAME',
                        help='node that has the e-stop, with its namespace (default: %(default)s)')
    parser.add_argument('--timeout', type=float, default=5.0, metavar='SECONDS',
                        help='how long to wait for the node and its answer (default: %(default)g)')


def call(arguments: argparse.Namespace, verb: str) -> int:
    """Call a service of the node and print what it says; 1 if it refuses."""
    if not 0.0 < arguments.timeout < float('inf'):
        raise ConfigurationError(
            f'--timeout must be above 0 s and finite, got {arguments.timeout:g}')
    trigger = tool('e_stop').trigger
    with tool('observer').Observer(verb) as observer:
        answer = trigger(observer, arguments.node, verb, arguments.timeout)
    if not answer.success:
        print_error(answer.message)
        return FAILED
    print(answer.message or 'done')
    return DONE
