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
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

import numpy as np

from ballbot_ros.crossing import max_step_height, try_step
from ballbot_ros.crossing.max_step_height import ATTEMPT_TOLERANCE, Crossings
from ballbot_ros.errors import BallbotError, ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.solvers.values import FINISHED
from ballbot_ros.results.files import load_arrow, replacing
from ballbot_ros.studies.parallel_map import checkpointed_map
from ballbot_ros.studies.progress import ignore
from ballbot_ros.studies.sweep_plan import NUMBERS, SweepPlan

BLOCK_SIZE = 1000  # cases in a file
TRIED_COLUMNS = {'passes': '1', 'score': 'm2/s2'}
METADATA_KEY = b'ballbot_sweep'  # key of the provenance in the metadata
SEARCHED_COLUMNS = {'max_height': 'm', 'error': 'm'}
Result = Tuple[Any, Any, Optional[str]]  # values of two result columns, or the failure


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
    crossings, heights, prepared = plan.crossings(rows)
    results: List[Any] = [None] * len(rows)
    if crossings is not None:
        ran = zip(np.flatnonzero(prepared).tolist(), _tried(crossings, heights)
                  if heights is not None else _found(crossings, plan.accuracy))
        for place, result in ran:
            results[place] = result
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


def _tried(crossings: Crossings, heights: Array) -> List[Optional[Result]]:
    """Return whether each ball crosses its step, and the score; None where the run fails."""
    results = crossings.tried(heights, ATTEMPT_TOLERANCE)
    return [(passes > 0.0, score, None) if outcome == FINISHED else None
            for passes, score, outcome in results.tolist()]


def _found(crossings: Crossings, accuracy: float) -> List[Optional[Result]]:
    """Return maximum step heights and their errors [m]; None where the run fails."""
    results = crossings.found(accuracy)
    return [(low, error, None) if outcome == FINISHED else None
            for low, _, error, _, outcome in results.tolist()]


def _run_alone(plan: SweepPlan, values: Mapping[str, float]) -> Result:
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
              progress: Callable[[float], None] = ignore, block: int = BLOCK_SIZE) -> int:
    """
    Run a plan and write a Parquet file, resuming an interrupted run.

    `block` is the number of cases in a block file; `progress` receives the number of finished
    cases.  Returns the number of cases that a previous run had finished.  Raises
    `ConfigurationError` if pyarrow is missing, a file cannot be written, `out` exists and is not
    the result of a sweep, or the folder next to it belongs to another sweep.
    """
    refuse_foreign(out)
    arrow = load_arrow()
    folder = out.with_name(out.name + '.blocks')
    blocks = {}
    for first in range(0, plan.size, block):
        stop = min(first + block, plan.size)
        blocks[f'{first:010d}-{stop:010d}.parquet'] = stop - first, (plan, first, stop)
    found = checkpointed_map(run_block, blocks, folder, plan.digest, pool, workers,
                             lambda table, path: write_parquet(arrow, plan, table, path), progress)
    _join(arrow, plan, [folder / name for name in blocks], out)
    shutil.rmtree(folder)
    return found


def refuse_foreign(out: Path) -> None:
    """Refuse to replace a file that no sweep has written; pyarrow must be installed."""
    arrow = load_arrow()
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


def write_parquet(arrow: Any, plan: SweepPlan, table: Dict[str, List[Any]], path: Path) -> None:
    """Write one block atomically."""
    with replacing(path) as stream:
        arrow.parquet.write_table(arrow.table(table, schema=_schema(arrow, plan)), stream)


def _join(arrow: Any, plan: SweepPlan, parts: List[Path], out: Path) -> None:
    with replacing(out) as stream, \
            arrow.parquet.ParquetWriter(stream, _schema(arrow, plan)) as writer:
        for part in parts:
            writer.write_table(arrow.parquet.read_table(part))
