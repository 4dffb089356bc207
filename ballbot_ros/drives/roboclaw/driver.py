# SPDX-License-Identifier: Apache-2.0
"""
RoboClaw by packet serial: a duty cycle, the open-loop voltage that the paper drove GimBall by.

The controller has no torque command.  The driver computes the voltage that makes the wanted
torque in a motor of given resistance and back voltage, at the speed that was last measured.
"""
from dataclasses import dataclass
import math

from ballbot_ros.config.fields import count, quantity
from ballbot_ros.drives.contract import bit_names, DriveOptions, Identity, Setting
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.roboclaw import codec
from ballbot_ros.drives.wire import WireBudget
from ballbot_ros.errors import DriveError

TIMEOUT_UNIT = 0.1  # of the serial timeout [s]
# A reading of the supply older than this must not scale the duty cycle any more [s].
STALE_VOLTAGE = 1.0
COUNTER = 2**32  # the encoder counter wraps

# What is asked one at a time beside position and speed; the status comes every other time.
SLOW = (codec.GET_BATTERY, codec.GET_CURRENTS, codec.GET_TEMPERATURE)
POLLED = tuple(number for slow in SLOW for number in (codec.GET_STATUS, slow))


@dataclass(frozen=True)
class RoboClawOptions(DriveOptions):
    """The options of a RoboClaw driver."""

    address: int = count('of the controller', default=0x80, minimum=0x80, maximum=0x87)
    motor: int = count('motor output', default=1, minimum=1, maximum=2)
    counts_per_turn: int = count('encoder counts per motor turn', default=4096, minimum=4)
    torque_constant: float = quantity('N m/A', 'motor torque per ampere', default=0.025,
                                      above=0.0)
    speed_constant: float = quantity('V s/rad', 'back voltage per motor speed', default=0.025,
                                     minimum=0.0)
    resistance: float = quantity('ohm', 'of the armature and its leads', default=3.125,
                                 above=0.0)
    status_period: float = quantity(
        's', 'time between requests for status, voltage, current and temperature, of which one '
        'is asked at a time', default=0.01, minimum=0.0, maximum=0.2)


class RoboClaw(Driver):
    """
    See `Driver`.

    The controller has no arming: before `arm`, and after a stop, this driver sends zero duty
    only.  Any byte feeds its serial timeout, requests too; so this driver itself sends zero
    duty with the requests once the last command is older than the watchdog time.
    """

    options: RoboClawOptions
    _parser: codec.ReplyParser
    protocol, maker = 'roboclaw', 'RoboClaw'
    Options = RoboClawOptions
    baud_rates = (38400, 115200, 460800, 230400, 57600, 19200, 9600, 2400)
    closes_torque_loop = False

    def _begin(self) -> None:
        motor = self.options.motor - 1
        self._parser = codec.ReplyParser(self.options.address)
        self._motion = (codec.GET_ENCODER[motor], codec.GET_SPEED[motor])
        self._answers: dict[int, codec.Reply] = {}
        self._turn = 0
        self._slow_at = -math.inf
        self._voltage_at = -math.inf
        self._duty = 0.0
        self._commanded_at = -math.inf
        self._counts = 0  # of the encoder, without the wraps of its counter

    # What waits

    def identify(self, patience: float = 0.5) -> Identity:
        """Ask who is there; see `Driver`."""
        deadline = self.clock() + patience
        text = self._ask(codec.GET_VERSION, deadline, handshake=True).text.strip()
        self._ask(codec.GET_BATTERY, deadline)
        name, _, version = text.rpartition(' ')
        return Identity(self.protocol, name, version.removeprefix('v'))

    def read_settings(self, patience: float = 0.5) -> tuple[Setting, ...]:
        """Read back and judge; see `Driver`."""
        deadline = self.clock() + patience
        options = self.options
        timeout = TIMEOUT_UNIT * self._ask(codec.GET_TIMEOUT, deadline).values[0]
        current = self._ask(codec.GET_MAX_CURRENT[options.motor - 1], deadline).values[0] / 100.0
        ceiling = current * options.torque_constant
        wanted = max(1, round(options.watchdog / TIMEOUT_UNIT)) * TIMEOUT_UNIT
        return (
            Setting('torque limit', f'{ceiling:.4g} N m', f'at most {options.torque_limit:g} N m',
                    ceiling <= 1.01 * options.torque_limit,
                    'Motion Studio, PWM Settings: max current '
                    f'{options.torque_limit / options.torque_constant:.3g} A'),
            Setting('watchdog', f'{timeout:g} s' if timeout else 'off', f'at most {wanted:g} s',
                    0.0 < timeout <= 1.01 * wanted,
                    f'Motion Studio, General Settings: serial timeout {wanted:g} s'))

    def _arm(self, deadline: float) -> None:
        status, = self._ask(codec.GET_STATUS, deadline).values
        if status & codec.ERRORS:
            names = ', '.join(bit_names(status, codec.STATUS))
            raise DriveError('not_armed', f'{self.line.port}: the RoboClaw names {names}')
        self._ask(codec.GET_BATTERY, deadline)

    # What does not wait

    def send_torque(self, torque: float, ask: bool = True) -> None:
        """
        Send the duty that makes a torque; see `Driver`.

        Raises
        ------
        DriveError
            Also ``no_voltage`` if the drive has not reported its supply voltage for a second.

        """
        if self._armed and self.clock() - self._voltage_at > STALE_VOLTAGE:
            raise DriveError('no_voltage', (
                f'{self.line.port}: the RoboClaw has not reported its supply voltage for '
                f'{STALE_VOLTAGE:g} s, without which a torque makes no duty cycle'))
        super().send_torque(torque, ask)
        self._commanded_at = self.clock()

    def feed(self) -> None:
        """Feed the watchdog and leave the duty as it is; see `Driver`."""
        self._send(self._group(codec.GET_PWMS, codec.GET_STATUS))
        self._commanded_at = self.clock()

    def ask(self) -> None:
        """Ask, and send zero duty where the last command is too old; see `Driver`."""
        stale = self._duty != 0.0 \
            and self.clock() - self._commanded_at > self.options.watchdog
        self._send((self._duty_message(0.0) if stale else b'') + self._requests())

    def budget(self) -> WireBudget:
        """Return the bytes of a period in which a slow value is asked for."""
        options = self.options
        numbers = (codec.GET_STATUS, *self._motion)  # the longest of the slow ones
        answers = sum(codec.answer_length(number) for number in numbers)
        return WireBudget(len(codec.set_duty(options.address, options.motor, 0.0))
                          + 2 * len(numbers), 1 + answers)

    def _torque_message(self, torque: float) -> bytes:
        if torque == 0.0:  # released is exactly no torque; the back voltage would be a guess
            return self._duty_message(0.0)
        options, last = self.options, self.telemetry
        voltage = torque * options.resistance / options.torque_constant \
            + options.speed_constant * (last.velocity or 0.0)
        return self._duty_message(voltage / last.bus_voltage if last.bus_voltage else 0.0)

    def _duty_message(self, duty: float) -> bytes:
        self._duty = duty
        return codec.set_duty(self.options.address, self.options.motor, duty)

    def _stop_message(self) -> bytes:
        return self._duty_message(0.0) + self._group(codec.GET_PWMS, codec.GET_STATUS)

    def _requests(self) -> bytes:
        now = self.clock()
        if now - self._slow_at < self.options.status_period:
            return self._group(*self._motion)
        self._slow_at = now
        self._turn += 1
        return self._group(POLLED[self._turn % len(POLLED)], *self._motion)

    def _group(self, *numbers: int) -> bytes:
        """Return requests that are answered together."""
        self._outstanding.append((self.clock(), numbers))
        self._parser.groups = tuple({group for _, group in self._outstanding})
        return b''.join(codec.ask(self.options.address, number) for number in numbers)

    def _ask(self, number: int, deadline: float, handshake: bool = False) -> codec.Reply:
        """Ask until there is an answer and return it; see `_ask_until`."""
        self._answers.pop(number, None)
        self._ask_until(lambda: number in self._answers,
                        lambda: self._group(number, *self._motion), deadline,
                        '' if handshake else f'command {number}')
        return self._answers[number]

    # Answers

    def _take_reply(self, group: list[codec.Reply], now: float) -> None:
        asked = self._answered(tuple(reply.command for reply in group))
        self.counts['replies'] += len(group) - 1
        for reply in group:
            self._answers[reply.command] = reply
            self._note(reply, asked, now)

    def _note(self, reply: codec.Reply, asked: float, now: float) -> None:
        """Put an answer into the telemetry."""
        motor = self.options.motor - 1
        last, number, values = self.telemetry, reply.command, reply.values
        turn = math.tau / self.options.counts_per_turn
        if number == self._motion[0]:
            # The nearest count that the wrapped counter can mean.
            step = (values[0] - self._counts + COUNTER // 2) % COUNTER - COUNTER // 2
            self._counts += step
            self.telemetry = last._replace(time=now, position=self._counts * turn)
        elif number == self._motion[1]:
            self.telemetry = last._replace(velocity=values[0] * turn)
        elif number == codec.GET_PWMS:
            if values[motor] == 0:
                self._off_asked_at = asked
        elif number == codec.GET_BATTERY:
            self._voltage_at = now
            self.telemetry = last._replace(bus_voltage=values[0] / 10.0)
        elif number == codec.GET_CURRENTS:
            self.telemetry = last._replace(current=values[motor] / 100.0)
        elif number == codec.GET_TEMPERATURE:
            self.telemetry = last._replace(temperature=values[0] / 10.0)
        elif number == codec.GET_STATUS:
            self.telemetry = last._replace(
                status_time=now, faults=bit_names(values[0], codec.STATUS),
                armed=self._armed and not values[0] & codec.ERRORS)
