# SPDX-License-Identifier: Apache-2.0
"""
A pseudo-terminal as the serial device of an emulated drive; it can be unplugged.

For a drive on a CAN bus it is an slcan adapter: text for the computer, frames for the bus.
"""
from contextlib import suppress
import os
from pathlib import Path
import pty
import re
import select
import termios
import tty
from typing import Optional

from ballbot_ros.drives.can_frames import CanFrame, record, RecordParser
from ballbot_ros.errors import ConfigurationError

# Code of termios -> baud rate.
SPEEDS = {code: int(name[1:]) for name, code in vars(termios).items()
          if re.fullmatch('B[1-9][0-9]*', name)}


class PseudoTerminal:
    """
    The drive's end of a serial line.

    `link` is a symbolic link that always points to the device, as udev has for a real one.  Raises
    `ConfigurationError` if it exists and is not a symbolic link, or cannot be created.
    """

    def __init__(self, link: Optional[Path] = None):
        self._link = link
        self.received = 0  # number of bytes read so far
        self._master = self._slave = -1
        if link is not None and link.exists() and not link.is_symlink():
            raise ConfigurationError(
                f'{link} exists and is not a symbolic link; choose another name for --link',
                'exists', '--link')
        self.device = ''
        try:
            self.plug()
        except OSError as error:
            raise ConfigurationError(
                f'{link} cannot be created: {error.strerror or error}; choose another name for '
                '--link', 'not_writable', '--link') from error

    @property
    def path(self) -> str:
        """Return the path to open: the link if there is one."""
        return str(self._link) if self._link is not None else self.device

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    @property
    def baud(self) -> Optional[int]:
        """Return the baud rate that the other side has set, None for a non-standard one."""
        return SPEEDS.get(termios.tcgetattr(self._master)[5]) if self.plugged else None

    def plug(self) -> None:
        """Create the device, usually under a new name, and point the link to it."""
        if self.plugged:
            return
        # The slave stays open here, so that programs can open and close the device.
        master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(master, False)
        self.device = os.ttyname(self._slave)
        if self._link is not None:
            fresh = self._link.with_name(f'{self._link.name}.{os.getpid()}')
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.device)
            fresh.replace(self._link)
        # Last: another thread that reads `plugged` as true can open the path.
        self._master = master

    def unplug(self) -> None:
        """Remove the device; a program that has it open receives an error."""
        if not self.plugged:
            return
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        # The master first: if the slave closed first, a waiting reader could read an end of file.
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1

    def wait(self, seconds: float) -> None:
        """Wait until there is something to read, or a time has passed."""
        descriptors = [self._master] if self.plugged else []
        select.select(descriptors, [], [], max(0.0, seconds))

    def read(self, most: int = 4096) -> bytes:
        """Return the received data, which may be empty."""
        try:
            data = os.read(self._master, most) if self.plugged and most > 0 else b''
        except OSError:
            data = b''
        self.received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Send data; bytes that are not read are lost, as on a real line."""
        if self.plugged and data:
            with suppress(OSError):
                os.write(self._master, data)


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
        self._text, self._records = b'', RecordParser()
        self._open, self._bit_rate = False, 0
        super().plug()

    @property
    def baud(self) -> Optional[int]:
        """Return the bit rate of the bus that the other side has set, None before that."""
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
        frames = self._records.feed(data)
        if self._open:
            self._answer(b''.join(map(text_of, frames)))

    def _execute(self, command: bytes) -> None:
        if command[:1] in (b'O', b'C'):
            self._open = command[:1] == b'O'
        elif re.fullmatch(b'S[0-8]', command):
            self._bit_rate = BIT_RATES[int(command[1:])]
        elif command:
            self._answer(FAILED)
            return
        self._answer(END)

    def _answer(self, text: bytes) -> None:
        super().write(text)


def text_of(frame: CanFrame) -> bytes:
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
