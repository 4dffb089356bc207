# SPDX-License-Identifier: Apache-2.0
"""
VESC serial protocol: packets with a CRC, firmware 5.03 to 7.01.

``02 length payload crc crc 03`` up to 255 bytes of payload, ``03 length length ...`` above; the
CRC is CRC-16/XMODEM of the payload, numbers are big-endian.  The first byte of a payload
identifies the message; a reply has that of its request.  Start bytes also occur inside packets:
the parser tries every position until a packet fits.  For settings, ``buffer_append_float32_auto``
equals IEEE 754 for all numbers that are not tiny; settings.py has the layout of the settings.

Source: vedderb/bldc, comm/packet.c, comm/commands.c, util/buffer.c, datatypes.h.
"""
from binascii import crc_hqx
from collections import Counter
import struct
from typing import Any, NamedTuple, Optional

SHORT, LONG, STOP = 0x02, 0x03, 0x03
SHORT_LIMIT = 255
# Firmware limit (PACKET_MAX_PL_LEN); its longest reply, the motor settings, is half as long.
LONGEST_PAYLOAD = 512

FW_VERSION, GET_VALUES, SET_CURRENT = 0, 4, 6
GET_MCCONF, GET_APPCONF, ALIVE, GET_VALUES_SELECTIVE = 14, 17, 30, 50

FAULTS = (
    'NONE', 'OVER_VOLTAGE', 'UNDER_VOLTAGE', 'DRV', 'ABS_OVER_CURRENT', 'OVER_TEMP_FET',
    'OVER_TEMP_MOTOR', 'GATE_DRIVER_OVER_VOLTAGE', 'GATE_DRIVER_UNDER_VOLTAGE',
    'MCU_UNDER_VOLTAGE', 'BOOTING_FROM_WATCHDOG_RESET', 'ENCODER_SPI',
    'ENCODER_SINCOS_BELOW_MIN_AMPLITUDE', 'ENCODER_SINCOS_ABOVE_MAX_AMPLITUDE',
    'FLASH_CORRUPTION', 'HIGH_OFFSET_CURRENT_SENSOR_1', 'HIGH_OFFSET_CURRENT_SENSOR_2',
    'HIGH_OFFSET_CURRENT_SENSOR_3', 'UNBALANCED_CURRENTS', 'BRK', 'RESOLVER_LOT', 'RESOLVER_DOS',
    'RESOLVER_LOS', 'FLASH_CORRUPTION_APP_CFG', 'FLASH_CORRUPTION_MC_CFG', 'ENCODER_NO_MAGNET',
    'ENCODER_MAGNET_TOO_STRONG', 'PHASE_FILTER', 'ENCODER_FAULT', 'LV_OUTPUT_FAULT',
    'ENCODER_SLIP', 'OVERSPEED', 'UNDERSPEED', 'ABS_OVERSPEED')

# Field of the values -> its bit in the mask, its format and its divisor.
FIELDS = {
    'temperature': (0, 'h', 10.0),
    'motor_temperature': (1, 'h', 10.0),
    'current': (2, 'i', 100.0),
    'bus_current': (3, 'i', 100.0),
    'erpm': (7, 'i', 1.0),
    'bus_voltage': (8, 'h', 10.0),
    'tachometer': (13, 'i', 1),
    'fault': (15, 'B', 1),
    'angle_deg': (16, 'i', 1e6),
    'status': (21, 'B', 1),
}
MASK = sum(1 << bit for bit, _, _ in FIELDS.values())
# The mask has no fields above bit 21, and the reply repeats it: the bits above hold a tag.
TAG_SHIFT, TAGS = 22, 1024
_VALUES = struct.Struct('>BI' + ''.join(form for _, form, _ in FIELDS.values()))
VALUES_LENGTH = _VALUES.size + 5  # of the packet
# Bits of the status: the timeout, or a kill switch, has disabled the current.
TIMED_OUT, KILL_SWITCH = 1, 2


class Values(NamedTuple):
    """The reply to `get_values`."""

    temperature: float  # of the power stage [degC]
    motor_temperature: float
    current: float  # of the motor, average since the previous reply [A]
    bus_current: float  # likewise of the supply [A]
    erpm: float  # electrical speed [1/min]
    bus_voltage: float  # [V]
    tachometer: int  # six per electrical turn
    fault: int
    angle_deg: float  # of the encoder, 0 to 360
    status: int
    tag: int = 0  # of the request


class Firmware(NamedTuple):
    """The reply to `get_firmware`."""

    major: int
    minor: int
    hardware: str
    serial_number: str
    test: int = 0  # number of a test build, 0 of a release


def frame(payload: bytes) -> bytes:
    """Return the packet of a payload; `ValueError` if it is empty, or longer than the limit."""
    length = len(payload)
    if not 0 < length <= LONGEST_PAYLOAD:
        raise ValueError(f'a payload has 1 to {LONGEST_PAYLOAD} bytes, got {length}')
    start = bytes((SHORT, length)) if length <= SHORT_LIMIT else struct.pack('>BH', LONG, length)
    return start + payload + struct.pack('>HB', crc_hqx(payload, 0), STOP)


def set_current(current: float) -> bytes:
    """Return the payload that commands a motor current [A]; feeds the watchdog."""
    return struct.pack('>Bi', SET_CURRENT, round(1000.0 * current))


def get_values(tag: int = 0) -> bytes:
    """Return the payload that requests the fields of `Values`; the reply repeats its tag."""
    return struct.pack('>BI', GET_VALUES_SELECTIVE, tag << TAG_SHIFT | MASK)


class FrameParser:
    """
    Finds packets with a correct length, CRC and stop byte.

    `counts` are ``refused`` packets of correct form with a wrong CRC, and ``skipped`` bytes that
    belong to no packet.
    """

    def __init__(self) -> None:
        self.counts = Counter(refused=0, skipped=0)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        buffer = self._buffer
        buffer += data
        payloads = []
        offset = 0
        while True:
            end = self._end(buffer, offset)
            if end is None:  # needs more bytes
                break
            if end < 0:
                offset += 1
                self.counts['skipped'] += 1
                continue
            start = offset + buffer[offset]  # the start byte is also the size of the header
            payloads.append(bytes(buffer[start:end - 3]))
            offset = end
        del buffer[:offset]
        return payloads

    def _end(self, buffer: bytearray, offset: int) -> Optional[int]:
        """Return the end of the packet at an offset, -1 if there is none, None if too short."""
        left = len(buffer) - offset
        if left < 1:
            return None
        header = buffer[offset]
        if header not in (SHORT, LONG):
            return -1
        if left < header:
            return None
        length = int.from_bytes(buffer[offset + 1:offset + header], 'big')
        # A payload that fits the short form uses it.
        if not (0 if header == SHORT else SHORT_LIMIT) < length <= LONGEST_PAYLOAD:
            return -1
        end = offset + header + length + 3
        if len(buffer) < end:
            return None
        if buffer[end - 1] != STOP:
            return -1
        payload = buffer[offset + header:end - 3]
        if crc_hqx(payload, 0) != int.from_bytes(buffer[end - 3:end - 1], 'big'):
            self.counts['refused'] += 1
            return -1
        return end


# Both directions have the same form.
parser, frame_reply = FrameParser, frame


def reply_of(data: bytes) -> bytes:
    """Return a packet made from any bytes; empty for no bytes."""
    return frame(data[:LONGEST_PAYLOAD]) if data else b''


def parse_values(payload: bytes) -> Optional[Values]:
    """Return the values of a reply to `get_values`, None if it is not one."""
    if len(payload) != _VALUES.size:
        return None
    name, mask, *raw = _VALUES.unpack(payload)
    tag = mask >> TAG_SHIFT
    if (name, mask) != (GET_VALUES_SELECTIVE, tag << TAG_SHIFT | MASK):
        return None
    scaled: list[Any] = [
        number / scale if isinstance(scale, float) else number
        for number, (_, _, scale) in zip(raw, FIELDS.values())]
    return Values(*scaled)._replace(tag=tag)


def pack_values(values: Values) -> bytes:
    """Return the payload of a reply to `get_values`, as the firmware sends it."""
    return _VALUES.pack(GET_VALUES_SELECTIVE, values.tag << TAG_SHIFT | MASK, *(
        int(number * scale) for number, (_, _, scale) in zip(values, FIELDS.values())))


def parse_firmware(payload: bytes) -> Optional[Firmware]:
    """Return the content of a reply to ``FW_VERSION``, None if it is not one."""
    name, end = payload[3:].partition(b'\0')[0], payload.find(b'\0', 3)
    if len(payload) < 3 or payload[0] != FW_VERSION or end < 0 or len(payload) < end + 13:
        return None
    return Firmware(payload[1], payload[2], name.decode('ascii', 'replace'),
                    payload[end + 1:end + 13].hex(),
                    payload[end + 14] if len(payload) > end + 14 else 0)


def fault_names(fault: int) -> tuple[str, ...]:
    """Return the name of a fault code; empty for code 0."""
    if fault == 0:
        return ()
    return (FAULTS[fault] if fault < len(FAULTS) else f'FAULT_{fault}',)
