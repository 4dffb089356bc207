# SPDX-License-Identifier: Apache-2.0
"""
RoboClaw by packet serial: a duty cycle, open-loop voltage control as for GimBall in the paper.

The controller has no torque command.  The driver computes the voltage for the commanded torque
from resistance and back EMF of the motor at the last measured speed.
"""
from dataclasses import dataclass
import math

from ballbot_ros.config.fields import count, quantity
from ballbot_ros.drives.contract import (
    bit_names, DriveOptions, Identity, judge_torque, Setting, shown, WireBudget)
from ballbot_ros.drives.driver import Driver, Match
from ballbot_ros.drives.roboclaw import codec
from ballbot_ros.errors import ConfigurationError, DriveError

# Timeout of the supply voltage that scales the duty cycle [s].
STALE_VOLTAGE = 1.0
COUNTER = 2**32  # the encoder counter wraps


@dataclass(frozen=True)
class RoboClawOptions(DriveOptions):
    """The options of a RoboClaw driver."""

    address: int = count('address of the controller', default=codec.ADDRESSES[0],
                         minimum=codec.ADDRESSES[0], maximum=codec.ADDRESSES[-1])
    axis: int = count('motor output, 0 for M1 and 1 for M2', default=0, maximum=1)
    counts_per_turn: int = count('encoder counts per motor turn', default=4096, minimum=4)
    torque_constant: float = quantity('N m/A', 'motor torque per ampere', default=0.025,
                                      above=0.0)
    speed_constant: float = quantity('V s/rad', 'back EMF per motor speed', default=0.025,
                                     minimum=0.0)
    resistance: float = quantity('ohm', 'resistance of the armature and its leads', default=3.125,
                                 above=0.0)
    status_period: float = quantity(
        's', 'time between requests for status, voltage, current, temperature and settings, '
        'one of which is sent at a time', default=0.01, minimum=0.01, maximum=0.2)

    def __post_init__(self) -> None:
        super().__post_init__()
        # With a rounded timeout, the drive and the bridge would detect different delays.
        if not math.isclose(self.watchdog, codec.TIMEOUT_UNIT * self.tenths):
            raise ConfigurationError(
                f'watchdog is {self.watchdog:g} s, and the serial timeout of a RoboClaw has units '
                f'of {codec.TIMEOUT_UNIT:g} s: use {codec.TIMEOUT_UNIT * max(1, self.tenths):g}',
                'out_of_range', 'watchdog')

    @property
    def tenths(self) -> int:
        """Return the serial timeout [0.1 s]."""
        return round(self.watchdog / codec.TIMEOUT_UNIT)


class RoboClaw(Driver):
    """
    See `Driver`.

    The controller has no arming: before `arm`, and after a stop, this driver sends only zero
    duty.  Any byte, even of a request, feeds its serial timeout, so this driver adds zero duty
    to the requests once the last command is older than the watchdog time.  A restart resets the
    serial timeout and may be too short to be detected, so the timeout is set again with each
    request of the status period.
    """

    options: RoboClawOptions
    _parser: codec.ReplyParser
    protocol, maker = 'roboclaw', 'RoboClaw'
    Options = RoboClawOptions
    shortest_answer = codec.answer_length(codec.GET_ENCODER[0]) + codec.answer_length(
        codec.GET_SPEED[0])
    baud_rates = (38400, 115200, 460800, 230400, 57600, 19200, 9600, 2400)
    closes_torque_loop = False
    shares_line = 'axis'

    def _begin(self) -> None:
        axis = self.options.axis
        self._parser = codec.ReplyParser(self.options.address)
        self._motion = (codec.GET_ENCODER[axis], codec.GET_SPEED[axis])
        # Requested in turn, the status every other time; see `PendingRequests`.
        self._slow = (codec.GET_BATTERY, codec.GET_CURRENTS, codec.GET_TEMPERATURE,
                      codec.GET_TIMEOUT, codec.GET_MAX_CURRENT[axis], codec.GET_PWMS)
        self._answers: dict[int, codec.Reply] = {}
        self._turn = 0
        self._slow_at = -math.inf
        self._voltage_at = -math.inf
        self._duty = 0.0
        self._commanded_at = -math.inf
        self._counts = 0  # of the encoder, not wrapped

    # Blocking methods

    def identify(self, timeout: float = 0.5) -> Identity:
        deadline = self.clock() + timeout
        # Requests feed the serial timeout, and an earlier duty may still be active.
        text = self._ask(codec.GET_VERSION, deadline, handshake=True,
                         before=self._duty_message(0.0)).text.strip()
        self._refuse_late(deadline)
        self._ask(codec.GET_BATTERY, deadline)
        self._ask(codec.GET_STATUS, deadline)
        name, _, version = text.rpartition(' ')
        return Identity(self.protocol, name, version.removeprefix('v'))

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        """
        Set the serial timeout, read back and check the settings; see `Driver`.

        The timeout is sent at each start and by `arm`: a reset of the drive, which may be too
        short to be detected, clears it.
        """
        deadline = self.clock() + timeout
        options = self.options
        current = self._ask(codec.GET_MAX_CURRENT[options.axis], deadline).values[0] / 100.0
        lowest, highest = (0.1 * value for value in self._ask(
            codec.GET_VOLTAGES, deadline).values)
        supply = 0.1 * self._ask(codec.GET_BATTERY, deadline).values[0]
        # The drive stores hundredths of an ampere: a value rounded up would be refused.
        most = math.floor(100.0 * options.own_limit / options.torque_constant + 1e-6) / 100.0
        try:
            timeout = self._set_timeout(deadline)
        except DriveError:
            timeout = math.nan
        wanted_time = options.watchdog
        return (
            judge_torque(current * options.torque_constant, options,
                         f'Motion Studio, PWM Settings: max current {most:g} A'),
            Setting('watchdog', 'off' if timeout == 0.0 else shown(timeout, 's'),
                    f'at most {wanted_time:g} s',
                    0.0 < timeout <= 1.01 * wanted_time,
                    'the drive does not accept commands 14 and 15, which set it: update its '
                    'firmware with Motion Studio; its Serial Timeout is then set to '
                    f'{wanted_time:g} s at each start'),
            Setting('supply', f'{supply:.3g} V', f'between {lowest:.3g} V and {highest:.3g} V, or '
                    'the motor freewheels below and is braked above', lowest < supply < highest,
                    'Motion Studio, General Settings: Main Battery minimum and maximum'))

    def _set_timeout(self, deadline: float) -> float:
        """Set the serial timeout and return the value read back [s]."""
        return codec.TIMEOUT_UNIT * self._ask(
            codec.GET_TIMEOUT, deadline,
            before=codec.set_timeout(self.options.address, self.options.tenths)).values[0]

    def clear_faults(self, timeout: float = 0.5) -> tuple[str, ...]:
        """
        Return an empty tuple if there is no fault, and refuse otherwise.

        No command of a RoboClaw clears faults: temperature faults clear with their cause, all
        others with a reset (commands 200 to 202, for an e-stop, belong to the MCP series).
        """
        deadline = self.clock() + timeout
        self.stop(timeout)
        self._ask(codec.GET_STATUS, deadline)
        if self.telemetry.faults:
            raise self._error(
                f'the RoboClaw reports {", ".join(self.telemetry.faults)}, which clear with their '
                'cause or after a power cycle; no command clears them', 'not_clearable')
        return ()

    def _arm(self, deadline: float) -> None:
        self._ask(codec.GET_STATUS, deadline)
        if self.telemetry.faults:
            raise self._error(
                f'the RoboClaw reports {", ".join(self.telemetry.faults)}', 'not_armed')
        timeout = self._set_timeout(deadline)
        if not 0.0 < timeout < (self.options.tenths + 0.5) * codec.TIMEOUT_UNIT:
            raise self._error(
                f'the serial timeout of the RoboClaw is {timeout:g} s, unchanged; it must be at '
                f'most {self.options.tenths * codec.TIMEOUT_UNIT:g} s', 'not_armed')
        self._ask(codec.GET_BATTERY, deadline)

    # Non-blocking methods

    def send_torque(self, torque: float, ask: bool = True) -> None:
        """
        Send the duty for a torque; see `Driver`.

        Also raises `DriveError` with reason ``no_voltage`` if the drive has not reported its
        supply voltage for a second.
        """
        if self._armed and self.clock() - self._voltage_at > STALE_VOLTAGE:
            raise self._error(
                f'the RoboClaw has not reported its supply voltage for {STALE_VOLTAGE:g} s, '
                'which determines the duty cycle for a torque', 'no_voltage')
        super().send_torque(torque, ask)
        self._commanded_at = self.clock()

    def feed(self) -> None:
        self._send(self._group(codec.GET_PWMS, codec.GET_STATUS, *self._motion))
        self._commanded_at = self.clock()

    def ask(self) -> None:
        """Send the requests, with zero duty if the last command is too old; see `Driver`."""
        if self._may_ask or not self._armed:
            stale = self._duty != 0.0 \
                and self.clock() - self._commanded_at > self.options.watchdog
            self._send((self._duty_message(0.0) if stale else b'') + self._requests())

    def budget(self) -> WireBudget:
        """Return the bytes of a period with a slow value."""
        options = self.options
        numbers = (codec.GET_MAX_CURRENT[options.axis], *self._motion)  # with the longest reply
        answers = sum(codec.answer_length(number) for number in numbers)
        return WireBudget(len(codec.set_duty(options.address, options.axis, 0.0))
                          + len(codec.set_timeout(options.address, self.options.tenths))
                          + 2 * len(numbers), 2 + answers)

    def _torque_message(self, torque: float) -> bytes:
        if torque == 0.0:  # zero duty releases the motor: exactly zero torque
            return self._duty_message(0.0)
        options, last = self.options, self.telemetry
        voltage = torque * options.resistance / options.torque_constant \
            + options.speed_constant * (last.velocity or 0.0)
        return self._duty_message(voltage / last.bus_voltage if last.bus_voltage else 0.0)

    def _duty_message(self, duty: float) -> bytes:
        self._duty = duty
        return codec.set_duty(self.options.address, self.options.axis, duty)

    def _stop_message(self) -> bytes:
        return self._duty_message(0.0) + self._group(
            codec.GET_PWMS, codec.GET_STATUS, *self._motion)

    def _requests(self) -> bytes:
        now = self.clock()
        if now - self._slow_at < self.options.status_period:
            # Alternating order: a reply immediately shows that the previous one was lost.
            self._motion = self._motion[::-1]
            return self._group(*self._motion)
        self._slow_at = now
        self._turn += 1
        slow = self._slow[self._turn // 2 % len(self._slow)] if self._turn % 2 \
            else codec.GET_STATUS
        return self._group(slow, *self._motion) \
            + codec.set_timeout(self.options.address, self.options.tenths)

    def _group(self, *numbers: int) -> bytes:
        """Return requests whose replies form a group; the motion requests identify the axis."""
        self._pending.add(numbers)
        self._parser.groups = tuple(self._pending.kinds)
        return b''.join(codec.ask(self.options.address, number) for number in numbers)

    def _ask(self, number: int, deadline: float, handshake: bool = False,
             before: bytes = b'') -> codec.Reply:
        self._answers.pop(number, None)
        self._ask_until(lambda: number in self._answers,
                        lambda: before + self._group(number, *self._motion), deadline,
                        '' if handshake else f'command {number}')
        return self._answers[number]

    # Answers

    def _take_reply(self, group: list[codec.Reply], now: float) -> None:
        match = self._match(tuple(reply.command for reply in group), now)
        self.counts['replies'] += len(group) - 1
        for reply in group:
            self._answers[reply.command] = reply
            self._note(reply, match, now)

    def _note(self, reply: codec.Reply, match: Match, now: float) -> None:
        axis = self.options.axis
        last, number, values = self.telemetry, reply.command, reply.values
        turn = math.tau / self.options.counts_per_turn
        if number == codec.GET_ENCODER[axis]:
            # The nearest count with this wrapped value.
            step = (values[0] - self._counts + COUNTER // 2) % COUNTER - COUNTER // 2
            self._counts += step
            self.telemetry = last._replace(
                time=now, measured=match.measured, position=self._counts * turn)
        elif number == codec.GET_SPEED[axis]:
            self.telemetry = last._replace(velocity=values[0] * turn)
        elif number == codec.GET_PWMS:
            if values[axis] == 0:
                self._off_requested_at = match.sent
        elif number == codec.GET_BATTERY:
            self._voltage_at = now
            self.telemetry = last._replace(bus_voltage=values[0] / 10.0)
        elif number == codec.GET_CURRENTS:
            self.telemetry = last._replace(current=values[axis] / 100.0)
        elif number == codec.GET_TEMPERATURE:
            self.telemetry = last._replace(temperature=values[0] / 10.0)
        elif number == codec.GET_TIMEOUT:
            self._check_setting('serial timeout [s]', values[0] * codec.TIMEOUT_UNIT)
        elif number == codec.GET_MAX_CURRENT[axis]:
            self._check_setting('max current [A]', values[0] / 100.0)
        elif number == codec.GET_STATUS:
            faults = bit_names(values[0] & codec.ERRORS, codec.STATUS)
            self.telemetry = last._replace(
                status_time=now, faults=faults, armed=self._armed and not faults,
                warnings=bit_names(values[0] & ~codec.ERRORS, codec.STATUS))
