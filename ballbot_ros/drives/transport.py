# SPDX-License-Identifier: Apache-2.0
"""
Serial ports; the only module that opens a port.

pyserial raises three unrelated families of exceptions when a cable is pulled: its own
SerialException, plain OSError (from ``in_waiting``) and termios.error (from ``flush``).  Here
they all become `LinkError`, with a reason and a remedy.

Anything that ``serial.serial_for_url`` accepts is a port: ``/dev/ttyUSB0``,
``/dev/serial/by-id/...``, ``socket://host:port``, ``rfc2217://host:port``, ``loop://``,
``spy:///dev/ttyUSB0?file=traffic.txt``.
"""
from contextlib import suppress
import errno
import os
import select
import termios
import time
from typing import Any, Callable, Optional, Protocol

import serial
from serial.tools import list_ports

from ballbot_ros.clock import steady_time
from ballbot_ros.drives.capture import TrafficSink
from ballbot_ros.errors import LinkError

# Backstop, and for ports whose free space cannot be queried [s]: pyserial reads its clock after
# the write, so a preempted process would time out.
WRITE_TIMEOUT = 0.5
# Poll period of a port without a file descriptor (loop://) [s].
POLL_PERIOD = 0.0005

LARGEST_READ = 4096
CONTROL = 6  # index of the control characters in the settings of a terminal
# At most a few hundred bytes are in transit, and the kernel buffers 4096: if a port has no space
# for this time, the other end does not read [s].
SEND_TIMEOUT = 0.02
# Timeout of one write, for a line that accepts a few bytes at a time [s].
LONGEST_WRITE = 0.5

# Exceptions of pyserial and the kernel.
FAILURES = (serial.SerialException, OSError, termios.error, ValueError)


class Transfer(Protocol):
    """Reads and writes of an open port; see `Link` and `Descriptor`."""

    def write(self, data: bytes) -> bool:
        """Write all data, and return whether the port accepted them."""

    def read(self) -> bytes:
        """Return the received data."""

    def wait(self, seconds: float, least: int) -> bool:
        """Wait for bytes, `least` since the last write; return whether there are any."""


class Descriptor:
    """
    A device open for non-blocking reads and writes; its owner closes it.

    All methods raise `OSError` or `termios.error` if the device is gone.
    """

    def __init__(self, number: int):
        self._number = number
        self._alone = [number]
        self._doubtful = True  # whether an empty read may mean a hang-up
        self._least = 1
        self._received = 0  # bytes since the last write
        self._state, self._room = select.poll(), select.poll()
        self._state.register(number, 0)  # poll always reports a hang-up
        self._room.register(number, select.POLLOUT)

    def read(self) -> bytes:
        try:
            data = os.read(self._number, LARGEST_READ)
        except BlockingIOError:
            return b''
        if data:
            self._doubtful = False
            self._received += len(data)
        elif self._doubtful:
            # A read of a terminal after a hang-up is empty, too.
            if self._state.poll(0):
                raise OSError('the device has hung up')
        else:  # an empty read after data is usual
            self._doubtful = True
        return data

    def write(self, data: bytes) -> bool:
        self._received = 0
        written = self._written(data)
        if written == len(data):
            return True
        deadline = steady_time() + LONGEST_WRITE
        while written < len(data):
            if not self._room.poll(1e3 * SEND_TIMEOUT) or steady_time() > deadline:
                return False
            written += self._written(data[written:])
        return True

    def wait(self, seconds: float, least: int = 1) -> bool:
        missing = max(1, least - self._received)  # the end of a longer reply may be one byte
        if missing != self._least:
            self._set_minimum(missing)
        # Only select does not round the timeout to milliseconds.
        ready, _, _ = select.select(self._alone, (), (), seconds if seconds > 0.0 else 0.0)
        if ready:
            self._doubtful = True
            return True
        return False

    def _set_minimum(self, least: int) -> None:
        """Make the kernel report data from a number of bytes on, as a reply arrives in pieces."""
        self._least = least
        if os.isatty(self._number):
            settings = termios.tcgetattr(self._number)
            settings[CONTROL][termios.VMIN] = least
            termios.tcsetattr(self._number, termios.TCSANOW, settings)

    def _written(self, data: bytes) -> int:
        try:
            return os.write(self._number, data)
        except BlockingIOError:
            return 0


class Indirect:
    """Access through pyserial, for URLs: a socket, a remote port, a monitored port."""

    def __init__(self, port: Any, descriptor: Optional[int]):
        self._port, self._descriptor = port, descriptor

    def write(self, data: bytes) -> bool:
        if self._descriptor is not None \
                and not select.select([], [self._descriptor], [], SEND_TIMEOUT)[1]:
            return False
        self._port.write(data)
        return True

    def read(self) -> bytes:
        data: bytes = self._port.read(LARGEST_READ)
        return data

    def wait(self, seconds: float, least: int) -> bool:
        if self._descriptor is not None:
            return bool(select.select([self._descriptor], [], [], max(0.0, seconds))[0])
        deadline = steady_time() + seconds
        while not self._port.in_waiting:
            if steady_time() >= deadline:
                return False
            time.sleep(POLL_PERIOD)
        return True


class Link:
    """
    An open port, device or URL, with non-blocking reads and writes.

    Not thread-safe; one thread must own it.  USB devices and pseudo-terminals ignore the
    baud rate [bit/s]; a recorder receives a copy of the traffic.  Raises `LinkError` if the port
    cannot be opened; its ``reason`` is one of missing, busy, permission, not_a_port, bad_address
    and bad_baud.
    """

    def __init__(self, port: str, baud: int, recorder: Optional[TrafficSink] = None):
        self.port = port
        self.baud = baud
        self._recorder = recorder
        self._transfer: Optional[Transfer] = None
        self._opened: Any = self._attempt(self._connect, opening=True)
        # Exclusive use starts now, but the buffer still holds earlier data.
        self._transfer = self._attempt(self._emptied)

    def write(self, data: bytes) -> None:
        """Write all data; raises `LinkError` if the port is gone, or accepts none for 20 ms."""
        if not self._attempt((self._transfer or self._closed()).write, data):
            raise _stuck(self.port)
        if self._recorder is not None:
            self._recorder.record('>', data)

    def read(self) -> bytes:
        """Return the received data, without waiting; `LinkError` if the port is gone."""
        data: bytes = self._attempt((self._transfer or self._closed()).read)
        if data and self._recorder is not None:
            self._recorder.record('<', data)
        return data

    def wait(self, seconds: float, least: int = 1) -> bool:
        """
        Wait until bytes can be read, or a time has passed [s]; return whether there are any.

        Where supported, fewer bytes than `least` since the last write, at most 255, do not end the
        wait; a change of their number takes system calls.  Raises `LinkError` if the port is gone.
        """
        return bool(self._attempt((self._transfer or self._closed()).wait, seconds, least))

    def close(self) -> None:
        """
        Close the port and drop the bytes that it has not sent.

        Closing twice, or after a loss of the port, is allowed.
        """
        opened, self._opened, self._transfer = self._opened, None, None
        if opened is not None:
            with suppress(Exception):  # a bus has no such method
                opened.reset_output_buffer()
            with suppress(Exception):  # fails if the port is gone
                opened.close()

    def __enter__(self) -> 'Link':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _closed(self) -> 'Transfer':
        raise LinkError(f'{self.port} has been closed', 'closed', 'port')

    def _attempt(self, action: Callable[..., Any], *arguments: Any, opening: bool = False) -> Any:
        """Return the result of an action on the port; convert its errors into `LinkError`."""
        try:
            return action(*arguments)
        except LinkError:
            raise
        except Exception as error:
            raise self._failure(error, opening) from error

    # For subclasses

    def _connect(self) -> Any:
        """Open the port and return an object with a method `close`."""
        return serial.serial_for_url(self.port, baudrate=self.baud, timeout=0.0,
                                     write_timeout=WRITE_TIMEOUT, exclusive=True)

    def _emptied(self) -> Transfer:
        """Drop received data and return the `Transfer`, without pyserial for a plain device."""
        port = self._opened
        port.reset_input_buffer()
        try:
            descriptor = port.fileno()
        except (OSError, AttributeError):  # loop:// and others have none
            descriptor = None
        if descriptor is not None and type(port) is serial.Serial:
            return Descriptor(descriptor)
        return Indirect(port, descriptor)

    def _failure(self, error: Exception, opening: bool) -> LinkError:
        """Return the error for a failed action; re-raise an exception that is not of the port."""
        port = self.port
        if not isinstance(error, FAILURES):
            raise error
        if isinstance(error, serial.SerialTimeoutException):
            return _stuck(port)
        if isinstance(error, ValueError):  # unknown scheme, or a baud rate that does not exist
            if 'baud' in str(error).lower():
                return LinkError(f'{port} cannot use this baud rate: {error}', 'bad_baud', 'baud')
            return LinkError(
                f'{port!r} is neither a device nor a URL that pyserial supports: {error}',
                'bad_address', 'port')
        if opening:
            return opening_failure(port, error)
        return LinkError(
            f'{port} is gone ({error}): unplugged, or its controller lost power', 'gone', 'port')


def ports() -> list[tuple[str, str]]:
    """Return device and description, if it has any, of each serial port of this machine."""
    return sorted((found.device, '' if found.description == 'n/a' else found.description)
                  for found in list_ports.comports())


def _stuck(port: str) -> LinkError:
    return LinkError(
        f'{port} accepts no more bytes: the other end does not read, or flow control blocks the '
        'port; disable hardware and software flow control', 'stuck', 'port')


def errno_of(error: Optional[BaseException]) -> Optional[int]:
    """Return the errno behind an exception, None if there is none."""
    while error is not None:
        number = getattr(error, 'errno', None) or getattr(error, 'error_code', None)
        if isinstance(error, termios.error):
            number = error.args[0]
        if number is not None:
            return int(number)
        error = error.__cause__ or error.__context__
    return None


def opening_failure(port: str, error: Exception) -> LinkError:
    """Return the error for a port that could not be opened, with the remedy."""
    number = errno_of(error)
    if number == errno.ENOENT:
        known = ', '.join(found.device for found in list_ports.comports())
        return LinkError(
            f'there is no port {port}; '
            + (f'available: {known}' if known else 'no port is available: is it plugged in?'),
            'missing', 'port')
    if number in (errno.EACCES, errno.EPERM):
        return LinkError(
            f'no permission to open {port}; join its group (sudo usermod -aG dialout $USER, '
            'then log in again)', 'permission', 'port')
    if number in (errno.EAGAIN, errno.EBUSY):
        return LinkError(
            f'{port} is in use by another program; find it with: sudo fuser -v {port}',
            'busy', 'port')
    if number in (errno.ENOTTY, errno.EISDIR, errno.EINVAL):
        return LinkError(f'{port} is not a serial port: {error}', 'not_a_port', 'port')
    return LinkError(f'{port} cannot be opened: {error}', 'missing', 'port')
