# SPDX-License-Identifier: Apache-2.0
"""ODrive on a CAN bus with CANSimple: torque mode, current loop in the drive."""
from collections import Counter, deque
from dataclasses import dataclass
import math
from typing import Any, Mapping, Optional

from ballbot_ros.config.fields import count, quantity, section, text
from ballbot_ros.drives.can_frames import CanFrame, judge_others, RECORD_SIZE, RecordParser
from ballbot_ros.drives.contract import DriveOptions, Identity, Setting, WireBudget
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.odrive.cansimple import codec
from ballbot_ros.drives.odrive.cansimple.codec import HIGHEST_NODE, REGISTERS
from ballbot_ros.drives.odrive.cansimple.settings import (
    check_confirmed, Endpoint, in_odrivetool, judge_firmware, judge_heartbeat, judge_positions,
    judge_trial, load_endpoints, missing, SLOWEST_HEARTBEAT)
from ballbot_ros.drives.odrive.firmware import (
    BUS_VOLTAGE, CLOSED_LOOP_CONTROL, CONTROL_MODE, ENCODER_5, GENERATION_5, GENERATION_6,
    generation_of, hardware_name, IDLE, in_words, INPUT_MODE, not_armed, PASSTHROUGH, RESULT_6,
    STATE, TORQUE_CONTROL, UNDER_POWER)
from ballbot_ros.drives.odrive.settings import judge
from ballbot_ros.errors import ConfigurationError, DriveError

# First firmware 0.5 whose heartbeat reports a failed encoder.
FIRST = (0, 5, 3)


@dataclass(frozen=True)
class ODriveCanOptions(DriveOptions):
    """The options of a driver; docs/hardware.md has those that each firmware needs."""

    node_id: int = count('node id of the axis on the bus', default=0, maximum=HIGHEST_NODE)
    status_period: float = quantity(
        's', 'time between requests for currents, voltage, temperatures and error registers, '
        'one of which is sent at a time', default=0.02, minimum=0.02, maximum=1.0)
    firmware: str = text(
        'version of a firmware 0.5, such as "0.5.6": it is not reported over CAN',
        default='')
    endpoints: str = text(
        'path of flat_endpoints.json, which the manufacturer provides for each firmware 0.6, to '
        'read settings over CAN', default='')
    confirmed: Optional[Mapping[str, float]] = section(
        'values of properties by name, which a person has read with odrivetool, as firmware 0.5 '
        'does not report them over CAN', default=None)

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


# Requested in turn, in addition to the position; one kind at most once in `LONGEST_LATENCY`.
POLLED = {'0.5': (codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.MOTOR_ERROR, codec.IQ,
                  codec.BUS_VOLTAGE_CURRENT, codec.ENCODER_ERROR, codec.CONTROLLER_ERROR),
          '0.6': (codec.ERROR, codec.IQ, codec.BUS_VOLTAGE_CURRENT, codec.ERROR, codec.IQ,
                  codec.BUS_VOLTAGE_CURRENT, codec.TEMPERATURE)}


REQUEST_PERIOD = 0.01  # between two requests while waiting [s]


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
        self._generation = GENERATION_6
        self._version: tuple[int, ...] = ()
        # By name; infinite if a register has an error whose bits are not read yet.
        self._values: dict[str, float] = {}
        self._result = 0  # of the last procedure, 0.6 only
        self._beats: deque[float] = deque(maxlen=3)  # arrival times of heartbeats [s]
        self._replies: dict[int, bytes] = {}  # command -> its last reply
        # The drive has executed all frames sent before this time: now, and at the last heartbeat.
        self._executed_until = self._reported_until = -math.inf
        self._torque, self._torque_at = 0.0, -math.inf
        self._status_at, self._turn = -math.inf, 0
        self._endpoints: Mapping[str, Endpoint] = {}
        self._read_back = 0  # number of read-backs
        self._nodes_seen: set[int] = set()  # nodes with a received heartbeat

    # Blocking methods

    def identify(self, timeout: float = 0.5) -> Identity:
        deadline = self.clock() + timeout
        self._wait_until_executed(deadline)
        self._refuse_late(deadline)
        timeout = self.options.reply_timeout
        version = self._ask(codec.VERSION, min(deadline, self.clock() + 2.0 * timeout))
        if version is None or len(version) != 8:  # 0.5 does not answer this request
            self._version, self._generation = self.options.version, GENERATION_5
            board = 'v3'
        else:
            self._version = tuple(version[4:7])
            self._generation = generation_of(self._version, 0, self.line.port)
            board = hardware_name(*version[1:4])
        self._identified = True
        self._drop_status()
        name = self._generation.name
        return Identity(self.protocol, board, in_words(self._version) or name, '', name)

    def _drop_status(self) -> None:
        """Drop state and errors until the next heartbeat."""
        self._values.clear()
        self._beats.clear()

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        """
        Read back the settings of a 0.6, test the watchdog of a 0.5, check them; see `Driver`.

        The test takes the watchdog time, in addition to `timeout`.
        """
        deadline, unknown = self.clock() + timeout, []
        self._require_identity(deadline)
        generation, options = self._generation, self.options
        self._wait_until_executed(deadline, 'requests')
        endpoints = load_endpoints(options.endpoints, self._version) \
            if options.endpoints and generation is not GENERATION_5 else {}
        self._endpoints = endpoints
        confirmed = options.confirmed or {} if generation is GENERATION_5 else {}

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
        settings += missing(unknown, generation is GENERATION_5, in_words(self._version))
        beats = self._beats
        beats.clear()
        unrequested = self.counts['unexpected']
        self._until(lambda: len(beats) == 3, min(deadline, self.clock() + 0.15))
        period = (beats[-1] - beats[0]) / (len(beats) - 1) if len(beats) > 1 else math.inf
        settings.append(judge_positions(
            self.counts['unexpected'] - unrequested, generation is GENERATION_5))
        settings += [judge_heartbeat(period, generation is GENERATION_5),
                     judge_others(self.counts['of_others'])]
        if generation is GENERATION_5:
            settings += [judge_firmware(in_words(self._version)), self._try_watchdog(deadline)]
        return tuple(settings)

    def _try_watchdog(self, deadline: float) -> Setting:
        """
        Test in idle state whether the watchdog of a firmware 0.5 expires without frames.

        Any frame to a 0.5 feeds its watchdog.
        """
        longest = self.options.watchdog
        if not self._beats or self._values[STATE] != IDLE:
            return judge_trial(None, False, longest)
        self._clear_errors(deadline)
        start = self.clock()
        expired = self._until(lambda: self._has_error(GENERATION_5.watchdog_expired),
                              start + 1.01 * longest + 2.0 * SLOWEST_HEARTBEAT)
        took = self.clock() - start
        self._send(codec.frame(self.options.node_id, codec.CLEAR_ERRORS))
        return judge_trial(took, expired, longest)

    def _clear_errors(self, deadline: float) -> None:
        """Clear all errors, wait until the drive has done so, and drop their values."""
        self._send(codec.frame(self.options.node_id, codec.CLEAR_ERRORS))
        self._wait_until_executed(deadline, 'requests')
        self._drop_status()

    def _has_error(self, bit: int) -> bool:
        return bool(int(self._values.get(self._generation.errors, 0)) & bit)

    def _arm(self, deadline: float) -> None:
        self._require_identity(deadline)
        generation = self._generation
        node, start = self.options.node_id, self.clock()
        for name in (CONTROL_MODE, INPUT_MODE.name):  # arming sets them
            self._settings.pop(name, None)
        # A latched error prevents arming; a present one returns immediately.
        self._send(self._torque_message(0.0) + codec.frame(node, codec.CLEAR_ERRORS)
                   + codec.set_mode(node, TORQUE_CONTROL, PASSTHROUGH)
                   + codec.set_state(node, CLOSED_LOOP_CONTROL) + self._ask_position())
        while True:
            self._drop_status()
            executed = self._until(lambda: bool(self._beats) and self._reported_until >= start,
                                   min(deadline, self.clock() + REQUEST_PERIOD))
            names = generation.faults(self._values, True)
            if executed and self._values[STATE] == CLOSED_LOOP_CONTROL and not names:
                return
            if executed and names or self.clock() >= deadline:
                result = () if generation is GENERATION_5 else RESULT_6.names_of(self._result)
                raise self._error(not_armed(names or result), 'not_armed')
            self._send(self._torque_message(0.0) + self._ask_position())

    def clear_faults(self, timeout: float = 0.5) -> tuple[str, ...]:
        if self._armed or self.telemetry.armed:
            raise self._error(UNDER_POWER, 'not_clearable', 'motor')
        deadline = self.clock() + timeout
        self._require_identity(deadline)
        self._clear_errors(deadline)
        self._until(lambda: bool(self._beats), deadline)
        return self.telemetry.faults

    # Non-blocking methods

    def feed(self) -> None:
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
        if self._identified and now - self._status_at >= self.options.status_period:
            polled = POLLED[self._generation.name]
            self._status_at, self._turn = now, (self._turn + 1) % len(polled)
            command = next((number for number, register in REGISTERS.items()
                            if self._values.get(register.path) == math.inf), polled[self._turn])
            self._pending.add(command)
            request += codec.ask(node, command)
            if self._turn == 0:
                request += self._read_back_request()
        return request

    def _read_back_request(self) -> bytes:
        """Return the request for the next setting to compare under power, empty for none."""
        names = [name for name in self._generation.safety_settings if name in self._endpoints]
        if not self._armed or not names:
            return b''
        self._read_back += 1
        return codec.read_endpoint(self.options.node_id, self._endpoints[
            names[self._read_back % len(names)]].number)

    def _send(self, data: bytes) -> None:
        # Any frame feeds the watchdog of a 0.5, and so would keep a torque of any sender active.
        if data and self.clock() - self._torque_at >= self.options.watchdog:
            data = codec.torque(self.options.node_id, 0.0) + data
        super()._send(data)

    def _ask_position(self) -> bytes:
        self._pending.add(codec.ENCODER_ESTIMATES)
        return codec.ask(self.options.node_id, codec.ENCODER_ESTIMATES)

    def _wait_until_executed(self, deadline: float, what: str = '') -> None:
        """Request the position until a reply arrives; see `_ask_until`."""
        start = self.clock()
        self._ask_until(lambda: self._executed_until >= start, self._ask_position, deadline, what)

    def _ask(self, command: int, deadline: float) -> Optional[bytes]:
        """Return the reply to a command, None if there is none before the deadline."""
        self._replies.pop(command, None)
        while command not in self._replies and self.clock() < deadline:
            self._send(codec.ask(self.options.node_id, command))
            self._until(lambda: command in self._replies, self._soon(deadline))
        return self._replies.get(command)

    def _read_endpoint(self, name: str, number: int, kind: str, deadline: float) -> float:
        """Return the value of an endpoint; raise `DriveError` if it does not arrive."""
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
                for name in self._generation.safety_settings:
                    value = codec.parse_endpoint(frame.data, *self._endpoints[name]) \
                        if name in self._endpoints else None
                    if value is not None:
                        self._check_setting(name, value)
            elif self._generation is not GENERATION_5 and command == codec.ERROR:
                self._values[self._generation.reason] = int.from_bytes(frame.data, 'little') >> 32
            elif command in REGISTERS and REGISTERS[command].path in self._values:
                self._values[REGISTERS[command].path] = int.from_bytes(frame.data, 'little')

    def _take_position(self, numbers: Optional[tuple[float, float]], now: float) -> None:
        match = self._match(codec.ENCODER_ESTIMATES, now)
        self._executed_until = max(self._executed_until, match.sent)
        # 0.5 reports 0 for an invalid estimate.
        if numbers is None or self._values.get(ENCODER_5.path) \
                or self._has_error(self._generation.no_estimate):
            return
        self.telemetry = self.telemetry._replace(
            time=now, measured=match.measured, position=numbers[0] * math.tau,
            velocity=numbers[1] * math.tau)

    def _take_heartbeat(self, content: Optional[codec.Heartbeat], now: float) -> None:
        if content is None:
            return
        values, flags = self._values, (content.first, content.second, content.third)
        values.update({self._generation.errors: content.errors, STATE: content.state})
        if self._generation is not GENERATION_5:
            self._result = content.first
        else:
            for register, flag in zip(REGISTERS.values(), flags):
                values[register.path] = values.get(register.path) or math.inf if flag & 1 else 0
        self._beats.append(now)
        self._reported_until = self._executed_until
        if content.state == IDLE:
            self._off_requested_at = self._reported_until
        self.telemetry = self.telemetry._replace(
            status_time=now, armed=content.state == CLOSED_LOOP_CONTROL,
            faults=self._generation.faults(values, self._armed))

    def _note(self, command: int, numbers: Optional[tuple[float, float]]) -> None:
        if numbers is None:
            return
        first, second = numbers
        if command == codec.IQ:
            self.telemetry = self.telemetry._replace(current=second)
        elif command == codec.BUS_VOLTAGE_CURRENT:
            self.telemetry = self.telemetry._replace(bus_voltage=first, bus_current=second)
        elif self._generation is not GENERATION_5:
            self.telemetry = self.telemetry._replace(temperature=first, motor_temperature=second)
