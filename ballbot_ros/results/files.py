# SPDX-License-Identifier: Apache-2.0
"""
Files of trajectories, without loss of precision.

Files are written atomically: to a temporary name in the same folder, then renamed.
"""
from contextlib import contextmanager
import csv
import json
import os
from pathlib import Path
import re
from tempfile import TemporaryFile
from typing import Any, BinaryIO, Iterator, Mapping, Union
import zipfile

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.config.fields import comma_hint
from ballbot_ros.config.optional import load_optional
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array
from ballbot_ros.physics.simulation.trajectory import Trajectory, UNITS
from ballbot_ros.results.units import in_si, SI

PathLike = Union[str, Path]

# Rows converted to text at a time, which bounds the memory of a long run.
_BLOCK = 20000

_HEADER = re.compile(r'^(?P<name>\w+) \[(?P<unit>[^\]]*)\]$')


@contextmanager
def replacing(path: PathLike) -> Iterator[BinaryIO]:
    """
    Yield a file that replaces `path` once it is complete.

    Folders are created as needed.  An interruption, such as Ctrl-C or a power failure, leaves an
    older file unchanged.  Raises `ConfigurationError` if the file cannot be written.
    """
    target = Path(path)
    draft = target.with_name(f'.{target.name}.{os.getpid()}.part')
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            with open(draft, 'wb') as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f'{target}: cannot be written: {error.strerror or error}; choose another folder or '
            'free disk space', 'not_writable', str(path)) from error


def check_writable(path: PathLike) -> None:
    """
    Refuse a file that cannot be written, before the computation of its content.

    No file or folder is created.  Raises `ConfigurationError` with the cause.
    """
    target = Path(path).absolute()
    try:
        folder = next(parent for parent in target.parents if parent.exists())
        problem = ('it is a folder' if target.is_dir()
                   else f'{folder} is not a folder' if not folder.is_dir() else '')
        if not problem:
            TemporaryFile(dir=folder).close()  # permissions miss /proc and full disks
    except OSError as error:
        problem = str(error.strerror)
    if problem:
        raise ConfigurationError(
            f'{path}: cannot be written: {problem}; use another path', 'not_writable', str(path))


def write_text(text: str, path: PathLike) -> None:
    """Write a text file atomically; see `replacing`."""
    with replacing(path) as stream:
        stream.write(text.encode('utf-8'))


def write_json(content: Any, path: PathLike) -> None:
    """Write JSON values, without NaN, as a text file; see `replacing`."""
    write_text(json.dumps(content, indent=2, allow_nan=False) + '\n', path)


def load_arrow() -> Any:
    """Return pyarrow with its module parquet; raise `ConfigurationError` if not installed."""
    load_optional('pyarrow.parquet', 'pyarrow', 'pip install pyarrow', 'a Parquet file')
    import pyarrow
    return pyarrow


def write_trajectory(trajectory: Trajectory, path: PathLike) -> None:
    """
    Write a trajectory in the format of the file name extension, with units and all digits.

    ``.csv``: the first row names the columns with their units, ``x [m]``.  ``.npz``: compressed
    numpy arrays, one per column, and an array ``units`` with a row of name and unit for each.
    ``.parquet``: each column has its unit in its metadata.

    Raises `ConfigurationError` if the extension is unknown, pyarrow is not installed (Parquet), or
    the file cannot be written.
    """
    writers = {'.csv': _write_csv, '.npz': _write_npz, '.parquet': _write_parquet}
    ending = Path(path).suffix
    if ending not in writers:
        raise ConfigurationError(
            f'{path}: a trajectory is written to a file ending in {", ".join(writers)}, '
            f'got {ending!r}', 'not_a_choice', 'path')
    writers[ending](trajectory.columns, path)


def _write_csv(columns: Mapping[str, Array], path: PathLike) -> None:
    write_columns(columns, UNITS, path)


def _write_npz(columns: Mapping[str, Array], path: PathLike) -> None:
    arrays: dict[str, Any] = {
        'units': np.array([[name, UNITS[name]] for name in columns]), **columns}
    with replacing(path) as stream:
        np.savez_compressed(stream, **arrays)


def _write_parquet(columns: Mapping[str, Array], path: PathLike) -> None:
    pyarrow = load_arrow()
    table = pyarrow.table(
        [pyarrow.array(values) for values in columns.values()], schema=pyarrow.schema(
            [pyarrow.field(name, pyarrow.float64(), metadata={'unit': UNITS[name]})
             for name in columns]))
    with replacing(path) as stream:
        pyarrow.parquet.write_table(table, stream)


def write_columns(columns: Mapping[str, NDArray[Any]], units: Mapping[str, str],
                  path: PathLike) -> None:
    """Write columns of equal length, numbers or words, as CSV; see `write_trajectory`."""
    length = len(next(iter(columns.values())))
    with replacing(path) as stream:
        header = ','.join(f'{name} [{units[name]}]' for name in columns)
        stream.write(f'{header}\n'.encode())
        for start in range(0, length, _BLOCK):
            block = zip(*(values[start:start + _BLOCK].tolist() for values in columns.values()))
            # str of a float is the shortest text that round-trips.
            text = ''.join(f'{",".join(map(str, row))}\n' for row in block)
            stream.write(text.encode())


def read_columns(path: PathLike) -> dict[str, Array]:
    """
    Return the columns of a file from `write_trajectory`, by name, in SI units.

    Columns of a trajectory may be in other units, such as ``x [mm]``; see `results.units`.  Raises
    `ConfigurationError` if the file cannot be read or is not of this kind, or the unit of a column
    does not fit.
    """
    columns, units = _read(Path(path))
    try:
        return {name: in_si(name, values, units[name]) for name, values in columns.items()}
    except ConfigurationError as error:
        raise error.at(str(path)) from error


def read_units(path: PathLike) -> dict[str, str]:
    """Return the units of the columns that `read_columns` returns; raises as it does."""
    return {name: SI.get(name, unit) for name, unit in _read(Path(path))[1].items()}


def _read(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    ending = path.suffix.lower()
    if ending not in READERS:
        raise ConfigurationError(
            f'{path}: a trajectory is kept in a file ending in .csv, .npz or .parquet, '
            f'got {path.suffix!r}', 'not_a_choice', 'path')
    try:
        columns, units = READERS[ending](path)
        samples = next(iter(columns.values()), np.empty(0)).size
        for name, values in columns.items():
            if values.shape != (samples,):
                raise ConfigurationError(
                    f'column {name!r} has the shape {values.shape}; each must have one number '
                    f'for each of {samples} samples', 'unreadable', name)
        return columns, units
    except OSError as error:
        raise ConfigurationError(
            f'{path}: cannot be read: {error.strerror or error}', 'unreadable', 'path') from error
    except ConfigurationError as error:
        raise error.at(str(path)) from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f'{path}: is not UTF-8 text; export it in this encoding', 'unreadable',
            'path') from error
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigurationError(
            f'{path}: is not a trajectory: {error}', 'unreadable', 'path') from error


def _read_csv(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """Return columns and units; the errors name line and column."""
    with open(path, encoding='utf-8-sig', newline='') as stream:
        rows = csv.reader(stream)
        titles = next(rows, [])
        units = {}
        for title in titles:
            match = _HEADER.match(title.strip())
            if match is None:
                used = 'semicolons' if ';' in title else 'tabs' if '\t' in title else ''
                raise ConfigurationError(
                    'line 1: ' + (f'{used} separate the columns; export the file with commas '
                                  'between the columns and decimal points' if used else
                                  f'column {title!r} has no name with a unit, such as "x [m]"'),
                    'unreadable', title)
            if match['name'] in units:
                raise ConfigurationError(
                    f'line 1: two columns have the name {match["name"]!r}; rename one',
                    'unreadable', title)
            units[match['name']] = match['unit']
        if not units:
            raise ConfigurationError('line 1: no columns', 'unreadable', 'line 1')
        table = [_numbers(row, titles, rows.line_num) for row in rows if row]
    if not table:
        raise ConfigurationError(
            'no rows of numbers below the names of the columns', 'unreadable', 'line 2')
    return dict(zip(units, np.array(table).T)), units


def _numbers(row: list[str], titles: list[str], line: int) -> list[float]:
    if len(row) != len(titles):
        hint = ': decimal commas? Write decimal points' if len(row) == 2 * len(titles) else ''
        raise ConfigurationError(
            f'line {line} has {len(row)} values, line 1 names {len(titles)} columns{hint}',
            'unreadable', f'line {line}')
    numbers = []
    for title, word in zip(titles, row):
        try:
            numbers.append(float(word))
        except ValueError:
            raise ConfigurationError(
                f'line {line}, column "{title}": {word!r} is not a number{comma_hint(word)}',
                'unreadable', title) from None
    return numbers


def _read_npz(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    # np.load alone also accepts the file of a single array, without its units.
    with zipfile.ZipFile(path), np.load(path, allow_pickle=False) as archive:
        units = {str(name): str(unit) for name, unit in archive['units']}
        return {name: np.asarray(archive[name], dtype=float) for name in units}, units


def _read_parquet(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    table = load_arrow().parquet.read_table(path)
    units = {field.name: (field.metadata or {}).get(b'unit', b'').decode()
             for field in table.schema}
    if '' in units.values():
        missing = [name for name, unit in units.items() if not unit]
        raise ValueError(f'column {missing[0]!r} has no unit in its metadata')
    return {name: np.array(table[name], dtype=float) for name in units}, units


READERS = {'.csv': _read_csv, '.npz': _read_npz, '.parquet': _read_parquet}
