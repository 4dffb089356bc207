# SPDX-License-Identifier: Apache-2.0
"""
Run a plan on many cores or a cluster; an interrupted run resumes.

The finished blocks are Parquet files in a folder next to the result, see `parallel_map`.  At the
end, one file with units and provenance in its metadata replaces the folder.
"""
from concurrent.futures import Executor
import json
from pathlib import Path
import shutil
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from ballbot_ros.crossing import max_step_height, try_step
from ballbot_ros.crossing.max_step_height import ATTEMPT_TOLERANCE, ERROR, LOW, OUTCOME
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics.solvers.values import FINISHED
from ballbot_ros.results.files import load_arrow, replacing
from ballbot_ros.studies.parallel_map import checkpointed_map, claimed
from ballbot_ros.studies.progress import ignore, Progress
from ballbot_ros.studies.sweep_plan import NUMBERS, SweepPlan

BLOCK_SIZE = 4000  # cases in a file; each file costs 4 ms, a case 30 us
TRIED_COLUMNS = {'passes': '1', 'score': 'm2/s2'}
METADATA_KEY = b'ballbot_sweep'  # key of the provenance in the metadata
SEARCHED_COLUMNS = {'max_height': 'm', 'error': 'm'}


class Finished(NamedTuple):
    """Numbers of cases of a finished sweep."""

    resumed: int  # that a previous, interrupted run had finished
    failed: int
    reason: str  # of the first failure; empty without one


def columns(plan: SweepPlan) -> Dict[str, str]:
    """Return the unit of each column of the result."""
    units = {name: NUMBERS[name]['unit'] for name in plan.names}
    results = SEARCHED_COLUMNS if plan.searches else TRIED_COLUMNS
    return {'case': '1', **units, **results, 'failure': ''}


def run_block(plan: SweepPlan, first: int, stop: int) -> Dict[str, List[Any]]:
    """
    Run the cases from number `first` to before `stop`.

    If a case cannot be created or simulated, the column ``failure`` has the reason, and its
    results are empty.
    """
    rows = plan.block(first, stop)
    results: List[Any] = [None] * len(rows)
    prepared = plan.crossings(rows)
    if prepared is not None:
        crossings, heights, which = prepared
        if heights is None:
            ran = crossings.found(plan.accuracy)[:, [OUTCOME, LOW, ERROR]].tolist()
        else:
            ran = [(outcome, score > 0.0, score) for outcome, score, _ in crossings.tried(
                heights, ATTEMPT_TOLERANCE).tolist()]
        for place, (outcome, *found) in zip(np.flatnonzero(which).tolist(), ran):
            if outcome == FINISHED:
                results[place] = *found, None
    for place, values in enumerate(rows.tolist()):
        # Cases that failed in the table run again individually, to obtain their errors.
        if results[place] is None:
            results[place] = _run_alone(plan, dict(zip(plan.names, values)))
    units = columns(plan)
    names = list(units)
    table: Dict[str, List[Any]] = {'case': list(range(first, first + len(rows)))}
    table.update({name: rows[:, place].tolist() for place, name in enumerate(plan.names)})
    table.update({name: list(column) for name, column in zip(names[-3:], zip(*results))})
    return table


def _run_alone(plan: SweepPlan, values: Mapping[str, float]) -> Tuple[Any, Any, Optional[str]]:
    """Return the result of one case, or the reason for its failure."""
    try:
        robot, speed, height, actuation, site, rules = plan.case(values)
        if height is None:
            found = max_step_height(robot, speed, actuation, None, plan.accuracy, site, rules)
            return found.height, found.error, None
        return (*try_step(robot, speed, height, actuation, site=site, rules=rules), None)
    except BallbotError as error:
        return None, None, str(error)


def run_sweep(plan: SweepPlan, out: Path, pool: Executor, workers: int,
              progress: Progress = ignore, block: int = BLOCK_SIZE) -> Finished:
    """
    Run a plan and write a Parquet file, resuming an interrupted run.

    `block` is the number of cases in a block file; `progress` receives the number of finished
    cases.  Raises `ConfigurationError` if pyarrow is missing, a file cannot be written, `out`
    exists and is not the result of a sweep, or the folder next to it belongs to another sweep or
    is in use.
    """
    arrow = load_arrow()
    _refuse_foreign(arrow, out)
    folder = out.with_name(out.name + '.blocks')
    blocks = {}
    for first in range(0, plan.size, block):
        stop = min(first + block, plan.size)
        blocks[f'{first:010d}-{stop:010d}.parquet'] = stop - first, (plan, first, stop)
    schema = _schema(arrow, plan)

    def write(table: Dict[str, List[Any]], path: Path) -> None:
        with replacing(path) as stream:
            arrow.parquet.write_table(arrow.table(table, schema=schema), stream)
    with claimed(folder, plan.digest):
        resumed = checkpointed_map(
            run_block, blocks, folder, pool, workers, write, progress)
        failed, reason = 0, ''
        with replacing(out) as stream, arrow.parquet.ParquetWriter(stream, schema) as writer:
            for name in blocks:
                part = arrow.parquet.read_table(folder / name)
                writer.write_table(part)
                reasons = part['failure'].drop_null()
                failed += len(reasons)
                reason = reason or next(map(str, reasons), '')
        shutil.rmtree(folder)
    return Finished(resumed, failed, reason)


def _refuse_foreign(arrow: Any, out: Path) -> None:
    """Refuse to replace a file that no sweep has written."""
    if not out.exists():
        return
    try:
        ours = METADATA_KEY in (arrow.parquet.read_schema(out).metadata or {})
    except (OSError, arrow.ArrowException):  # a folder, no permission, no Parquet
        ours = False
    if not ours:
        raise ConfigurationError(
            f'{out} exists and is not the result of a sweep; move it away or choose another file '
            'with --out', 'inconsistent', 'out')


def _schema(arrow: Any, plan: SweepPlan) -> Any:
    kinds = {'case': arrow.int64(), 'passes': arrow.bool_(), 'failure': arrow.string()}
    described = {'plan': plan.describe(), 'digest': plan.digest, 'units': columns(plan),
                 'cases': plan.size}
    return arrow.schema(
        [arrow.field(name, kinds.get(name, arrow.float64()),
                     metadata={'unit': unit}) for name, unit in columns(plan).items()],
        metadata={METADATA_KEY: json.dumps(described)})
