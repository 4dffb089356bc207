# SPDX-License-Identifier: Apache-2.0
"""The verb ``emulate-motor``: a motor controller in software on a serial device."""
import argparse
import gc
import os
from pathlib import Path
import select
import sys
from typing import Iterator

from ballbot_ros.cli.options import add_number, add_overwrite, add_seed
from ballbot_ros.cli.output import check_new_file
from ballbot_ros.cli.verb import DONE, FAILED, print_error
from ballbot_ros.config.fields import count
from ballbot_ros.drives import DRIVES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--protocol', required=True, metavar='NAME',
                        help=f'protocol of the drive: {" or ".join(DRIVES)}')
    parser.add_argument('--firmware', default='', metavar='GENERATION',
                        help='firmware of an odrive: 0.5 (default) or 0.6')
    parser.add_argument('--quirk', action='append', default=[], metavar='NAME',
                        help='emulate a quirk of some boards, by a name from the table '
                        'in docs/hardware.md; may be repeated')
    parser.add_argument('--robot', metavar='NAME',
                        help='robot with a motor (a name or a YAML file) to use instead of the '
                        'one of the scene')
    parser.add_argument('--steering', action='store_true',
                        help='add a second motor that leans the pendulum: on M2 of a roboclaw, '
                        'or at the next address of a CAN bus')
    parser.add_argument('--scene', default='flat', metavar='NAME',
                        help='scene (a name or a YAML file) with the ground and the initial state '
                        'of the ball (default: %(default)s)')
    add_number(parser, '--baud', 'RATE', count(
        'baud rate of the drive', default=115200, minimum=1))
    parser.add_argument('--watchdog', type=float, metavar='SECONDS',
                        help='time without a command after which the drive disarms, 0 for never '
                        '(default: 0.1)')
    parser.add_argument('--link', type=Path, metavar='PATH',
                        help='symbolic link to create, which points to the serial device')
    parser.add_argument('--fault', action='append', default=[], metavar='LINE',
                        help='start with this fault, such as "corrupt 0.01"; may be repeated')
    parser.add_argument('--control', type=Path, metavar='SOCKET',
                        help='Unix socket to read faults from, one per line, in addition to '
                        'standard input')
    parser.add_argument('--log', type=Path, metavar='FILE',
                        help='CSV file for every change of the torque, written at the end')
    add_overwrite(parser, file=True)
    add_seed(parser, 'the random faults')


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.config.files import find_config
    from ballbot_ros.emulator.ball import settings_for
    from ballbot_ros.emulator.control import answer, Channel, execute
    from ballbot_ros.emulator.emulator import Emulator
    from ballbot_ros.physics.simulation.scene import load_scene
    find_config('scenes', arguments.scene)
    if arguments.robot is not None:
        find_config('robots', arguments.robot)
    if arguments.log is not None:
        check_new_file(arguments.log, arguments.overwrite, '--log')
    scene = load_scene(arguments.scene, robot=arguments.robot)
    given = {} if arguments.watchdog is None else {'watchdog': arguments.watchdog}
    settings = settings_for(scene.model.robot, firmware=arguments.firmware,
                            quirks=tuple(arguments.quirk), **given)
    emulator = Emulator(arguments.protocol, scene, arguments.baud, settings, arguments.link,
                        arguments.seed, steering=arguments.steering)
    channel = None
    try:
        for line in arguments.fault:
            execute(emulator, line)
        if arguments.control is not None:
            channel = Channel(emulator, arguments.control)
        # As in `ros.run`: garbage collection of all modules takes longer than a period.
        gc.collect()
        gc.freeze()
        emulator.start()
        print(emulator.path, flush=True)
        for line in _typed_lines():
            if line.strip():
                print(answer(emulator, line), flush=True)
        emulator.wait()  # until a signal or the end of a run
    except KeyboardInterrupt:
        pass
    finally:
        if channel is not None:
            channel.close()
        emulator.stop()
        if arguments.log is not None:
            from ballbot_ros.results.files import write_text
            # Time of `steady_time` [s], and motor torque [N m].
            write_text('time,torque\n' + ''.join(
                f'{when:.6f},{torque:.9g}\n' for when, torque in emulator.log),
                arguments.log)
    if emulator.failure is not None:
        print_error(str(emulator.failure))
        return FAILED
    return DONE


def _typed_lines() -> Iterator[str]:
    pending = b''
    while True:
        # A signal that arrives just before a blocking read would not interrupt it.
        if not select.select([sys.stdin], [], [], 0.5)[0]:
            continue
        data = os.read(sys.stdin.fileno(), 4096)
        *lines, pending = (pending + data).split(b'\n') if data else (pending, b'')
        yield from (line.decode(errors='replace') for line in lines)
        if not data:
            return
