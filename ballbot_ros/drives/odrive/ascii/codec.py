# SPDX-License-Identifier: Apache-2.0
r"""
ODrive ASCII protocol, firmware 0.5 and 0.6: lines of text with a checksum.

A line is ``text *NN`` and a line end; ``NN`` is the exclusive or of all characters before the
asterisk, in decimal.  A drive adds it to a reply if and only if the command had one, so every
command here has one, and a line from the drive without a checksum is not accepted as a reply.

The checksum is weak, and the drive executes a line without it: a ``3`` with one flipped bit is
``;``, which starts a comment and hides the rest.  Hence a torque is written as a small number
and an exponent, ``0.000005000e4``: any truncation of it is nearly zero.  A space precedes
the asterisk, so that a corrupted separator does not lengthen the number.

Sources.  For 0.5: docs/ascii-protocol.rst and Firmware/communication/ascii_protocol.cpp in
odriverobotics/ODrive, at fw-v0.5.  The source of 0.6 is not published; the maker publishes the
page "ASCII Protocol" (docs.odriverobotics.com/v/latest/manual) on checksum, comments and lost
responses, and odriverobotics/ODriveArduino, src/ODriveUART.cpp, which sends ``sc``, ``c``, ``f``,
``r`` and ``w`` in the form of 0.5.  Guessed for 0.6: that ``u`` still feeds the watchdog (users'
programs send it), that numbers have six decimals as in 0.5, and that Boolean values are 0 and 1.
Any other format is not accepted as a number, and the drive is refused.
"""
from collections import Counter
from functools import cache, reduce
from operator import xor
import re
from typing import NamedTuple, Optional

# The drive builds a line in a buffer of this size, with checksum and line end.
LONGEST_LINE = 64
LINE_END = b'\r\n'

# A truncated torque is smaller by at least this power of ten.
TORQUE_EXPONENT = 4
TORQUE_SCALE = 10.0**TORQUE_EXPONENT

_CHECKED = re.compile(rb'([\x20-\x29\x2b-\x7e]*)\*(0|[1-9][0-9]{0,2})')
_FEEDBACK = re.compile(r'(-?[0-9]{1,9}\.[0-9]{6}) (-?[0-9]{1,9}\.[0-9]{6})')
_NUMBER = re.compile(r'-?[0-9]{1,15}(\.[0-9]{0,6})?|-?inf')


class Feedback(NamedTuple):
    """The reply to ``f``."""

    position: float  # [turn]
    velocity: float  # [turn/s]


def checksum(text: bytes) -> int:
    """Return the exclusive or of all bytes."""
    return reduce(xor, text, 0)


def line(text: str) -> bytes:
    """Return a command with its checksum and line end."""
    body = f'{text} '.encode('ascii')
    return b'%s*%d\n' % (body, checksum(body))


def torque(axis: int, value: float) -> bytes:
    """Return the command for a motor torque, rounded to 1e-5 N m; feeds the watchdog."""
    return line(f'c {axis} {value / TORQUE_SCALE:.9f}e{TORQUE_EXPONENT}')


@cache
def feedback(axis: int) -> bytes:
    """Return the request for position and velocity."""
    return line(f'f {axis}')


def feed_watchdog(axis: int) -> bytes:
    """Return the command that feeds the watchdog and nothing else."""
    return line(f'u {axis}')


@cache
def read(name: str) -> bytes:
    """Return the request for a property."""
    return line(f'r {name}')


def write(name: str, value: float) -> bytes:
    """Return the command that sets a property; there is no answer."""
    return line(f'w {name} {value:.9g}')


def marker(number: int) -> bytes:
    """
    Return lines that write and read back one of `MARKERS`, without other effects.

    Replies arrive in the order of the requests but do not identify them.  Replies before that to a
    marker belong to earlier requests.  The wrong checksum at the start ends an incomplete line
    of an earlier program in the buffer of the drive, so that the drive ignores that line.
    """
    return b'*999\n' + write(SCRATCH, number) + read(SCRATCH)


# A property for tests: the drive stores it without effect.
SCRATCH = 'test_property'
# Numbers that no other property has: an error bit that neither generation defines, in nine digits,
# the most that 0.5 prints.
MARKERS = range(0x20000000, 0x20000000 + 1000)

CLEAR_ERRORS = line('sc')
INFO = line('i')


class LineParser:
    r"""
    Finds the lines of the drive that have a correct checksum.

    Only ``\r\n`` ends a line: a lone ``\n`` is an error, and the text around it is refused.
    `counts` are ``refused`` lines with wrong checksum or characters, and ``unchecked`` lines of
    printable text without a checksum, which a drive prints unrequested, or as a reply if it
    does not support checksums.
    """

    def __init__(self) -> None:
        self.counts = Counter(refused=0, unchecked=0)
        self._rest = b''

    def feed(self, data: bytes) -> list[str]:
        *lines, rest = (self._rest + data).split(LINE_END)
        # Data longer than any line cannot become one; their end may be half of a line end.
        self._rest = rest[-LONGEST_LINE:]
        return [text for text in map(self._check, lines) if text is not None]

    def _check(self, raw: bytes) -> Optional[str]:
        match = _CHECKED.fullmatch(raw)
        if match and len(raw) <= LONGEST_LINE and checksum(match[1]) == int(match[2]):
            return match[1].decode('ascii')
        if raw:
            text = b'*' not in raw and raw.isascii() and raw.decode('ascii').isprintable()
            self.counts['unchecked' if text else 'refused'] += 1
        return None


# Functions of every codec; see drives/__init__.py.
parser = LineParser


def frame_reply(text: str) -> bytes:
    """Return a reply with its checksum and line end, as the drive sends it."""
    body = text.encode('ascii')
    return b'%s*%d\r\n' % (body, checksum(body))


def reply_of(data: bytes) -> bytes:
    """Return a reply with a valid checksum, made from any bytes."""
    text = bytes(byte & 0x7F for byte in data if byte & 0x7F not in b'*' + LINE_END)
    return frame_reply(text.decode('ascii'))


def parse_feedback(text: str) -> Optional[Feedback]:
    """Return the two numbers of a reply to ``f``, None if it is not one."""
    match = _FEEDBACK.fullmatch(text)
    return Feedback(float(match[1]), float(match[2])) if match else None


def parse_number(text: str) -> Optional[float]:
    """Return the number of a reply to ``r``, None if it is not one."""
    return float(text) if _NUMBER.fullmatch(text) else None
