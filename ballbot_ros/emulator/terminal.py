# SPDX-License-Identifier: Apache-2.0
"""A pseudo-terminal as the serial device of an emulated drive; it can be unplugged."""
from contextlib import suppress
import os
from pathlib import Path
import pty
import re
import select
import termios
import tty
from typing import Optional

from ballbot_ros.errors import ConfigurationError

# Speeds as termios codes them.
SPEEDS = {code: int(name[1:]) for name, code in vars(termios).items()
          if re.fullmatch('B[1-9][0-9]*', name)}


class PseudoTerminal:
    """
    The end of a serial line that the drive has.

    Parameters
    ----------
    link : Path, optional
        Symbolic link to keep pointing to the device, as udev does for a real one.

    Raises
    ------
    ConfigurationError
        If `link` exists and is not a symbolic link, or cannot be created.

    """

    def __init__(self, link: Optional[Path] = None):
        self._link = link
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
                f'{link} cannot be made: {error.strerror or error}; choose another name for '
                '--link', 'not_writable', '--link') from error

    @property
    def path(self) -> str:
        """Return the path to open: the link if there is one."""
        return str(self._link) if self._link is not None else self.device

    @property
    def plugged(self) -> bool:
        """Return whether the device is there."""
        return self._master >= 0

    @property
    def baud(self) -> Optional[int]:
        """Return the baud rate that the other side has set, None for an odd one."""
        return SPEEDS.get(termios.tcgetattr(self._master)[5]) if self.plugged else None

    def plug(self) -> None:
        """Make the device, usually under a new name, and point the link to it."""
        if self.plugged:
            return
        # The other side of it stays open here, so that a reader may come and go.
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        if self._link is not None:
            fresh = self._link.with_name(f'{self._link.name}.{os.getpid()}')
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.device)
            fresh.replace(self._link)

    def unplug(self) -> None:
        """Take the device away; a program that has it open gets an error."""
        if not self.plugged:
            return
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        # The master first: closing our other end first could let a waiting reader see an end.
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
            return os.read(self._master, most) if self.plugged and most > 0 else b''
        except OSError:
            return b''

    def write(self, data: bytes) -> None:
        """Send; bytes that are not read are lost, as on a real line."""
        if self.plugged and data:
            with suppress(OSError):
                os.write(self._master, data)
