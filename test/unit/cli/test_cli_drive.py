# SPDX-License-Identifier: Apache-2.0
"""Manual driving by keys and sticks; the terminal settings are always restored."""
import argparse
from contextlib import suppress
import io
import os
import pty
import select
import signal
import subprocess
import sys
import termios
from types import SimpleNamespace

import pytest
from refusals import refused

from ballbot_ros.cli.drive import (
    drive, Driving, FIRST_REPEAT_TIMEOUT, Gamepad, Keyboard, keys_of, line, REPEAT_TIMEOUT)

UNUSED = 60  # number of terminals, more than other tests use
OPTIONS = argparse.Namespace(step=0.1, max_speed=0.6, hold=False, node='bridge')


@pytest.fixture
def terminal():
    """Yield the two ends of a terminal: the input of the user, and that of the command."""
    # A bridge of another test that has lost its drive repeatedly opens the device that it had:
    # use an unused number.
    pairs = [pty.openpty()]
    while int(os.ttyname(pairs[-1][1]).rpartition('/')[2]) < UNUSED:
        pairs.append(pty.openpty())
    (master, slave), *others = reversed(pairs)
    with os.fdopen(slave, 'r') as stream:
        yield SimpleNamespace(master=master, stream=stream,
                              settings=lambda: termios.tcgetattr(stream.fileno()))
    for one in (master, *(end for pair in others for end in pair)):
        with suppress(OSError):  # closed by the test
            os.close(one)


class Robot(SimpleNamespace):
    """Record the requests, and type the next key after each."""

    def __init__(self, terminal, *keys):
        super().__init__(speed=0.25, pendulum=0.5, decision='CROSS', e_stop=False, followers=1,
                         reply='', asked=[], calls=[])
        self._terminal, self._keys = terminal, list(keys)

    def publish(self, speed):
        self.asked.append(speed)
        if self._keys:
            key = self._keys.pop(0)
            if callable(key):
                key()
                return
            os.write(self._terminal.master, key)
            assert select.select([self._terminal.stream], [], [], 30.0)[0]

    def engage(self):
        self.calls.append('engage')

    def release(self):
        self.calls.append('release')


GRAPH = SimpleNamespace(spin=lambda seconds: None)


def test_keys_change_the_speed_until_q_and_the_terminal_is_restored(terminal, capsys):
    before = terminal.settings()
    robot = Robot(terminal, b'\x1b[A', b'\x1b[A', b'\x1b[B', b' ', b'e', b'R', b'q')
    with Keyboard(terminal.stream) as keyboard:
        assert terminal.settings() != before
        assert drive(OPTIONS, GRAPH, robot, keyboard) == 0
    assert terminal.settings() == before
    assert robot.asked == pytest.approx([0.0, 0.1, 0.2, 0.1, 0.0, 0.0, 0.0])
    assert robot.calls == ['engage', 'release']
    shown = capsys.readouterr().out
    for words in ('measured +0.25 m/s', 'pendulum  +29 deg', 'CROSS', 'e-stop off'):
        assert words in shown


def test_ctrl_c_ends_like_q(terminal):
    robot = Robot(terminal, b'\x1b[A', b'\x03')
    with Keyboard(terminal.stream) as keyboard:
        assert drive(OPTIONS, GRAPH, robot, keyboard) == 0


@pytest.mark.parametrize('error', [RuntimeError('broken'), KeyboardInterrupt(), SystemExit(143)])
def test_the_terminal_is_restored_after_any_error(terminal, error):
    def fail():
        raise error

    before = terminal.settings()
    with pytest.raises(type(error)), Keyboard(terminal.stream) as keyboard:
        drive(OPTIONS, GRAPH, Robot(terminal, fail), keyboard)
    assert terminal.settings() == before


def test_no_speed_is_requested_after_the_terminal_is_closed(terminal):
    robot = Robot(terminal, b'\x1b[A', lambda: os.close(terminal.master))
    with Keyboard(terminal.stream) as keyboard:
        assert drive(OPTIONS, GRAPH, robot, keyboard) == 1
    assert robot.asked == pytest.approx([0.0, 0.1])


def test_keys_pressed_before_the_start_are_ignored(terminal):
    os.write(terminal.master, b'\x1b[A' * 5 + b'\n')
    assert select.select([terminal.stream], [], [], 30.0)[0]
    robot = Robot(terminal, b'q')
    with Keyboard(terminal.stream) as keyboard:
        drive(OPTIONS, GRAPH, robot, keyboard)
    assert robot.asked == [0.0]


@pytest.mark.parametrize('stream', [io.StringIO(), None])
def test_drive_without_a_terminal_is_refused(stream, tmp_path):
    with open(tmp_path / 'file', 'w') as file, refused('unavailable', 'terminal'):
        Keyboard(file if stream is None else stream)


@pytest.mark.slow
def test_the_command_stops_the_robot_and_restores_the_terminal_at_its_end(terminal):
    before = terminal.settings()
    process = subprocess.Popen(
        [sys.executable, '-m', 'ballbot_ros.cli', 'drive'], stdin=terminal.stream,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF', 'COLUMNS': '200'})
    printed = b''
    try:
        while b'no subscriber of cmd_vel' not in printed:
            printed += (more := os.read(process.stdout.fileno(), 4096))
            assert more, printed
        os.write(terminal.master, b'\x1b[A')
        while b'command +0.10' not in printed:
            printed += (more := os.read(process.stdout.fileno(), 4096))
            assert more, printed
        process.send_signal(signal.SIGTERM)
        assert process.wait(30.0) == 128 + signal.SIGTERM
    finally:
        process.kill()
        process.wait()
    assert terminal.settings() == before
    assert b'Traceback' not in printed + process.stdout.read()
    process.stdout.close()


def test_speeds_are_multiples_of_the_step_within_the_limit():
    driving = Driving(0.1, 0.25)
    for _ in range(9):
        driving.press('up', 0.0)
    assert driving.speed == 0.25
    driving.press('down', 0.0)
    assert driving.speed == pytest.approx(0.1)
    for _ in range(9):
        driving.press('down', 0.0)
    assert driving.at(1e9) == -0.25
    driving.press('space', 0.0)
    assert driving.at(0.0) == 0.0


def test_the_robot_stops_when_a_held_key_is_released():
    driving = Driving(0.3, 0.6, hold=True)
    driving.press('up', 10.0)
    assert driving.at(10.0 + 0.9 * FIRST_REPEAT_TIMEOUT) == 0.3
    driving.press('up', 10.5)
    assert driving.at(10.5 + 0.9 * REPEAT_TIMEOUT) == 0.3
    assert driving.at(10.5 + 1.1 * REPEAT_TIMEOUT) == 0.0
    assert driving.at(11.0) == 0.0
    driving.press('down', 20.0)
    assert driving.at(20.0 + 0.9 * FIRST_REPEAT_TIMEOUT) == -0.3


def test_an_e_stop_also_resets_the_requested_speed():
    driving = Driving(0.1, 0.6)
    driving.press('up', 0.0)
    assert driving.press('e', 0.0) == 'engage' and driving.speed == 0.0
    driving.press('up', 0.0)
    assert driving.press('R', 0.0) == 'release' and driving.speed == 0.0
    driving.press('up', 0.0)
    assert driving.press('r', 0.0) == driving.press('x', 0.0) and driving.speed == 0.1
    assert driving.press('interrupt', 0.0) == 'quit' and driving.speed == 0.0


def test_keys_are_distinguished_and_unknown_ones_ignored():
    assert keys_of(b'\x1b[A\x1bOBq \x03') == ['up', 'down', 'q', 'space', 'interrupt']
    assert keys_of(b'\x1b[5~\x1b[1;5Ce\xc3\xa4\x1b') == ['e']
    assert keys_of(b'') == []


def test_the_status_line_fits_the_terminal_and_marks_unknown_values():
    robot = SimpleNamespace(
        speed=None, pendulum=None, decision='', e_stop=None, followers=0, reply='')
    text = line(robot, 0.0, 200)
    assert 'no subscriber' in text and '-  m/s' in text and 'stop' not in text
    robot = Robot(None)
    robot.e_stop, robot.reply = True, 'e-stop:\nengaged'
    text = line(robot, 0.1, 200)
    assert 'E-STOP' in text and text.endswith('e-stop: engaged')
    robot.reply = 'x' * 300
    for width in (1, 4, 20, 80):
        assert len(line(robot, 0.1, width)) <= max(width - 1, 3)


# Gamepads

CODES = SimpleNamespace(EV_ABS=3, EV_KEY=1, ABS_Y=1, BTN_SOUTH=304, BTN_EAST=305)


def fake_evdev(events, low=0, high=255, devices=('/dev/input/event7',), keys=(304, 305)):
    """Return a module evdev with a gamepad that gives these events."""
    left = list(events)
    device = SimpleNamespace(
        capabilities=lambda absinfo: {3: [0, 1], 1: list(keys)},
        absinfo=lambda code: SimpleNamespace(min=low, max=high, value=(low + high) // 2),
        read_one=lambda: left.pop(0) if left else None)
    return SimpleNamespace(ecodes=CODES, list_devices=lambda: list(devices),
                           InputDevice=lambda path: device)


def event(kind, code, value):
    return SimpleNamespace(type=kind, code=code, value=value)


def test_a_stick_and_two_buttons_are_read_by_evdev(monkeypatch):
    monkeypatch.setitem(sys.modules, 'evdev', fake_evdev(
        [event(3, 1, 0), event(1, 305, 1), event(1, 305, 0), event(1, 304, 1), event(3, 0, 9)]))
    gamepad = Gamepad()
    assert gamepad.read() == (1.0, ['e', 'space'])
    assert gamepad.read() == (1.0, [])
    driving = Driving(0.1, 0.6)
    driving.stick(gamepad.read()[0])
    assert driving.speed == 0.6


def test_an_untouched_stick_commands_nothing(monkeypatch):
    monkeypatch.setitem(sys.modules, 'evdev', fake_evdev([event(3, 1, 131)]))
    assert Gamepad().read() == (0.0, [])


@pytest.mark.parametrize('value, part', [
    (0, 1.0), (20, 1.0 - 0.2 / 0.9), (80, 0.1 / 0.9), (90, 0.0), (110, 0.0), (200, -1.0)])
def test_a_stick_has_a_dead_zone_and_keeps_its_range(value, part, monkeypatch):
    monkeypatch.setitem(sys.modules, 'evdev', fake_evdev([event(3, 1, value)], high=200))
    assert Gamepad().read()[0] == pytest.approx(part)


@pytest.mark.parametrize('devices, keys', [((), (304,)), (('/dev/input/event1',), (30,))])
def test_a_missing_gamepad_is_distinguished_from_an_unreadable_one(devices, keys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'evdev', fake_evdev([], devices=devices, keys=keys))
    with refused('unavailable', 'gamepad'):
        Gamepad()
    monkeypatch.setitem(sys.modules, 'evdev', None)
    with refused('not_installed', 'evdev'):
        Gamepad()


def test_a_gamepad_that_is_unplugged_ends_the_drive(terminal, capsys):
    def read():
        raise OSError('No such device')

    with Keyboard(terminal.stream) as keyboard:
        code = drive(OPTIONS, GRAPH, Robot(terminal), keyboard, SimpleNamespace(read=read))
    assert code == 1 and 'stopped: No such device' in capsys.readouterr().err
