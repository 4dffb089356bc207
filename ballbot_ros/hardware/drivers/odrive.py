# SPDX-License-Identifier: Apache-2.0
"""ODrive with firmware 0.5, by its ASCII protocol: torque mode, current measured in the drive."""
from collections import deque
from dataclasses import dataclass
import math
import re
import time
from typing import Any, Callable, Optional

from ballbot_ros.errors import DriveError
from ballbot_ros.fields import count, quantity
from ballbot_ros.hardware.codecs import odrive as codec
from ballbot_ros.hardware.driver import DriveOptions, Driver, Identity, Line, Setting
from ballbot_ros.hardware.wire import WireBudget

TURN = 2.0 * math.pi
# In firmware 0.4 and before the torque command means amperes; 0.6 has other property names.
FIRMWARE = (0, 5)
# Longest replies: "-12345.123456 -1234.123456*255\r\n", and a value cut to nine characters.
LONGEST_FEEDBACK, LONGEST_VALUE = 32, 15
MARKERS = range(200, 1000)

# What is asked one at a time beside position and velocity; errors and state come often.
ERROR, STATE = 'error', 'current_state'
SLOW = {
    'current': 'motor.current_control.Iq_measured',
    'temperature': 'motor.fet_thermistor.temperature',
    'motor_temperature': 'motor.motor_thermistor.temperature',
    'bus_voltage': 'vbus_voltage',
}
ROUND = tuple(name for slow in SLOW.values() for name in (ERROR, STATE, slow))


@dataclass(frozen=True)
class ODriveOptions(DriveOptions):
    """What an ODrive driver is told."""

    axis: int = count('motor output of the board', default=0, maximum=1)
    status_period: float = quantity(
        's', 'time between questions for errors, state, voltage, current and temperatures, of '
        'which one is asked at a time', default=0.02, minimum=0.0, maximum=1.0)


class ODrive(Driver):
    """
    See `Driver`.

    Replies do not name their question.  So one property is asked for at a time; where its value
    is overdue, or one comes that was not asked for, a numbered marker is sent, and no value is
    believed until that has been answered.
    """

    protocol = 'odrive'
    Options = ODriveOptions
    baud_rates = (115200, 921600, 460800, 230400, 57600)

    def __init__(self, line: Line, options: Any, clock: Callable[[], float] = time.monotonic):
        """Take the line; nothing is sent yet."""
        super().__init__(line, options, clock)
        self._parser = codec.LineParser()
        self._texts: deque[str] = deque(maxlen=8)  # neither feedback nor value nor marker
        self._feedback_asked: deque[float] = deque(maxlen=1000)
        self._marker = MARKERS[0]
        self._marked_at: Optional[float] = None  # None: in step
        self._asked: Optional[str] = None  # property whose value is to come
        self._asked_at = -math.inf
        self._value: Optional[float] = None  # the last one, None for an invalid property
        self._turn = 0
        self._idle_asked_at = -math.inf  # when the state was asked that turned out to be idle

    # What waits

    def identify(self, patience: float = 0.5) -> Identity:
        """Ask who is there; see `Driver`."""
        deadline = self.clock() + patience
        self._fall_in_step(deadline)
        found: dict[str, str] = {}
        while 'Serial number' not in found:
            self._texts.clear()
            self._send(codec.INFO)
            self._until(lambda: len(self._texts) >= 3, self._soon(deadline))
            for text in self._texts:
                name, _, found[name] = text.partition(': ')
            if self.clock() >= deadline:
                break
        firmware = found.get('Firmware version', '')
        if tuple(int(part) for part in re.findall('[0-9]+', firmware)[:2]) != FIRMWARE:
            raise DriveError('firmware', (
                f'{self.line.port}: ODrive firmware must be 0.5, got {firmware or "no answer"}: '
                'older ones take a torque command for amperes, newer ones name their properties '
                'otherwise'))
        return Identity(self.protocol, found.get('Hardware version', ''), firmware,
                        found.get('Serial number', ''))

    def read_settings(self, patience: float = 0.5) -> tuple[Setting, ...]:
        """Read back and judge; see `Driver`."""
        deadline = self.clock() + patience

        def read(name: str) -> float:
            value = self._read(name, deadline)
            return math.nan if value is None else value

        limit, watchdog = self.options.torque_limit, self.options.watchdog
        ceiling = min(read('motor.config.torque_lim'), read('motor.config.current_lim')
                      * read('motor.config.torque_constant'))
        enabled, timeout = read('config.enable_watchdog') == 1.0, read('config.watchdog_timeout')
        mode, ready = read('controller.config.input_mode'), read('encoder.is_ready')
        return (
            Setting('torque limit', f'{ceiling:.4g} N m', f'at most {limit:g} N m',
                    ceiling <= 1.01 * limit,
                    self._write_line('motor.config.torque_lim', limit)),
            Setting('watchdog', f'{timeout:g} s' if enabled else 'off',
                    f'at most {watchdog:g} s', enabled and 0.0 < timeout <= 1.01 * watchdog,
                    self._write_line('config.watchdog_timeout', watchdog) + ', '
                    + self._write_line('config.enable_watchdog', 1)),
            Setting('input mode', f'{mode:g}', f'{codec.PASSTHROUGH} (pass through)',
                    mode == codec.PASSTHROUGH,
                    self._write_line('controller.config.input_mode', codec.PASSTHROUGH)),
            Setting('encoder', 'ready' if ready == 1.0 else 'not ready', 'ready', ready == 1.0,
                    'calibrate the encoder with odrivetool'))

    def _arm(self, deadline: float) -> None:
        # An error left over keeps the drive from arming; a present one comes back at once.
        self._send(self._torque_message(0.0) + codec.CLEAR_ERRORS)
        self._refuse_faults(deadline)
        wanted = codec.CLOSED_LOOP_CONTROL
        self._send(codec.write(self._full('requested_state'), wanted))
        while self._read(STATE, deadline) != wanted:
            self.feed()
            self._refuse_faults(deadline)
            if self.clock() >= deadline:
                raise DriveError('not_armed', (
                    f'{self.line.port}: the ODrive does not go into closed loop control and '
                    f'names no error'))
        self._refuse_faults(deadline)

    # What does not wait

    def feed(self) -> None:
        """Feed the watchdog; see `Driver`."""
        self._send(codec.feed_watchdog(self.options.axis))

    def _stop_message(self) -> bytes:
        return (self._torque_message(0.0)
                + codec.write(self._full('requested_state'), codec.IDLE)
                + self._in_step_question(STATE))

    def stopped_since(self, time: float) -> bool:
        """Tell whether the state, asked for after `time`, was idle; see `Driver`."""
        return self._idle_asked_at >= time

    def budget(self) -> WireBudget:
        """Return the bytes of a period in which the longest property is asked for."""
        ask = max(len(codec.read(self._full(name))) for name in ROUND)
        command = len(codec.torque(self.options.axis, -self.options.torque_limit))
        return WireBudget(command + len(codec.feedback(self.options.axis)) + ask,
                          LONGEST_FEEDBACK + LONGEST_VALUE)

    def _torque_message(self, torque: float) -> bytes:
        return codec.torque(self.options.axis, torque)

    def _questions(self) -> bytes:
        now = self.clock()
        self._feedback_asked.append(now)
        question = codec.feedback(self.options.axis)
        if now - self._asked_at >= self.options.status_period or self._marked_at is not None:
            name = ROUND[self._turn % len(ROUND)]
            asked = self._in_step_question(name)
            self._turn += self._asked == name and bool(asked)
            question += asked
        return question

    # Questions for properties

    def _full(self, name: str) -> str:
        return name if name == 'vbus_voltage' else f'axis{self.options.axis}.{name}'

    def _write_line(self, name: str, value: float) -> str:
        """Return what a person types to change a setting."""
        return f'w {self._full(name)} {value:g}'

    def _in_step_question(self, name: str) -> bytes:
        """Return the question for a property, a marker where one is needed, or nothing yet."""
        now = self.clock()
        if self._marked_at is None and self._asked is None:
            self._asked, self._asked_at = name, now
            return codec.read(self._full(name))
        if self._marked_at is not None and now - self._marked_at > self.options.reply_timeout:
            self._marker = self._marker + 1 if self._marker + 1 in MARKERS else MARKERS[0]
            self._marked_at = now
            return codec.FRESH_LINE + codec.marker(self._marker)
        return b''

    def _fall_out_of_step(self) -> None:
        """Believe no value until a marker, still to be sent, has been answered."""
        self._asked = None
        self._marked_at = -math.inf

    def _fall_in_step(self, deadline: float) -> None:
        """
        Send markers until one is answered.

        Raises
        ------
        DriveError
            ``silent``, ``garbled`` or ``wrong_protocol``.

        """
        self._fall_out_of_step()
        received, texts = self.counts['bytes'], self._parser.unchecked
        while self._marked_at is not None:
            self._send(self._in_step_question(''))
            self._until(lambda: self._marked_at is None, self._soon(deadline))
            if self._marked_at is not None and self.clock() >= deadline:
                if self._parser.unchecked > texts:
                    raise DriveError('wrong_protocol', (
                        f'{self.line.port}: text comes back, but not that of an ODrive, whose '
                        'replies have a checksum'))
                raise self._nobody(self.counts['bytes'] - received, 'ODrive')

    def _read(self, name: str, deadline: float) -> Optional[float]:
        """
        Return the value of a property, None if there is no such property.

        Raises
        ------
        DriveError
            ``silent`` if there is no answer before the deadline.

        """
        while True:
            if self._marked_at is not None or self._asked is not None:
                self._fall_in_step(deadline)
            self._send(self._in_step_question(name))
            if self._until(lambda: self._asked is None, self._soon(deadline)) \
                    and self._marked_at is None:
                return self._value
            if self.clock() >= deadline:
                raise DriveError('silent', (
                    f'{self.line.port}: the ODrive does not answer the question for '
                    f'{self._full(name)}'))

    def _refuse_faults(self, deadline: float) -> None:
        """Raise `DriveError` if the axis has an error."""
        bits = self._read(ERROR, deadline)
        if bits:
            raise DriveError('not_armed', (
                f'{self.line.port}: the ODrive names {", ".join(codec.error_names(int(bits)))}; '
                'mend the cause, odrivetool tells more with dump_errors(odrv0)'))

    # Replies

    def _take(self, data: bytes, now: float) -> None:
        self.counts['bytes'] += len(data)
        for text in self._parser.feed(data):
            self.counts['replies'] += 1
            self._take_text(text, now)
        self.counts['refused'] = self._parser.refused
        self.counts['unchecked'] = self._parser.unchecked
        overdue = now - self.options.reply_timeout
        while self._feedback_asked and self._feedback_asked[0] < overdue:
            self._feedback_asked.popleft()
            self.counts['lost'] += 1
        if self._asked is not None and self._asked_at < overdue:
            self.counts['lost'] += 1
            self._fall_out_of_step()

    def _take_text(self, text: str, now: float) -> None:
        feedback = codec.parse_feedback(text)
        if feedback is not None:
            if self._feedback_asked:
                self._feedback_asked.popleft()
            # An encoder that failed reads as 0.
            if 'ENCODER_FAILED' not in self.telemetry.faults:
                self.telemetry = self.telemetry._replace(
                    time=now, position=feedback.position * TURN,
                    velocity=feedback.velocity * TURN)
            return
        value = codec.parse_number(text)
        if value is not None or text == codec.INVALID_PROPERTY:
            if self._marked_at is None and self._asked is not None:
                name, self._asked, self._value = self._asked, None, value
                if value is not None and math.isfinite(value):
                    self._note(name, value, now)
                return
            self.counts['unexpected'] += 1
            if self._marked_at is None:
                self._fall_out_of_step()
        elif text == codec.marker_answer(self._marker):
            self._marked_at = None
        else:
            self._texts.append(text)

    def _note(self, name: str, value: float, now: float) -> None:
        """Put the value of a property into the telemetry."""
        if name == STATE:
            if value == codec.IDLE:
                self._idle_asked_at = self._asked_at
            self.telemetry = self.telemetry._replace(
                status_time=now, armed=value == codec.CLOSED_LOOP_CONTROL)
        elif name == ERROR:
            self.telemetry = self.telemetry._replace(
                status_time=now, faults=codec.error_names(int(value)))
        told: dict[str, Any] = {
            field: value for field, slow in SLOW.items() if name == slow}
        self.telemetry = self.telemetry._replace(**told)
