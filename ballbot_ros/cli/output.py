# SPDX-License-Identifier: Apache-2.0
"""Output of the verbs: JSON, tables, figures, folders, files, and progress on standard error."""
from contextlib import contextmanager, suppress
import json
from pathlib import Path
import sys
from time import perf_counter
from typing import Any, Callable, Iterable, Iterator, Optional, Sequence

from ballbot_ros.cli.verb import note
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.studies.progress import ignore

OUTPUT = Path('ballbot_output')  # folder of the results if no other is given


def print_json(content: Any) -> None:
    """Print values as JSON, without NaN."""
    json.dump(content, sys.stdout, indent=2, allow_nan=False)
    print()


def save_figure(figure: Any, folder: Path, name: str, kind: str = 'both') -> list[str]:
    """Write a figure as SVG, PNG or both, and return the names of the files."""
    from ballbot_ros.figures.canvas import save
    names = figure_files([name], kind)
    for file in names:
        save(figure, folder / file)
    return names


_claimed: list[Path] = []


def result_folder(given: Optional[Path], default: str, names: Sequence[str],
                  overwrite: bool) -> Path:
    """
    Return a folder without results for the files of a verb: the given one, else one in `OUTPUT`.

    The latter is named `default`, with ``_2``, ``_3``, ... while it contains one of the files,
    unless these are to be overwritten.  The folder is created, so that no other process chooses
    it; see `empty_folders_removed`.  Missing parents of a given folder are reported.  Raises
    `ConfigurationError` if the given folder contains results, or cannot be written.
    """
    from ballbot_ros.results.files import check_writable

    def results_in(folder: Path) -> list[str]:
        return [name for name in names if (folder / name).exists()]

    def claim(folder: Path) -> bool:
        check_writable(folder / names[0])
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        try:
            folder.mkdir(parents=True)
        except FileExistsError:  # an empty one belongs to another run that has just started
            return any(folder.iterdir()) and not results_in(folder)
        _claimed.extend(missing)
        return True

    folder = OUTPUT / default if given is None else given
    if given is not None:
        report_new_folders(folder)
    number = 1
    while not claim(folder) and given is None and not overwrite:
        number += 1
        folder = OUTPUT / f'{default}_{number}'
    if results_in(folder) and not overwrite:
        raise ConfigurationError(
            f'{folder} contains results ({", ".join(results_in(folder)[:3])}); add --overwrite to '
            'replace them, or choose another folder with --out', 'exists', '--out')
    return folder


@contextmanager
def empty_folders_removed() -> Iterator[None]:
    """Remove the created folders that are empty at the end."""
    try:
        yield
    finally:
        for folder in sorted(_claimed, reverse=True):
            with suppress(OSError):
                folder.rmdir()
        _claimed.clear()


def report_new_folders(path: Path) -> None:
    """Report on standard error that folders above a path do not exist and will be created."""
    missing = [folder for folder in path.absolute().parents if not folder.exists()]
    if missing:
        note(f'Note: {path.parent} does not exist and will be created')


def check_new_file(path: Path, overwrite: bool, option: str = '--out',
                   endings: Sequence[str] = ()) -> None:
    """
    Refuse a file that cannot be written, or that exists and is not to be replaced.

    A missing folder is reported.  `endings` are the allowed extensions; any if empty.
    """
    from ballbot_ros.results.files import check_writable
    if endings and path.suffix.lower() not in endings:
        raise ConfigurationError(
            f'{option} must end in {" or ".join(endings)}, got {str(path)!r}', 'not_a_choice',
            option)
    check_writable(path)
    if path.exists() and not overwrite:
        raise ConfigurationError(
            f'{path} exists; add --overwrite to replace it, or choose another {option}', 'exists',
            option)
    report_new_folders(path)


def figure_files(names: Iterable[str], kind: str = 'both') -> list[str]:
    """Return the file names of figures; see `save_figure`."""
    from ballbot_ros.figures.canvas import FORMATS
    return [f'{name}.{ending}' for name in names
            for ending in (FORMATS if kind == 'both' else (kind,))]


YAML = ('.yaml', '.yml')


@contextmanager
def resumable(place: Path) -> Iterator[None]:
    """Add to the error of Ctrl-C the path from which the same command resumes."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f'the same command resumes from {place}') from None


# Delay before a progress bar appears [s].
QUIET_TIME = 0.5


class _Bar:
    """A bar on a terminal, elsewhere `line` unless empty; no output for a short task."""

    def __init__(self, doing: str, total: Optional[float], amount: str, line: str = ''):
        self._doing, self._total, self._amount, self._line = doing, total, amount, line
        self._start_time = perf_counter()
        self._bar: Any = None

    def __call__(self, done: float) -> None:
        if self._bar is not None:
            self._bar.update(0, completed=done)
        elif perf_counter() - self._start_time > QUIET_TIME:
            if sys.stderr.isatty():
                self._start(done)
            elif self._line:
                note(self._line)
                self._line = ''

    def _start(self, done: float) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn)
        self._bar = Progress(
            TextColumn(self._doing), BarColumn(), TextColumn(self._amount),
            TimeElapsedColumn() if self._total is None else TimeRemainingColumn(),
            console=Console(stderr=True), transient=True)
        self._bar.add_task('', total=self._total, completed=done)
        self._bar.start()

    def stop(self) -> None:
        if self._bar is not None:
            self._bar.stop()


@contextmanager
def compilation_shown() -> Iterator[None]:
    """Show on a terminal the number of kernels compiled so far, and the elapsed time."""
    if not sys.stderr.isatty():
        yield
        return
    from ballbot_ros.compile_notice import on_compiling
    bars: list[_Bar] = []  # of the present compilation, if any

    def show(done: int, more: bool) -> None:
        if more:
            if not bars:  # the total number of kernels is known only at the end
                bars.append(_Bar('compiling for this machine, the first time only', None,
                                 '{task.completed:.0f} kernels'))
            bars[0](done)
        elif bars:
            bars.pop().stop()

    on_compiling(show)
    try:
        yield
    finally:
        on_compiling(None)
        show(0, False)


@contextmanager
def watched(total: float, silent: bool, doing: str = 'simulating',
            unit: str = 's', keeps: bool = True) -> Iterator[Callable[[float], None]]:
    """
    Yield a callback that shows the progress of a task on standard error, unless `silent`.

    `total` is in `unit`: simulated time of a run [s], or a count; with `keeps`, the message states
    that Ctrl-C keeps the results so far.
    """
    if silent:
        yield ignore
        return
    ending = 'ends it and keeps the results so far' if keeps else 'ends it'
    bar = _Bar(doing, total, f'{{task.completed:.4g}} of {{task.total:.4g}} {unit}',
               f'{doing} {total:g} {unit}; Ctrl-C {ending}')
    try:
        yield bar
    finally:
        bar.stop()
