# SPDX-License-Identifier: Apache-2.0
"""ODrive on a CAN bus by CANSimple: torque mode, current measured there."""
from collections import Counter, deque
from dataclasses import dataclass
import math
from typing import Any, Mapping, NamedTuple, Optional

from ballbot_ros.config.fields import count, quantity, section, text
from ballbot_ros.drives.can_frames import CanFrame, judge_others, RECORD_SIZE, RecordParser
from ballbot_ros.drives.contract import DriveOptions, Identity, Setting, WireBudget
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.odrive.cansimple import codec
from ballbot_ros.drives.odrive.cansimple.codec import Heartbeat, HIGHEST_NODE
from ballbot_ros.drives.odrive.cansimple.settings import (
    check_confirmed, Endpoint, in_odrivetool, judge_firmware, judge_heartbeat, judge_positions,
    judge_trial, load_endpoints, missing, SLOWEST_HEARTBEAT)
from ballbot_ros.drives.odrive.firmware import (
    BUS_VOLTAGE, CLOSED_LOOP_CONTROL, CONTROL_MODE, CONTROLLER_5, ENCODER_5, Generation,
    generation_of, GENERATIONS, hardware_name, IDLE, in_words, INPUT_MODE, MOTOR_5, PASSTHROUGH,
    RESULT_6, TORQUE_CONTROL)
from ballbot_ros.drives.odrive.settings import judge
from ballbot_ros.errors import ConfigurationError, DriveError

# First firmware 0.5 whose heartbeat reports a failed encoder.
FIRST = (0, 5, 3)


@dataclass(frozen=True)
class ODriveCanOptions(DriveOptions):
    """See the fields; which firmware needs which is in docs/hardware.md."""

    node_id: int = count('node id of the axis on the bus', default=0, maximum=HIGHEST_NODE)
    status_period: float = quantity(
        's', 'time between requests for currents, voltage, temperatures and error registers, of '
        'which one is asked at a time', default=0.02, minimum=0.02, maximum=1.0)
    firmware: str = text(
        'version of a firmware 0.5, such as "0.5.6", which it does not report over CAN',
        default='')
    endpoints: str = text(
        'path of flat_endpoints.json, which the maker has for each firmware 0.6: by it settings '
        'are read over CAN', default='')
    confirmed: Optional[Mapping[str, float]] = section(
        'values of properties that a person has read with odrivetool, by name, where a firmware '
        '0.5 does not report them over CAN', default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_confirmed(self.confirmed)
        if self.firmware and not self.version:
            raise ConfigurationError(
                'firmware must be the version of a firmware 0.5 from 0.5.3 on, such as "0.5.6", '
                f'got {self.firmware!r}', 'out_of_range', 'firmware')

    @property
    def version(self) -> tuple[int, ...]:
        """Return the version of the firmware, empty if it is not given, or cannot be used."""
        parts = self.firmware.split('.')
        numbers = tuple(int(part) for part in parts if part.isdigit())
        known = len(numbers) == len(parts) == 3 and FIRST <= numbers and numbers[:2] == FIRST[:2]
        return numbers if known else ()


OLD = GENERATIONS[0]
# Registers of 0.5, in the order of the flags of its heartbeat.
REGISTERS = {codec.MOTOR_ERROR: MOTOR_5, codec.ENCODER_ERROR: ENCODER_5,
             codec.CONTROLLER_ERROR: CONTROLLER_5}
# Requested in turn besides the position; one of them at least only once in `LONGEST_LATENCY`.
POLLED = {'0.5': (codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.MOTOR_ERROR, codec.IQ,
                  codec.BUS_VOLTAGE_CURRENT, codec.ENCODER_ERROR, codec.CONTROLLER_ERROR),
          '0.6': (codec.ERROR, codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.ERROR, codec.IQ,
                  codec.BUS_VOLTAGE_CURRENT, codec.TEMPERATURE)}


class Beat(NamedTuple):
    """A heartbeat and its arrival time [s]."""

    time: float
    content: Heartbeat


class AxisCondition:
    """
    The state of the axis, and its errors by the names of its generation.

    Attributes
    ----------
    generation : Generation or None
        None before the handshake.
    beats : deque of Beat
        The last ones, the latest at the end.

    """

    def __init__(self) -> None:
        self.generation: Optional[Generation] = None
        self.beats: deque[Beat] = deque(maxlen=3)
        self._result = 0  # of the last procedure, 0.6 only
        self._registers: dict[int, int] = {}

    @property
    def state(self) -> Optional[int]:
        """Return the state of the axis in the latest heartbeat, None without one."""
        return self.beats[-1].content.state if self.beats else None

    @property
    def armed(self) -> bool:
        """Return whether the motor has power, by the latest heartbeat."""
        return self.state == CLOSED_LOOP_CONTROL

    @property
    def idle(self) -> bool:
        """Return whether the motor has no power, by the latest heartbeat."""
        return self.state == IDLE

    @property
    def period(self) -> float:
        """Return the time between two heartbeats [s], infinite where fewer have come."""
        beats = self.beats
        return (beats[-1].time - beats[0].time) / (len(beats) - 1) if len(beats) > 1 \
            else float('inf')

    @property
    def without_estimate(self) -> bool:
        """Return whether a position is not valid now; 0.5 reports 0 then."""
        if self.generation is None or not self.beats:
            return False
        content = self.beats[-1].content
        failed = self.generation is OLD and content.second & 1
        return bool(content.errors & self.generation.no_estimate or failed)

    @property
    def expired(self) -> bool:
        """Return whether the watchdog has expired, by the latest heartbeat."""
        return self.generation is not None and bool(self.beats) and bool(
            self.beats[-1].content.errors & self.generation.watchdog_expired)

    @property
    def unread(self) -> Optional[int]:
        """Return the command for a register that is needed to name the error."""
        for command in self._flagged():
            if command not in self._registers:
                return command
        return None

    def faults(self, ours: bool) -> tuple[str, ...]:
        """
        Return the names of all errors, in idle also of those that removed the power.

        A watchdog that expired without power is not a fault; `ours` is whether this driver had
        armed the motor.
        """
        if self.generation is None or not self.beats:
            return ()
        bits = self.beats[-1].content.errors
        if not (ours or self.armed):
            bits &= ~self.generation.watchdog_expired
        if self.generation is not OLD and self.idle:
            bits |= self._registers.get(codec.ERROR, 0) >> 32  # the reason
        parts: tuple[str, ...] = ()
        for command in self._flagged():
            register = REGISTERS[command]
            value = self._registers.get(command, 0)
            parts += register.names_of(value) if value else (register.path,)
        return (*self.generation.names_of(bits), *parts)

    def _flagged(self) -> tuple[int, ...]:
        """Return the commands for the registers that 0.5 flags."""
        if self.generation is not OLD or not self.beats:
            return ()
        content = self.beats[-1].content
        flags = (content.first, content.second, content.third)
        return tuple(command for command, flag in zip(REGISTERS, flags) if flag & 1)

    @property
    def reason(self) -> str:
        """Return why a state was not reached, as far as the heartbeat reports it."""
        reported = self.generation is not None and self.generation is not OLD
        return ', '.join(RESULT_6.names_of(self._result) if reported else ()) or 'no reason'

    def take_beat(self, content: Heartbeat, now: float) -> None:
        """Take a heartbeat."""
        self.beats.append(Beat(now, content))
        self._result = content.first

    def take_register(self, command: int, data: bytes) -> None:
        """Take an error register."""
        self._registers[command] = int.from_bytes(data, 'little')

    def forget(self) -> None:
        """Drop the registers: they are being cleared."""
        self._registers.clear()


REQUEST_PERIOD = 0.01        # between two requests while waiting [s]


class ODriveCan(Driver):
    """
    See `Driver`.

    Only a heartbeat reports whether the motor has power.  A heartbeat received after
    the answer to a request was sent after the drive had executed all frames before the request:
    frames of one sender keep their order.
    """

    options: ODriveCanOptions
    protocol, maker = 'odrive_can', 'ODrive'
    shares_line = 'node_id'
    Options = ODriveCanOptions
    baud_rates = (250000, 1000000, 500000, 125000)

    def _begin(self) -> None:
        self._parser = RecordParser()
        self._condition = AxisCondition()
        self._version: tuple[int, ...] = ()
        self._replies: dict[int, bytes] = {}  # command -> its last reply
        # The drive has executed all frames sent before: as of now, and as of the latest heartbeat.
        self._obeyed_until = self._reported_until = -math.inf
        self._torque, self._torque_at = 0.0, -math.inf
        self._status_at, self._turn = -math.inf, 0
        self._endpoints: Mapping[str, Endpoint] = {}
        self._read_back = 0  # number of read-backs
        self._nodes_seen: set[int] = set()  # nodes with a received heartbeat

    # Blocking methods

    def identify(self, timeout: float = 0.5) -> Identity:
        """Do the handshake; see `Driver`."""
        deadline = self.clock() + timeout
        self._see_obeyed(deadline)
        timeout = self.options.reply_timeout
        version = self._ask(codec.VERSION, min(deadline, self.clock() + 2.0 * timeout))
        if version is None or len(version) != 8:  # 0.5 does not answer that
            self._version, self._condition.generation = self.options.version, GENERATIONS[0]
            board = 'v3'
        else:
            self._version = tuple(version[4:7])
            self._condition.generation = generation_of(self._version, 0, self.line.port)
            board = hardware_name(*version[1:4])
        name = self._condition.generation.name
        return Identity(self.protocol, board, in_words(self._version) or name, '', name)

    def _known(self, deadline: float) -> Generation:
        if self._condition.generation is None:
            self.identify(deadline - self.clock())
        assert self._condition.generation is not None
        return self._condition.generation

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        """
        Read back the settings of a 0.6, test the watchdog of a 0.5, and check; see `Driver`.

        The test takes the watchdog time, in addition to `timeout`.
        """
        deadline, unknown = self.clock() + timeout, []
        generation, options = self._known(deadline), self.options
        self._see_obeyed(deadline, 'requests')
        endpoints = load_endpoints(options.endpoints, self._version) \
            if options.endpoints and generation is not OLD else {}
        self._endpoints = endpoints
        confirmed = options.confirmed or {} if generation is OLD else {}

        def read(name: str) -> float:
            if name in endpoints:
                return self._read_endpoint(name, *endpoints[name], deadline)
            if name == BUS_VOLTAGE:
                self._ask(codec.BUS_VOLTAGE_CURRENT, self._soon(deadline))
                return math.nan if self.telemetry.bus_voltage is None \
                    else self.telemetry.bus_voltage
            if name not in confirmed:
                unknown.append(name)
            return float(confirmed.get(name, math.nan))

        settings = [item._replace(remedy=in_odrivetool(item.remedy))
                    for item in judge(generation, read, options)]
        settings += missing(unknown, generation is OLD, in_words(self._version))
        self._condition.beats.clear()
        unrequested = self.counts['unexpected']
        self._until(lambda: len(self._condition.beats) == 3, min(deadline, self.clock() + 0.15))
        settings.append(judge_positions(
            self.counts['unexpected'] - unrequested, generation is OLD))
        settings += [judge_heartbeat(self._condition.period, generation is OLD),
                     judge_others(self.counts['of_others'])]
        if generation is OLD:
            settings += [judge_firmware(in_words(self._version)), self._try_watchdog(deadline)]
        return tuple(settings)

    def _try_watchdog(self, deadline: float) -> Setting:
        """
        Test in idle whether the watchdog of a firmware 0.5 expires when nothing is sent.

        Any frame to a 0.5 feeds it.
        """
        condition, longest = self._condition, self.options.watchdog
        if not condition.idle:
            return judge_trial(None, False, longest)
        self._clear_errors(deadline)
        begin = self.clock()
        condition.beats.clear()
        expired = self._until(
            lambda: condition.expired, begin + 1.01 * longest + 2.0 * SLOWEST_HEARTBEAT)
        took = self.clock() - begin
        self._send(codec.frame(self.options.node_id, codec.CLEAR_ERRORS))
        return judge_trial(took, expired, longest)

    def _clear_errors(self, deadline: float) -> None:
        """Clear all errors, and return when the drive has executed it."""
        self._condition.forget()
        self._send(codec.frame(self.options.node_id, codec.CLEAR_ERRORS))
        self._see_obeyed(deadline, 'requests')

    def _arm(self, deadline: float) -> None:
        self._known(deadline)
        node, condition, begin = self.options.node_id, self._condition, self.clock()
        for name in (CONTROL_MODE, INPUT_MODE.name):  # which arming sets
            self._settings.pop(name, None)
        # A latched error prevents arming; a present one returns immediately.
        condition.forget()
        self._send(self._torque_message(0.0) + codec.frame(node, codec.CLEAR_ERRORS)
                   + codec.set_mode(node, TORQUE_CONTROL, PASSTHROUGH)
                   + codec.set_state(node, CLOSED_LOOP_CONTROL) + self._ask_position())
        while True:
            condition.beats.clear()  # earlier states are stale
            obeyed = self._until(lambda: bool(condition.beats) and self._reported_until >= begin,
                                 min(deadline, self.clock() + REQUEST_PERIOD))
            names = condition.faults(ours=True)
            if obeyed and condition.armed and not names:
                return
            if obeyed and names or self.clock() >= deadline:
                raise DriveError(
                    f'{self.line.port}: the ODrive does not go into closed loop control and '
                    f'names {", ".join(names) or condition.reason}; remove the cause, '
                    'odrivetool shows more with dump_errors(odrv0)', 'not_armed', 'drive')
            self._send(self._torque_message(0.0) + self._ask_position())

    def clear_faults(self, timeout: float = 0.5) -> tuple[str, ...]:
        """Clear latched faults, without power; see `Driver`."""
        if self._armed or self.telemetry.armed:
            raise DriveError(
                f'{self.line.port}: the motor is under power; stop it first',
                'not_clearable', 'motor')
        deadline = self.clock() + timeout
        self._known(deadline)
        self._clear_errors(deadline)
        self._condition.beats.clear()
        self._until(lambda: bool(self._condition.beats), deadline)
        return self.telemetry.faults

    # Non-blocking methods

    def feed(self) -> None:
        """Feed the watchdog; see `Driver`."""
        self._send(self._torque_message(self._torque if self._armed else 0.0))

    def budget(self) -> WireBudget:
        """Return the records of a command, two requests, their replies and a heartbeat."""
        return WireBudget(3 * RECORD_SIZE, 3 * RECORD_SIZE)

    def _torque_message(self, torque: float) -> bytes:
        self._torque, self._torque_at = torque, self.clock()
        return codec.torque(self.options.node_id, torque)

    def _stop_message(self) -> bytes:
        return (self._torque_message(0.0) + codec.set_state(self.options.node_id, IDLE)
                + self._ask_position())

    def _requests(self) -> bytes:
        now, node, request = self.clock(), self.options.node_id, self._ask_position()
        generation, unread = self._condition.generation, self._condition.unread
        if generation is not None and now - self._status_at >= self.options.status_period:
            polled = POLLED[generation.name]
            self._status_at, self._turn = now, (self._turn + 1) % len(polled)
            command = polled[self._turn] if unread is None else unread
            self._pending.add(command)
            request += codec.ask(node, command)
            if self._turn == 0:
                request += self._read_back_request(generation)
        return request

    def _read_back_request(self, generation: Generation) -> bytes:
        """Return the request for the next setting to compare under power, empty for none."""
        names = [name for name in generation.safety_settings if name in self._endpoints]
        if not self._armed or not names:
            return b''
        self._read_back += 1
        return codec.read_endpoint(self.options.node_id, self._endpoints[
            names[self._read_back % len(names)]].number)

    def _send(self, data: bytes) -> None:
        # Any frame feeds the watchdog of a 0.5: it would keep an old torque alive, of any sender.
        if data and self.clock() - self._torque_at >= self.options.watchdog:
            data = codec.torque(self.options.node_id, 0.0) + data
        super()._send(data)

    def _ask_position(self) -> bytes:
        self._pending.add(codec.ENCODER_ESTIMATES)
        return codec.ask(self.options.node_id, codec.ENCODER_ESTIMATES)

    def _see_obeyed(self, deadline: float, what: str = '') -> None:
        """Request the position until a reply arrives; see `_ask_until`."""
        begin = self.clock()
        self._ask_until(lambda: self._obeyed_until >= begin, self._ask_position, deadline, what)

    def _ask(self, command: int, deadline: float) -> Optional[bytes]:
        """Return the reply to a command, None if there is none before the deadline."""
        self._replies.pop(command, None)
        while command not in self._replies and self.clock() < deadline:
            self._send(codec.ask(self.options.node_id, command))
            self._until(lambda: command in self._replies, self._soon(deadline))
        return self._replies.get(command)

    def _read_endpoint(self, name: str, number: int, kind: str, deadline: float) -> float:
        """Return the value of an endpoint; raise `DriveError` if it does not come."""
        def value() -> Optional[float]:
            return codec.parse_endpoint(self._replies.get(codec.TX_SDO, b''), number, kind)
        self._replies.pop(codec.TX_SDO, None)
        self._ask_until(lambda: value() is not None,
                        lambda: codec.read_endpoint(self.options.node_id, number), deadline,
                        f'the request for {name}')
        found = value()
        return math.nan if found is None else found

    def _handshake_error(self, before: Counter[str]) -> DriveError:
        return self._no_node(before, self._nodes_seen, 'is its CAN protocol SIMPLE')

    # Replies

    def _take_reply(self, reply: Any, now: float) -> None:
        frame: CanFrame = reply
        node, command = divmod(frame.identifier, 1 << codec.COMMAND_BITS)
        if command == codec.HEARTBEAT and not frame.extended:
            self._nodes_seen.add(node)
        if frame.extended or node != self.options.node_id:
            return
        if frame.remote or command in codec.COMMANDS:
            self.counts['of_others'] += 1
            return
        self._replies[command] = frame.data
        if command == codec.HEARTBEAT:
            self._take_heartbeat(codec.parse_heartbeat(frame.data), now)
        elif command == codec.ENCODER_ESTIMATES:
            self._take_position(codec.parse_floats(frame.data), now)
        else:
            self._pending.match(command, now)
            if command in (codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.TEMPERATURE):
                self._note(command, codec.parse_floats(frame.data))
            elif command == codec.TX_SDO:
                generation = self._condition.generation
                for name in generation.safety_settings if generation is not None else ():
                    value = codec.parse_endpoint(frame.data, *self._endpoints[name]) \
                        if name in self._endpoints else None
                    if value is not None:
                        self._check_setting(name, value)
            elif command in (codec.MOTOR_ERROR, codec.ENCODER_ERROR, codec.CONTROLLER_ERROR):
                self._condition.take_register(command, frame.data)

    def _take_position(self, numbers: Optional[tuple[float, float]], now: float) -> None:
        match = self._match(codec.ENCODER_ESTIMATES, now)
        self._obeyed_until = max(self._obeyed_until, match.sent)
        if numbers is None or self._condition.without_estimate:
            return
        self.telemetry = self.telemetry._replace(
            time=now, measured=match.measured, position=numbers[0] * math.tau,
            velocity=numbers[1] * math.tau)

    def _take_heartbeat(self, content: Optional[codec.Heartbeat], now: float) -> None:
        if content is None:
            return
        self._condition.take_beat(content, now)
        self._reported_until = self._obeyed_until
        if self._condition.idle:
            self._off_asked_at = self._reported_until
        self.telemetry = self.telemetry._replace(
            status_time=now, armed=self._condition.armed,
            faults=self._condition.faults(self._armed))

    def _note(self, command: int, numbers: Optional[tuple[float, float]]) -> None:
        """Put other replies into the telemetry."""
        generation = self._condition.generation
        if numbers is None or generation is None:
            return
        first, second = numbers
        if command == codec.IQ:
            self.telemetry = self.telemetry._replace(current=second)
        elif command == codec.BUS_VOLTAGE_CURRENT:
            self.telemetry = self.telemetry._replace(bus_voltage=first, bus_current=second)
        elif generation is not OLD:
            self.telemetry = self.telemetry._replace(temperature=first, motor_temperature=second)
