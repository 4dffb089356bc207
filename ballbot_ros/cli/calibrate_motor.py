# SPDX-License-Identifier: Apache-2.0
"""The verb ``calibrate-motor``: calibrate the joint between drive and pendulum."""
import argparse
from pathlib import Path
from shlex import quote
from typing import Any, Mapping

from ballbot_ros.cli.options import add_hardware, add_port
from ballbot_ros.cli.verb import DONE

REPLY_TIMEOUT = 0.5  # of the handshake [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_hardware(parser)
    add_port(parser)
    parser.add_argument('--out', type=Path, default=Path('my_motor.yaml'), metavar='FILE',
                        help='hardware file to write (default: %(default)s)')


class Console:
    """A dialogue at the terminal."""

    def say(self, text: str) -> None:
        print(text, flush=True)

    def ask(self, question: str) -> str:
        """Return the answer; ``q`` or the end of input cancels the calibration."""
        from ballbot_ros.errors import RefusedError
        try:
            answer = input(f'{question}: ')
        except EOFError:
            answer = 'q'
        if answer.strip().lower() == 'q':
            raise RefusedError('calibration ended; nothing was written', 'cancelled',
                               'calibration')
        return answer


def run(arguments: argparse.Namespace) -> int:
    from ballbot_ros.bridge.commissioning.calibration import Calibrator
    from ballbot_ros.bridge.drive_line import connector, handshake
    from ballbot_ros.bridge.hardware_file import load_hardware
    from ballbot_ros.config.files import read_config, relative
    from ballbot_ros.errors import ConfigurationError
    from ballbot_ros.physics.model.robot import load_robot
    from ballbot_ros.results.files import check_writable
    if arguments.out.exists():
        raise ConfigurationError(
            f'{arguments.out} exists; move it away or give another --out', 'exists', '--out')
    check_writable(arguments.out)
    hardware = load_hardware(arguments.hardware).at(arguments.port)
    driver, identity, _ = handshake(connector(hardware), REPLY_TIMEOUT)
    try:
        print(f'{identity.in_words} on {hardware.connection.port}')
        found = Calibrator(hardware, load_robot(hardware.robot), driver, Console()).run()
    finally:
        driver.line.close()
    _, content = read_config('hardware', arguments.hardware)
    write(arguments.out, {
        **content, 'name': arguments.out.stem,
        'robot': relative(hardware.robot, arguments.out.parent),
        'connection': {**content['connection'], 'port': hardware.connection.port}},
        found, arguments.hardware)
    print(f'Written: {arguments.out}.  Next: ros2 run ballbot_ros bridge --ros-args -p '
          + quote(f'hardware:={arguments.out.resolve()}'))
    return DONE


def write(path: Path, content: Mapping[str, Any], found: Any, base: str) -> None:
    """Write the content of the hardware file `base` with the result of its calibration."""
    import yaml

    from ballbot_ros.bridge.hardware_file import read_hardware
    from ballbot_ros.results.files import write_text
    spread = 3.0 * found.torque_factor_sd
    joint = {
        **content['joint'], 'direction': found.direction,
        'encoder_scale': {'value': round(found.encoder_scale, 7), 'unit': '1',
                          'source': 'measured'},
        'torque_factor': {
            'value': round(found.torque_factor, 4), 'unit': '1', 'source': 'measured',
            'range': [round(max(1e-3, found.torque_factor - spread), 4),
                      round(found.torque_factor + spread, 4)],
            'note': f'as accurate as M2 and e of the robot; friction {found.friction:.3f} N m'}}
    calibrated = {**content, 'joint': joint}
    read_hardware(calibrated, str(path))  # check that the file is readable
    write_text(f'# Measured by ballbot calibrate-motor; other values are those of {base}.\n'
               + yaml.safe_dump(calibrated, sort_keys=False), path)
