# SPDX-License-Identifier: Apache-2.0
"""Frames of a letter and a number: torque, stop, request; armed and disarmed come back."""
from collections import Counter
import struct

TORQUE, STOP, REQUEST = b'T', b'S', b'R'
ARMED, DISARMED = b'A', b'D'
UNIT = 1e-6  # of torque [N m]
_FRAME = struct.Struct('>ci')


def frame(letter, number=0):
    """Return a frame."""
    return _FRAME.pack(letter, number)


class Parser:
    """Finds frames."""

    def __init__(self, letters):
        self._letters, self._buffer, self.counts = letters, b'', Counter()

    def feed(self, data):
        """Take bytes and return the letters and numbers that they complete."""
        self._buffer += data
        found = []
        while len(self._buffer) >= _FRAME.size:
            whole = self._buffer[:1] in self._letters
            if whole:
                found.append(_FRAME.unpack_from(self._buffer))
            self._buffer = self._buffer[_FRAME.size if whole else 1:]
        return found


def parser():
    """Return a parser of replies."""
    return Parser((ARMED, DISARMED))


def frame_reply(message):
    """Return the bytes of a reply."""
    return frame(*message)


def reply_of(data):
    """Return a reply with any number."""
    return frame(ARMED, int.from_bytes(data[:4], 'big') % 2**31)
