# SPDX-License-Identifier: Apache-2.0
"""The verb ``drive``: drive the robot from a keyboard or with a gamepad."""
import argparse
import math
import os
import re
import select
import shutil
import sys
import termios
import time
from typing import Any, Optional, TextIO

from ballbot_ros.cli.options import add_number, from_ros
from ballbot_ros.cli.verb import DONE, FAILED, note, print_error
from ballbot_ros.config.fields import quantity
from ballbot_ros.config.optional import load_optional
from ballbot_ros.errors import ConfigurationError

RATE = 20.0  # of cmd_vel [Hz]
STATUS_PERIOD = 0.1  # of the status line [s]
# With a dead man's switch: time for which a key counts as held after its last repetition [s].
# Keyboards wait up to 0.66 s before the first repetition, and less before the next ones.
FIRST_REPEAT_TIMEOUT, REPEAT_TIMEOUT = 0.75, 0.25

# Keys that stop the robot, and the additional request of each.
STOPPING_KEYS = {'space': '', 's': '', '0': '', 'e': 'engage', 'E': 'engage', 'R': 'release',
                 'q': 'quit', 'Q': 'quit', 'interrupt': 'quit'}

HELP = ('up/down faster, slower   space stop   e e-stop   R release it   q quit')
HOLD_HELP = ('hold up/down to drive   space stop   e e-stop   R release it   q quit')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    for option, what, default in (('--step', 'change of the speed per key press', 0.1),
                                  ('--max-speed', 'highest commanded speed', 0.6)):
        add_number(parser, option, 'M_PER_S', quantity(
            'm/s', what, default=default, above=0.0, maximum=3.0))
    parser.add_argument('--hold', action='store_true',
                        help='drive at the speed --step, only while a key is held down')
    parser.add_argument('--gamepad', action='store_true',
                        help='drive with a gamepad (left stick: speed; A: stop; B: e-stop); needs '
                        'the package evdev')
    parser.add_argument('--node', default='bridge', metavar='NAME',
                        help='node whose e-stop is engaged and released (default: %(default)s)')


def run(arguments: argparse.Namespace) -> int:
    """Drive until q; return 1 if the terminal or the gamepad was disconnected."""
    if arguments.step > arguments.max_speed:
        raise ConfigurationError(f'--step {arguments.step:g} is more than --max-speed '
                                 f'{arguments.max_speed:g}', 'inconsistent', '--step')
    keyboard = Keyboard()
    gamepad = Gamepad() if arguments.gamepad else None
    graph, driver = from_ros(), from_ros('ballbot_ros.ros.robot_driver')
    note('looking for the robot ...')
    with graph.Observer('drive') as observer:
        robot = driver.RobotDriver(observer, arguments.node)
        try:
            with keyboard:
                return drive(arguments, observer, robot, keyboard, gamepad)
        finally:
            robot.last()


def drive(arguments: argparse.Namespace, observer: Any, robot: Any, keyboard: Any,
          gamepad: Any = None) -> int:
    """
    Publish the commands of keys and stick at `RATE`, and show the status line.

    Returns 0 after q, 1 if the terminal or the gamepad was disconnected.
    """
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
                stick, keys = gamepad.read()
                pressed += keys
                driving.stick(stick)
            for key in pressed:
                request = driving.press(key, time.monotonic())
                if request == 'quit':
                    return DONE
                if request:
                    getattr(robot, request)()
            if (now := time.monotonic()) >= next_time:
                robot.publish(driving.at(now))
                # Missed set-points are not repeated.
                next_time = max(next_time + 1.0 / RATE, now)
            observer.spin(0.0)
            if now >= show_at or pressed:
                show_at = now + STATUS_PERIOD
                width = shutil.get_terminal_size().columns
                sys.stdout.write(f'\r{line(robot, driving.speed, width)}\x1b[K')
                sys.stdout.flush()
    except OSError as error:
        print_error(f'stopped: {error}')
        return FAILED
    finally:
        if not keyboard.gone:
            print(flush=True)


class Driving:
    """
    Converts keys to a speed within +-`largest` [m/s].

    An arrow key changes the speed by `step` or, with `hold`, sets this speed while it is held.
    """

    def __init__(self, step: float, largest: float, hold: bool = False):
        self._step, self._largest, self.hold = step, largest, hold
        self.speed = 0.0  # commanded [m/s]
        self._until = math.inf
        self._last = ''

    def press(self, key: str, now: float) -> str:
        """Handle a key at a time [s]; return its request: engage, release, quit or ''."""
        if key in ('up', 'down', 'left', 'right'):
            self._drive(1.0 if key in ('up', 'right') else -1.0, key, now)
        elif key in STOPPING_KEYS:
            self.stop()
        return STOPPING_KEYS.get(key, '')

    def _drive(self, sign: float, key: str, now: float) -> None:
        if self.hold:
            repeated = key == self._last and now < self._until
            self.speed = sign * self._step
            self._until = now + (REPEAT_TIMEOUT if repeated else FIRST_REPEAT_TIMEOUT)
            self._last = key
            return
        wanted = round((self.speed + sign * self._step) / self._step) * self._step
        self.speed = min(max(wanted, -self._largest), self._largest)

    def stick(self, part: float) -> None:
        """Set the speed from the position of a stick, -1 to 1."""
        self.speed = min(max(part, -1.0), 1.0) * self._largest

    def stop(self) -> None:
        """Set the commanded speed to 0."""
        self.speed, self._last = 0.0, ''

    def at(self, now: float) -> float:
        """Return the commanded speed at a time [s]; with `hold`, 0 after a key was released."""
        if self.hold and now >= self._until:
            self.stop()
        return self.speed


def line(robot: Any, wanted: float, width: int) -> str:
    """Return the status line for a commanded speed [m/s], cut to the width of the terminal."""
    words = [f'command {wanted:+.2f} m/s']
    words.append('measured   -  m/s' if robot.speed is None
                 else f'measured {robot.speed:+.2f} m/s')
    words.append('pendulum    - deg' if robot.pendulum is None
                 else f'pendulum {math.degrees(robot.pendulum):+4.0f} deg')
    if robot.e_stop is not None:
        words.append('E-STOP' if robot.e_stop else 'e-stop off')
    if robot.decision:
        words.append(robot.decision)
    if not robot.followers:
        words.append('no subscriber of cmd_vel')
    if robot.reply:
        words.append(' '.join(robot.reply.split()))
    text = '  '.join(words)
    return text if len(text) < width else f'{text[:max(width - 4, 0)]}...'


# Escape sequences of terminals, in both modes of the arrow keys.
_KEYS = {b'\x1b[A': 'up', b'\x1b[B': 'down', b'\x1b[C': 'right', b'\x1b[D': 'left',
         b'\x1bOA': 'up', b'\x1bOB': 'down', b'\x1bOC': 'right', b'\x1bOD': 'left',
         b' ': 'space', b'\x03': 'interrupt', b'\x04': 'interrupt'}
# An escape sequence, known or not, or one byte.
_KEY = re.compile(rb'\x1b.?[^A-Za-z~]*[A-Za-z~]?|.', re.DOTALL)
_BYTES_MAX = 1024


def keys_of(data: bytes) -> list[str]:
    """Return names of keys, such as ``'up'``; letters and digits unchanged, others omitted."""
    return [_KEYS.get(code) or code.decode() for code in _KEY.findall(data)
            if code in _KEYS or code.isalnum()]


class Keyboard:
    """
    Reads the keys of a terminal as they are pressed, without Enter and without an echo.

    Use as a context manager: every exit restores the settings of the terminal.  Ctrl-C is a key
    here and does not interrupt, so that the robot is stopped first.  `gone` is true once the
    terminal has been closed.  Raises `ConfigurationError` if the stream, standard input by
    default, is not a terminal.
    """

    def __init__(self, stream: Optional[TextIO] = None):
        stream = sys.stdin if stream is None else stream
        try:
            self._file = stream.fileno()
            self._before: Any = termios.tcgetattr(self._file)
        except (AttributeError, OSError, ValueError, termios.error) as error:
            raise ConfigurationError(
                'standard input is not a terminal, from which keys are read: run this command in '
                'a terminal, or publish cmd_vel from a program',
                'unavailable', 'terminal') from error
        self.gone = False

    def __enter__(self) -> 'Keyboard':
        """Switch to unbuffered keys; discard keys pressed before."""
        mode = termios.tcgetattr(self._file)
        mode[0] &= ~termios.IXON
        mode[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 0
        termios.tcsetattr(self._file, termios.TCSAFLUSH, mode)
        return self

    def __exit__(self, *_: Any) -> None:
        try:
            termios.tcsetattr(self._file, termios.TCSAFLUSH, self._before)
        except termios.error:
            self.gone = True

    def keys(self, wait: float) -> list[str]:
        """Return the pressed keys; wait at most this time [s] for the first."""
        try:
            ready, _, _ = select.select([self._file], [], [], wait)
            data = os.read(self._file, _BYTES_MAX) if ready else None
        except OSError:
            data = b''
        if data == b'':  # ready without data: closed
            self.gone = True
        return keys_of(data or b'')


# Largest deflection of a released stick, relative to its range.
DEAD_ZONE = 0.1


class Gamepad:
    """The first gamepad; raises `ConfigurationError` without one or without package evdev."""

    def __init__(self) -> None:
        evdev = load_optional('evdev', 'evdev', 'pip install evdev')
        codes = self._codes = evdev.ecodes
        for path in evdev.list_devices():
            device = evdev.InputDevice(path)
            able = device.capabilities(absinfo=False)
            if codes.ABS_Y in able.get(codes.EV_ABS, ()) \
                    and codes.BTN_SOUTH in able.get(codes.EV_KEY, ()):
                break
        else:
            raise ConfigurationError(
                'no gamepad is connected, or this user may not open it: sudo usermod -aG input '
                '$USER', 'unavailable', 'gamepad')
        self._device = device
        # A: stop, B: e-stop.  No button releases the e-stop, to prevent a release by mistake.
        self._buttons = {codes.BTN_SOUTH: 'space', codes.BTN_EAST: 'e'}
        information = device.absinfo(codes.ABS_Y)
        self._low, self._high = information.min, information.max
        self._value = information.value

    def read(self) -> tuple[float, list[str]]:
        """
        Return the stick, forward positive from -1 to 1, and the keys since the last call.

        Raises OSError if the gamepad is unplugged.
        """
        keys = []
        while (event := self._device.read_one()) is not None:
            if event.type == self._codes.EV_ABS and event.code == self._codes.ABS_Y:
                self._value = event.value
            elif event.type == self._codes.EV_KEY and event.value == 1 \
                    and event.code in self._buttons:
                keys.append(self._buttons[event.code])
        # The axis has its minimum at full forward deflection.
        part = (self._low + self._high - 2.0 * self._value) / (self._high - self._low)
        beyond = max(0.0, abs(part) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
        return math.copysign(beyond, part), keys
