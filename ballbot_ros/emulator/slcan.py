# SPDX-License-Identifier: Apache-2.0
"""An slcan adapter on a pseudo-terminal: text on the side of the computer, frames on the bus."""
import re
from typing import Optional

from ballbot_ros.drives.can_frames import CanFrame, record, RecordParser
from ballbot_ros.emulator.terminal import PseudoTerminal

END, FAILED = b'\r', b'\a'
# Bit rate of each command S0 to S8, as in the manual of Lawicel's CANUSB.
BIT_RATES = (10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000)
_FRAME = re.compile(rb'([tr])([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)'
                    rb'|([TR])([01][0-9A-Fa-f]{7})([0-8])((?:[0-9A-Fa-f]{2})*)')


class SlcanAdapter(PseudoTerminal):
    """
    See `PseudoTerminal`; data are records of frames.

    It acknowledges each command with a carriage return, refuses an unknown one with a bell, and
    neither sends nor receives frames while its channel is closed.
    """

    def plug(self) -> None:
        """Plug in, the channel closed."""
        self._text, self._records = b'', RecordParser()
        self._open, self._bit_rate = False, 0
        super().plug()

    @property
    def baud(self) -> Optional[int]:
        """Return the bit rate of the bus that the other side has set, None before it has."""
        return self._bit_rate or None

    def read(self, most: int = 4096) -> bytes:
        """Execute received commands and return the records of their frames."""
        *commands, self._text = (self._text + super().read(most)).split(END)
        frames = b''
        for command in commands:
            frame = parse_frame(command) if self._open else None
            if frame is not None:
                frames += record(frame)
                self._answer(END)
            else:
                self._execute(command)
        return frames

    def write(self, data: bytes) -> None:
        """Pass on the records of frames."""
        frames = self._records.feed(data)
        if self._open:
            self._answer(b''.join(map(text_of, frames)))

    def _execute(self, command: bytes) -> None:
        if command[:1] in (b'O', b'C'):
            self._open = command[:1] == b'O'
        elif command[:1] == b'S' and command[1:].isdigit() and int(command[1:]) < len(BIT_RATES):
            self._bit_rate = BIT_RATES[int(command[1:])]
        elif command:
            self._answer(FAILED)
            return
        self._answer(END)

    def _answer(self, text: bytes) -> None:
        super().write(text)


def text_of(frame: CanFrame) -> bytes:
    """Return the text of a frame."""
    kind = 'Rr' if frame.remote else 'Tt'
    head = f'{kind[0]}{frame.identifier:08X}' if frame.extended \
        else f'{kind[1]}{frame.identifier:03X}'
    return f'{head}{len(frame.data)}{frame.data.hex().upper()}'.encode('ascii') + END


def parse_frame(text: bytes) -> Optional[CanFrame]:
    """Return the frame of a text without its end, None if it is not one."""
    match = _FRAME.fullmatch(text)
    if match is None:
        return None
    kind, identifier, length, data = (part for part in match.groups() if part is not None)
    if len(data) != (0 if kind in b'rR' else 2 * int(length)):
        return None
    return CanFrame(int(identifier, 16), bytes.fromhex(data.decode('ascii')), kind in b'TR',
                    kind in b'rR')
