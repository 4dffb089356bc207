# SPDX-License-Identifier: Apache-2.0
"""
Emulated ODrive with firmware 0.5 or 0.6 on a CAN bus; its motor is that of emulated_board.py.

0.5 follows Firmware/communication/can/can_simple.cpp and odrive_can.cpp of odriverobotics/ODrive
at fw-v0.5.6, with their quirks: any frame to the node, even a request, feeds its watchdog; the
transmit queue has three entries, and a reply is lost if it is full; an invalid estimate is 0.

The source of 0.6 is not published.  Its messages are from the maker's documents, see codec.py; the
numbers of its endpoints are arbitrary, as they differ between firmwares.  Assumed as the harder
case: only set-points and states feed the watchdog, and arming sets the torque to `init_torque`.
"""
import math
import struct
from typing import Any, Mapping

from ballbot_ros.drives.can_frames import CanFrame, RECORD_SIZE, RecordParser
from ballbot_ros.drives.contract import BITS_PER_BYTE
from ballbot_ros.drives.odrive.cansimple import codec
from ballbot_ros.drives.odrive.emulated_board import BoardDevice
from ballbot_ros.drives.odrive.firmware import (
    CONTROL_MODE, GENERATION_5, INPUT_MODE, REQUESTED_STATE, RESULT_6, SERIAL_NUMBER, STATE)

MAILBOXES = 3
REBOOT = 0x16


class ODriveCanDevice(BoardDevice):
    """See `Device`; the node id is the number of the axis; each axis of a board is a `Device`."""

    protocol = 'odrive_can'

    def _boot(self) -> None:
        super()._boot()
        self._old = self.firmware.generation is GENERATION_5
        self.heartbeat_rate = 'axis0.config.can.heartbeat_' + (
            'rate_ms' if self._old else 'msg_rate_ms')
        self.properties[self.heartbeat_rate] = 100 if self.has('factory') else 10
        self._records = RecordParser()
        self._beat_at = -math.inf
        self._busy_until = -math.inf  # the end of the queued frames [s]

    def endpoints(self) -> dict[str, Any]:
        """Return the content of the maker's flat_endpoints.json for a 0.6."""
        return {'fw_version': '.'.join(map(str, self.firmware.version_of(self.settings))),
                'hw_version': '.'.join(map(str, self.firmware.board)),
                'endpoints': {name: {'id': number, 'type': _type_of(value), 'access': 'rw'}
                              for name, (number, value) in self._numbered().items()}}

    def _numbered(self) -> Mapping[str, tuple[int, float]]:
        return {name: (number, value)
                for number, (name, value) in enumerate(sorted(self.properties.items()), start=400)
                if name != SERIAL_NUMBER}

    def _receive(self, data: bytes, now: float) -> bytes:
        reply = b''
        for frame in self._records.feed(data):
            node, command = divmod(frame.identifier, 1 << codec.COMMAND_BITS)
            if node == self.settings.axis and not frame.extended:
                answer = self._execute(command, frame, now)
                self.tick(now)
                reply += self._sent(answer, now)
        period = 1e-3 * self.properties[self.heartbeat_rate]
        if period and now - self._beat_at >= period - 1e-9:
            beat = self._sent(self._heartbeat(), now)
            if beat:  # at a fixed period, unless it is delayed by more than that
                late = now - self._beat_at > 2.0 * period
                self._beat_at = now if late else self._beat_at + period
            reply += beat
        return reply

    def _sent(self, record: bytes, now: float) -> bytes:
        """Return the record of a reply; empty if the transmit queue is full."""
        duration = RECORD_SIZE * BITS_PER_BYTE / self.baud
        if not record or self._busy_until - now > (MAILBOXES - 1) * duration:
            return b''
        self._busy_until = max(self._busy_until, now) + duration
        return record

    def _heartbeat(self) -> bytes:
        here = self.properties
        if self._old:
            more = [int(bool(here[register.path])) for register in codec.REGISTERS.values()]
        else:
            more = [int(here[RESULT_6.path]), 0, 0]
        return codec.frame(self.settings.axis, codec.HEARTBEAT, struct.pack(
            '<IBBBB', int(here[self.firmware.generation.errors]) & 0xFFFFFFFF,
            int(here[STATE]) & 0xFF, *more))

    def _execute(self, command: int, frame: CanFrame, now: float) -> bytes:
        """Execute a command and return the record of its reply; see `do_command`."""
        here, data, length = self.properties, frame.data, len(frame.data)
        if self._old or command in (codec.SET_INPUT_TORQUE, codec.SET_AXIS_STATE):
            self.feed(now)
        if command == codec.CLEAR_ERRORS:
            self.clear_errors()
        elif command == REBOOT:
            self.reboot(now)
        elif frame.remote or not data and not self.has('0.5.4'):
            return self._reply(command)
        elif command == codec.SET_AXIS_STATE and length >= 4:
            here[REQUESTED_STATE] = int.from_bytes(data[:4], 'little')
        elif command == codec.SET_CONTROLLER_MODE and length >= 8:
            here[CONTROL_MODE], here[INPUT_MODE.name] = struct.unpack('<II', data)
        elif command == codec.SET_INPUT_TORQUE and length >= 4:
            value, = struct.unpack_from('<f', data)
            self.input_torque = 0.0 if math.isnan(value) else value
        elif command == codec.RX_SDO and not self._old and length >= 4:
            return self._endpoint_reply(*struct.unpack_from('<BH', data))
        return b''

    def _reply(self, command: int) -> bytes:
        sensed = self.sensed
        numbers = {
            codec.ENCODER_ESTIMATES: (sensed.position / math.tau, sensed.velocity / math.tau),
            codec.IQ: (0.0, self.current()),
            codec.BUS_VOLTAGE_CURRENT: (sensed.bus_voltage, self.supply_current())}
        if not self._old:
            numbers[codec.TEMPERATURE] = (sensed.temperature, sensed.motor_temperature)
        if command in numbers:
            return codec.frame(self.settings.axis, command, struct.pack('<ff', *numbers[command]))
        data = self._register(command)
        return codec.frame(self.settings.axis, command, data) if data else b''

    def _register(self, command: int) -> bytes:
        here = self.properties
        if self._old:
            return int(here[codec.REGISTERS[command].path]).to_bytes(8, 'little') \
                if command in codec.REGISTERS else b''
        if command == codec.VERSION:
            return bytes((2, *self.firmware.board, *self.firmware.version_of(self.settings), 0))
        if command == codec.ERROR:
            return struct.pack('<II', int(here[self.names.errors]), int(here[self.names.reason]))
        return b''

    def _endpoint_reply(self, operation: int, number: int) -> bytes:
        found = [value for each, value in self._numbered().values() if each == number]
        if operation != codec.READ or not found:
            return b''
        value = found[0] if isinstance(found[0], float) else int(found[0])
        raw = struct.pack('<BHB' + codec.TYPES[_type_of(value)], 0, number, 0, value)
        return codec.frame(self.settings.axis, codec.TX_SDO, raw)


def _type_of(value: float) -> str:
    return 'float' if isinstance(value, float) else 'uint32'
