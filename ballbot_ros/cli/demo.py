# SPDX-License-Identifier: Apache-2.0
"""The verb ``demo``: all ROS nodes together, on a scene with two steps."""
import argparse
from pathlib import Path

from ballbot_ros.cli.options import add_quiet
from ballbot_ros.drives import DRIVES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add output, nodes and time."""
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder for what it records (default: ballbot_output/demo, or '
                        'ballbot_output/demo_hardware)')
    parser.add_argument('--real-time', action='store_true',
                        help='in real time instead of as fast as it goes')
    parser.add_argument('--hardware', action='store_true',
                        help='with an emulated motor controller behind a serial line and the '
                        'bridge, in real time')
    parser.add_argument('--protocol', choices=tuple(DRIVES),
                        help='of that motor controller (default: odrive)')
    parser.add_argument('--firmware', default='', metavar='GENERATION',
                        help='of an odrive: 0.5 (default) or 0.6')
    parser.add_argument('--serial-imu', action='store_true',
                        help='the IMU on a serial line of its own, too, read by the node imu')
    parser.add_argument('--timeout', type=float, default=60.0, metavar='SECONDS',
                        help='give up after this long (default: %(default)g)')
    add_quiet(parser)


def run(arguments: argparse.Namespace) -> int:
    """
    Run the demo.

    Raises
    ------
    ConfigurationError
        If the timeout is not above 0, a protocol or firmware is given without such a motor
        controller, the folder cannot be written, or ROS cannot be found.

    """
    from ballbot_ros.drives import device_class
    from ballbot_ros.errors import ConfigurationError
    if not 0.0 < arguments.timeout < float('inf'):
        raise ConfigurationError(
            f'--timeout must be more than 0 s and finite, got {arguments.timeout!r}')
    if arguments.protocol is not None and not arguments.hardware:
        raise ConfigurationError('--protocol goes with --hardware')
    if arguments.serial_imu and not arguments.hardware:
        raise ConfigurationError('--serial-imu goes with --hardware')
    protocol = arguments.protocol or 'odrive'
    known = device_class(protocol).firmwares
    if arguments.firmware and (not arguments.hardware or arguments.firmware not in known):
        raise ConfigurationError(
            f'--firmware goes with --hardware, and must be {" or ".join(known) or "left out"} '
            f'with --protocol {protocol}, got {arguments.firmware!r}')
    try:
        from ballbot_ros.demo import run_demo, run_hardware_demo
    except ImportError as error:
        raise ConfigurationError(
            f'the demo needs ROS 2, and {error.name or error} cannot be imported; source '
            '/opt/ros/jazzy/setup.bash, or run "make demo" in a checkout.  "ballbot simulate" '
            'works without ROS') from error
    folder = 'demo_hardware' if arguments.hardware else 'demo'
    out = arguments.out or Path('ballbot_output') / folder
    from ballbot_ros.results.files import check_writable
    check_writable(out / 'crossing.png')
    if arguments.hardware:
        code: int = run_hardware_demo(out=out, protocol=protocol,
                                      firmware=arguments.firmware,
                                      serial_imu=arguments.serial_imu, quiet=arguments.quiet,
                                      timeout=arguments.timeout)
    else:
        code = run_demo(out=out, real_time=arguments.real_time,
                        quiet=arguments.quiet, timeout=arguments.timeout)
    return code
