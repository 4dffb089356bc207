# SPDX-License-Identifier: Apache-2.0
"""
Files of a black box: MCAP, written by a separate thread, so that the loop never waits for a disk.

The blocks of the ring are the chunks of the file, so that a dump takes little CPU time from the
loop: it only compresses them, without the interpreter lock, and writes them.
"""
from contextlib import suppress
from datetime import datetime, timezone
from itertools import chain
import logging
import os
from pathlib import Path
import threading
import time
from typing import List, Mapping
import zlib

import lz4.frame
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from ballbot_ros.black_box.ring import BlackBox, CHANNELS, MESSAGE, OUTSIDE_LENGTH, SPAN

LOG = logging.getLogger(__name__)

LIBRARY = 'ballbot_ros black box'
NAME, PATTERN = 'ballbot-%Y%m%dT%H%M%S.%fZ.mcap', 'ballbot-*.mcap'
# The file covers this time after a fault, too [s].
TIME_AFTER_FAULT = 1.0
# Shortest time between two files [s]; doubled each time the same fault recurs.
SHORTEST_PAUSE = 10.0
# Largest number of files; the oldest ones are deleted.
MOST_FILES = 10
# Age of the last write after which a draft belongs to a killed process [s].
STALE_DRAFT = 60.0
NICENESS = 10
# Longest wait for the last file, at the end of the process [s].
CLOSE_TIMEOUT = 10.0


class BlackBoxFiles:
    """
    Writes the content of a black box to a folder after each fault, with metadata for a reader.

    `failure` is why the last file was not written, empty if it was; `written` counts the files.
    """

    def __init__(self, box: BlackBox, folder: Path, about: Mapping[str, str]):
        self._box, self._folder, self._about = box, folder.expanduser(), about
        self._reason, self._last, self._pause = '', -SPAN, SHORTEST_PAUSE
        self.failure, self.written = '', 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name='black box', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write pending files, and end; a second call has no effect."""
        self._ending.set()
        self._box.faulted.set()
        self._thread.join(CLOSE_TIMEOUT)

    def _run(self) -> None:
        with suppress(OSError):  # below all other threads of this process
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
        # Write a fault that occurred during the last dump, too.
        while not self._ending.is_set() or self._box.faulted.is_set():
            self._box.faulted.wait()
            self._ending.wait(max(
                TIME_AFTER_FAULT, self._last + self._pause - time.monotonic()))
            fault = self._box.take_fault()
            if fault is not None:
                self._dump(*fault)

    def _dump(self, when: float, reason: str) -> None:
        self._pause = min(2.0 * self._pause, SPAN) if reason == self._reason \
            else SHORTEST_PAUSE
        self._reason, self._last = reason, time.monotonic()
        try:
            path = write_file(self._folder, self._box, when, reason, self._about)
        except OSError as error:
            self.failure = str(error)
            LOG.warning('the black box cannot be written: %s', error)
            return
        self.failure = ''
        self.written += 1
        LOG.info('the last minutes are in %s; see them with: ballbot replay %s', path, path)


def write_file(folder: Path, box: BlackBox, when: float, reason: str,
               about: Mapping[str, str]) -> Path:
    """
    Write a file atomically, delete the oldest ones, and return its path.

    `when` is the time of the fault by the clock of the box [s].  Raises `OSError` if it cannot be
    written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{datetime.now(timezone.utc):{NAME}}'
    draft = path.with_name(f'.{path.name}.part')
    try:
        with open(draft, 'wb') as stream:
            head = MCAP0_MAGIC + _packed(Header('', LIBRARY), Metadata('fault', {
                'reason': reason, 'time': repr(when + box.clock_offset)}),
                Metadata('about', dict(about)), *_channels())
            checksum = 0
            for part in chain([head], (_packed(_chunk(block)) for block in box.snapshot())):
                stream.write(part)
                checksum = zlib.crc32(part, checksum)
            stream.write(_packed(DataEnd(checksum), Footer(0, 0, 0)))
            stream.write(MCAP0_MAGIC)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    # The clock may have been set back: files of the future do not replace the new one.
    for old in sorted(set(folder.glob(PATTERN)) - {path})[:1 - MOST_FILES]:
        old.unlink(missing_ok=True)
    for old in folder.glob(f'.{PATTERN}.part'):
        with suppress(OSError):
            if old.stat().st_mtime < time.time() - STALE_DRAFT:
                old.unlink()
    return path


def _channels() -> List[McapRecord]:
    found: List[McapRecord] = []
    for number, kind in CHANNELS.items():
        found += [
            Schema(number, kind.schema.encode(), 'ros2msg',
                   f'ballbot_ros/msg/BlackBox{kind.name.title().replace("_", "")}'),
            Channel(number, f'/black_box/{kind.name}', 'cdr', {}, number)]
    return found


def _chunk(block: memoryview) -> Chunk:
    """Return a block of messages as a chunk, with its earliest and latest time."""
    at, stamps = 0, []
    while at < len(block):
        _, length, _, _, stamp, _, _ = MESSAGE.unpack_from(block, at)
        stamps.append(stamp)
        at += OUTSIDE_LENGTH + length
    return Chunk('lz4', lz4.frame.compress(block), max(stamps), min(stamps), zlib.crc32(block),
                 len(block))


def _packed(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data
