# SPDX-License-Identifier: Apache-2.0
"""
Run a plan on many cores and keep every block that is done.

Blocks are written one file each, whole or not at all, into a folder beside the result; a sweep
that is killed goes on with those that are missing.  At the end they become one Parquet file with
units and provenance in its metadata, and the folder goes.
"""
from concurrent.futures import Executor, FIRST_COMPLETED, Future, wait
from itertools import islice
import json
from pathlib import Path
import shutil
from typing import Any, Callable, Dict, List, Mapping, Optional, Set, Tuple

import numpy as np

from ballbot_ros.crossing import max_step_height, try_step
from ballbot_ros.crossing.table import Crossings, TOLERANCE
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.values import FINISHED
from ballbot_ros.results.files import replacing, write_text
from ballbot_ros.studies.progress import ignore
from ballbot_ros.studies.sweep_plan import NUMBERS, SweepPlan

BLOCK = 1000  # cases between two files
AHEAD = 3     # blocks handed out for each worker
TRIED = {'passes': '1', 'score': 'm2/s2'}
NOTE = b'ballbot_sweep'  # in the metadata of a result: what it was made from
SEARCHED = {'max_height': 'm', 'error': 'm'}
Result = Tuple[Any, Any, Optional[str]]  # two of these, or why there are none


def columns(plan: SweepPlan) -> Dict[str, str]:
    """Return the unit of each column of the result."""
    units = {name: NUMBERS[name]['unit'] for name in plan.names}
    return {'case': '1', **units, **(SEARCHED if plan.searches else TRIED), 'failure': ''}


def run_block(plan: SweepPlan, first: int, behind: int) -> Dict[str, List[Any]]:
    """
    Run the cases from one number to before another.

    A case that cannot be made, or whose simulation cannot go on, says why in the column
    ``failure``; its results are empty.
    """
    rows = plan.block(first, behind)
    crossings, heights, prepared = plan.crossings(rows)
    results: List[Any] = [None] * len(rows)
    if crossings is not None:
        ran = zip(np.flatnonzero(prepared).tolist(), _tried(crossings, heights)
                  if heights is not None else _found(crossings, plan.accuracy))
        for place, result in ran:
            results[place] = result
    for place, values in enumerate(rows.tolist()):
        # By itself is what cannot be prepared or go on: there it is said why.
        if results[place] is None:
            results[place] = _run_alone(plan, dict(zip(plan.names, values)))
    units = columns(plan)
    names = list(units)
    table: Dict[str, List[Any]] = {'case': list(range(first, first + len(rows)))}
    table.update({name: rows[:, place].tolist() for place, name in enumerate(plan.names)})
    table.update({name: list(column) for name, column in zip(names[-3:], zip(*results))})
    return table


def _tried(crossings: Crossings, heights: Array) -> List[Optional[Result]]:
    """Return whether each ball gets over its step, and by how much; None where it cannot go on."""
    results = crossings.tried(heights, TOLERANCE)
    return [(passes > 0.0, score, None) if outcome == FINISHED else None
            for passes, score, outcome in results.tolist()]


def _found(crossings: Crossings, accuracy: float) -> List[Optional[Result]]:
    """Return highest steps and their errors [m]; None where a ball cannot go on."""
    results = crossings.found(accuracy)
    return [(low, error, None) if outcome == FINISHED else None
            for low, _, error, _, outcome in results.tolist()]


def _run_alone(plan: SweepPlan, values: Mapping[str, float]) -> Result:
    """Return the result of one case, or why it has none."""
    try:
        robot, speed, height, actuation, site, rules = plan.case(values)
        if height is None:
            found = max_step_height(robot, speed, actuation, None, plan.accuracy, site, rules)
            return found.height, found.error, None
        return (*try_step(robot, speed, height, actuation, site=site, rules=rules), None)
    except BallbotError as error:
        return None, None, str(error)


def run_sweep(plan: SweepPlan, out: Path, pool: Executor, workers: int,
              progress: Callable[[float], None] = ignore, block: int = BLOCK) -> int:
    """
    Run a plan into a Parquet file, going on with what an earlier run has left.

    Parameters
    ----------
    plan : SweepPlan
    out : Path
    pool : Executor
        Of processes, or of a cluster.
    workers : int
        That the pool has.
    progress : callable, optional
        Called with the number of cases done.
    block : int
        Cases per file; that of the first run counts.

    Returns
    -------
    int
        Cases that were found done.

    Raises
    ------
    ConfigurationError
        If pyarrow is missing, a file cannot be written, `out` is there and is no result of a
        sweep, or the folder beside it is that of another sweep.

    """
    arrow = load_arrow()
    refuse_foreign(arrow, out)
    folder = out.with_name(out.name + '.blocks')
    block = _open(plan, folder, block)
    starts = range(0, plan.size, block)
    left = [first for first in starts if not _part(folder, first).is_file()]
    found = done = plan.size - sum(min(block, plan.size - first) for first in left)
    waiting: Set[Future[Any]] = set()
    pending = iter(left)
    progress(done)
    while True:
        waiting |= {pool.submit(run_block, plan, first, min(first + block, plan.size))
                    for first in islice(pending, AHEAD * workers - len(waiting))}
        if not waiting:
            break
        ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        for future in ready:
            table = future.result()
            first = table['case'][0]
            write_parquet(arrow, plan, table, _part(folder, first))
            done += len(table['case'])
            progress(done)
    _join(arrow, plan, [_part(folder, first) for first in starts], out)
    shutil.rmtree(folder)
    return found


def load_arrow() -> Any:
    """Return pyarrow with its Parquet part, or say how to get it."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ConfigurationError(
            'a sweep writes Parquet files and needs pyarrow: pip install pyarrow') from error
    return pyarrow


def refuse_foreign(arrow: Any, out: Path) -> None:
    """
    Refuse to take the place of a file that no sweep has written.

    Raises
    ------
    ConfigurationError
        Naming the file.

    """
    if not out.exists():
        return
    try:
        ours = NOTE in (arrow.parquet.read_schema(out).metadata or {})
    except (OSError, arrow.ArrowException):  # a folder, no permission, no Parquet
        ours = False
    if not ours:
        raise ConfigurationError(
            f'{out} is there and is not the result of a sweep; move it away or choose another '
            'file to write to')


def _part(folder: Path, first: int) -> Path:
    return folder / f'{first:010d}.parquet'


def _open(plan: SweepPlan, folder: Path, block: int) -> int:
    """Make the folder of the blocks, or check that it is of this plan; return their size."""
    note = folder / 'plan.json'
    if not note.is_file():
        write_text(json.dumps({'digest': plan.digest, 'block': block}), note)
        return block
    try:
        known = json.loads(note.read_text(encoding='utf-8'))
        digest, size = known['digest'], int(known['block'])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f'{note}: is damaged; remove {folder} to begin anew') from error
    if digest != plan.digest:
        raise ConfigurationError(
            f'{folder} holds another sweep that is not done; go on with that one, remove the '
            'folder, or choose another file to write to')
    return size


def _schema(arrow: Any, plan: SweepPlan) -> Any:
    """Return the columns with their units, and what the file was made from."""
    kinds = {'case': arrow.int64(), 'passes': arrow.bool_(), 'failure': arrow.string()}
    described = {'plan': plan.describe(), 'digest': plan.digest, 'units': columns(plan),
                 'cases': plan.size}
    return arrow.schema(
        [arrow.field(name, kinds.get(name, arrow.float64()),
                     metadata={'unit': unit}) for name, unit in columns(plan).items()],
        metadata={NOTE: json.dumps(described)})


def write_parquet(arrow: Any, plan: SweepPlan, table: Dict[str, List[Any]], path: Path) -> None:
    """Write one block, whole or not at all."""
    with replacing(path) as stream:
        arrow.parquet.write_table(arrow.table(table, schema=_schema(arrow, plan)), stream)


def _join(arrow: Any, plan: SweepPlan, parts: List[Path], out: Path) -> None:
    """Write all blocks as one file, a block at a time."""
    with replacing(out) as stream, \
            arrow.parquet.ParquetWriter(stream, _schema(arrow, plan)) as writer:
        for part in parts:
            writer.write_table(arrow.parquet.read_table(part))
