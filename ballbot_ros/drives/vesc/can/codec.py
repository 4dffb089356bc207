# SPDX-License-Identifier: Apache-2.0
"""
VESC on a CAN bus, firmware 5.03 to 7.01: the messages of its serial protocol in frames.

The 29-bit identifier of a frame is the kind of the packet, followed by the eight bits of the id of
the receiver.  A message of up to six bytes is one frame; a longer one fills a buffer of the
receiver, by frames with an offset and seven bytes (six from offset 259 on), and a last frame with
length and CRC completes it.  The reply has the same form and goes to the id of the sender.

Source: vedderb/bldc, comm/comm_can.c (`comm_can_send_buffer`, `decode_msg`), datatypes.h, which
agree from firmware 5 to 7.
"""
from binascii import crc_hqx
from collections import Counter
import struct
from typing import Iterator, Optional

from ballbot_ros.drives.can_frames import CanFrame, record, RecordParser
from ballbot_ros.drives.vesc.uart.codec import LONGEST_PAYLOAD

SET_CURRENT, FILL_RX_BUFFER, FILL_RX_BUFFER_LONG = 1, 5, 6
PROCESS_RX_BUFFER, PROCESS_SHORT_BUFFER, PING, PONG = 7, 8, 17, 18
STATUS = (9, 14, 15, 16, 27, 58)  # status that each VESC broadcasts under its own id
ANSWER_ME, ANSWER = 0, 1  # purposes of a message
BROADCAST_ID = 255

SHORT, PIECE, LONG_PIECE = 6, 7, 6
FIRST_LONG = 259  # offsets above 255 do not fit into one byte: seven times 37
# Default ids of the computer and of an emulated VESC.
HOST_ID, DRIVE_ID = 254, 0


def packet(kind: int, to: int, data: bytes) -> CanFrame:
    """Return a frame to the receiver with the id `to`."""
    return CanFrame(kind << 8 | to, data, extended=True)


def frames(payload: bytes, to: int, sender: int, purpose: int) -> Iterator[CanFrame]:
    """Yield the frames of a message of 1 to `LONGEST_PAYLOAD` bytes."""
    head = bytes((sender, purpose))
    if len(payload) <= SHORT:
        yield packet(PROCESS_SHORT_BUFFER, to, head + payload)
        return
    for offset in range(0, min(len(payload), FIRST_LONG), PIECE):
        yield packet(FILL_RX_BUFFER, to, bytes((offset,)) + payload[offset:offset + PIECE])
    for offset in range(FIRST_LONG, len(payload), LONG_PIECE):
        yield packet(FILL_RX_BUFFER_LONG, to,
                     struct.pack('>H', offset) + payload[offset:offset + LONG_PIECE])
    yield packet(PROCESS_RX_BUFFER, to,
                 head + struct.pack('>HH', len(payload), crc_hqx(payload, 0)))


def records(payload: bytes, to: int, sender: int, purpose: int) -> bytes:
    """Return the records of the frames of a message; see `frames`."""
    return b''.join(map(record, frames(payload, to, sender, purpose)))


class Assembly:
    """
    Assembles messages from frames.

    `refused` is the number of messages with a missing frame or a wrong CRC.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._buffer = b''

    def take(self, kind: int, data: bytes) -> Optional[bytes]:
        """Process a frame for this receiver, and return the message that it completes."""
        if kind == PROCESS_SHORT_BUFFER:
            return data[2:] or None
        if kind == FILL_RX_BUFFER and data:
            self._fill(data[0], data[1:])
        elif kind == FILL_RX_BUFFER_LONG and len(data) >= 2:
            self._fill(int.from_bytes(data[:2], 'big'), data[2:])
        elif kind == PROCESS_RX_BUFFER:
            buffer, self._buffer = self._buffer, b''
            if SHORT < len(buffer) and data[2:] == struct.pack(
                    '>HH', len(buffer), crc_hqx(buffer, 0)):
                return buffer
            self.refused += 1
        return None

    def _fill(self, offset: int, piece: bytes) -> None:
        if offset == 0:
            self._buffer = b''
        if offset == len(self._buffer) and offset + len(piece) <= LONGEST_PAYLOAD:
            self._buffer += piece


class PayloadParser:
    """
    Finds the messages to the id `own` from the id `sender`.

    `counts` are ``refused`` messages, ``skipped`` bytes that belong to no frame, and
    ``of_others``, frames to `sender` from other nodes; `nodes_seen` are the ids of all nodes that
    sent their status.
    """

    def __init__(self, own: int = HOST_ID, sender: int = DRIVE_ID):
        self.counts = Counter(refused=0, skipped=0, of_others=0)
        self.nodes_seen: set[int] = set()
        self._own, self._sender = own, sender
        self._records, self._assembly = RecordParser(), Assembly()

    def feed(self, data: bytes) -> list[bytes]:
        found = []
        for frame in self._records.feed(data):
            kind, to = frame.identifier >> 8, frame.identifier & 0xFF
            if not frame.extended or frame.remote:
                continue
            if kind in STATUS:
                self.nodes_seen.add(to)
            elif to == self._sender:
                self.counts['of_others'] += 1
            elif to == self._own:
                payload = self._assembly.take(kind, frame.data)
                last = kind in (PROCESS_SHORT_BUFFER, PROCESS_RX_BUFFER)
                if payload is not None and last and frame.data[:2] == bytes(
                        (self._sender, ANSWER)):
                    found.append(payload)
        self.counts['refused'] = self._assembly.refused
        self.counts['skipped'] = self._records.counts['skipped']
        return found


# Functions of every codec; see drives/__init__.py.
parser = PayloadParser


def frame_reply(payload: bytes) -> bytes:
    """Return the frames of a reply to the computer."""
    return records(payload, HOST_ID, DRIVE_ID, ANSWER)


def reply_of(data: bytes) -> bytes:
    """Return the frames of a reply made from any bytes; empty for no bytes."""
    return frame_reply(data[:LONGEST_PAYLOAD]) if data else b''
