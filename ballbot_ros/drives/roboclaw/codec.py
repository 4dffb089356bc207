# SPDX-License-Identifier: Apache-2.0
"""
RoboClaw packet serial: short packets with a CRC.

A command that sets a value is ``address command data crc crc`` and is acknowledged by FF.  A
request is ``address command`` alone; its answer is ``data crc crc``, where the CRC
(CRC-16/XMODEM) also covers the request.  So an answer has no start byte, length or identifier, and
only 16 bits distinguish it from noise.  Requests are therefore sent in groups, and `ReplyParser`
accepts answers only if those to all requests of a group are consecutive.

Source: RoboClaw Series User Manual (commands 14, 15, 16, 21, 24, 30, 32, 48, 49, 59, 82, 90, 135)
and basicmicro/roboclaw_python_library.  Older firmware, of Ion Motion Control, is not supported:
it has no commands 14 and 15, and its status has 16 bits.
"""
from binascii import crc_hqx
from collections import Counter
import struct
from typing import NamedTuple, Optional, Sequence

ADDRESSES = range(0x80, 0x88)
ACKNOWLEDGED = 0xFF
FULL_DUTY = 32767
TIMEOUT_UNIT = 0.1  # of the serial timeout [s]

SET_TIMEOUT, GET_TIMEOUT, GET_VERSION, GET_BATTERY = 14, 15, 21, 24
GET_PWMS, GET_CURRENTS, GET_VOLTAGES, GET_TEMPERATURE, GET_STATUS = 48, 49, 59, 82, 90
# Of motor 1 and motor 2.
GET_ENCODER, GET_SPEED, SET_DUTY, GET_MAX_CURRENT = (16, 17), (30, 31), (32, 33), (135, 136)

# Request -> format of its answer; None for text that ends with a zero byte.
ANSWERS: dict[int, Optional[struct.Struct]] = {
    GET_TIMEOUT: struct.Struct('>B'),
    GET_ENCODER[0]: struct.Struct('>iB'),
    GET_ENCODER[1]: struct.Struct('>iB'),
    GET_VERSION: None,
    GET_BATTERY: struct.Struct('>H'),
    GET_SPEED[0]: struct.Struct('>iB'),
    GET_SPEED[1]: struct.Struct('>iB'),
    GET_PWMS: struct.Struct('>hh'),
    GET_CURRENTS: struct.Struct('>hh'),
    GET_VOLTAGES: struct.Struct('>HH'),
    GET_TEMPERATURE: struct.Struct('>H'),
    GET_STATUS: struct.Struct('>I'),
    GET_MAX_CURRENT[0]: struct.Struct('>II'),
    GET_MAX_CURRENT[1]: struct.Struct('>II'),
}
LONGEST_VERSION = 48

STATUS = {
    0x1: 'E_STOP', 0x2: 'TEMPERATURE_ERROR', 0x4: 'TEMPERATURE_2_ERROR',
    0x8: 'MAIN_VOLTAGE_HIGH_ERROR', 0x10: 'LOGIC_VOLTAGE_HIGH_ERROR',
    0x20: 'LOGIC_VOLTAGE_LOW_ERROR', 0x40: 'M1_DRIVER_FAULT_ERROR',
    0x80: 'M2_DRIVER_FAULT_ERROR', 0x100: 'M1_SPEED_ERROR', 0x200: 'M2_SPEED_ERROR',
    0x400: 'M1_POSITION_ERROR', 0x800: 'M2_POSITION_ERROR', 0x1000: 'M1_CURRENT_ERROR',
    0x2000: 'M2_CURRENT_ERROR', 0x10000: 'M1_OVER_CURRENT_WARNING',
    0x20000: 'M2_OVER_CURRENT_WARNING', 0x40000: 'MAIN_VOLTAGE_HIGH_WARNING',
    0x80000: 'MAIN_VOLTAGE_LOW_WARNING', 0x100000: 'TEMPERATURE_WARNING',
    0x200000: 'TEMPERATURE_2_WARNING', 0x400000: 'S4_SIGNAL_TRIGGERED',
    0x800000: 'S5_SIGNAL_TRIGGERED', 0x1000000: 'SPEED_ERROR_LIMIT_WARNING',
    0x2000000: 'POSITION_ERROR_LIMIT_WARNING'}
# The bits that remove the power until the drive is reset, or the cause has disappeared.
ERRORS = 0xFFFF


class Reply(NamedTuple):
    """An answer and the request that it answers."""

    command: int
    values: tuple[int, ...]  # empty for text
    text: str = ''


def command(address: int, number: int, data: bytes = b'') -> bytes:
    """Return a command with its CRC."""
    body = bytes((address, number)) + data
    return body + crc_hqx(body, 0).to_bytes(2, 'big')


def ask(address: int, number: int) -> bytes:
    """Return a request."""
    return bytes((address, number))


def set_duty(address: int, axis: int, duty: float) -> bytes:
    """Return the command for a duty cycle, -1 to 1; axis 0 is M1, 1 is M2."""
    counts = round(FULL_DUTY * min(max(duty, -1.0), 1.0))
    return command(address, SET_DUTY[axis], struct.pack('>h', counts))


def set_timeout(address: int, tenths: int) -> bytes:
    """Return the command for the serial timeout [0.1 s]."""
    return command(address, SET_TIMEOUT, bytes((tenths,)))


def crc_of_request(address: int, number: int) -> int:
    """Return the CRC of a request, the initial value of the CRC of its answer."""
    return crc_hqx(ask(address, number), 0)


def answer(address: int, number: int, *values: int, text: str = '') -> bytes:
    """Return the answer to a request, as the firmware sends it."""
    form = ANSWERS[number]
    data = form.pack(*values) if form is not None else text.encode('ascii') + b'\0'
    return data + crc_hqx(data, crc_of_request(address, number)).to_bytes(2, 'big')


def answer_length(number: int) -> int:
    """Return the length of an answer [bytes], the largest possible one for text."""
    form = ANSWERS[number]
    return (LONGEST_VERSION if form is None else form.size) + 2


class ReplyParser:
    """
    Finds the answers to groups of requests in the data of the drive.

    `groups` are requests that were sent together, in their order; two or more in each, so that at
    least 32 bits protect an answer.  No group may be a prefix of another.  `counts` has the number
    of ``skipped`` bytes, which neither belong to an answer nor acknowledge a command.
    """

    def __init__(self, address: int):
        self.groups: Sequence[Sequence[int]] = ()
        self.counts = Counter(skipped=0)
        self._address = address
        self._buffer = b''

    def feed(self, data: bytes) -> list[list[Reply]]:
        self._buffer += data
        groups = []
        offset = 0
        while offset < len(self._buffer):
            found, end = self._match(offset)
            if found:
                groups.append(found)
                offset = end
            elif end < 0:  # more bytes may complete a group
                break
            else:
                self.counts['skipped'] += self._buffer[offset] != ACKNOWLEDGED
                offset += 1
        self._buffer = self._buffer[offset:]
        return groups

    def _match(self, offset: int) -> tuple[list[Reply], int]:
        """Return the answers to a group and their end, or none and -1 if bytes are missing."""
        missing = False
        for group in self.groups:
            found: list[Reply] = []
            end = offset
            for number in group:
                reply, end = self._reply(number, end)
                if reply is None:
                    break
                found.append(reply)
            if len(found) == len(group):
                return found, end
            missing = missing or end < 0
        return [], -1 if missing else offset

    def _reply(self, number: int, offset: int) -> tuple[Optional[Reply], int]:
        """Return the answer to a request and its end, or None and -1 if bytes are missing."""
        buffer, form = self._buffer, ANSWERS[number]
        if form is not None:
            end = offset + form.size
        else:
            zero = buffer.find(0, offset, offset + LONGEST_VERSION)
            if zero < 0:
                return None, -1 if len(buffer) - offset < LONGEST_VERSION else 0
            end = zero + 1
        if len(buffer) < end + 2:
            return None, -1
        data = buffer[offset:end]
        crc = crc_hqx(data, crc_of_request(self._address, number))
        if crc != int.from_bytes(buffer[end:end + 2], 'big') or not (form or data.isascii()):
            return None, 0
        if form is not None:
            return Reply(number, form.unpack(data)), end + 2
        return Reply(number, (), data[:-1].decode('ascii')), end + 2


def parser() -> ReplyParser:
    """Return a parser of the replies to requests about motor 1."""
    found = ReplyParser(ADDRESSES[0])
    motion = (GET_ENCODER[0], GET_SPEED[0])
    found.groups = (motion, *((number, *motion) for number in (GET_STATUS, GET_VERSION)))
    return found


def frame_reply(group: Sequence[Reply]) -> bytes:
    """Return the answers to a group of requests, as the drive sends them."""
    return b''.join(answer(ADDRESSES[0], reply.command, *reply.values, text=reply.text)
                    for reply in group)


def reply_of(data: bytes) -> bytes:
    """Return answers for status, encoder and speed, made from any bytes."""
    values = struct.unpack('>IiBiB', data[:14].ljust(14, b'\0'))
    return frame_reply((Reply(GET_STATUS, values[:1]), Reply(GET_ENCODER[0], values[1:3]),
                        Reply(GET_SPEED[0], values[3:])))
