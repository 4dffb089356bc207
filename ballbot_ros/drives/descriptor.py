# SPDX-License-Identifier: Apache-2.0
"""
Reads and writes of an open serial device straight on its file descriptor.

pyserial opens and sets it up.  Its own read and write ask the kernel before and after each call
and look at the clock: at 500 Hz that took more of the processor than the laws of the controller.
"""
import os
import select
import termios
import time

LARGEST_READ = 4096
CONTROL = 6  # place of the control characters among the settings of a terminal
# Some hundred bytes are under way at most, and the kernel takes 4096: a port that has no room for
# so long is one that nobody drains [s].
PATIENCE = 0.02
# Longest that one write waits, for a line that takes a few bytes now and then [s].
LONGEST_WRITE = 0.5


class Descriptor:
    """
    A device that never blocks.

    All methods raise `OSError` or `termios.error` if the device is gone.

    Parameters
    ----------
    number : int
        Open, for reading and writing, without blocking.

    """

    def __init__(self, number: int):
        """Take the descriptor; whoever opened it closes it."""
        self._number = number
        self._alone = [number]
        self._doubtful = True  # whether nothing to read may mean that nobody is there
        self._least = 1
        self._state, self._room = select.poll(), select.poll()
        self._state.register(number, 0)  # that it has hung up is told unasked
        self._room.register(number, select.POLLOUT)

    def read(self) -> bytes:
        """Return what has arrived, which may be nothing."""
        try:
            data = os.read(self._number, LARGEST_READ)
        except BlockingIOError:
            return b''
        if data:
            self._doubtful = False
        elif self._doubtful:
            # Of a terminal that was hung up, nothing can be read either.
            if self._state.poll(0):
                raise OSError('the device has hung up')
        else:  # nothing after something is usual
            self._doubtful = True
        return data

    def write(self, data: bytes) -> bool:
        """Write all, and return whether there was room for it."""
        written = self._written(data)
        if written == len(data):
            return True
        deadline = time.monotonic() + LONGEST_WRITE
        while written < len(data):
            if not self._room.poll(1e3 * PATIENCE) or time.monotonic() > deadline:
                return False
            written += self._written(data[written:])
        return True

    def wait(self, seconds: float, least: int = 1) -> bool:
        """Wait for so many bytes, at most so long, and return whether they are there."""
        if least != self._least:
            self._tell_from(least)
        # Of the ways to wait, this is the only one that does not round to milliseconds.
        ready, _, _ = select.select(self._alone, (), (), seconds if seconds > 0.0 else 0.0)
        if ready:
            self._doubtful = True
            return True
        return False

    def _tell_from(self, least: int) -> None:
        """Let the kernel tell of bytes when there are so many: a reply comes in pieces."""
        self._least = least
        if os.isatty(self._number):
            settings = termios.tcgetattr(self._number)
            settings[CONTROL][termios.VMIN] = least
            termios.tcsetattr(self._number, termios.TCSANOW, settings)

    def _written(self, data: bytes) -> int:
        """Return how many bytes went out at once."""
        try:
            return os.write(self._number, data)
        except BlockingIOError:
            return 0
