# SPDX-License-Identifier: Apache-2.0
"""The verb ``view``: a scene, a bag or running nodes in a browser."""
import argparse
from pathlib import Path
import sys
from threading import Event
from typing import Optional

from ballbot_ros.cli.command import DONE
from ballbot_ros.cli.options import add_number, add_quiet
from ballbot_ros.config.fields import count, quantity
from ballbot_ros.errors import ConfigurationError

LOOPBACK = '127.0.0.1'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('scene', nargs='?', default='voltage_start', metavar='SCENE',
                        help='name of a scene ("ballbot scenes" lists them) or of a floor, a YAML '
                        'file of either, or a bag: its folder or a file ending in .mcap '
                        '(default: %(default)s)')
    parser.add_argument('--live', action='store_true',
                        help='show running nodes instead, a simulator or a bridge; needs ROS')
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help='namespace of the robot, among running nodes or in a bag')
    parser.add_argument('--robot', default='', metavar='NAME',
                        help='robot to draw, if neither nodes nor bag name it')
    add_server(parser)
    add_quiet(parser)


def add_server(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--host', default=LOOPBACK, metavar='ADDRESS',
                        help='address to listen on; any but the default opens the page and the '
                        'controls to the network (default: %(default)s)')
    add_number(parser, '--port', 'PORT', count(
        'port to listen on (default: the first free one from 8080 on)', default=None,
        maximum=65535))
    parser.add_argument('--no-browser', action='store_true', help='open no browser')
    add_number(parser, '--duration', 'SECONDS', quantity(
        's', 'end after this time (default: at Ctrl-C)', above=0.0, optional=True))


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    check(arguments)
    source = other_source(arguments)
    if source is not None:
        return serve(source, arguments, begin=not arguments.live)
    if is_floor(arguments.scene):
        from ballbot_ros.view.floor_source import FloorSource
        return serve(FloorSource(arguments.scene), arguments, begin=True)
    from ballbot_ros.view.scene_source import SceneSource
    return serve(SceneSource(arguments.scene, paused=True), arguments, begin=True)


def is_floor(name: str) -> bool:
    """Return whether this is the name or the file of a floor; a scene of the name is first."""
    from ballbot_ros.config.files import (
        find_config, is_path, read_yaml, shipped_files, SIGNATURES)
    if not is_path(name):
        return name in {path.stem for path in shipped_files('floors')} \
            - {path.stem for path in shipped_files('scenes')}
    content = read_yaml(find_config('floors', name)).keys()
    return bool(SIGNATURES['floors'] & content) and not SIGNATURES['scenes'] & content


def other_source(arguments: argparse.Namespace) -> Optional[object]:
    """
    Return the source of a bag or of running nodes, None for a scene.

    Raises
    ------
    ConfigurationError
        For a bag that cannot be read, an option without effect on a scene, and if ROS is missing
        for nodes.

    """
    path = Path(arguments.scene)
    if arguments.live:
        try:
            from ballbot_ros.view.live import LiveSource
        except ImportError as error:
            raise ConfigurationError(
                f'--live needs ROS 2, and {error.name or error} cannot be imported; source '
                '/opt/ros/jazzy/setup.bash, or run it in the .venv of a checkout',
                'not_installed', 'ROS') from error
        return LiveSource(arguments.namespace, arguments.robot)
    if path.suffix == '.mcap' or path.is_dir():
        try:
            from ballbot_ros.view.bag_source import BagSource
        except ImportError as error:
            raise ConfigurationError(
                f'a bag needs the package rosbags, and {error.name or error} cannot be imported; '
                'install it with: pip install rosbags', 'not_installed', 'rosbags') from error
        return BagSource(path, arguments.namespace, arguments.robot, paused=True)
    for option in ('namespace', 'robot'):
        if getattr(arguments, option):
            raise ConfigurationError(
                f'--{option} requires a bag or --live; the page has a choice of robots for a '
                'scene', 'inconsistent', f'--{option}')
    return None


def check(arguments: argparse.Namespace) -> None:
    """
    Refuse a missing package.

    Raises
    ------
    ConfigurationError
        Naming the option, or the package that is missing.

    """
    from importlib.util import find_spec
    if find_spec('viser') is None:
        raise ConfigurationError(
            'the page needs the package viser, which is not installed; install it with: '
            'pip install "ballbot_ros[view]", or pip install viser', 'not_installed', 'viser')


def serve(source: object, arguments: argparse.Namespace, begin: bool) -> int:
    """
    Serve a page for a source until the end of its duration, return 0; Ctrl-C raises.

    Parameters
    ----------
    source : Source
        Of `ballbot_ros.view.source`; ended here.
    arguments : namespace
        With the options of `add_server`, checked.
    begin : bool
        See `Page`.

    """
    from ballbot_ros.view.page import Page
    from ballbot_ros.view.server import free_port, PageServer
    if arguments.host not in (LOOPBACK, 'localhost', '::1'):
        print(f'Warning: with --host {arguments.host} everyone in the network can see the page '
              'and drive the robot; there is no password', file=sys.stderr)
    server = PageServer(arguments.host, free_port(arguments.host, arguments.port))
    page = Page(source, server, begin)  # type: ignore[arg-type]
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
