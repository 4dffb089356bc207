# SPDX-License-Identifier: Apache-2.0
"""The verb ``view``: a scene, a bag or running nodes in a browser."""
import argparse
from pathlib import Path
from threading import Event
from typing import Any

from ballbot_ros.cli.options import add_number, add_quiet, from_ros, refuse_without, warn
from ballbot_ros.cli.verb import DONE
from ballbot_ros.config.fields import count, quantity
from ballbot_ros.config.optional import load_optional

LOOPBACK = '127.0.0.1'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument('scene', nargs='?', default='voltage_start', metavar='SCENE',
                       help='name of a scene ("ballbot scenes" lists them) or of a floor, a YAML '
                       'file of either, or a bag: its folder or a file ending in .mcap '
                       '(default: %(default)s)')
    shown.add_argument('--live', action='store_true',
                       help='show running nodes instead, a simulator or a bridge; needs ROS')
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help='namespace of the robot, among running nodes or in a bag')
    parser.add_argument('--robot', default='', metavar='NAME',
                        help='robot to draw, if neither the nodes nor the bag name one')
    parser.add_argument('--host', default=LOOPBACK, metavar='ADDRESS',
                        help='address to listen on; any other than the default exposes the page '
                        'and the controls to the network (default: %(default)s)')
    add_number(parser, '--port', 'PORT', count(
        'port to listen on (default: the first free one from 8080 on)', default=None,
        maximum=65535))
    parser.add_argument('--no-browser', action='store_true', help='do not open a browser')
    add_number(parser, '--duration', 'SECONDS', quantity(
        's', 'end after this time (default: at Ctrl-C)', above=0.0, optional=True))
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    load_optional('viser', 'viser', 'pip install "ballbot_ros[view]", or pip install viser')
    return serve(source_of(arguments), arguments, begin=not arguments.live)


def is_floor(name: str) -> bool:
    """Return whether this is a name or file of a floor; a scene of that name has precedence."""
    from ballbot_ros.config.files import (
        find_config, is_path, read_yaml, shipped_files, SIGNATURES)
    if not is_path(name):
        return name in {path.stem for path in shipped_files('floors')} \
            - {path.stem for path in shipped_files('scenes')}
    content = read_yaml(find_config('floors', name)).keys()
    return bool(SIGNATURES['floors'] & content) and not SIGNATURES['scenes'] & content


def source_of(arguments: argparse.Namespace) -> Any:
    """
    Return the source of running nodes, a bag, a floor or a scene.

    Raises `ConfigurationError` for a file that cannot be read, for an option without effect on a
    scene, and for nodes if ROS is missing.
    """
    if arguments.live:
        return from_ros('ballbot_ros.view.live').LiveSource(arguments.namespace, arguments.robot)
    path = Path(arguments.scene)
    if path.suffix == '.mcap' or path.is_dir():
        module = load_optional('ballbot_ros.view.bag_source', 'rosbags', 'pip install rosbags')
        return module.BagSource(path, arguments.namespace, arguments.robot, paused=True)
    refuse_without(arguments, 'a bag or --live; the page has a choice of robots for a scene',
                   False, '--namespace', '--robot')
    if is_floor(arguments.scene):
        from ballbot_ros.view.floor_source import FloorSource
        return FloorSource(arguments.scene)
    from ballbot_ros.view.scene_source import SceneSource
    return SceneSource(arguments.scene)


def serve(source: Any, arguments: argparse.Namespace, begin: bool) -> int:
    """Serve a page for a source until the duration ends, and close it; Ctrl-C raises."""
    from ballbot_ros.view.page import Page
    from ballbot_ros.view.server import free_port, PageServer
    if arguments.host not in (LOOPBACK, 'localhost', '::1'):
        warn([f'with --host {arguments.host} everyone on the network can see the page and drive '
              'the robot; there is no password'])
    server = PageServer(arguments.host, free_port(arguments.host, arguments.port))
    page = Page(source, server, begin)
    try:
        page.start()
        if not arguments.quiet:
            print(f'{page.url}  (Ctrl-C ends)', flush=True)
        if not arguments.no_browser:
            import webbrowser
            webbrowser.open(page.url)
        Event().wait(arguments.duration)
    finally:
        page.close()
    return DONE
