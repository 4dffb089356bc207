# SPDX-License-Identifier: Apache-2.0
"""
Outcomes on disk: a line of JSON each, with a checksum, so that a power cut costs the last at most.

A log teaches how robot and sensor differ from what is assumed, so what may not be trusted is not
used at all: a line that is damaged, an absurd number, another robot or format, or more outcomes
in a second than a robot can have, and the whole log is refused, with the reason.  Only an end
that was cut off is left out: that is what a power cut does.  Nothing here raises for what is in
a file or for what a disk does.
"""
from contextlib import suppress
from dataclasses import dataclass, replace
import errno
import fcntl
import json
import os
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from typing import List, Optional, Tuple

from ballbot_ros.decision.outcome_lines import line_of, outcome_of
from ballbot_ros.decision.outcomes import Outcome
from ballbot_ros.errors import BallbotError, ConfigurationError

# When a log is as long as this, the newest of it are kept in a new one [bytes], [outcomes].
LONGEST, KEPT = 2_000_000, 500
# More outcomes of one run within this time are none of a robot [s].
SHORTEST_TIME, MOST_IN_IT = 1.0, 3
WAITING = 64


@dataclass(frozen=True)
class Reading:
    """
    What a log holds.

    Attributes
    ----------
    outcomes : tuple of Outcome
        Oldest first; none of a log that is refused.
    good : int
        Bytes that hold them; what comes behind was cut off [bytes].
    size : int
        Of the file [bytes].
    refusal : str
        Why the log is not used, empty if it is.

    """

    outcomes: Tuple[Outcome, ...] = ()
    good: int = 0
    size: int = 0
    refusal: str = ''

    @property
    def torn(self) -> bool:
        """Return whether the end was cut off."""
        return self.size > self.good


def read_outcomes(path: Path, robot: str = '') -> Reading:
    """
    Read a log; a file that does not exist is an empty one.

    Parameters
    ----------
    path : Path
    robot : str
        Digest of the robot whose log it must be; of any one robot by default.

    """
    try:
        with open(path, 'rb') as file:
            content = file.read(2 * LONGEST + 1)
    except FileNotFoundError:
        return Reading()
    except OSError as error:
        return Reading(refusal=f'{path} cannot be read: {error.strerror or error}')
    if len(content) > 2 * LONGEST:
        return Reading(refusal=f'{path} is longer than any log of outcomes')
    lines = content.split(b'\n')
    tail = lines.pop()
    outcomes: List[Outcome] = []
    runs: List[str] = []
    good = 0
    for number, line in enumerate(lines, 1):
        try:
            outcome, run = outcome_of(line)
            robot = robot or outcome.robot
            _check(outcome, run, robot, outcomes, runs)
        except BallbotError as error:
            # A power cut may have left the length of a line without what is in it.
            if number == len(lines) and not tail and _unreadable(line):
                return Reading(tuple(outcomes), good, len(content))
            return Reading(refusal=f'{path}, line {number}: {error}')
        outcomes.append(outcome)
        runs.append(run)
        good += len(line) + 1
    return Reading(tuple(outcomes), good, len(content))


def _unreadable(line: bytes) -> bool:
    """Return whether a line is no JSON at all."""
    try:
        json.loads(line.decode('utf-8'))
    except (UnicodeDecodeError, ValueError, RecursionError):
        return True
    return False


def _check(outcome: Outcome, run: str, robot: str, outcomes: List[Outcome],
           runs: List[str]) -> None:
    """Refuse an outcome that does not go with those before it."""
    if outcome.robot != robot:
        raise ConfigurationError(
            f'it is of another robot (digest {outcome.robot or "none"}, this one has '
            f'{robot or "none"})')
    recent = [item for item, other in zip(outcomes[-MOST_IN_IT:], runs[-MOST_IN_IT:])
              if other == run and abs(outcome.stamp - item.stamp) < SHORTEST_TIME]
    if len(recent) == MOST_IN_IT:
        raise ConfigurationError(
            f'more than {MOST_IN_IT} outcomes within {SHORTEST_TIME:g} s: no robot has so many')


class OutcomeLog:
    """
    Keeps outcomes on disk, in a thread of its own: a disk may take its time.

    Parameters
    ----------
    path : Path
        Its folder must exist.
    robot : str
        Digest of the robot.

    Attributes
    ----------
    reading : Reading
        What was there at the start.
    problem : str
        Why outcomes are not kept just now, empty if they are.

    """

    def __init__(self, path: Path, robot: str):
        """Read what is there, and get ready to append."""
        self._path = path
        self._robot = robot
        self._run = os.urandom(4).hex()
        self._recent: List[Outcome] = []
        self.reading = read_outcomes(path, robot)
        self.problem = ''
        if self.reading.refusal:
            self.problem = (f'{self.reading.refusal}; nothing is learned from it and nothing '
                            'added to it: "ballbot outcomes reset" begins another one')
        self._good, self._size = self.reading.good, self.reading.size
        self._file: Optional[int] = None
        self._queue: Queue[Optional[Outcome]] = Queue(WAITING)
        self._thread = Thread(target=self._write_all, daemon=True, name='outcome_log')
        self._thread.start()

    def append(self, outcome: Outcome) -> None:
        """Keep an outcome as soon as the disk takes it; returns at once."""
        with suppress(Full):  # a disk that has stood still for so long has told of it
            self._queue.put_nowait(replace(outcome, robot=self._robot))

    def close(self, patience: float = 2.0) -> None:
        """Write what waits, for at most `patience` [s]."""
        with suppress(Full):
            self._queue.put_nowait(None)
        self._thread.join(patience)

    def _write_all(self) -> None:
        while True:
            outcome = self._queue.get()
            if outcome is None:
                self._close_file()
                return
            if self.reading.refusal:
                continue
            try:
                self._write(outcome)
            except OSError as error:
                self.problem = (f'outcomes are not kept: {self._path}: '
                                f'{error.strerror or error}')
            except BallbotError as error:
                self.problem = f'an outcome is not kept: {error}'
            else:
                self.problem = ''

    def _write(self, outcome: Outcome) -> None:
        """Append a line, so that all of it is on the disk, or none."""
        _check(outcome, self._run, self._robot, self._recent, [self._run] * len(self._recent))
        line = line_of(outcome, self._run)
        if self._good + len(line) > LONGEST:
            self._shorten()
        file = self._opened()
        # What a power cut or a full disk left of a line goes.
        os.ftruncate(file, self._good)
        if os.pwrite(file, line, self._good) != len(line):
            os.ftruncate(file, self._good)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(file)
        self._good += len(line)
        self._recent = [*self._recent, outcome][-MOST_IN_IT:]

    def _opened(self) -> int:
        """Return the open file, which no other process writes to meanwhile."""
        if self._file is None:
            new = not self._path.exists()
            file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                lock(file)
                if os.fstat(file).st_size != self._size:
                    raise OSError(errno.ESTALE, 'somebody else has changed it')
            except OSError:
                os.close(file)
                raise
            self._file = file
            if new:
                _sync_folder(self._path)
        return self._file

    def _shorten(self) -> None:
        """Keep the newest outcomes in a new file, which takes the place of the old one at once."""
        kept = self._path.read_bytes()[:self._good].split(b'\n')[:-1][-KEPT:]
        content = b''.join(line + b'\n' for line in kept)
        write_whole(self._path, content)
        self._good = self._size = len(content)
        self._close_file()

    def _close_file(self) -> None:
        if self._file is not None:
            os.close(self._file)
            self._file = None


def lock(file: int) -> None:
    """
    Keep a file, by its descriptor, to this process until it is closed.

    Raises
    ------
    OSError
        If another one has it.

    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise OSError(error.errno, 'another process writes to it') from error


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that a power cut leaves the old one or the new one."""
    other = path.with_name(f'{path.name}.new')
    with open(other, 'wb') as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(other, path)
    _sync_folder(path)


def _sync_folder(path: Path) -> None:
    # Some file systems do not take it; the line itself is on the disk.
    with suppress(OSError):
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
