# SPDX-License-Identifier: Apache-2.0
"""
Faults on demand: one line of text each, from the command line, standard input or a socket.

docs/hardware.md contains a table that is generated from `FAULTS`.
"""
from dataclasses import replace
import json
import math
from pathlib import Path
import socketserver
from threading import Thread
from typing import Callable, NamedTuple, Optional

from ballbot_ros.clock import steady_time
from ballbot_ros.config.fields import suggestion
from ballbot_ros.emulator.emulator import Emulator
from ballbot_ros.emulator.line import LineFaults
from ballbot_ros.errors import BallbotError, ConfigurationError


class Fault(NamedTuple):
    """A command of the control channel."""

    argument: str  # argument after the name, as text; empty for none
    effect: str
    act: Callable[[Emulator, float, float], None]  # emulator, number, now
    default: Optional[float] = None  # of the number; None if it must be given
    least: float = 0.0
    most: float = math.inf


def _plug_after(emulator: Emulator, seconds: float, now: float) -> None:
    emulator.terminal.unplug()
    emulator.plug_at = now + seconds
    emulator.to_drive.clear()
    emulator.from_drive.clear()


def _plug(emulator: Emulator, _: float, now: float) -> None:
    emulator.plug_at = now


def _silence(emulator: Emulator, seconds: float, now: float) -> None:
    emulator.silent_until = now + seconds


def _sense(name: str) -> Callable[[Emulator, float, float], None]:
    """Return the function that sets a measurement of the drive."""
    def act(emulator: Emulator, value: float, _: float) -> None:
        emulator.device.sensed = emulator.device.sensed._replace(**{name: value})
    return act


def _encoder_jump(emulator: Emulator, turns: float, _: float) -> None:
    emulator.encoder_jump += turns * math.tau


def _slow_reader(emulator: Emulator, rate: float, _: float) -> None:
    emulator.read_rate = rate


def _clear(emulator: Emulator, _: float, now: float) -> None:
    emulator.to_drive.faults = emulator.from_drive.faults = LineFaults()
    emulator.silent_until = -math.inf
    emulator.read_rate = math.inf
    emulator.encoder_jump = 0.0
    fresh = type(emulator.device.sensed)()
    emulator.device.sensed = emulator.device.sensed._replace(
        temperature=fresh.temperature, stop_switch=0.0,
        bus_voltage=emulator.ball.motor.maximum_voltage)
    _plug(emulator, 0.0, now)


FAULTS = {
    'unplug': Fault('seconds; permanent if omitted', 'the device disappears, and returns under '
                    'another name', _plug_after, math.inf),
    'plug': Fault('', 'the device returns', _plug),
    'silence': Fault('seconds', 'the drive receives but does not reply', _silence),
    'reboot': Fault('', 'the drive resets its state and ignores data while it boots',
                    lambda emulator, _, now: emulator.device.reboot(now)),
    'over_current': Fault('', 'the drive trips as on a short circuit',
                          lambda emulator, *_: emulator.device.over_current()),
    'temperature': Fault('degC', 'sets the temperature of the power stage; above its limit, the '
                         'drive trips', _sense('temperature'), least=-273.15, most=1000.0),
    'voltage': Fault('V', 'sets the supply voltage', _sense('bus_voltage'), most=1000.0),
    'stop_switch': Fault('1 or 0', 'engages (1) or releases (0) the emergency switch at the input '
                         'of the drive, if configured', _sense('stop_switch'), 1.0, most=1.0),
    'encoder_jump': Fault('motor turns', 'increment of the encoder offset', _encoder_jump,
                          least=-1e6, most=1e6),
    'slow_reader': Fault('bytes/s', 'limits the rate at which the drive reads', _slow_reader),
    'reset': Fault('', 'resets the ball to the start of its scene',
                   lambda emulator, *_: emulator.ball.reset()),
    'clear': Fault('', 'ends all faults of line, supply, temperature, switch and encoder, and '
                   'plugs the device in', _clear),
}
# Faults of single bytes: each field of `LineFaults`; an optional second word is the direction.
LINE_FAULTS = {name: item.metadata for name, item in LineFaults.__dataclass_fields__.items()}


def execute(emulator: Emulator, line: str) -> str:
    """Execute a line and return the answer; `ConfigurationError` for an unknown one."""
    name, *words = line.split() or ['']
    if name == 'state':
        return json.dumps(state_of(emulator))
    if name in LINE_FAULTS:
        both = {'to': emulator.to_drive, 'from': emulator.from_drive}
        word = words.pop() if len(words) == 2 else ''
        if word and word not in both:
            raise ConfigurationError(
                f'{name}: the second word must be "to" or "from" (the drive), got {word!r}',
                'not_a_choice', name)
        number = _number(name, words, None)
        changes = [(direction, replace(direction.faults, **{name: number}))
                   for direction in ([both[word]] if word else both.values())]

        def change() -> None:
            for direction, faults in changes:
                direction.faults = faults
        emulator.call(change)
    elif name in FAULTS:
        fault = FAULTS[name]
        if words and not fault.argument:
            raise ConfigurationError(f'{name} takes no number, got {words[0]!r}',
                                     'wrong_type', name)
        number = _number(name, words, fault.default if fault.argument else 0.0)
        if not fault.least <= number <= fault.most:
            raise ConfigurationError(
                f'{name}: the number must be at least {fault.least:g} and at most '
                f'{fault.most:g}, got {number:g}', 'out_of_range', name)
        emulator.call(lambda: fault.act(emulator, number, steady_time()))
    else:
        known = (*FAULTS, *LINE_FAULTS, 'state')
        raise ConfigurationError(f'{name!r} is not a fault{suggestion(name, known)}',
                                 'unknown_name', name)
    return 'ok'


def _number(name: str, words: list[str], default: Optional[float]) -> float:
    if not words and default is not None:
        return default
    try:
        number, = (float(word) for word in words)
    except ValueError:
        raise ConfigurationError(
            f'{name} takes one number, got {" ".join(words) or "nothing"}',
            'wrong_type', name) from None
    return number


def state_of(emulator: Emulator) -> dict[str, object]:
    """Return the state of the emulated robot, all SI."""
    state, imu = emulator.state, emulator.imu()
    return {
        'device': emulator.path, 'plugged': emulator.terminal.plugged,
        'motor_torque': emulator.torque, 'pendulum_torque': emulator.pendulum_torque,
        'time': state.time, 'x': state.x, 'velocity_x': state.velocity_x,
        'ball_angle': state.ball_angle, 'ball_rate': state.ball_rate,
        'pendulum_angle': state.pendulum_angle, 'pendulum_rate': state.pendulum_rate,
        'joint_angle': state.joint_angle, 'joint_rate': state.joint_rate,
        'imu_turn_rate': imu.turn_rate, 'imu_forward': imu.forward, 'imu_upward': imu.upward,
        'dropped_periods': emulator.dropped,
        **(emulator.ball.lateral._asdict() if emulator.steering else {})}


def answer(emulator: Emulator, line: str) -> str:
    """Execute a line and return one line: ``ok``, a JSON object, or ``error:`` and the reason."""
    try:
        return execute(emulator, line)
    except BallbotError as error:
        return f'error: {error}'


class Channel:
    """Executes lines received over a Unix socket, and answers each with one line."""

    def __init__(self, emulator: Emulator, path: Path):
        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                for raw in self.rfile:
                    text = answer(emulator, raw.decode('utf-8', 'replace'))
                    self.wfile.write(f'{text}\n'.encode())

        self._path = path
        if path.exists() and not path.is_socket():
            raise ConfigurationError(
                f'{path} exists and is not a socket; choose another name for --control',
                'exists', '--control')
        try:
            path.unlink(missing_ok=True)
            self._server = socketserver.ThreadingUnixStreamServer(str(path), Handler)
        except OSError as error:
            raise ConfigurationError(
                f'cannot listen on {path}: {error.strerror or error}',
                'not_writable', '--control') from error
        self._server.daemon_threads = True
        self._thread = Thread(target=self._server.serve_forever, name='control', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
        self._path.unlink(missing_ok=True)
