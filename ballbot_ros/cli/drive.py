# SPDX-License-Identifier: Apache-2.0
"""The verb ``drive``: the robot from a keyboard or a gamepad."""
import argparse
from contextlib import contextmanager
import shutil
import signal
import sys
import time
from typing import Any, Iterator

from ballbot_ros.cli.command import DONE, FAILED, print_error
from ballbot_ros.errors import ConfigurationError

RATE = 20.0  # of cmd_vel [Hz]
SHOWN = 0.1  # how often the line is written again [s]
FASTEST = 3.0  # that may be asked for [m/s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add speeds, dead man's switch and gamepad."""
    parser.add_argument('--step', type=float, default=0.1, metavar='M_PER_S',
                        help='how much a key changes the speed (default: %(default)g)')
    parser.add_argument('--max-speed', type=float, default=0.6, metavar='M_PER_S',
                        help='highest speed that is ever asked for (default: %(default)g)')
    parser.add_argument('--hold', action='store_true',
                        help='drive at the speed --step, and only while a key is held down')
    parser.add_argument('--gamepad', action='store_true',
                        help='drive with a gamepad (left stick: speed; A: stop; B: e-stop); needs '
                        'evdev or pygame')
    parser.add_argument('--node', default='bridge', metavar='NAME',
                        help='node whose e-stop is engaged and released (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Drive until q; 1 if the terminal or the gamepad went away."""
    for name in ('step', 'max_speed'):
        value = getattr(arguments, name)
        if not 0.0 < value <= FASTEST:
            raise ConfigurationError(f'--{name.replace("_", "-")} must be above 0 and at most '
                                     f'{FASTEST:g} m/s, got {value:g}')
    if arguments.step > arguments.max_speed:
        raise ConfigurationError(f'--step {arguments.step:g} is more than --max-speed '
                                 f'{arguments.max_speed:g}')
    from ballbot_ros.cli.gamepad import open_gamepad
    from ballbot_ros.cli.keyboard import Keyboard
    from ballbot_ros.cli.running_graph import tell, tool
    keyboard = Keyboard()
    gamepad = open_gamepad() if arguments.gamepad else None
    observer_class, driver = tool('observer').Observer, tool('driver')
    tell('looking for the robot ...')
    with ended_by_exception(), observer_class('drive') as observer:
        robot = driver.RobotDriver(observer, arguments.node)
        try:
            with keyboard:
                return drive(arguments, observer, robot, keyboard, gamepad)
        finally:
            robot.last()


def drive(arguments: argparse.Namespace, observer: Any, robot: Any, keyboard: Any,
          gamepad: Any = None) -> int:
    """
    Publish at a rate what keys and stick ask for, and show one line.

    Parameters
    ----------
    arguments : Namespace
    observer : Observer
    robot : RobotDriver
    keyboard : Keyboard
    gamepad : EvdevGamepad or PygameGamepad, optional

    Returns
    -------
    int
        0 after q, 1 if the terminal or the gamepad went away.

    """
    from ballbot_ros.cli.driving import Driving, HELP, HOLD_HELP
    driving = Driving(arguments.step, arguments.max_speed, arguments.hold)
    print(HOLD_HELP if arguments.hold else HELP)
    next_time = show_at = time.monotonic()
    try:
        while True:
            now = time.monotonic()
            pressed = keyboard.keys(max(next_time - now, 0.0))
            if keyboard.gone:
                return FAILED
            if gamepad is not None:
                reading = gamepad.read()
                pressed += reading.keys
                driving.stick(reading.stick)
            for key in pressed:
                wish = driving.press(key, time.monotonic())
                if wish.engage:
                    robot.engage()
                if wish.release:
                    robot.release()
                if wish.quit:
                    return DONE
            if (now := time.monotonic()) >= next_time:
                robot.publish(driving.at(now))
                # After a hiccup no set-points are made up for.
                next_time = max(next_time + 1.0 / RATE, now)
            observer.spin(0.0)
            if now >= show_at or pressed:
                show_at = now + SHOWN
                show(robot, driving.speed)
    except OSError as error:
        print_error(f'stopped: {error}')
        return FAILED
    finally:
        if not keyboard.gone:
            print(flush=True)


def show(robot: Any, wanted: float) -> None:
    """Write the line anew in its place."""
    from ballbot_ros.cli.driving import line
    width = shutil.get_terminal_size().columns
    text = line(wanted, robot.speed, robot.pendulum, robot.decision, robot.e_stop,
                robot.followers, robot.said, width)
    sys.stdout.write(f'\r{text}\x1b[K')
    sys.stdout.flush()


@contextmanager
def ended_by_exception() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into an exception, so that the robot is stopped on the way out."""
    def leave(number: int, _: Any) -> None:
        sys.exit(128 + number)

    before = {number: signal.signal(number, leave) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
