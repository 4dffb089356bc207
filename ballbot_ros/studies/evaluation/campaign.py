# SPDX-License-Identifier: Apache-2.0
"""
Run thousands of approaches on many cores and keep every one that is done.

Results are lines of JSON in one file that only grows; each batch is on the disk before the next
is counted as done.  A run that is killed goes on with what is missing.
"""
from concurrent.futures import Executor, FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
import hashlib
from itertools import islice
import json
import math
import os
from pathlib import Path
from typing import Any, Dict, IO, List, Optional, Set, Tuple

from ballbot_ros import __version__
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.studies.evaluation.approaches import Approach, draw_approach
from ballbot_ros.studies.evaluation.crossable import crossable_approach
from ballbot_ros.studies.evaluation.loop import about, Believer, run_approach
from ballbot_ros.studies.evaluation.search import possible
from ballbot_ros.studies.progress import ignore, Progress

BLOCK = 5   # approaches between two writings
AHEAD = 3   # blocks handed out for each worker
FILE = 'approaches.jsonl'

# What a decision raises that is no error of its input: a mistake in it, to be counted.
RAISED = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError,
          TypeError, ValueError)


@dataclass(frozen=True)
class Campaign:
    """
    Which approaches to run, with which planners; the same campaign is the same approaches.

    Attributes
    ----------
    parts : tuple of (str, str, int)
        Planner, group (``drawn`` or ``crossable``), and how many approaches: the first ones.
    seed : int
    kind, sensor : str or None
        Of all grounds and sensors, if given; see `grounds.KINDS` and `sensors.Flaws.kind`.
    required_probability : float or None
        Other than the tuning says.
    limits : tuple of (float, float)
        Run-ups and the steps that most robots cross from there, see `search.limit_of_most`; only
        needed for the group ``crossable``.
    searched : int
        Of the first planner: the first so many approaches that were not crossed are searched for
        a way.

    """

    parts: Tuple[Tuple[str, str, int], ...]
    seed: int = 0
    kind: Optional[str] = None
    sensor: Optional[str] = None
    required_probability: Optional[float] = None
    limits: Tuple[Tuple[float, float], ...] = ()
    searched: int = 0

    @property
    def size(self) -> int:
        """Return the number of runs."""
        return sum(count for _, _, count in self.parts)

    @property
    def digest(self) -> str:
        """Return what tells campaigns apart whose lines must not be mixed."""
        same = {name: value for name, value in asdict(self).items()
                if name not in ('parts', 'limits', 'searched')}
        believed = self.believer()
        known = (believed.robot.digest, believed.curve, believed.tuning, believed.gains)
        return hashlib.sha256(repr((_sources(), known, same)).encode()).hexdigest()[:16]

    def believer(self) -> Believer:
        """Return what the decision believes."""
        return _believer(self.required_probability)

    def approach(self, group: str, number: int) -> Approach:
        """Return one of its approaches."""
        believer = self.believer()
        if group == 'crossable':
            return crossable_approach(believer.robot, self.limits, self.seed, number)
        approach = draw_approach(believer.robot, believer.tuning, self.seed, number, self.kind)
        if self.sensor is None or approach.ground.sensors not in ('any', self.sensor):
            return approach
        return replace(approach, flaws=replace(approach.flaws, kind=self.sensor))


@lru_cache(maxsize=1)
def _sources() -> str:
    """Return a digest of all that an approach depends on: what was changed must not be mixed."""
    package = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256(__version__.encode())
    for folder in ('control', 'crossing', 'decision', 'physics', 'plant', 'studies/evaluation'):
        for source in sorted((package / folder).rglob('*.py')):
            digest.update(source.read_bytes())
    return digest.hexdigest()


@lru_cache(maxsize=4)
def _believer(required_probability: Optional[float]) -> Believer:
    changes: Dict[str, Any] = {} if required_probability is None else {
        'required_probability': required_probability}
    return Believer(**changes)


def run_block(campaign: Campaign, planner: str, group: str,
              numbers: List[int]) -> List[Dict[str, Any]]:
    """Run some approaches; a decision that raises has failed, and the others go on."""
    rows = []
    believer = campaign.believer()
    for number in numbers:
        approach = campaign.approach(group, number)
        try:
            row = run_approach(approach, planner, believer)
        except RAISED as error:
            row = {**about(approach, planner), 'outcome': 'raised', 'attempts': [], 'changes': 0,
                   'failure': f'{type(error).__name__}: {error}'}
        row['group'] = group
        first = planner == campaign.parts[0][0] and group == 'drawn'
        if (first and number < campaign.searched and math.isfinite(approach.ground.goal)
                and row['kind'] != 'nothing'):
            row['possible'] = row['outcome'] == 'over' or possible(
                approach, believer.robot, believer.gains)
        rows.append(row)
    return rows


def read_rows(path: Path, digest: Optional[str] = None) -> List[Dict[str, Any]]:
    """
    Return the rows of a file; a last line that was cut off is left out.

    Raises
    ------
    ConfigurationError
        If the file is of another campaign than that of a digest, or is none.

    """
    lines = path.read_text(encoding='utf-8').split('\n')
    try:
        head = json.loads(lines[0])['campaign']
        rows = [json.loads(line) for line in lines[1:-1]]
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f'{path}: is not what ballbot evaluate-decision writes, or is damaged; move it away '
            'or choose another folder') from error
    if digest is not None and head != digest:
        raise ConfigurationError(
            f'{path}: is of another seed, kind, sensor or version of the code; choose another '
            'folder')
    return rows


def _open(campaign: Campaign, path: Path) -> Tuple[IO[bytes], List[Dict[str, Any]]]:
    """Open the file to append to, without a line that was cut off, and return its rows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if path.is_file() and path.stat().st_size:
        rows = read_rows(path, campaign.digest)
        content = path.read_bytes()
        os.truncate(path, content.rfind(b'\n') + 1)
        return path.open('ab'), rows
    stream = path.open('ab')
    _append(stream, [{'campaign': campaign.digest, 'version': __version__, **asdict(campaign)}])
    return stream, rows


def _append(stream: IO[bytes], rows: List[Dict[str, Any]]) -> None:
    stream.write(''.join(json.dumps(row) + '\n' for row in rows).encode())
    stream.flush()
    os.fsync(stream.fileno())


def run_campaign(campaign: Campaign, folder: Path, pool: Executor, workers: int,
                 progress: Progress = ignore) -> List[Dict[str, Any]]:
    """
    Run a campaign, going on with what an earlier run has left.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        Where `FILE` is, or is made.
    pool : Executor
        Of processes.
    workers : int
        That the pool has.
    progress : callable, optional
        Called with the number of runs done.

    Returns
    -------
    list of dict
        The row of each run.

    Raises
    ------
    ConfigurationError
        If the file is of another campaign, or cannot be written.

    """
    try:
        stream, rows = _open(campaign, folder / FILE)
    except OSError as error:
        raise ConfigurationError(
            f'{folder / FILE}: cannot be written: {error.strerror or error}; choose another '
            'folder') from error
    with stream:
        wanted = {(planner, group, number) for planner, group, count in campaign.parts
                  for number in range(count)}
        done = set(map(_key, rows))
        pending = iter(_blocks(campaign, done))
        progress(len(wanted & done))
        waiting: Set[Future[List[Dict[str, Any]]]] = set()
        while True:
            waiting |= {pool.submit(run_block, campaign, *block)
                        for block in islice(pending, AHEAD * workers - len(waiting))}
            if not waiting:
                break
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in ready:
                found = future.result()
                _append(stream, found)
                rows += found
                done |= set(map(_key, found))
                progress(len(wanted & done))
    return [row for row in rows if _key(row) in wanted]


def _key(row: Dict[str, Any]) -> Tuple[str, str, int]:
    return row['planner'], row['group'], row['number']


def _blocks(campaign: Campaign,
            done: Set[Tuple[str, str, int]]) -> List[Tuple[str, str, List[int]]]:
    """Return what is to be done: a planner, a group and some numbers each."""
    blocks = []
    for planner, group, count in campaign.parts:
        left = [number for number in range(count) if (planner, group, number) not in done]
        blocks += [(planner, group, left[begin:begin + BLOCK])
                   for begin in range(0, len(left), BLOCK)]
    return blocks
