# SPDX-License-Identifier: Apache-2.0
"""
Read the file of a black box; `ballbot_ros.black_box.file` says what is in it.

A file that is damaged or was cut off gives what is left of it, and `BlackBoxRecording.damage` says
what is not.
"""
from dataclasses import dataclass, field
from datetime import datetime, timezone
import json
import math
from pathlib import Path
import struct
from typing import Any, Dict, Iterator, List, Mapping, NamedTuple, Tuple
import zlib

import numpy as np

from ballbot_ros.black_box.file import FRAME, MAGIC
from ballbot_ros.black_box.ring import FAULT
from ballbot_ros.drives.capture import FROM_DRIVE, Record, TO_DRIVE
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.results.files import PathLike

# No block is longer [bytes]; a length beyond is damage.
LONGEST = 1 << 22
SIDES = {'to_drive': TO_DRIVE, 'from_drive': FROM_DRIVE}


class Happening(NamedTuple):
    """An event, or a line of the log."""

    time: float  # of the steady clock of the robot [s]
    weight: int  # `bridge.black_box.NOTE`, `EVENT` or `FAULT`
    text: str


@dataclass(frozen=True)
class BlackBoxRecording:
    """
    What a file holds; times are of the steady clock of the robot [s].

    Attributes
    ----------
    head : mapping
        ``reason``, ``fault_time``, ``about``, ``states``, and more.
    tables : mapping of str to mapping of str to (n,) array
        By kind (``period``, ``drive``, ``command``, ``imu``) and column.
    units : mapping of str to mapping of str to str
        Likewise.
    traffic : list of Record
        Pieces of the line, times as above.
    events : list of Happening
        In order of time.
    damage : tuple of str
        What could not be read, in words.

    """

    head: Mapping[str, Any]
    tables: Mapping[str, Mapping[str, Array]]
    units: Mapping[str, Mapping[str, str]]
    traffic: List[Record]
    events: List[Happening]
    damage: Tuple[str, ...] = field(default=())

    @property
    def fault_time(self) -> float:
        """Return when the fault was noticed [s]."""
        return float(self.head['fault_time'])

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times of the first and the last record [s], nan without any."""
        times = [float(stamp) for table in self.tables.values()
                 for stamp in (*table['time'][:1], *table['time'][-1:])]
        times += [item.time for item in (*self.traffic[:1], *self.traffic[-1:])]
        times += [item.time for item in (*self.events[:1], *self.events[-1:])]
        return (min(times), max(times)) if times else (math.nan, math.nan)

    def wall_clock(self, time: float) -> datetime:
        """Return the time of day of a time [s], UTC, by the clock of the robot at the dump."""
        return datetime.fromtimestamp(
            float(self.head['unix_time']) + time - float(self.head['clock']), timezone.utc)

    @property
    def faults(self) -> List[Happening]:
        """Return the events of which a file is written."""
        return [event for event in self.events if event.weight == FAULT]


def read_black_box(path: PathLike) -> BlackBoxRecording:
    """
    Read a file.

    Raises
    ------
    ConfigurationError
        If it cannot be read, is of another kind or version, or has lost its header.

    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ConfigurationError(
            f'{path}: cannot be read: {error.strerror or error}') from error
    if not content.startswith(MAGIC):
        begin = content[:len(MAGIC)]
        raise ConfigurationError(
            f'{path}: is no file of a black box, or of another version: it begins with {begin!r} '
            f'and must with {MAGIC!r}')
    damage: List[str] = []
    blocks = _blocks(content, damage)
    try:
        head = _head(next(blocks, b''))
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f'{path}: its header is damaged, and nothing can be read without it: '
            f'{", ".join(damage) or error}') from error
    return _recording(head, blocks, damage)


def _head(text: bytes) -> Dict[str, Any]:
    """Return the header with what must be in it, or raise ValueError, KeyError or TypeError."""
    head = json.loads(text)
    for name in ('fault_time', 'clock', 'unix_time'):
        if not math.isfinite(float(head[name])):
            raise ValueError(f'{name} is {head[name]}')
    head['layouts'] = {
        int(number): (kind['name'], struct.Struct(kind['layout']),
                      tuple((name, unit) for name, unit in kind['fields']), kind['tail'])
        for number, kind in head['kinds'].items()}
    head['about'], head['reason'] = dict(head['about']), str(head['reason'])
    return dict(head)


def _blocks(content: bytes, damage: List[str]) -> Iterator[bytes]:
    """Yield header and blocks that are whole, and write down what is not."""
    at, number = len(MAGIC), 0
    while at < len(content):
        if at + FRAME.size > len(content):
            break
        length, checksum = FRAME.unpack_from(content, at)
        at += FRAME.size
        if length == 0:
            if checksum != zlib.crc32(b''):
                damage.append('the end has a wrong checksum')
            if at < len(content):
                damage.append(f'{len(content) - at} bytes behind the end')
            return
        data = content[at:at + length]
        if length > LONGEST or len(data) < length:
            break
        at += length
        number += 1
        if zlib.crc32(data) == checksum:
            yield data
        elif number == 1:
            damage.append('the checksum of the header is wrong')
            return
        else:
            damage.append(f'block {number - 1} has a wrong checksum and is left out')
    damage.append(f'the file was cut off, or is damaged, after {at} bytes: what comes later is '
                  'missing')


def _recording(head: Dict[str, Any], blocks: Iterator[bytes], damage: List[str]
               ) -> BlackBoxRecording:
    """Sort the records of all blocks."""
    layouts = head['layouts']
    rows: Dict[int, List[Tuple[Any, ...]]] = {number: [] for number in layouts}
    for data in blocks:
        try:
            _take(zlib.decompress(data), layouts, rows)
        except (zlib.error, struct.error, KeyError, UnicodeDecodeError) as error:
            damage.append(f'a block ends in something else than records ({error!r})')
    tables, units = {}, {}
    traffic: List[Record] = []
    events: List[Happening] = []
    for number, (name, _, fields, tail) in layouts.items():
        if tail == 'bytes' and name in SIDES:
            traffic += [Record(row[0], SIDES[name], row[-1]) for row in rows[number]]
        elif tail == 'text':
            events += [Happening(row[0], row[1], row[-1]) for row in rows[number]]
        elif not tail:
            columns = np.array(rows[number], float).reshape(-1, len(fields)).T
            tables[name] = {title: column for (title, _), column in zip(fields, columns)}
            units[name] = dict(fields)
    traffic.sort(key=lambda record: record.time)
    events.sort(key=lambda event: event.time)
    return BlackBoxRecording(head, tables, units, traffic, events, tuple(damage))


def _take(data: bytes, layouts: Mapping[int, Tuple[str, struct.Struct, Any, str]],
          rows: Mapping[int, List[Tuple[Any, ...]]]) -> None:
    """Cut a block into records; whatever is none raises."""
    at, end = 0, len(data)
    while at < end:
        kind = data[at]
        _, layout, _, tail = layouts[kind]
        values = layout.unpack_from(data, at)
        at += layout.size
        if tail:
            length = values[-1]
            piece = data[at:at + length]
            if len(piece) < length:
                raise struct.error('a record is longer than its block')
            rows[kind].append((*values[1:-1], piece.decode('utf-8', 'replace')
                               if tail == 'text' else piece))
            at += length
        else:
            rows[kind].append(values[1:])
