# SPDX-License-Identifier: Apache-2.0
"""The verbs for a running graph: topics, echo, hz, record, and the e-stop of a node."""
import argparse
from functools import cache, partial
import math
from pathlib import Path
import time
from typing import Callable

from ballbot_ros.cli.options import add_number, from_ros
from ballbot_ros.cli.verb import DONE, FAILED, note, print_error, Verb
from ballbot_ros.config.fields import quantity
from ballbot_ros.errors import ConfigurationError


def note_once(sentence: str) -> Callable[[], None]:
    """Return a function that prints a note at its first call."""
    return cache(partial(note, sentence))


def add_topics(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('-t', '--show-types', action='store_true', help='also print the types')
    parser.add_argument('-v', '--verbose', action='store_true',
                        help='also print types and numbers of publishers and subscribers')


def list_topics(arguments: argparse.Namespace) -> int:
    """Print a line per topic."""
    graph = from_ros()
    with graph.Observer('topics') as observer:
        found = graph.topics(observer)
    width = max((len(topic.name) for topic in found), default=0)
    for topic in found:
        types = f'[{", ".join(topic.types)}]'
        if arguments.verbose:
            print(f'{topic.name:<{width}}  {types}  publishers: {topic.publishers}, '
                  f'subscribers: {topic.subscribers}')
        else:
            print(f'{topic.name} {types}' if arguments.show_types else topic.name)
    if not found:
        note('no topics: no node runs in this ROS_DOMAIN_ID, or discovery is limited '
             '(docs/security.md)')
    return DONE


def add_echo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('topic', metavar='TOPIC', help='topic to print')
    parser.add_argument('--once', action='store_true', help='end after the first message')
    parser.add_argument('--csv', action='store_true',
                        help='print the values of a message on one line, without their names')
    add_timeout(parser)


def add_timeout(parser: argparse.ArgumentParser) -> None:
    add_number(parser, '--timeout', 'SECONDS', quantity(
        's', 'end after this time (default: never)', above=0.0, optional=True))


def echo(arguments: argparse.Namespace) -> int:
    """Print messages until Ctrl-C; return 1 if none arrived before the timeout."""
    graph, timeout = from_ros(), arguments.timeout or math.inf
    form = graph.as_csv if arguments.csv else graph.as_yaml
    with graph.Observer('echo') as observer:
        shown = graph.echo(
            observer, arguments.topic, lambda message: print(form(message), flush=True),
            arguments.once, timeout,
            note_once(f'waiting for a message on {arguments.topic} ...'))
    if not shown:
        note(f'no message on {arguments.topic} within {timeout:g} s')
    return DONE if shown else FAILED


def add_hz(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('topic', metavar='TOPIC', help='topic to measure')
    add_timeout(parser)


def hz(arguments: argparse.Namespace) -> int:
    """Print the rate each second until Ctrl-C; return 1 if no message arrived in time."""
    waiting = note_once(f'waiting for messages on {arguments.topic} ...')
    received = False
    graph = from_ros()
    with graph.Observer('hz') as observer:
        for sentence in graph.rates(
                observer, arguments.topic, arguments.timeout or math.inf, waiting):
            received = received or sentence is not None
            if sentence is None:
                waiting()
            else:
                print(sentence, flush=True)
    return DONE if received else FAILED


def add_record(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('topics', nargs='*', metavar='TOPIC', help='topics to record')
    parser.add_argument('-a', '--all', action='store_true',
                        help='record all topics, including those that appear later')
    parser.add_argument('-o', '--output', type=Path, metavar='DIR',
                        help='new folder for the bag (default: bag_DATE_TIME)')
    add_number(parser, '--duration', 'SECONDS', quantity(
        's', 'end after this time (default: at Ctrl-C)', above=0.0, optional=True), '-d')


def record(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C or the end of the duration; return 1 if no message arrived."""
    if arguments.all == bool(arguments.topics):
        raise ConfigurationError('name the topics to record, or give -a for all', 'missing',
                                 'TOPIC')
    folder = arguments.output or Path(time.strftime('bag_%Y_%m_%d-%H_%M_%S'))
    if folder.exists():  # the bag would replace it
        raise ConfigurationError(
            f'{folder} exists already; name another folder with -o, or remove it', 'exists', '-o')
    recorder = from_ros('ballbot_ros.bags.record')
    from ballbot_ros.results.files import check_writable
    check_writable(folder.parent / f'{folder.name}.mcap')
    with from_ros().Observer('record') as observer:
        counts = recorder.record(observer, folder, arguments.topics,
                                 arguments.duration or math.inf, note)
    for topic, count in sorted(counts.items()):
        print(f'{count:8d}  {topic}')
    print(f'{sum(counts.values())} messages of {len(counts)} topics in {folder}')
    return DONE if counts else FAILED


def add_e_stop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--node', default='bridge', metavar='NAME',
                        help='node with the e-stop, and its namespace (default: %(default)s)')
    add_number(parser, '--timeout', 'SECONDS', quantity(
        's', 'longest time to wait for the node and its reply', default=5.0, above=0.0))


def call_e_stop(arguments: argparse.Namespace, service: str) -> int:
    """Call a service of the node and print its reply; return 1 if the node refuses."""
    graph = from_ros()
    with graph.Observer(service) as observer:
        success, message = graph.trigger(observer, arguments.node, service, arguments.timeout)
    if not success:
        print_error(message)
        return FAILED
    print(message or 'done')
    return DONE


TOPICS, ECHO, HZ = Verb(add_topics, list_topics), Verb(add_echo, echo), Verb(add_hz, hz)
RECORD = Verb(add_record, record)
ENGAGE = Verb(add_e_stop, lambda arguments: call_e_stop(arguments, 'engage_e_stop'))
RELEASE = Verb(add_e_stop, lambda arguments: call_e_stop(arguments, 'release_e_stop'))
