# SPDX-License-Identifier: Apache-2.0
"""
Emulated ODrive with firmware 0.5 or 0.6 and its ASCII protocol.

0.5 follows Firmware/communication/ascii_protocol.cpp of odriverobotics/ODrive, with its quirks:
a line without a checksum is executed, ``;`` starts a comment, ``!`` ends a line, the numeric
prefix of a text is read as a number, and a value is truncated to nine characters.  Motor and
errors are in emulated_board.py.

The source of 0.6 is not published.  Its names, and that a response is discarded while the previous
one is still being sent, are from the maker's documents; see firmware.py and codec.py.  All else is
assumed to be as in 0.5, except where that would be easier for the driver: here a torque command
does not change the control mode, and arming sets the torque to `init_torque`.
"""
import math
import re
from typing import Callable, Optional

from ballbot_ros.drives.contract import BITS_PER_BYTE
from ballbot_ros.drives.odrive.ascii.codec import checksum, frame_reply, LINE_END, LONGEST_LINE
from ballbot_ros.drives.odrive.emulated_board import BoardDevice
from ballbot_ros.drives.odrive.firmware import (
    BUS_CURRENT, BUS_VOLTAGE, CONTROL_MODE, EFFECTIVE_CURRENT, MOTOR_TEMPERATURE, SERIAL_NUMBER,
    TEMPERATURE, TORQUE_CONTROL, VALUE_LENGTH_MAX, VERSION)

LONGEST_COMMAND = 256
LINE_ENDS = re.compile(rb'[\r\n!]')
NUMBER = r'(?:[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+(?:[eE][-+]?[0-9]+)?|inf|nan)'
FLOAT = rf'\s*([-+]?{NUMBER})'


class ODriveDevice(BoardDevice):
    """See `Device`; properties of the axis with the motor are stored under the name axis0."""

    protocol = 'odrive'

    def _boot(self) -> None:
        super()._boot()
        self._line = b''
        self._reading = True
        self._sending_until = -math.inf
        generation = self.firmware.generation
        self._measured: dict[str, Callable[[], float]] = {
            generation.current: self.current,
            BUS_VOLTAGE: lambda: self.sensed.bus_voltage, BUS_CURRENT: self.supply_current,
            EFFECTIVE_CURRENT: self.effective_current_limit,
            TEMPERATURE: lambda: self.sensed.temperature,
            MOTOR_TEMPERATURE: lambda: self.sensed.motor_temperature}

    def _receive(self, data: bytes, now: float) -> bytes:
        reply = b''
        *lines, rest = LINE_ENDS.split(self._line + data)
        for line in lines:
            if self._reading and len(line) < LONGEST_COMMAND:
                reply += self._sent(self._line_received(line, now), now)
                self.tick(now)
            self._reading = True
        if len(rest) >= LONGEST_COMMAND:
            rest, self._reading = b'', False
        self._line = rest
        return reply

    def _sent(self, responses: list[bytes], now: float) -> bytes:
        reply = b''
        for response in responses:
            if self.firmware.generation.one_reply_at_a_time and now < self._sending_until:
                continue
            duration = len(response) * BITS_PER_BYTE / self.baud
            self._sending_until = now + self.turnaround + duration
            reply += response
        return reply

    def _line_received(self, raw: bytes, now: float) -> list[bytes]:
        raw = raw.split(b';')[0]
        body, asterisk, digits = raw.partition(b'*')
        checked = bool(asterisk and digits)
        if checked:
            number = re.match(rb'\s*\+?([0-9]+)', digits)
            if number is None or int(number[1]) != checksum(body):
                return []
        text = (body if checked else raw).decode('latin-1')
        return [_respond(answer, checked) for answer in self._execute(text, now)]

    def _execute(self, text: str, now: float) -> list[str]:
        letter = text[:1]
        if letter == 'c':
            return self._with_axis(text, now, FLOAT, self._set_torque)
        if letter == 'f':
            return self._with_axis(text, None, '', lambda _: [
                f'{self.sensed.position / math.tau:f} {self.sensed.velocity / math.tau:f}'])
        if letter == 'u':
            return self._with_axis(text, now, '', lambda _: [])
        if letter == 'i':
            return ['Hardware version: {}.{}-{}V'.format(*self.firmware.board),
                    'Firmware version: {}.{}.{}'.format(*map(self.properties.get, VERSION)),
                    f'Serial number: {self.properties[SERIAL_NUMBER]:X}']
        if letter == 's':
            return self._control_system(text[1:2], now)
        if letter == 'r':
            return self._read(text.split()[1:2])
        if letter == 'w':
            return self._write(text.split()[1:3])
        return ['unknown command']

    def _control_system(self, letter: str, now: float) -> list[str]:
        """Save and restart, restart, or clear the errors."""
        if letter == 's' and not self.armed:
            self._saved = {name: value for name, value in self.properties.items()
                           if name.startswith('config.') or '.config.' in name}
        if letter in ('r', 's') and not (letter == 's' and self.armed):
            self.reboot(now)
        elif letter == 'c':
            self.clear_errors()
        return []

    def _with_axis(self, text: str, feeds: Optional[float], more: str,
                   act: Callable[[tuple[float, ...]], list[str]]) -> list[str]:
        """Read the motor number, and numbers after it, as sscanf does; then act."""
        match = re.match(rf'.\s*\+?([0-9]+){more}', text)
        if match is None:
            return ['invalid command format']
        if int(match[1]) >= self.firmware.generation.axes:
            return [f'invalid motor {int(match[1])}']
        if int(match[1]) != self.settings.axis:  # no motor is connected to the other output
            return ['0.000000 0.000000'] if text[0] == 'f' else []
        if feeds is not None:
            self.feed(feeds)
        return act(tuple(0.0 if math.isnan(float(number)) else float(number)
                         for number in match.groups()[1:] if number is not None))

    def _set_torque(self, numbers: tuple[float, ...]) -> list[str]:
        if self.firmware.torque_command_sets_mode:
            self.properties[CONTROL_MODE] = TORQUE_CONTROL
        self.input_torque = numbers[0]
        return []

    def _read(self, words: list[str]) -> list[str]:
        if not words:
            return ['invalid command format']
        name = self._own_name(words[0])
        if name in self._measured:
            return [f'{self._measured[name]():f}'[:VALUE_LENGTH_MAX]]
        if name not in self.properties:
            return ['invalid property']
        value = self.properties[name]
        text = f'{value:f}' if isinstance(value, float) else str(value)
        return [text[:VALUE_LENGTH_MAX]]

    def _write(self, words: list[str]) -> list[str]:
        name = self._own_name(words[0]) if len(words) == 2 else ''
        if name not in self.properties:
            return ['invalid property']
        number = re.match(FLOAT, words[1])
        old = self.properties[name]
        if number is not None and name not in self.firmware.read_only:
            value = float(number[1])
            if isinstance(old, float) or math.isfinite(value):
                self.properties[name] = type(old)(value)
        return []

    def _own_name(self, name: str) -> str:
        """Return the name under which a property is stored; empty for the axis without a motor."""
        if not name.startswith('axis'):
            return name
        axis, _, rest = name.partition('.')
        return f'axis0.{rest}' if axis == f'axis{self.settings.axis}' else ''


def _respond(text: str, checked: bool) -> bytes:
    """Return a reply as the drive sends it, truncated to its buffer."""
    return (frame_reply(text) if checked else text.encode('ascii') + LINE_END)[:LONGEST_LINE]
