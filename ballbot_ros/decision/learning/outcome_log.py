# SPDX-License-Identifier: Apache-2.0
"""
Outcomes of attempts on disk, one row of a SQLite database each.

SQLite makes an insertion durable and atomic, and locks the file against other processes.
Implausible content would corrupt the learned parameters: for a damaged file, a value out of range,
another robot or format, or more outcomes per second than a robot can produce, the complete log is
refused with the reason.  Neither the content of a file nor a disk failure raises an exception
on reading or appending.
"""
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
import json
import math
import os
from pathlib import Path
import sqlite3
from typing import Any, Dict, List, Optional, Tuple

from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.values import After, Plan, Strategy
from ballbot_ros.errors import BallbotError, ConfigurationError

FORMAT = 2  # of the table, in `PRAGMA user_version`
# Only the latest outcomes are kept.
OUTCOMES_MAX = 5000
# More outcomes of one run within this time are implausible [s].
BURST_TIME, BURST_MAX = 1.0, 3
# Maximum time to wait for the lock of another process [s].
LOCK_TIMEOUT = 0.5

COLUMNS = tuple(item.name for item in fields(Outcome))
CREATE = (f'CREATE TABLE IF NOT EXISTS outcomes '
          f'(number INTEGER PRIMARY KEY, run TEXT NOT NULL, {", ".join(COLUMNS)})')
INSERT = (f'INSERT INTO outcomes (run, {", ".join(COLUMNS)}) '
          f'VALUES ({", ".join("?" * (len(COLUMNS) + 1))})')


@dataclass(frozen=True)
class Reading:
    """Content of a log."""

    outcomes: Tuple[Outcome, ...] = ()  # oldest first; empty for a log that is refused
    refusal: str = ''  # why the log is not used, empty if it is


def read_outcomes(path: Path, robot: str = '') -> Reading:
    """
    Read a log; a missing file is an empty log.

    All outcomes must be of the robot with the digest `robot`, by default of any single robot.
    """
    if not path.exists():
        return Reading()
    try:
        with closing(_connect(f'{path.absolute().as_uri()}?mode=ro')) as database:
            version, = database.execute('PRAGMA user_version').fetchone()
            if version != FORMAT:
                raise ConfigurationError(
                    f'format {version}, this version reads {FORMAT}' if version else
                    'it is not a log of outcomes', 'wrong_kind', 'format')
            fault, = database.execute('PRAGMA integrity_check(1)').fetchone()
            if fault != 'ok':
                raise ConfigurationError(f'the database is damaged: {fault}',
                                         'unreadable', str(path))
            rows = database.execute(
                f'SELECT run, {", ".join(COLUMNS)} FROM outcomes ORDER BY number').fetchall()
        return Reading(_checked(rows, robot))
    except (sqlite3.Error, BallbotError, TypeError, ValueError, RecursionError) as error:
        return Reading(refusal=f'{path} cannot be used: {error}')


def _connect(uri: str) -> sqlite3.Connection:
    return sqlite3.connect(uri, uri=True, timeout=LOCK_TIMEOUT, isolation_level=None)


def _checked(rows: List[Tuple[Any, ...]], robot: str) -> Tuple[Outcome, ...]:
    """Return the outcomes in rows; refuse inconsistent ones."""
    found: List[Tuple[str, Outcome]] = []
    for number, (run, *values) in enumerate(rows, 1):
        content: Dict[str, Any] = dict(zip(COLUMNS, values))
        plan = content.pop('plan')
        outcome = replace(Outcome.from_mapping(content, f'outcome {number}'),
                          plan=None if plan is None else _plan(json.loads(plan)))
        robot = robot or outcome.robot
        _check_next(run, outcome, robot, found[-BURST_MAX:])
        found.append((run, outcome))
    return tuple(outcome for _, outcome in found)


def _check_next(run: str, outcome: Outcome, robot: str,
                recent: List[Tuple[str, Outcome]]) -> None:
    """Refuse an outcome of another robot, and a burst of outcomes."""
    if outcome.robot != robot:
        raise ConfigurationError(
            f'an outcome is of another robot (digest {outcome.robot or "none"}, this one has '
            f'{robot or "none"})', 'inconsistent', 'robot')
    if len([item for other, item in recent if other == run and
            abs(outcome.stamp - item.stamp) < BURST_TIME]) == BURST_MAX:
        raise ConfigurationError(
            f'more than {BURST_MAX} outcomes within {BURST_TIME:g} s are implausible',
            'out_of_range', 'time')


def _plan(content: Any) -> Plan:
    """Return the plan of an outcome; refuse one with other fields or with NaN."""
    names = {item.name for item in fields(Plan)}
    if not isinstance(content, dict) or set(content) != names:
        raise ConfigurationError(f'a plan must have the fields {", ".join(sorted(names))}',
                                 'missing', 'plan')
    values = {name: float(value) for name, value in content.items()
              if name not in ('strategy', 'after')}
    if any(map(math.isnan, values.values())):
        raise ConfigurationError('a plan has a number that is NaN', 'not_finite', 'plan')
    return Plan(Strategy(content['strategy']), after=After(content['after']), **values)


class OutcomeLog:
    """
    Appends outcomes to a log in a separate thread, because a disk may block.

    The folder of the log must exist; `robot` is the digest of the robot.
    """

    def __init__(self, path: Path, robot: str):
        self._path, self._robot, self._run = path, robot, os.urandom(4).hex()
        self._recent: List[Tuple[str, Outcome]] = []
        self.reading = read_outcomes(path, robot)  # the content at the start
        self.problem = ''  # why outcomes cannot be written at present, empty if they can
        if self.reading.refusal:
            self.problem = (f'{self.reading.refusal}; nothing is learned from it or '
                            'added to it: "ballbot outcomes reset" starts a new log')
        elif not os.access(there := path if path.exists() else path.parent, os.W_OK):
            self.problem = (f'outcomes cannot be kept in {path}: {there} '
                            + ('is not writable' if there.exists() else 'does not exist'))
        self._database: Optional[sqlite3.Connection] = None
        self._writer = ThreadPoolExecutor(1, 'outcome_log')

    def append(self, outcome: Outcome) -> None:
        """Queue an outcome for writing, and return immediately."""
        if not self.reading.refusal:
            self._writer.submit(self._write, replace(outcome, robot=self._robot))

    def close(self) -> None:
        """Write pending outcomes and close the file."""
        self._writer.submit(self._close)
        self._writer.shutdown()

    def _write(self, outcome: Outcome) -> None:
        try:
            _check_next(self._run, outcome, self._robot, self._recent)
            values = {name: getattr(outcome, name) for name in COLUMNS}
            values['plan'] = None if outcome.plan is None else json.dumps(asdict(outcome.plan))
            if self._database is None:
                self._database = self._opened()
            self._database.execute(INSERT, (self._run, *values.values()))
            self._database.execute(
                'DELETE FROM outcomes WHERE number <= '
                '(SELECT max(number) FROM outcomes) - ?', (OUTCOMES_MAX,))
            self._recent = [*self._recent, (self._run, outcome)][-BURST_MAX:]
            self.problem = ''
        except (sqlite3.Error, BallbotError) as error:
            self.problem = f'an outcome is not kept: {self._path}: {error}'
            self._close()

    def _opened(self) -> sqlite3.Connection:
        """Return the database, locked against other processes."""
        database = _connect(f'{self._path.absolute().as_uri()}?mode=rwc')
        try:
            # An exclusive lock, kept from the first write until the file is closed.
            for statement in ('PRAGMA locking_mode=EXCLUSIVE', 'PRAGMA synchronous=FULL', CREATE,
                              f'PRAGMA user_version={FORMAT}'):
                database.execute(statement)
        except sqlite3.Error:
            database.close()
            raise
        return database

    def _close(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None


def move_away(path: Path, backup: Path) -> None:
    """
    Rename a log, unless another process writes to it.

    Raises
    ------
    ConfigurationError
        If the log is locked, or cannot be renamed.

    """
    try:
        with closing(_connect(f'{path.absolute().as_uri()}?mode=rw')) as database:
            try:
                database.execute('BEGIN EXCLUSIVE')
            except sqlite3.DatabaseError as error:
                if 'locked' in str(error):
                    raise
            os.rename(path, backup)
    except (sqlite3.Error, OSError) as error:
        raise ConfigurationError(
            f'{path} cannot be reset: {error}; stop obstacle_decision first if it runs',
            'not_writable', str(path)) from error
