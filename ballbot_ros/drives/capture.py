# SPDX-License-Identifier: Apache-2.0
"""
Record the raw traffic of a line in a file.

A line of the file is a time [s], a direction (``>`` to the drive, ``<`` from it) and the
bytes in hexadecimal::

    # ballbot traffic 1
    0.000000 > 662030202a3131380a
    0.001812 < 302e303030303030

The tests replay a capture into a driver in place of a `Link` (test/helpers/replay.py), so that a
fault observed on a real robot becomes a test.

A capture that reaches `MOST_BYTES` continues in a new file; the previous part is kept with the
suffix ``.1``, older parts are deleted.
"""
import logging
from pathlib import Path
from typing import NamedTuple, Optional, Protocol

from ballbot_ros.clock import steady_time
from ballbot_ros.errors import ConfigurationError

# The loop of the bridge forwards the records of this logger between its periods.
LOG = logging.getLogger('ballbot_ros.bridge.capture')

HEADER = '# ballbot traffic 1'
# Largest size of a capture file [bytes]: half an hour at 500 Hz with any protocol.
MOST_BYTES = 256 * 1024**2


def part_before(path: Path) -> Path:
    """Return the path of the part before the latest part of a capture."""
    return path.with_name(f'{path.name}.1')


class TrafficSink(Protocol):
    """Receiver of a copy of the traffic of a line."""

    def record(self, direction: str, data: bytes) -> None:
        """Record a piece of traffic."""


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

    A full disk must not stop a motor bridge: a failure to write ends the recording with a warning,
    and is kept as `failure`.  The previous part of an older capture is deleted.

    Raises `ConfigurationError` if the file cannot be created.
    """

    def __init__(self, path: Path):
        self.failure: Optional[str] = None
        self._start = steady_time()
        self._path, self._size = Path(path), 0
        try:
            part_before(self._path).unlink(missing_ok=True)
            self._open()
        except OSError as error:
            raise ConfigurationError(f'cannot record to {path}: {error}',
                                     'not_writable', str(path)) from error

    def record(self, direction: str, data: bytes) -> None:
        """Write a piece of traffic."""
        if self.failure is None:
            line = f'{steady_time() - self._start:.6f} {direction} {data.hex()}\n'
            try:
                if self._size + len(line) > MOST_BYTES:
                    self._file.close()
                    self._path.replace(part_before(self._path))
                    self._open()
                self._file.write(line)
                self._size += len(line)
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        if self.failure is None:
            self.failure = str(error)
            LOG.warning('the capture %s ends here, the bridge continues: %s', self._path, error)

    def _open(self) -> None:
        self._file = open(self._path, 'w', encoding='ascii')
        self._file.write(f'{HEADER}\n')
        self._size = len(HEADER) + 1

    def close(self) -> None:
        """Finish the file."""
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)
