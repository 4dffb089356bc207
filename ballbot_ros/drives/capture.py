# SPDX-License-Identifier: Apache-2.0
"""
Keep the raw traffic of a serial line in a file, and play it back.

A line of the file is a time [s], a direction (``>`` to the drive, ``<`` from it) and the
bytes in hexadecimal::

    # ballbot traffic 1
    0.000000 > 662030202a3131380a
    0.001812 < 302e303030303030

A capture replaces a `Link` as input of a driver, so that a fault observed on a real robot becomes
a test.

A capture of `MOST_BYTES` continues in a new file; the previous part is kept with the suffix
``.1``, older parts are deleted.  `read_capture` reads both.
"""
from collections import deque
from pathlib import Path
import time
from typing import Callable, NamedTuple, Optional, Protocol, Sequence

from ballbot_ros.errors import ConfigurationError, LinkError

HEADER = '# ballbot traffic 1'
TO_DRIVE, FROM_DRIVE = '>', '<'
# Longest file of a capture [bytes]: half an hour at 500 Hz with any protocol.
MOST_BYTES = 256 * 1024**2


def part_before(path: Path) -> Path:
    """Return the path of the part before the latest part of a capture."""
    return path.with_name(f'{path.name}.1')


class TrafficSink(Protocol):
    """Receiver of a copy of the traffic of a line."""

    def record(self, direction: str, data: bytes) -> None:
        """Take a piece of traffic."""


class ShownToAll:
    """Passes traffic to several sinks, in the order given."""

    def __init__(self, *sinks: TrafficSink):
        self._sinks = sinks

    def record(self, direction: str, data: bytes) -> None:
        """Pass a piece of traffic to all sinks."""
        for sink in self._sinks:
            sink.record(direction, data)


class Record(NamedTuple):
    """One piece of traffic."""

    time: float  # since the start of the capture [s]
    direction: str  # '>' to the drive, '<' from it
    data: bytes


class Recorder:
    """
    Writes traffic to a file.

    A full disk must not stop a motor bridge: a failure to write ends the recording, and
    `failure` keeps it for the diagnostics.  The second part of an older capture is deleted.

    Parameters
    ----------
    path : Path
    clock : callable
        Gives seconds.
    most_bytes : int
        Longest file.

    Raises
    ------
    ConfigurationError
        If the file cannot be created.

    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic,
                 most_bytes: int = MOST_BYTES):
        self.failure: Optional[str] = None
        self._clock = clock
        self._begin = clock()
        self._path, self._most_bytes, self._size = Path(path), most_bytes, 0
        try:
            part_before(self._path).unlink(missing_ok=True)
            self._open()
        except OSError as error:
            raise ConfigurationError(f'cannot record to {path}: {error}',
                                     'not_writable', str(path)) from error

    def record(self, direction: str, data: bytes) -> None:
        """Write a piece of traffic."""
        if self.failure is None:
            line = f'{self._clock() - self._begin:.6f} {direction} {data.hex()}\n'
            try:
                if self._size + len(line) > self._most_bytes:
                    self._file.close()
                    self._path.replace(part_before(self._path))
                    self._open()
                self._file.write(line)
                self._size += len(line)
            except OSError as error:
                self.failure = str(error)

    def _open(self) -> None:
        self._file = open(self._path, 'w', encoding='ascii')
        self._file.write(f'{HEADER}\n')
        self._size = len(HEADER) + 1

    def close(self) -> None:
        """Finish the file."""
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or str(error)


def read_capture(path: Path) -> list[Record]:
    """
    Read a capture, with the part before it if there is one.

    An incomplete last line, after the end of its process, is ignored.

    Raises
    ------
    ConfigurationError
        Naming file and line of invalid traffic.

    """
    before = part_before(path)
    return [*(_read(before) if before.exists() else ()), *_read(path)]


def _read(path: Path) -> list[Record]:
    """Return the records of one file."""
    try:
        lines = path.read_text(encoding='ascii').splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f'{path}: cannot be read: {error}',
                                 'unreadable', str(path)) from error
    if not lines or lines[0].rstrip('\n') != HEADER:
        raise ConfigurationError(f'{path}: is not a capture, the first line must be {HEADER!r}',
                                 'wrong_kind', str(path))
    records = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.endswith('\n'):
            break
        try:
            stamp, direction, *data = line.split()
            if direction not in (TO_DRIVE, FROM_DRIVE):
                raise ValueError(f'direction {direction!r}')
            records.append(Record(float(stamp), direction, bytes.fromhex(''.join(data))))
        except ValueError as error:
            raise ConfigurationError(
                f'{path}:{number}: is not "time > hex" or "time < hex": {error}',
                'unreadable', str(path)) from error
    return records


class Replay:
    """
    A capture in place of a `Link`: each read returns the next piece from the drive.

    Attributes
    ----------
    written : list of bytes
        The written data.

    """

    def __init__(self, records: Sequence[Record]):
        self.written: list[bytes] = []
        self.port, self.baud = 'replay', 0
        self.bytes_out = self.bytes_in = 0
        self._pieces = deque(
            record.data for record in records if record.direction == FROM_DRIVE)

    @property
    def finished(self) -> bool:
        """Return whether all records were read."""
        return not self._pieces

    def write(self, data: bytes) -> None:
        """Keep the data in `written`."""
        self.written.append(data)
        self.bytes_out += len(data)

    def read(self) -> bytes:
        """
        Return the next piece.

        Raises
        ------
        LinkError
            After the last one, as an unplugged line does.

        """
        if self.finished:
            raise LinkError('the capture ends here', 'gone', 'port')
        piece = self._pieces.popleft()
        self.bytes_in += len(piece)
        return piece

    def wait(self, seconds: float, least: int = 1) -> bool:
        """Return whether there is more."""
        return not self.finished

    def close(self) -> None:
        """Do nothing."""
