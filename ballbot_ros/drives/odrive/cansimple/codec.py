# SPDX-License-Identifier: Apache-2.0
"""
CANSimple, the protocol of an ODrive on a CAN bus, firmware 0.5 and 0.6.

The 11-bit identifier of a frame is the id of the node, followed by the five bits of the command.
A remote frame requests a reply, which has the same identifier; numbers are little-endian.

Sources.  For 0.5: Firmware/communication/can/can_simple.cpp and can_simple.hpp in
odriverobotics/ODrive, at fw-v0.5.3 to fw-v0.5.6; earlier heartbeats have no error flags.  For
0.6: the maker's page "CAN Protocol" (docs.odriverobotics.com/v/latest/manual), its examples in
odriverobotics/ODriveResources (examples/can_simple.py, can_param_access.py), and the fields of a
DBC file for 0.6.10.
"""
import math
import struct
from typing import NamedTuple, Optional

from ballbot_ros.drives.can_frames import CanFrame, MOST_DATA, record, RecordParser
from ballbot_ros.drives.odrive.firmware import CONTROLLER_5, ENCODER_5, MOTOR_5

# In both generations.
HEARTBEAT, SET_AXIS_STATE, ENCODER_ESTIMATES, SET_CONTROLLER_MODE = 0x01, 0x07, 0x09, 0x0B
SET_INPUT_TORQUE, IQ, BUS_VOLTAGE_CURRENT, CLEAR_ERRORS = 0x0E, 0x14, 0x17, 0x18
# 0.5 only.
MOTOR_ERROR, ENCODER_ERROR, CONTROLLER_ERROR = 0x03, 0x04, 0x1D
# Error registers of 0.5 by request, in the order of the flags in its heartbeat.
REGISTERS = {MOTOR_ERROR: MOTOR_5, ENCODER_ERROR: ENCODER_5, CONTROLLER_ERROR: CONTROLLER_5}
# 0.6 only; 0.5 does not report its version.
VERSION, ERROR, RX_SDO, TX_SDO, TEMPERATURE = 0x00, 0x03, 0x04, 0x05, 0x15

# Frames that only a computer sends.
COMMANDS = (0x02, SET_AXIS_STATE, SET_CONTROLLER_MODE, 0x0C, 0x0D, SET_INPUT_TORQUE, 0x0F, 0x16,
            CLEAR_ERRORS)

READ = 0  # operation on an endpoint

COMMAND_BITS = 5
HIGHEST_NODE = 0x3E  # 0x3F is the broadcast id

_TWO_FLOATS, _TWO_WORDS = struct.Struct('<ff'), struct.Struct('<II')
_SDO = struct.Struct('<BHB')
# Type of an endpoint in flat_endpoints.json -> its format; longer ones do not fit into a frame.
TYPES = {'bool': '?', 'uint8': 'B', 'int8': 'b', 'uint16': 'H', 'int16': 'h', 'uint32': 'I',
         'int32': 'i', 'float': 'f'}


class Heartbeat(NamedTuple):
    """Cyclic message of each drive."""

    errors: int  # of the axis
    state: int
    # 0.5: whether the motor, the encoder and the controller have an error, in bit 0; 0.6: the
    # result of the last procedure, whether a trajectory is done, unused.
    first: int
    second: int
    third: int


def frame(node: int, command: int, data: bytes = b'') -> bytes:
    """Return the record of a command."""
    return record(CanFrame(node << COMMAND_BITS | command, data))


def ask(node: int, command: int) -> bytes:
    """Return the record of the request for the reply to a command."""
    return record(CanFrame(node << COMMAND_BITS | command, remote=True))


def torque(node: int, value: float) -> bytes:
    """Return the command for a motor torque [N m]."""
    return frame(node, SET_INPUT_TORQUE, struct.pack('<f', value))


def set_state(node: int, state: int) -> bytes:
    """Return the command for a state of the axis."""
    return frame(node, SET_AXIS_STATE, struct.pack('<I', state))


def set_mode(node: int, control: int, input_mode: int) -> bytes:
    """Return the command for control mode and input mode."""
    return frame(node, SET_CONTROLLER_MODE, _TWO_WORDS.pack(control, input_mode))


def read_endpoint(node: int, endpoint: int) -> bytes:
    """Return the request for the value of an endpoint, 0.6 only."""
    return frame(node, RX_SDO, _SDO.pack(READ, endpoint, 0))


def parse_heartbeat(data: bytes) -> Optional[Heartbeat]:
    """Return the content of a heartbeat, None if it is not one."""
    return Heartbeat(*struct.unpack('<IBBBB', data)) if len(data) == 8 else None


def parse_floats(data: bytes) -> Optional[tuple[float, float]]:
    """Return two finite numbers, None if the data are not that."""
    if len(data) != _TWO_FLOATS.size:
        return None
    first, second = _TWO_FLOATS.unpack(data)
    return (first, second) if math.isfinite(first) and math.isfinite(second) else None


def parse_endpoint(data: bytes, endpoint: int, kind: str) -> Optional[float]:
    """Return the value of an endpoint from a ``TX_SDO``, None if it is that of another."""
    size = _SDO.size + struct.calcsize(TYPES[kind])
    if len(data) < size or _SDO.unpack_from(data)[1] != endpoint:
        return None
    return float(struct.unpack_from('<' + TYPES[kind], data, _SDO.size)[0])


# Functions of every codec; see drives/__init__.py.
parser, frame_reply = RecordParser, record


def reply_of(data: bytes) -> bytes:
    """Return the record of a reply of node 0, made from any bytes."""
    command = data[0] % (1 << COMMAND_BITS) if data else HEARTBEAT
    return frame(0, command, data[1:1 + MOST_DATA])
