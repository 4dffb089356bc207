# SPDX-License-Identifier: Apache-2.0
"""ODrive with firmware 0.5 or 0.6, ASCII protocol: torque mode, current loop in the drive."""
from collections import Counter, deque
from dataclasses import dataclass
import math
from typing import Any, Optional

from ballbot_ros.config.fields import count, quantity
from ballbot_ros.drives.contract import DriveOptions, Identity, Setting, Telemetry, WireBudget
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.odrive.ascii import codec
from ballbot_ros.drives.odrive.firmware import (
    CLOSED_LOOP_CONTROL, CONTROL_MODE, EFFECTIVE_CURRENT, Generation, generation_of, GENERATIONS,
    HARDWARE, hardware_name, IDLE, in_words, not_armed, REQUESTED_STATE, SATURATED, SERIAL_NUMBER,
    STATE, TORQUE_CONTROL, UNDER_POWER, VERSION)
from ballbot_ros.drives.odrive.settings import judge
from ballbot_ros.errors import DriveError

# A loss of power is reported after this time even if registers were not read [s].
REGISTER_TIMEOUT = 0.1


class DriveStatus:
    """
    Collects the last value of each property in `values`, and reports them as telemetry.

    After an error, or a loss of motor power, all registers are read before anything is reported:
    the controller error alone does not give the cause, and a state read before the errors would be
    reported without one.  A current limit below the torque limit [N m] is a warning.
    """

    def __init__(self, generation: Generation, torque_limit: float):
        self.generation = generation
        self.values: dict[str, float] = {}
        self._torque_limit = torque_limit
        self._turn = self._round = 0
        self._open: list[str] = []  # to read before a loss of power is reported
        self._opened_at = -math.inf
        self._about: Optional[tuple[float, int]] = None  # the cause at their last read

    @property
    def urgent(self) -> bool:
        """Return whether the next request must not wait for its turn."""
        return bool(self._open)

    @property
    def errors(self) -> int:
        """Return the error bits that prevent motor power."""
        return int(self.values.get(self.generation.errors, 0.0))

    def next_name(self, now: float) -> str:
        """Return the property to request at a time [s]."""
        if self._open and now - self._opened_at > REGISTER_TIMEOUT:
            self._open, self._about = [], self._cause  # the loss is reported without them
        if self._open:
            return self._open[0]
        names = self.generation.polled + (
            tuple(item.path for item in self.generation.details) if self.errors else ())
        self._turn += 1
        if self._turn >= len(names):  # one of the settings after each round of telemetry
            settings = self.generation.safety_settings
            self._turn, self._round = -1, (self._round + 1) % len(settings)
            return settings[self._round]
        return names[self._turn]

    def forget_details(self) -> None:
        """Drop the values of the detail registers."""
        for register in self.generation.details:
            self.values.pop(register.path, None)
        self._open, self._about = [], None

    def forget_errors(self) -> None:
        """Drop all errors after they have been cleared."""
        self.forget_details()
        self.values.pop(self.generation.errors, None)
        self.values.pop(self.generation.reason, None)

    def take(self, name: str, value: Optional[float], now: float, ours: bool) -> None:
        """
        Update the value of a property at a time [s]; None if the reply was not a number.

        `ours` is whether this driver has armed the motor and not stopped it since.
        """
        if value is not None and math.isfinite(value):
            self.values[name] = value
        if not self.errors and not (ours and self.values.get(STATE) == IDLE):
            self.forget_details()
        elif name in self._open:
            self._open.remove(name)
            if not self._open:
                self._about = self._cause
        elif not self._open and self._about != self._cause:
            self._open = [item for item in self.generation.fault_properties if item != name]
            self._opened_at = now

    @property
    def _cause(self) -> tuple[float, int]:
        """Return state and error bits, which the detail registers explain."""
        return self.values.get(STATE, math.nan), self.errors

    def report(self, telemetry: Telemetry, name: str, now: float, ours: bool) -> Telemetry:
        """Return the telemetry, updated by the property that was read last."""
        generation, values = self.generation, self.values
        if name in generation.telemetry and name in values:
            reported: dict[str, Any] = {generation.telemetry[name]: values[name]}
            telemetry = telemetry._replace(**reported)
        if name in generation.warnings:
            telemetry = telemetry._replace(warnings=self._warnings())
        if name not in generation.fault_properties or STATE not in values or self._open:
            return telemetry
        return telemetry._replace(
            status_time=now, armed=values[STATE] == CLOSED_LOOP_CONTROL,
            faults=generation.faults(values, ours))

    def _warnings(self) -> tuple[str, ...]:
        generation, values = self.generation, self.values
        current = values.get(EFFECTIVE_CURRENT, math.inf)
        constant = values.get(generation.torque_constant, math.inf)
        names: tuple[str, ...] = ()
        if current * constant < 0.99 * self._torque_limit:
            names = (f'effective_current_lim {current:.3g} A',)
        if values.get(SATURATED, 0.0) == 1.0:
            names += (SATURATED,)
        return names


MARKER = 'marker'


class Properties:
    """
    Requests one property at a time, and matches the values to the requests.

    After an overdue or an unrequested value it is out of sync: it sends a numbered marker, and
    accepts no value until the marker is answered.  A value is overdue after a timeout [s].

    `requested` is the property whose value is pending, `requested_at` the time of the last request
    [s], `value` the last reply, None for text that is not a number, such as "invalid property",
    and `marker` the number of the last marker.
    """

    def __init__(self, timeout: float):
        self.requested: Optional[str] = None
        self.requested_at = -math.inf
        self.value: Optional[float] = None
        self._timeout = timeout
        self.marker = codec.MARKERS[0]
        self._marked_at: Optional[float] = None  # None: in sync

    @property
    def in_sync(self) -> bool:
        """Return whether the next value is the reply to the pending request."""
        return self._marked_at is None

    @property
    def free(self) -> bool:
        """Return whether a property can be requested now."""
        return self.in_sync and self.requested is None

    def lose_sync(self) -> None:
        """Accept no value until a marker, still to be sent, has been answered."""
        self.requested = None
        self._marked_at = -math.inf

    def ask(self, name: str, path: str, now: float) -> bytes:
        """
        Return the request for a property, a marker if one is needed, or no bytes yet.

        `name` is the name in this package, `path` the name in the drive.
        """
        if self.free:
            self.requested, self.requested_at = name, now
            return codec.read(path)
        if self._marked_at is not None and now - self._marked_at > self._timeout:
            following = self.marker + 1
            self.marker = following if following in codec.MARKERS else codec.MARKERS[0]
            self._marked_at = now
            return codec.marker(self.marker)
        return b''

    def take(self, text: str) -> Optional[str]:
        """
        Match a reply; return the property that it answers, `MARKER`, or None if it answers none.

        Text that answers a request means that there is no such property.
        """
        value = codec.parse_number(text)
        if not self.in_sync and value == self.marker:
            self._marked_at = None
            return MARKER
        if self.free or not self.in_sync:
            if value is not None and self.in_sync:
                self.lose_sync()
            return None
        name, self.requested, self.value = self.requested, None, value
        return name

    def drop_overdue(self, now: float) -> None:
        """Lose sync if the pending value is overdue."""
        if self.requested is not None and now - self.requested_at > self._timeout:
            self.lose_sync()


@dataclass(frozen=True)
class ODriveOptions(DriveOptions):
    """The options of an ODrive driver."""

    axis: int = count('motor output of the board', default=0, maximum=1)
    status_period: float = quantity(
        's', 'time between requests for errors, state, voltage, current and temperatures, '
        'one of which is sent at a time', default=0.02, minimum=0.0, maximum=1.0)


# Longest replies: "-12345.123456 -1234.123456*255\r\n", and a value truncated to nine characters.
LONGEST_FEEDBACK, LONGEST_VALUE = 32, 15
SHORTEST_FEEDBACK = len('0.000000 0.000000*0\r\n')
LEAST_SERIAL_NUMBER = 10**9  # a smaller one was truncated to nine digits, as in firmware 0.5


class ODrive(Driver):
    """
    See `Driver`.

    The firmware version in the handshake selects the table of names.  If a drive sends one reply
    at a time, a property is requested after the position has arrived.
    """

    options: ODriveOptions
    protocol, maker = 'odrive', 'ODrive'
    keeping = 'ss (in a serial terminal, like these lines; it restarts the drive)'
    Options = ODriveOptions
    shortest_answer = SHORTEST_FEEDBACK
    baud_rates = (115200, 921600, 460800, 230400, 57600)

    def _begin(self) -> None:
        self._parser = codec.LineParser()
        self._status = DriveStatus(GENERATIONS[-1], self.options.torque_limit)
        self._properties = Properties(self.options.reply_timeout)
        self._texts: deque[str] = deque(maxlen=8)  # neither feedback nor values
        self._then: Optional[str] = None  # property to request after the position
        self._period_start = -math.inf

    @property
    def _generation(self) -> Generation:
        return self._status.generation

    # Blocking methods

    def identify(self, timeout: float = 0.5) -> Identity:
        deadline = self.clock() + timeout
        self._synchronise(deadline)
        version = tuple(self._read(name, deadline) for name in VERSION)
        self._status = DriveStatus(generation_of(
            version, self.options.axis, self.line.port), self.options.torque_limit)
        self._identified = True
        hardware = hardware_name(*(self._read(name, deadline) for name in HARDWARE))
        return Identity(self.protocol, hardware, in_words(version),
                        self._serial_number(deadline), self._generation.name)

    def _serial_number(self, deadline: float) -> str:
        number = self._read(SERIAL_NUMBER, deadline)
        if number >= LEAST_SERIAL_NUMBER:
            return f'{int(number):012X}'
        self._texts.clear()
        self._send(codec.INFO)  # three lines, the last with the serial number
        if not self._until(lambda: len(self._texts) >= 3, self._soon(deadline)):
            self._properties.lose_sync()  # delayed lines may still arrive
        return next((text.partition(': ')[2] for text in self._texts
                     if text.startswith('Serial number: ')), '')

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        deadline = self.clock() + timeout
        self._require_identity(deadline)
        settings = judge(
            self._generation, lambda name: self._read(name, deadline), self.options)
        return tuple(item._replace(remedy=self._path(item.remedy)) for item in settings)

    def _arm(self, deadline: float) -> None:
        self._require_identity(deadline)
        # A latched error prevents arming; a present one returns immediately.
        self._send(self._torque_message(0.0) + codec.CLEAR_ERRORS)
        self._status.forget_errors()
        path = self._path(CONTROL_MODE)
        self._settings.pop(path, None)  # arming sets it
        self._send(codec.write(path, TORQUE_CONTROL))
        if self._read(CONTROL_MODE, deadline) != TORQUE_CONTROL:
            raise self._error(
                f'the ODrive does not enter torque control, see {path}', 'not_armed', path)
        self._refuse_faults(deadline)
        self._send(codec.write(self._path(REQUESTED_STATE), CLOSED_LOOP_CONTROL))
        while self._read(STATE, deadline) != CLOSED_LOOP_CONTROL:
            self._send(self._torque_message(0.0))
            self._refuse_faults(deadline)
            if self.clock() >= deadline - self.options.reply_timeout:
                raise self._not_armed(deadline)
        self._refuse_faults(deadline)

    def _refuse_faults(self, deadline: float) -> None:
        """Raise `DriveError` if the axis has an error, or does not report it."""
        bits = self._read(self._generation.errors, deadline)
        if not math.isfinite(bits):
            path = self._path(self._generation.errors)
            raise self._error(f'the ODrive has no {path}', 'not_armed', path)
        if bits:
            raise self._not_armed(deadline)

    def _not_armed(self, deadline: float) -> DriveError:
        """Return the error at arming, with the errors of all registers that reply in time."""
        try:
            names = self._faults(deadline, True)
        except DriveError:
            names = self._generation.faults(self._status.values, True)
        return self._error(not_armed(names), 'not_armed')

    def _faults(self, deadline: float, ours: bool) -> tuple[str, ...]:
        return self._generation.faults({name: self._read(name, self._soon(deadline))
                                        for name in self._generation.fault_properties}, ours)

    def clear_faults(self, timeout: float = 0.5) -> tuple[str, ...]:
        deadline = self.clock() + timeout
        self._require_identity(deadline)
        if self._armed or self._read(STATE, deadline) != IDLE:
            raise self._error(UNDER_POWER, 'not_clearable', 'motor')
        self._send(codec.feed_watchdog(self.options.axis) + codec.CLEAR_ERRORS)
        self._status.forget_errors()
        return self._faults(deadline, False)

    # Non-blocking methods

    def feed(self) -> None:
        self._send(codec.feed_watchdog(self.options.axis))

    def _stop_message(self) -> bytes:
        return (self._torque_message(0.0)
                + codec.write(self._path(REQUESTED_STATE), IDLE)
                + self._property_request(STATE))

    def budget(self) -> WireBudget:
        """Return the bytes of a period with the longest request of any firmware."""
        axis, limit = self.options.axis, -self.options.torque_limit
        command = len(codec.torque(axis, limit))
        ask = max(len(codec.read(self._path(name)))
                  for generation in GENERATIONS for name in generation.polled)
        most = max(len(codec.feedback(axis)) + ask, len(codec.marker(codec.MARKERS[0])))
        return WireBudget(command + most, LONGEST_FEEDBACK + LONGEST_VALUE)

    def _torque_message(self, torque: float) -> bytes:
        return codec.torque(self.options.axis, torque)

    def _requests(self) -> bytes:
        now, properties, start = self.clock(), self._properties, self._period_start
        self._period_start = now
        marker = b'' if properties.in_sync else self._property_request(STATE)
        if marker:
            return marker  # it is long, so it is sent alone
        if self._generation.one_reply_at_a_time and properties.requested \
                and properties.requested_at >= start:
            return b''  # its pending reply would suppress the reply to another request
        self._pending.add(codec.Feedback)
        request = codec.feedback(self.options.axis)
        if properties.free and (self._status.urgent
                                or now - properties.requested_at >= self.options.status_period):
            request += self._property_request(self._status.next_name(now))
        return request

    # Requests for properties

    def _path(self, name: str) -> str:
        """Return the drive's name of a property of the motor output in use."""
        return name.replace('axis0.', f'axis{self.options.axis}.')

    def _property_request(self, name: str) -> bytes:
        """Return the request for a property, empty if none is due; see `Properties.ask`."""
        if self._generation.one_reply_at_a_time and codec.Feedback in self._pending.kinds:
            self._then = name
            return b''
        return self._ask_property(name)

    def _ask_property(self, name: str) -> bytes:
        properties = self._properties
        request = properties.ask(name, self._path(name), self.clock())
        if request:
            self._pending.add(properties.marker if properties.requested is None
                              else (name, properties.requested_at))
        return request

    def _synchronise(self, deadline: float) -> None:
        """Send markers until one is answered; raises `DriveError` as `identify` does."""
        self._properties.lose_sync()
        self._ask_until(lambda: self._properties.in_sync, lambda: self._property_request(STATE),
                        deadline)

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        # A corrupted reply may have lost its checksum.
        if self.counts['unchecked'] > before['unchecked'] \
                and self.counts['refused'] == before['refused']:
            return self._error('text received, but not from an ODrive, whose replies have a '
                               'checksum', 'wrong_protocol')
        return super()._handshake_error(before)

    def _read(self, name: str, deadline: float) -> float:
        """
        Return the value of a property, NaN if there is no such property.

        Raises `DriveError` if there is no answer before the deadline; see `Driver.read_settings`.
        """
        properties, before = self._properties, self.counts.copy()
        while True:
            self._then = None
            if not properties.free:
                self._synchronise(deadline)
            self._until(lambda: not self._pending, self._soon(deadline))
            self._pending.clear()
            self._send(self._property_request(name))
            self._until(lambda: properties.requested is None, self._soon(deadline))
            if properties.free:
                return math.nan if properties.value is None else properties.value
            if self.clock() >= deadline:
                raise self._no_answer(before, f'for {self._path(name)}')

    # Replies

    def _take(self, data: bytes, now: float) -> None:
        super()._take(data, now)
        self._properties.drop_overdue(now)

    def _take_reply(self, text: str, now: float) -> None:
        feedback = codec.parse_feedback(text)
        if feedback is not None:
            self._take_feedback(feedback, now)
            return
        name, number = self._properties.take(text), codec.parse_number(text)
        if name is not None and name != MARKER:
            self._pending.match((name, self._properties.requested_at), now)
            self._note(name, self._properties.value, now)
        elif number is not None:
            self._match(number, now)
        else:
            self._texts.append(text)

    def _take_feedback(self, feedback: codec.Feedback, now: float) -> None:
        match = self._match(codec.Feedback, now)
        if self._then is not None:
            name, self._then = self._then, None
            self._send(self._ask_property(name))
        # A failed encoder reads as 0.
        if not self._status.errors & self._generation.no_estimate:
            self.telemetry = self.telemetry._replace(
                time=now, measured=match.measured, position=feedback.position * math.tau,
                velocity=feedback.velocity * math.tau)

    def _note(self, name: str, value: Optional[float], now: float) -> None:
        if name == STATE and value == IDLE:
            self._off_requested_at = self._properties.requested_at
        if name in self._generation.safety_settings and value is not None:
            self._check_setting(self._path(name), value)
        self._status.take(name, value, now, self._armed)
        self.telemetry = self._status.report(self.telemetry, name, now, self._armed)
