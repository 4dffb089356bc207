# SPDX-License-Identifier: Apache-2.0
"""Single keys of a terminal whose settings are restored afterwards."""
import os
import select
import sys
import termios
from typing import Any, List, Optional, TextIO

from ballbot_ros.errors import ConfigurationError

# Escape sequences of terminals; both modes of the arrows.
_KEYS = {b'\x1b[A': 'up', b'\x1b[B': 'down', b'\x1b[C': 'right', b'\x1b[D': 'left',
         b'\x1bOA': 'up', b'\x1bOB': 'down', b'\x1bOC': 'right', b'\x1bOD': 'left',
         b' ': 'space', b'\x03': 'interrupt', b'\x04': 'interrupt'}
_BYTES_MAX = 1024


def keys_of(data: bytes) -> List[str]:
    """Return names of keys, ``'up'`` for instance; letters as they are, others left out."""
    found = []
    while data:
        for code, name in _KEYS.items():
            if data.startswith(code):
                found.append(name)
                data = data[len(code):]
                break
        else:
            if data[:1] == b'\x1b':  # an unknown sequence: skip all of it
                end = 2
                while end < len(data) and not data[end:end + 1].isalpha() \
                        and data[end:end + 1] != b'~':
                    end += 1
                data = data[end + 1:]
                continue
            if data[:1].isalnum():
                found.append(data[:1].decode())
            data = data[1:]
    return found


class Keyboard:
    """
    The keys of a terminal as they are pressed, without Enter and without an echo.

    Use as a context manager: every exit restores the settings of the terminal.  Ctrl-C is a key
    here and interrupts nothing, so that the robot is stopped first.

    Parameters
    ----------
    stream : text stream, optional
        Standard input by default.

    Attributes
    ----------
    gone : bool
        Whether the terminal has been closed.

    Raises
    ------
    ConfigurationError
        If it is not a terminal.

    """

    def __init__(self, stream: Optional[TextIO] = None):
        stream = sys.stdin if stream is None else stream
        try:
            self._file = stream.fileno()
            self._before: Any = termios.tcgetattr(self._file)
        except (AttributeError, OSError, ValueError, termios.error) as error:
            raise ConfigurationError(
                'the keyboard is read from a terminal, and standard input is not one: run it in a '
                'terminal, or publish cmd_vel from a program',
                'unavailable', 'terminal') from error
        self.gone = False

    def __enter__(self) -> 'Keyboard':
        """Switch to single keys; drop keys pressed before."""
        mode = termios.tcgetattr(self._file)
        mode[0] &= ~termios.IXON
        mode[3] &= ~(termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 0, 0
        termios.tcsetattr(self._file, termios.TCSAFLUSH, mode)
        return self

    def __exit__(self, *_: Any) -> None:
        """Restore the terminal; drop keys pressed meanwhile."""
        try:
            termios.tcsetattr(self._file, termios.TCSAFLUSH, self._before)
        except termios.error:
            self.gone = True

    def keys(self, wait: float) -> List[str]:
        """Return the pressed keys; wait at most this time [s] for the first."""
        try:
            ready, _, _ = select.select([self._file], [], [], wait)
            data = os.read(self._file, _BYTES_MAX) if ready else None
        except OSError:
            data = b''
        if data == b'':  # ready, and nothing to read: closed
            self.gone = True
        return keys_of(data or b'')
