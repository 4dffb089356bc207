# SPDX-License-Identifier: Apache-2.0
"""
An ODrive with firmware 0.5, as its ASCII protocol sees it.

Written after Firmware/communication/ascii_protocol.cpp and MotorControl/axis.cpp of
odriverobotics/ODrive, with their oddities: a line without a checksum is obeyed, ``;`` starts a
comment, ``!`` ends a line, numbers are read as far as they go, and a value is cut to nine
characters.
"""
import math
import re
from typing import Callable, Optional

from ballbot_ros.emulator.device import Device, DriveSettings
from ballbot_ros.hardware.codecs.odrive import (
    checksum, CLOSED_LOOP_CONTROL, IDLE, LONGEST_LINE, PASSTHROUGH, TORQUE_CONTROL)

TURN = 2.0 * math.pi
AXES = 2
FIRMWARE = '0.5.6'
LONGEST_COMMAND = 256
LINE_ENDS = re.compile(rb'[\r\n!]')
INVALID_STATE, MOTOR_FAILED, WATCHDOG_TIMER_EXPIRED = 0x1, 0x40, 0x800
FLOAT = r'\s*([-+]?(?:[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+(?:[eE][-+]?[0-9]+)?|inf|nan))'


class ODriveDevice(Device):
    """See `Device`; the motor is on axis 0."""

    protocol = 'odrive'

    def __init__(self, settings: DriveSettings):
        """Boot."""
        super().__init__(settings)
        self._boot()

    def _boot(self) -> None:
        settings = self.settings
        self._line = b''
        self._reading = True
        self._fed: Optional[float] = None
        self._input_torque = 0.0
        # What can be read, and what of it can be written.
        self.properties: dict[str, float] = {
            'error': 0, 'current_state': IDLE, 'requested_state': 0,
            'config.enable_watchdog': float(settings.watchdog > 0.0),
            'config.watchdog_timeout': settings.watchdog,
            'controller.config.control_mode': TORQUE_CONTROL,
            'controller.config.input_mode': PASSTHROUGH,
            'motor.config.torque_lim': settings.torque_limit,
            'motor.config.current_lim': settings.current_limit,
            'motor.config.torque_constant': settings.torque_constant,
            'encoder.is_ready': 1,
        }
        self._measured: dict[str, Callable[[], float]] = {
            'motor.current_control.Iq_measured':
                lambda: self.torque() / settings.torque_constant,
            'motor.fet_thermistor.temperature': lambda: self.sensed.temperature,
            'motor.motor_thermistor.temperature': lambda: self.sensed.motor_temperature,
        }

    @property
    def armed(self) -> bool:
        """Tell whether the motor is under power."""
        return self.properties['current_state'] == CLOSED_LOOP_CONTROL

    def torque(self) -> float:
        """Return the torque at the shaft; see `Device`."""
        if not self.armed or self.properties['controller.config.control_mode'] != TORQUE_CONTROL:
            return 0.0
        limit = min(self.properties['motor.config.torque_lim'],
                    self.properties['motor.config.current_lim']
                    * self.properties['motor.config.torque_constant'])
        return min(max(self._input_torque, -limit), limit)

    def tick(self, now: float) -> None:
        """Look after watchdog and temperature; see `Device`."""
        if self._fed is None:
            self._fed = now
        if self.properties['config.enable_watchdog'] \
                and now - self._fed > self.properties['config.watchdog_timeout']:
            self._trip(WATCHDOG_TIMER_EXPIRED)
        if self.sensed.temperature >= self.settings.highest_temperature:
            self._trip(MOTOR_FAILED)
        wanted = self.properties['requested_state']
        if wanted:
            self.properties['requested_state'] = 0
            if wanted == CLOSED_LOOP_CONTROL:
                self._fed = now
            elif wanted != IDLE:
                self.properties['error'] = int(self.properties['error']) | INVALID_STATE
                wanted = IDLE
            self.properties['current_state'] = wanted
        if self.properties['error']:
            self.properties['current_state'] = IDLE

    def over_current(self) -> None:
        """Trip; see `Device`."""
        self._trip(MOTOR_FAILED)

    def _trip(self, bit: int) -> None:
        self.properties['error'] = int(self.properties['error']) | bit
        self.properties['current_state'] = IDLE

    def _receive(self, data: bytes, now: float) -> bytes:
        reply = b''
        *lines, rest = LINE_ENDS.split(self._line + data)
        for line in lines:
            if self._reading:
                reply += self._line_received(line, now)
                self.tick(now)
            self._reading = True
        if len(rest) >= LONGEST_COMMAND:
            rest, self._reading = b'', False
        self._line = rest
        return reply

    def _line_received(self, raw: bytes, now: float) -> bytes:
        """Obey one line and return the reply."""
        raw = raw.split(b';')[0]
        body, asterisk, digits = raw.partition(b'*')
        checked = bool(asterisk and digits)
        if checked:
            number = re.match(rb'\s*\+?([0-9]+)', digits)
            if number is None or int(number[1]) != checksum(body):
                return b''
        text = (body if checked else raw).decode('latin-1')
        answers = self._obey(text, now)
        return b''.join(_respond(answer, checked) for answer in answers)

    def _obey(self, text: str, now: float) -> list[str]:
        letter = text[:1]
        if letter == 'c':
            return self._with_axis(text, now, FLOAT, self._set_torque)
        if letter == 'f':
            return self._with_axis(text, None, '', lambda _: [
                f'{self.sensed.position / TURN:f} {self.sensed.velocity / TURN:f}'])
        if letter == 'u':
            return self._with_axis(text, now, '', lambda _: [])
        if letter == 'i':
            return ['Hardware version: 3.6-56V', f'Firmware version: {FIRMWARE}',
                    'Serial number: 208F3387304B']
        if letter == 's':
            if text[1:2] == 'r':
                self.reboot(now)
            elif text[1:2] == 'c':
                self.properties['error'] = 0
            return []
        if letter == 'r':
            return self._read(text.split()[1:2])
        if letter == 'w':
            return self._write(text.split()[1:3])
        return ['unknown command']

    def _with_axis(self, text: str, feeds: Optional[float], more: str,
                   act: Callable[[Optional[float]], list[str]]) -> list[str]:
        """Read the motor number, and a number after it, as sscanf does; then act."""
        match = re.match(rf'.\s*\+?([0-9]+){more}', text)
        if match is None:
            return ['invalid command format']
        if int(match[1]) >= AXES:
            return [f'invalid motor {int(match[1])}']
        if int(match[1]) != 0:  # the other motor output: nothing is connected to it
            return ['0.000000 0.000000'] if text[0] == 'f' else []
        if feeds is not None:
            self._fed = feeds
        return act(float(match[2]) if more else None)

    def _set_torque(self, value: Optional[float]) -> list[str]:
        self.properties['controller.config.control_mode'] = TORQUE_CONTROL
        self._input_torque = 0.0 if value is None or math.isnan(value) else value
        return []

    def _read(self, names: list[str]) -> list[str]:
        if not names:
            return ['invalid command format']
        if names[0] == 'vbus_voltage':
            return [f'{self.sensed.bus_voltage:f}'[:9]]
        name = names[0].removeprefix('axis0.')
        if name == names[0] or name not in {**self.properties, **self._measured}:
            return ['invalid property']
        if name in self._measured:
            return [f'{self._measured[name]():f}'[:9]]
        value = self.properties[name]
        return [f'{value:f}'[:9] if isinstance(value, float) else str(value)]

    def _write(self, words: list[str]) -> list[str]:
        name = words[0].removeprefix('axis0.') if words else ''
        if name not in self.properties or len(words) < 2:
            return ['invalid property']
        number = re.match(FLOAT, words[1])
        old = self.properties[name]
        if number is not None:
            self.properties[name] = type(old)(float(number[1]))
        return []


def _respond(text: str, checked: bool) -> bytes:
    """Return a reply as the drive sends it, cut to its buffer."""
    body = text.encode('latin-1')
    tail = b'*%d\r\n' % checksum(body) if checked else b'\r\n'
    return (body + tail)[:LONGEST_LINE]
