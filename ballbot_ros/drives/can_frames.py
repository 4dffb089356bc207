# SPDX-License-Identifier: Apache-2.0
"""
CAN frames as records of 16 bytes, so that a bus is a stream of bytes like a serial line.

A record has the layout of SocketCAN (``struct can_frame``, little-endian): identifier with its two
flags, length, data padded with zeros.  Two of its three spare bytes hold a CRC of the other bytes.
On the bus each frame has a CRC, which the controllers check and do not pass on; that of the record
makes the parser reject corrupted records in captures, fuzz tests and on an emulated line.

At ten bits per byte (`contract.BITS_PER_BYTE`) a record counts as 160 bits.  This is the length of
the longest frame: 29-bit identifier, eight bytes, all possible stuff bits, and the interframe
space; a frame with an 11-bit identifier has at most 135 bits, a request without data 55.
"""
from binascii import crc_hqx
from collections import Counter
import struct
from typing import NamedTuple, Optional

from ballbot_ros.drives.contract import Setting

RECORD_SIZE = 16
MOST_DATA = 8
_RECORD = struct.Struct('<IBxH8s')
_EXTENDED, _REMOTE = 0x80000000, 0x40000000
_IDENTIFIER_MAX, _EXTENDED_IDENTIFIER_MAX = 0x7FF, 0x1FFFFFFF


class CanFrame(NamedTuple):
    """A classical CAN frame."""

    identifier: int
    data: bytes = b''  # at most eight bytes
    extended: bool = False  # the identifier has 29 bits, not 11
    remote: bool = False  # requests the frame with this identifier; no data


def record(frame: CanFrame) -> bytes:
    """Return the record of a frame; raises `ValueError` if the frame is not valid."""
    identifier, data, extended, remote = frame
    highest = _EXTENDED_IDENTIFIER_MAX if extended else _IDENTIFIER_MAX
    if not 0 <= identifier <= highest or len(data) > MOST_DATA or remote and data:
        raise ValueError(f'this is not a valid CAN frame: {frame!r}')
    head = identifier | (_EXTENDED if extended else 0) | (_REMOTE if remote else 0)
    raw = _RECORD.pack(head, len(data), 0, data)
    return _RECORD.pack(head, len(data), crc_hqx(raw, 0xFFFF), data)


def parse_record(raw: bytes) -> Optional[CanFrame]:
    """Return the frame of a record of 16 bytes, None if the record is not valid."""
    head, length, _, padded = _RECORD.unpack(raw)
    if length > MOST_DATA:
        return None
    frame = CanFrame(head & _EXTENDED_IDENTIFIER_MAX, padded[:length], bool(head & _EXTENDED),
                     bool(head & _REMOTE))
    try:
        return frame if record(frame) == raw else None
    except ValueError:
        return None


def judge_others(number: int) -> Setting:
    """Check the number of frames to the drive from another sender."""
    return Setting('only sender', 'yes' if not number else f'no: {number} frames from others',
                   'yes', not number, 'another program or computer commands this drive: stop it')


class RecordParser:
    """Finds records in a stream; `counts` has the number of ``skipped`` bytes between them."""

    def __init__(self) -> None:
        self.counts = Counter(skipped=0)
        self._rest = b''

    def feed(self, data: bytes) -> list[CanFrame]:
        data = self._rest + data
        frames, offset = [], 0
        while len(data) - offset >= RECORD_SIZE:
            frame = parse_record(data[offset:offset + RECORD_SIZE])
            if frame is None:
                offset += 1
                self.counts['skipped'] += 1
            else:
                frames.append(frame)
                offset += RECORD_SIZE
        self._rest = data[offset:]
        return frames
