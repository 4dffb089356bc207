# SPDX-License-Identifier: Apache-2.0
"""The verb ``topics``: what is published and subscribed to in the running graph."""
import argparse

from ballbot_ros.cli.command import DONE
from ballbot_ros.cli.running_graph import tell, tool


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what is shown."""
    parser.add_argument('-t', '--show-types', action='store_true', help='print their types, too')
    parser.add_argument('-v', '--verbose', action='store_true',
                        help='print their types, and how many publish and subscribe')


def run(arguments: argparse.Namespace) -> int:
    """Print a line per topic."""
    listed = tool('topics').topics
    with tool('observer').Observer('topics') as observer:
        found = listed(observer)
    width = max((len(topic.name) for topic in found), default=0)
    for topic in found:
        types = f'[{", ".join(topic.types)}]'
        if arguments.verbose:
            print(f'{topic.name:<{width}}  {types}  publishers: {topic.publishers}, '
                  f'subscribers: {topic.subscribers}')
        else:
            print(f'{topic.name} {types}' if arguments.show_types else topic.name)
    if not found:
        tell('no topics: no node is running in this ROS_DOMAIN_ID, or none can be found from '
             'here (docs/security.md)')
    return DONE
