# SPDX-License-Identifier: Apache-2.0
"""
Files of a black box: written by a thread of their own, so that the loop never waits for a disk.

A file begins with `MAGIC` and a header, a JSON object that describes every kind of record.  Blocks
of records follow, compressed by zlib, and an empty one is the end.  Header and blocks stand behind
their length and their CRC-32, so that a file that was cut off or damaged gives what is left of it;
`ballbot_ros.black_box.reader` reads it.
"""
from contextlib import suppress
from datetime import datetime, timezone
import json
import logging
import os
from pathlib import Path
import struct
import threading
import time
from typing import BinaryIO, List, Mapping
import zlib

from ballbot_ros.black_box.ring import BlackBox, KINDS, SPAN, STATES

LOG = logging.getLogger(__name__)

MAGIC = b'ballbot black box 1\n'
# Length and CRC-32 of what follows.
FRAME = struct.Struct('<II')
ENDING, NAME = '.blackbox', 'ballbot-%Y%m%dT%H%M%S.%fZ'
# What happens after a fault is kept, too, for so long [s].
AFTERMATH = 1.0
# Between two files at least [s]; twice as long each time that the fault is the same again.
APART = 10.0
# The oldest file goes when there are more.
MOST_FILES = 10
# A draft that nobody has written to for so long is left by a process that was killed [s].
STALE = 60.0
# Niceness of the thread.
POLITE = 10
# For the last file, at the end of the process [s].
PATIENCE = 10.0


class BlackBoxFiles:
    """
    Writes what a black box holds to a folder when a fault has happened.

    Parameters
    ----------
    box : BlackBox
    folder : Path
        Made when the first file is written.
    about : mapping of str to str
        What a reader should know: hardware, robot, protocol.
    apart, aftermath : float
        See `APART` and `AFTERMATH` [s].

    Attributes
    ----------
    failure : str
        Why the last file could not be written; empty if it could.
    written : int
        Files.

    """

    def __init__(self, box: BlackBox, folder: Path, about: Mapping[str, str],
                 apart: float = APART, aftermath: float = AFTERMATH):
        """Begin to wait for a fault."""
        self._box, self._folder, self._about = box, folder.expanduser(), about
        self._apart, self._aftermath = apart, aftermath
        self._reason, self._last, self._pause = '', -SPAN, apart
        self.failure, self.written = '', 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name='black box', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write what is due, and end; a second time does no harm."""
        self._ending.set()
        self._box.faulted.set()
        self._thread.join(PATIENCE)

    def _run(self) -> None:
        with suppress(OSError):  # behind everything else in this process
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), POLITE)
        # A fault that came during the last writing is in a file, too.
        while not self._ending.is_set() or self._box.faulted.is_set():
            self._box.faulted.wait()
            self._ending.wait(max(
                self._aftermath, self._last + self._pause - time.monotonic()))
            fault = self._box.take_fault()
            if fault is not None:
                self._dump(*fault)

    def _dump(self, when: float, reason: str) -> None:
        """Write a file, and remember when the next one may follow."""
        self._pause = min(2.0 * self._pause, SPAN) if reason == self._reason else self._apart
        self._reason, self._last = reason, time.monotonic()
        try:
            path = write_file(self._folder, self._box.snapshot(), header(
                self._box, when, reason, self._about))
        except OSError as error:
            self.failure = str(error)
            LOG.warning('the black box cannot be written: %s', error)
            return
        self.failure = ''
        self.written += 1
        LOG.info('the last minutes are in %s; see them with: ballbot replay %s', path, path)


def header(box: BlackBox, when: float, reason: str, about: Mapping[str, str]
           ) -> Mapping[str, object]:
    """Return what a reader must know, for a fault at a time [s] of the clock of the box."""
    return {
        'reason': reason, 'fault_time': when, 'clock': box.clock(), 'unix_time': time.time(),
        'about': dict(about), 'states': [state.name for state in STATES],
        'kinds': {str(number): kind._asdict() for number, kind in KINDS.items()}}


def write_file(folder: Path, blocks: List[memoryview], head: Mapping[str, object]) -> Path:
    """
    Write a file, whole or not at all, and let go of the oldest ones; return where it is.

    Raises
    ------
    OSError
        If it cannot be written.

    """
    folder.mkdir(parents=True, exist_ok=True)
    now = datetime.fromtimestamp(float(str(head['unix_time'])), timezone.utc)
    path = folder / f'{now:{NAME}}{ENDING}'
    draft = path.with_name(f'.{path.name}.part')
    try:
        with open(draft, 'wb') as stream:
            stream.write(MAGIC)
            _put(stream, json.dumps(head).encode())
            for block in blocks:
                _put(stream, zlib.compress(block, 1))
            _put(stream, b'')
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    for old in sorted(folder.glob(f'ballbot-*{ENDING}'))[:-MOST_FILES]:
        old.unlink(missing_ok=True)
    for old in folder.glob(f'.ballbot-*{ENDING}.part'):
        with suppress(OSError):
            if old.stat().st_mtime < now.timestamp() - STALE:
                old.unlink()
    return path


def _put(stream: BinaryIO, data: bytes) -> None:
    stream.write(FRAME.pack(len(data), zlib.crc32(data)))
    stream.write(data)
