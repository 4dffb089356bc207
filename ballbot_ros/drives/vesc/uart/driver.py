# SPDX-License-Identifier: Apache-2.0
"""VESC with its serial protocol: current mode; the torque constant converts a torque."""
import math
from typing import Mapping, Optional

from ballbot_ros.drives.contract import bit_names, Identity, Setting, WireBudget
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.vesc import settings
from ballbot_ros.drives.vesc.settings import VescOptions
from ballbot_ros.drives.vesc.uart import codec

# A motor current below this fraction of the limit counts as zero, because of sensor noise.
NO_CURRENT = 0.05
# Time between two read-backs of the settings under power [s], alternately limits and application:
# at 115200 baud a reply delays the measurements by 40 ms.
READ_BACK_PERIOD = 5.0
# Why a motor has no current, by bit of the status; the names are those of timeout.c.
STATUS = {codec.TIMED_OUT: 'HAS_TIMEOUT', codec.KILL_SWITCH: 'KILL_SW_ACTIVE'}


class Vesc(Driver):
    """
    See `Driver`.

    A VESC has no arming: it follows each current command.  Before `arm`, and after a stop, this
    driver sends none.  Then its timeout expires, and its status reports this; `arm` feeds the
    timeout until the thread of the VESC, which runs every 10 ms, has cleared that status.
    """

    options: VescOptions
    protocol, maker = 'vesc', 'VESC'
    Options = VescOptions
    replies_are_named = True
    separator = bytes(255)  # a parser may wait for this many bytes after a corrupted length
    shortest_answer = codec.VALUES_LENGTH
    baud_rates = (115200, 921600, 460800, 230400, 57600)
    _frame_reply = staticmethod(codec.frame_reply)

    def _begin(self) -> None:
        self._parser = codec.FrameParser()
        self._tag = 0
        self._replies: dict[int, bytes] = {}  # message -> its last reply, except values
        self._turn_offset: Optional[float] = None  # tachometer minus encoder, at the first reply
        self._version: settings.Version = (0, 0)
        self._limits: Mapping[str, float] = settings.UNKNOWN_LIMITS
        self._read_back, self._read_back_at = codec.GET_MCCONF, -math.inf
        self._status, self._status_requested_at = 0, -math.inf

    # Blocking methods

    def identify(self, timeout: float = 0.5) -> Identity:
        deadline = self.clock() + timeout
        firmware = codec.parse_firmware(self._ask(codec.FW_VERSION, deadline, handshake=True))
        if firmware is None:
            raise self._error(
                'a VESC replies but does not report its firmware', 'firmware', 'firmware')
        version, test = (firmware.major, firmware.minor), firmware.test
        reason = settings.why_not(version, test)
        if reason:
            raise self._error(
                f'VESC firmware must be 5.03 to 7.xx, got {version[0]}.{version[1]:02}: {reason}; '
                'update it with VESC Tool, Firmware', 'firmware', 'firmware')
        self._refuse_late(deadline)
        self._version, self._identified = version, True
        return Identity(self.protocol, firmware.hardware, f'{version[0]}.{version[1]:02}'
                        + (f' test {test}' if test else ''), firmware.serial_number)

    def read_settings(self, timeout: float = 0.5) -> tuple[Setting, ...]:
        deadline = self.clock() + timeout
        self._require_identity(deadline)
        application = settings.parse_application(
            self._ask(codec.GET_APPCONF, deadline), self._version) or settings.UNKNOWN
        self._limits = settings.parse_limits(
            self._ask(codec.GET_MCCONF, deadline), self._version) or settings.UNKNOWN_LIMITS
        return settings.judge(application, self._limits, self.options,
                              self.telemetry.bus_voltage or math.nan)

    def _arm(self, deadline: float) -> None:
        self._read_back_at, reported = self.clock(), False
        while True:
            answered = self._ask_status(self._torque_message(0.0), deadline)
            reported = reported or answered
            if answered and self.telemetry.faults:
                raise self._error(
                    f'the VESC reports {", ".join(self.telemetry.faults)}; the terminal of VESC '
                    'Tool shows details with: faults', 'not_armed')
            if answered and not self._status & codec.TIMED_OUT:
                return
            if self.clock() >= deadline:
                raise self._error('the VESC ' + (
                    'reports that its timeout has expired although it is fed' if reported
                    else 'does not report its state'),
                    'not_armed', 'watchdog' if reported else 'drive')

    def clear_faults(self, timeout: float = 1.0) -> tuple[str, ...]:
        """
        Wait until the VESC has cleared its faults, and refuse if it does not.

        No message clears them: the VESC does so its fault stop time (by default half
        a second) after the cause has disappeared.
        """
        deadline = self.clock() + timeout
        self.stop(timeout)
        while True:
            answered = self._ask_status(b'', deadline)
            if answered and not self.telemetry.faults or self.clock() >= deadline:
                break
        if self.telemetry.faults or not answered:
            raise self._error(
                f'the VESC reports {", ".join(self.telemetry.faults)}, which it clears by itself '
                'half a second after the cause; no message clears them'
                if answered else 'the VESC does not report its state', 'not_clearable')
        return ()

    def _ask_status(self, command: bytes, deadline: float) -> bool:
        """Send a command with a request; return whether a status requested since then arrives."""
        start = self.clock()
        self._send(command + self._requests())
        return self._until(lambda: self._status_requested_at >= start, self._soon(deadline))

    # Non-blocking methods

    def feed(self) -> None:
        self._send(self._packet(bytes((codec.ALIVE,))))

    def budget(self) -> WireBudget:
        """Return the bytes of a command, a request and its reply."""
        values = codec.pack_values(codec.Values(*(0,) * len(codec.FIELDS)))
        return WireBudget(len(self._torque_message(0.0) + self._packet(codec.get_values())),
                          len(self._frame_reply(values)))

    def _packet(self, payload: bytes) -> bytes:
        """Return the bytes that carry a message on the line."""
        return codec.frame(payload)

    def _torque_message(self, torque: float) -> bytes:
        return self._packet(codec.set_current(torque / self.options.torque_constant))

    def _stop_message(self) -> bytes:
        return self._torque_message(0.0) + self._requests()

    def _requests(self) -> bytes:
        self._tag = (self._tag + 1) % codec.TAGS
        self._pending.add(self._tag)
        return self._packet(codec.get_values(self._tag)) + self._read_back_request()

    def _read_back_request(self) -> bytes:
        """Return the request for the settings that are due, empty for none."""
        now = self.clock()
        if not self._armed or now - self._read_back_at < READ_BACK_PERIOD:
            return b''
        self._read_back_at = now
        self._read_back = codec.GET_APPCONF if self._read_back == codec.GET_MCCONF \
            else codec.GET_MCCONF
        return self._packet(bytes((self._read_back,)))

    def _ask(self, message: int, deadline: float, handshake: bool = False) -> bytes:
        self._replies.pop(message, None)
        self._ask_until(
            lambda: message in self._replies, lambda: self._packet(bytes((message,))),
            deadline, '' if handshake else f'message {message}')
        return self._replies[message]

    # Replies

    def _take_reply(self, payload: bytes, now: float) -> None:
        values = codec.parse_values(payload)
        if values is not None:
            self._note(values, now)
        elif payload[0] in (codec.FW_VERSION, codec.GET_APPCONF, codec.GET_MCCONF):
            self._replies[payload[0]] = payload
            self._check_settings(payload)
        else:
            self.counts['unexpected'] += 1

    def _check_settings(self, payload: bytes) -> None:
        if not self._identified:
            return
        application = settings.parse_application(payload, self._version)
        found = application._asdict() if application is not None \
            else settings.parse_limits(payload, self._version) or {}
        for name, value in found.items():
            self._check_setting(name, value)

    def _note(self, values: codec.Values, now: float) -> None:
        """Update the telemetry; the tag of a reply identifies its request."""
        match = self._match(values.tag, now)
        if match.sent == -math.inf:
            return  # a reply to no request, or to a dropped one
        self._status, self._status_requested_at = values.status, match.sent
        limit = self.options.own_limit / self.options.torque_constant
        if abs(values.current) <= NO_CURRENT * limit:
            self._off_requested_at = match.sent
        # Without commands a timeout is expected.
        status = values.status if self._armed else values.status & ~codec.TIMED_OUT
        faults = codec.fault_names(values.fault) + (bit_names(status, STATUS) if status else ())
        self.telemetry = self.telemetry._replace(
            time=now, measured=match.measured, position=self._position(values),
            velocity=values.erpm / self.options.pole_pairs * math.tau / 60.0,
            current=values.current, bus_voltage=values.bus_voltage,
            bus_current=values.bus_current,
            temperature=values.temperature, motor_temperature=values.motor_temperature,
            status_time=now, faults=faults, armed=self._armed and not faults,
            warnings=settings.warnings_of(values, self._limits))

    def _position(self, values: codec.Values) -> float:
        """
        Return the angle of the shaft [rad].

        The tachometer counts full turns with only six steps per electrical turn; the encoder has a
        fine resolution but wraps every turn.  The tachometer gives the turn of the encoder, even
        after lost replies.
        """
        turns: float = values.tachometer / (6.0 * self.options.pole_pairs)
        if not self.options.encoder:
            return turns * math.tau
        part = values.angle_deg / 360.0
        if self._turn_offset is None:
            self._turn_offset = turns - part
        return (round(turns - self._turn_offset - part) + part) * math.tau
