# SPDX-License-Identifier: Apache-2.0
"""
The one place that opens a serial port.

pyserial raises three unrelated families of exceptions when a cable is pulled: its own
SerialException, plain OSError (from ``in_waiting``) and termios.error (from ``flush``).  Here
they all become `LinkError`, with a reason and what to do.

Anything that ``serial.serial_for_url`` takes is a port: ``/dev/ttyUSB0``,
``/dev/serial/by-id/...``, ``socket://host:port``, ``rfc2217://host:port``, ``loop://``,
``spy:///dev/ttyUSB0?file=traffic.txt``.
"""
from contextlib import contextmanager, suppress
import errno
import select
import termios
import time
from typing import Any, Iterator, Optional

import serial
from serial.tools import list_ports

from ballbot_ros.drives.capture import Recorder
from ballbot_ros.errors import LinkError

# Some hundred bytes are under way at most, and the kernel takes 4096: a port that has no room for
# so long is one that nobody drains [s].
PATIENCE = 0.02
# pyserial looks at its clock after the bytes have gone, so that a process that was held up would
# see a stuck line: this is for ports whose room cannot be asked for, and for the worst [s].
WRITE_TIMEOUT = 0.5
LARGEST_READ = 4096
# How often a port without a file descriptor (loop://) is looked at while waiting [s].
POLL_PERIOD = 0.0005


class Link:
    """
    An open serial port that never blocks: what has arrived is read, what is written goes out.

    Not safe for several threads; give it one owner.

    Parameters
    ----------
    port : str
        Device or URL, see above.
    baud : int
        [bit/s]; ignored by USB devices and pseudo-terminals, but set all the same.
    recorder : Recorder, optional
        Keeps a copy of the traffic.

    Attributes
    ----------
    bytes_out, bytes_in : int
        Written and read so far.

    Raises
    ------
    LinkError
        If the port cannot be opened; its ``reason`` is one of missing, busy, permission,
        not_a_port, bad_address and bad_baud.

    """

    def __init__(self, port: str, baud: int, recorder: Optional[Recorder] = None):
        """Open the port, exclusively."""
        self.port = port
        self.baud = baud
        self.bytes_out = self.bytes_in = 0
        self._recorder = recorder
        self._serial: Any = None
        with _converted(port, opening=True):
            self._serial = serial.serial_for_url(
                port, baudrate=baud, timeout=0.0, write_timeout=WRITE_TIMEOUT, exclusive=True)
        # Others may not share the port, but what was sent before we came is still in its buffer.
        with _converted(port):
            self._serial.reset_input_buffer()
        try:
            self._descriptor: Optional[int] = self._serial.fileno()
        except (OSError, AttributeError):  # loop:// and the like have none
            self._descriptor = None

    def write(self, data: bytes) -> None:
        """
        Write all of `data`.

        Raises
        ------
        LinkError
            If the port is gone, or has no room for 20 ms.

        """
        with _converted(self.port):
            port = self._open()
            if self._descriptor is not None \
                    and not select.select([], [self._descriptor], [], PATIENCE)[1]:
                raise serial.SerialTimeoutException('no room')
            port.write(data)
        self.bytes_out += len(data)
        if self._recorder is not None:
            self._recorder.record('>', data)

    def read(self) -> bytes:
        """
        Return what has arrived, which may be nothing; do not wait.

        Raises
        ------
        LinkError
            If the port is gone.

        """
        with _converted(self.port):
            data: bytes = self._open().read(LARGEST_READ)
        self.bytes_in += len(data)
        if data and self._recorder is not None:
            self._recorder.record('<', data)
        return data

    def wait(self, seconds: float) -> bool:
        """
        Wait until bytes can be read, at most so long, and return whether there are any.

        Raises
        ------
        LinkError
            If the port is gone.

        """
        with _converted(self.port):
            if self._descriptor is not None:
                return bool(select.select([self._descriptor], [], [], max(0.0, seconds))[0])
            deadline = time.monotonic() + seconds
            while not self._open().in_waiting:
                if time.monotonic() >= deadline:
                    return False
                time.sleep(POLL_PERIOD)
        return True

    def close(self) -> None:
        """Close the port; closing twice, or a port that is gone, is no error."""
        port, self._serial, self._descriptor = self._serial, None, None
        if port is not None:
            # One that is gone already is what was wanted.
            with suppress(serial.SerialException, OSError, termios.error):
                port.close()

    def _open(self) -> Any:
        if self._serial is None:
            raise LinkError('closed', f'{self.port} has been closed')
        return self._serial

    def __enter__(self) -> 'Link':
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()


def ports() -> list[tuple[str, str]]:
    """Return device and description, if it has any, of each serial port of this machine."""
    return sorted((found.device, '' if found.description == 'n/a' else found.description)
                  for found in list_ports.comports())


@contextmanager
def _converted(port: str, opening: bool = False) -> Iterator[None]:
    """Turn what pyserial may raise into a `LinkError`."""
    try:
        yield
    except LinkError:
        raise
    except serial.SerialTimeoutException as error:
        raise LinkError('stuck', (
            f'{port} takes no more bytes: nobody reads at the other end, or flow control '
            'holds the line; switch hardware and software handshake off')) from error
    except (serial.SerialException, OSError, termios.error) as error:
        if opening:
            raise _opening_failure(port, error) from error
        raise LinkError('gone', f'{port} is gone ({error}): unplugged, or its controller lost '
                        'power') from error
    except ValueError as error:  # an unknown scheme, or a baud rate that does not exist
        if 'baud' in str(error).lower():
            raise LinkError('bad_baud', f'{port} cannot do this baud rate: {error}') from error
        raise LinkError('bad_address', (
            f'{port!r} is neither a device nor a URL that pyserial knows: {error}')) from error


def _opening_failure(port: str, error: Any) -> LinkError:
    """Say why a port did not open, and what to do."""
    number = getattr(error, 'errno', None)
    # pyserial does not copy the number of a termios.error, which has it in its arguments only.
    for origin in (error, error.__context__):
        if number is None and isinstance(origin, termios.error):
            number = origin.args[0]
    if number == errno.ENOENT:
        known = ', '.join(found.device for found in list_ports.comports())
        return LinkError('missing', (
            f'there is no port {port}; '
            + (f'there are {known}' if known else 'there is none at all: is it plugged in?')))
    if number in (errno.EACCES, errno.EPERM):
        return LinkError('permission', (
            f'no permission to open {port}; join its group (sudo usermod -aG dialout $USER, '
            'then log in again)'))
    if number in (errno.EAGAIN, errno.EBUSY):
        return LinkError('busy', (
            f'{port} is in use by another program; find it with: sudo fuser -v {port}'))
    if number in (errno.ENOTTY, errno.EISDIR, errno.EINVAL):
        return LinkError('not_a_port', f'{port} is not a serial port: {error}')
    return LinkError('missing', f'{port} cannot be opened: {error}')
