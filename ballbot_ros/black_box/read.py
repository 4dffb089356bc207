# SPDX-License-Identifier: Apache-2.0
"""
Read the file of a black box.

The readable part of a damaged or truncated file is returned; `BlackBoxRecording.damage` lists the
unreadable parts.
"""
from dataclasses import dataclass, field
from datetime import datetime, timezone
from io import BytesIO
import math
from pathlib import Path
import struct
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from mcap.exceptions import McapError
from mcap.records import Chunk, Footer, Header, Metadata
from mcap.stream_reader import get_chunk_data_stream, StreamReader
import numpy as np

from ballbot_ros.black_box.dump import LIBRARY, PATTERN
from ballbot_ros.black_box.ring import (
    CHANNELS, EVENT, FROM_DRIVE, MESSAGE, OUTSIDE_LENGTH, TO_DRIVE)
from ballbot_ros.drives.capture import Record
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.results.files import PathLike

# Largest length of a record [bytes]; a greater one indicates damage.
LONGEST_RECORD = 1 << 22
DAMAGES = (McapError, EOFError, MemoryError, OverflowError, ValueError, KeyError, RuntimeError,
           struct.error)


class RecordedEvent(NamedTuple):
    """An event, or a line of the log."""

    time: float  # [s]
    level: int  # a `Level`
    text: str


@dataclass(frozen=True)
class BlackBoxRecording:
    """The content of a file; times are of the system clock of the robot [s]."""

    reason: str  # of the fault
    fault_time: float  # time of the detection of the fault [s]
    about: Mapping[str, str]  # hardware, robot, protocol and more
    # By channel (``period``, ``drive``, ``command``, ``imu``) and column.
    tables: Mapping[str, Mapping[str, Array]]
    traffic: List[Record]  # traffic of the link
    events: List[RecordedEvent]  # in order of time
    damage: Tuple[str, ...] = field(default=())  # unreadable parts

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times of the first and the last message [s], NaN without any."""
        times = [float(stamp) for table in self.tables.values()
                 for stamp in (*table['time'][:1], *table['time'][-1:])]
        times += [item.time for item in (*self.traffic[:1], *self.traffic[-1:])]
        times += [item.time for item in (*self.events[:1], *self.events[-1:])]
        return (min(times), max(times)) if times else (math.nan, math.nan)


def date(time: float) -> datetime:
    """Return the date of a time of a recording [s], UTC."""
    return datetime.fromtimestamp(time, timezone.utc)


def find_black_box(path: Path) -> Optional[Path]:
    """Return the file of a black box, the latest one in a folder, None for anything else."""
    if path.is_dir():
        files = sorted(path.glob(PATTERN))
        return files[-1] if files and _is_black_box(files[-1]) else None
    return path if _is_black_box(path) else None


def _is_black_box(path: Path) -> bool:
    try:
        with open(path, 'rb') as stream:
            first = next(StreamReader(stream, record_size_limit=LONGEST_RECORD).records)
    except (OSError, StopIteration, *DAMAGES):
        return False
    return isinstance(first, Header) and first.library == LIBRARY


def read_black_box(path: PathLike) -> BlackBoxRecording:
    """Read a file; raise `ConfigurationError` if it is not a black box or has no metadata."""
    damage: List[str] = []
    metadata: Dict[str, Dict[str, str]] = {}
    messages: Dict[int, List[Tuple[float, bytes]]] = {number: [] for number in CHANNELS}
    complete = False
    try:
        # With a damaged length, a `BytesIO` is read to its end; a file would allocate that length.
        stream = BytesIO(Path(path).read_bytes())
    except OSError as error:
        raise ConfigurationError(
            f'{path}: cannot be read: {error.strerror or error}',
            'unreadable', str(path)) from error
    try:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True,
                                   record_size_limit=LONGEST_RECORD).records:
            if isinstance(record, Header) and record.library != LIBRARY:
                break
            if isinstance(record, Metadata):
                metadata[record.name] = record.metadata
            elif isinstance(record, Chunk):
                _take(record, messages, damage)
            complete = complete or isinstance(record, Footer)
    except DAMAGES as error:
        damage.append(f'the file is damaged or truncated: {error!r}')
    try:
        reason, when = metadata['fault']['reason'], float(metadata['fault']['time'])
    except (KeyError, ValueError):
        raise ConfigurationError(
            f'{path}: is not a file of a black box, or its metadata are damaged: '
            f'{", ".join(damage) or "it has no record of a fault"}',
            'unreadable', str(path)) from None
    if not complete and not damage:
        damage.append('the file is truncated')
    traffic = sorted(
        (Record(stamp, side, data[4:4 + struct.unpack_from('<I', data)[0]])
         for channel, side in ((TO_DRIVE, '>'), (FROM_DRIVE, '<'))
         for stamp, data in messages[channel]), key=lambda record: record.time)
    events = sorted(
        (RecordedEvent(stamp, data[0], data[8:-1].decode('utf-8', 'replace'))
         for stamp, data in messages[EVENT]), key=lambda event: event.time)
    return BlackBoxRecording(
        reason, when, metadata.get('about', {}), _tables(messages), traffic, events,
        tuple(damage))


def _take(chunk: Chunk, messages: Dict[int, List[Tuple[float, bytes]]],
          damage: List[str]) -> None:
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(size)
    except DAMAGES as error:
        damage.append(f'a damaged chunk was skipped: {error!r}')
        return
    at = 0  # the library would create an object per message
    while at < size:
        _, length, channel, _, stamp, _, _ = MESSAGE.unpack_from(data, at)
        end = at + OUTSIDE_LENGTH + length
        messages[channel].append((1e-9 * stamp, data[at + MESSAGE.size:end]))
        at = end


def _tables(messages: Mapping[int, List[Tuple[float, bytes]]]) -> Dict[str, Dict[str, Array]]:
    """Return the numeric channels as columns."""
    tables: Dict[str, Dict[str, Any]] = {}
    for number, kind in CHANNELS.items():
        if any(type_ in ('string', 'uint8[]') for type_, _, _ in kind.fields):
            continue
        layout = kind.layout
        rows = [(stamp, *layout.unpack_from(data)) for stamp, data in messages[number]]
        columns = np.array(rows, float).reshape(-1, 1 + len(kind.fields)).T
        names = ['time', *(name for _, name, _ in kind.fields)]
        tables[kind.name] = dict(zip(names, columns))
    return tables
