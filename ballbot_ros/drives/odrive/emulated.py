# SPDX-License-Identifier: Apache-2.0
"""
An ODrive with firmware 0.5 or 0.6, as its ASCII protocol sees it.

0.5 is written after Firmware/communication/ascii_protocol.cpp and MotorControl/axis.cpp of
odriverobotics/ODrive, with their oddities: a line without a checksum is obeyed, ``;`` starts a
comment, ``!`` ends a line, numbers are read as far as they go, and a value is cut to nine
characters.

The source of 0.6 is not published.  Its names, and that a response is discarded while the one
before it is still being sent, are from the maker's documents; see firmware.py and codec.py.  All
else is guessed to be as in 0.5, and where a guess could spare the driver something, it is made
against the driver: here a torque command does not change the control mode, and arming sets the
torque to that of `init_torque`.
"""
import math
import re
from typing import Callable, Optional

from ballbot_ros.drives.emulated_device import Device
from ballbot_ros.drives.odrive.codec import (
    checksum, CLOSED_LOOP_CONTROL, frame_reply, IDLE, LINE_END, LONGEST_LINE, TORQUE_CONTROL)
from ballbot_ros.drives.odrive.emulated_names import NAMES, Names
from ballbot_ros.drives.wire import BITS_PER_BYTE

LONGEST_COMMAND = 256
LONGEST_VALUE = 9
LINE_ENDS = re.compile(rb'[\r\n!]')
FLOAT = r'\s*([-+]?(?:[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?|\.[0-9]+(?:[eE][-+]?[0-9]+)?|inf|nan))'


class ODriveDevice(Device):
    """See `Device`; the motor is on axis 0."""

    protocol = 'odrive'
    firmwares = tuple(NAMES)

    def _boot(self) -> None:
        self.names: Names = NAMES[self.settings.firmware or self.firmwares[0]]
        self._line = b''
        self._reading = True
        self._fed: Optional[float] = None
        self._sending_until = -math.inf
        self._input_torque = 0.0
        self.properties = self.names.properties(self.settings)
        self._measured: dict[str, Callable[[], float]] = {
            self.names.current: lambda: self.torque() / self.settings.torque_constant,
            'vbus_voltage': lambda: self.sensed.bus_voltage,
            'axis0.motor.fet_thermistor.temperature': lambda: self.sensed.temperature,
            'axis0.motor.motor_thermistor.temperature': lambda: self.sensed.motor_temperature,
        }

    @property
    def armed(self) -> bool:
        """Return whether the motor is under power."""
        return self.properties['axis0.current_state'] == CLOSED_LOOP_CONTROL

    def torque(self) -> float:
        """Return the torque at the shaft; see `Device`."""
        here = self.properties
        if not self.armed or here['axis0.controller.config.control_mode'] != TORQUE_CONTROL:
            return 0.0
        most = here[self.names.current_limit] * here[self.names.torque_constant]
        lowest = here[self.names.torque_min] if self.names.torque_min \
            else -here[self.names.torque_max]
        return min(max(self._input_torque, lowest, -most), here[self.names.torque_max], most)

    def tick(self, now: float) -> None:
        """Look after watchdog and temperature; see `Device`."""
        here, names = self.properties, self.names
        if self._fed is None:
            self._fed = now
        if here['axis0.config.enable_watchdog'] \
                and now - self._fed > here['axis0.config.watchdog_timeout']:
            self._trip(names.watchdog_expired)
        if self.sensed.temperature >= self.settings.highest_temperature:
            self._trip(names.too_hot)
        wanted = here['axis0.requested_state']
        if wanted:
            here['axis0.requested_state'] = 0
            if wanted == CLOSED_LOOP_CONTROL and names.ready(here):
                self._fed = now
                self._input_torque = here.get('axis0.config.init_torque', self._input_torque)
            elif wanted != IDLE:
                names.refuse(here, wanted)
                wanted = IDLE
            here['axis0.current_state'] = wanted
        if here[names.errors]:
            here['axis0.current_state'] = IDLE

    def over_current(self) -> None:
        """Trip; see `Device`."""
        self._trip(self.names.too_much_current)

    def _trip(self, bit: int) -> None:
        here = self.properties
        here[self.names.errors] = int(here[self.names.errors]) | bit
        if 'axis0.disarm_reason' in here:
            here['axis0.disarm_reason'] = int(here['axis0.disarm_reason']) | bit
        here['axis0.current_state'] = IDLE

    def _receive(self, data: bytes, now: float) -> bytes:
        reply = b''
        *lines, rest = LINE_ENDS.split(self._line + data)
        for line in lines:
            if self._reading:
                reply += self._sent(self._line_received(line, now), now)
                self.tick(now)
            self._reading = True
        if len(rest) >= LONGEST_COMMAND:
            rest, self._reading = b'', False
        self._line = rest
        return reply

    def _sent(self, responses: list[bytes], now: float) -> bytes:
        """Return what of the responses goes out."""
        reply = b''
        for response in responses:
            if self.names.one_reply_at_a_time and now < self._sending_until:
                continue
            duration = len(response) * BITS_PER_BYTE / self.baud
            self._sending_until = now + self.turnaround + duration
            reply += response
        return reply

    def _line_received(self, raw: bytes, now: float) -> list[bytes]:
        """Obey one line and return the responses."""
        raw = raw.split(b';')[0]
        body, asterisk, digits = raw.partition(b'*')
        checked = bool(asterisk and digits)
        if checked:
            number = re.match(rb'\s*\+?([0-9]+)', digits)
            if number is None or int(number[1]) != checksum(body):
                return []
        text = (body if checked else raw).decode('latin-1')
        return [_respond(answer, checked) for answer in self._obey(text, now)]

    def _obey(self, text: str, now: float) -> list[str]:
        letter = text[:1]
        if letter == 'c':
            return self._with_axis(text, now, FLOAT, self._set_torque)
        if letter == 'f':
            return self._with_axis(text, None, '', lambda _: [
                f'{self.sensed.position / math.tau:f} {self.sensed.velocity / math.tau:f}'])
        if letter == 'u':
            return self._with_axis(text, now, '', lambda _: [])
        if letter == 'i':
            return self.names.info(self.properties)
        if letter == 's':
            if text[1:2] == 'r':
                self.reboot(now)
            elif text[1:2] == 'c':
                self.properties.update({name: 0 for name in (
                    self.names.errors, 'axis0.disarm_reason') if name in self.properties})
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
        if int(match[1]) >= self.names.axes:
            return [f'invalid motor {int(match[1])}']
        if int(match[1]) != 0:  # the other motor output: nothing is connected to it
            return ['0.000000 0.000000'] if text[0] == 'f' else []
        if feeds is not None:
            self._fed = feeds
        return act(float(match[2]) if more else None)

    def _set_torque(self, value: Optional[float]) -> list[str]:
        if self.names.torque_command_sets_mode:
            self.properties['axis0.controller.config.control_mode'] = TORQUE_CONTROL
        self._input_torque = 0.0 if value is None or math.isnan(value) else value
        return []

    def _read(self, words: list[str]) -> list[str]:
        if not words:
            return ['invalid command format']
        name = words[0]
        if name in self._measured:
            return [f'{self._measured[name]():f}'[:LONGEST_VALUE]]
        if name not in self.properties:
            return ['invalid property']
        value = self.properties[name]
        return [(f'{value:f}' if isinstance(value, float) else str(value))[:LONGEST_VALUE]]

    def _write(self, words: list[str]) -> list[str]:
        if len(words) < 2 or words[0] not in self.properties:
            return ['invalid property']
        number = re.match(FLOAT, words[1])
        old = self.properties[words[0]]
        if number is not None and words[0] not in self.names.read_only:
            self.properties[words[0]] = type(old)(float(number[1]))
        return []


def _respond(text: str, checked: bool) -> bytes:
    """Return a reply as the drive sends it, cut to its buffer."""
    return (frame_reply(text) if checked else text.encode('ascii') + LINE_END)[:LONGEST_LINE]
