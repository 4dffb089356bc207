# SPDX-License-Identifier: Apache-2.0
"""The verb ``demo``: all ROS nodes together, on shipped or other scenes."""
import argparse
from contextlib import nullcontext
from pathlib import Path

from ballbot_ros.cli.options import (
    add_number, add_overwrite, add_quiet, from_ros, refuse_without)
from ballbot_ros.cli.output import OUTPUT, result_folder
from ballbot_ros.config.fields import quantity
from ballbot_ros.drives import DRIVES
from ballbot_ros.errors import ConfigurationError

# Options that take a name or a YAML file.
FILE_OPTIONS = {'scene': 'name or YAML file of a scene to run instead of the two of the demo',
                'robot': 'name or YAML file of a robot to use instead of that of the scene',
                'curve': 'height curve of the decision, fitted by "ballbot fit-curve"',
                'tuning': 'name or YAML file of the gains of the controller (default: published)'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for the recording (default: demo, demo_hardware or '
                        'demo_house in ballbot_output; demo_2, ... if it contains results)')
    add_overwrite(parser)
    parser.add_argument('--real-time', action='store_true',
                        help='run in real time instead of as fast as possible')
    parser.add_argument('--view', action='store_true',
                        help='open the live page in a browser; run no faster than real time')
    parser.add_argument('--hardware', action='store_true',
                        help='run the bridge with an emulated motor controller on a serial '
                        'link, in real time')
    parser.add_argument('--house', action='store_true',
                        help='drive from room to room on the floor "apartment" with the navigator')
    parser.add_argument('--goal', nargs=2, type=float, action='append', default=[],
                        metavar=('X', 'Y'),
                        help='position [m] to drive to with --house, instead of its rooms; may be '
                        'repeated')
    parser.add_argument('--protocol', choices=tuple(DRIVES),
                        help='protocol of the emulated motor controller (default: odrive)')
    parser.add_argument('--firmware', default='', metavar='GENERATION',
                        help='firmware of an odrive: 0.5 (default) or 0.6')
    parser.add_argument('--serial-imu', action='store_true',
                        help='connect the emulated IMU to the node imu by a separate serial '
                        'link')
    for option, what in FILE_OPTIONS.items():
        parser.add_argument(f'--{option}', metavar='NAME', help=what)
    parser.add_argument('--planner', metavar='NAME',
                        help="planner of the decision: rollout, or cubic for the paper's rule "
                        '(default: rollout)')
    add_number(parser, '--duration', 'SECONDS', quantity(
        's', 'end of the run, in simulated time (default: 30)', above=0.0, optional=True))
    add_number(parser, '--timeout', 'SECONDS', quantity(
        's', 'longest wall time without a new state', default=60.0, above=0.0))
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """
    Run the demo.

    Raises `ConfigurationError` for an option without effect, for a scene, robot, curve or gains
    that do not exist or are inconsistent, for a folder that cannot be written, and if ROS cannot
    be found.
    """
    check(arguments)
    demo = from_ros('ballbot_ros.demo.demo')
    from ballbot_ros.results.files import check_writable
    folder = 'demo_hardware' if arguments.hardware else (
        'demo_house' if arguments.house else 'demo')
    picture = 'house.png' if arguments.house else 'crossing.png'
    check_writable((arguments.out or OUTPUT / folder) / picture)  # before scenes are loaded
    cases = [] if arguments.hardware or arguments.house else demo.demo_cases(
        arguments.scene, arguments.robot, arguments.curve, arguments.tuning, arguments.duration,
        arguments.planner or 'rollout')
    names: tuple[str, ...] = (picture, 'bag', 'logs')
    if cases:
        names = tuple(f'{Path(case.scene).stem}/{name}' for case in cases for name in names)
    out = result_folder(arguments.out, folder, names, arguments.overwrite)
    page = from_ros('ballbot_ros.demo.page').page_beside if arguments.view else nullcontext
    common = {'out': out, 'quiet': arguments.quiet, 'timeout': arguments.timeout}
    pace = {'real_time': arguments.real_time, 'watched': arguments.view}
    with page(arguments.quiet):
        if arguments.hardware:
            code = from_ros('ballbot_ros.demo.hardware').run_hardware_demo(
                **common, protocol=arguments.protocol or 'odrive', firmware=arguments.firmware,
                serial_imu=arguments.serial_imu)
        elif arguments.house:
            code = from_ros('ballbot_ros.demo.house').run_house_demo(
                **common, **pace, longest=arguments.duration, robot=arguments.robot,
                curve=arguments.curve, goals=arguments.goal)
        else:
            code = demo.run_demo(**common, **pace, cases=cases)
    return int(code)


def check(arguments: argparse.Namespace) -> None:
    """Refuse missing files and invalid combinations."""
    from ballbot_ros.config.files import find_config
    from ballbot_ros.drives import device_class
    refuse_without(arguments, '--hardware', arguments.hardware, '--protocol', '--serial-imu')
    refuse_without(arguments, '--house', arguments.house, '--goal')
    if arguments.hardware and arguments.house:
        raise ConfigurationError(
            '--house excludes --hardware, which drives straight only', 'inconsistent',
            '--house')
    own_scene = 'another demo: this one has its own scene'
    refuse_without(
        arguments, own_scene, not arguments.hardware, '--robot', '--curve', '--duration')
    refuse_without(arguments, own_scene, not (arguments.hardware or arguments.house), '--scene',
                   '--tuning', '--planner')
    for option in FILE_OPTIONS:
        if getattr(arguments, option) is not None:
            find_config(f'{option}s', getattr(arguments, option))
    protocol = arguments.protocol or 'odrive'
    known = device_class(protocol).firmwares
    if arguments.firmware and (not arguments.hardware or arguments.firmware not in known):
        raise ConfigurationError(
            f'--firmware requires --hardware, and must be {" or ".join(known) or "left out"} '
            f'with --protocol {protocol}, got {arguments.firmware!r}',
            'not_a_choice', '--firmware')
