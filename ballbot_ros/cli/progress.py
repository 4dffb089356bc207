# SPDX-License-Identifier: Apache-2.0
"""Progress of a long run on standard error."""
from contextlib import contextmanager
import sys
from time import perf_counter
from typing import Any, Callable, Iterator, Optional

from ballbot_ros.studies.progress import ignore

# Time without a progress bar [s].
QUIET_TIME = 0.5


class _Progress:
    """A bar on a terminal, one line elsewhere, nothing for a short run."""

    def __init__(self, total: float, doing: str, unit: str, keeps: bool):
        self.total, self.doing, self.unit = total, doing, unit
        self.ending = 'ends it and keeps the part so far' if keeps else 'ends it'
        self.begin = perf_counter()
        self.bar: Any = None
        self.shown = False

    def __call__(self, done: float) -> None:
        """Show the progress towards the total."""
        if self.bar is not None:
            self.bar.update(0, completed=min(done, self.total))
        elif not self.shown and perf_counter() - self.begin > QUIET_TIME:
            self.shown = True
            if sys.stderr.isatty():
                self._start()
            else:
                print(f'{self.doing} {self.total:g} {self.unit}; Ctrl-C {self.ending}',
                      file=sys.stderr, flush=True)

    def _start(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
        self.bar = Progress(
            TextColumn(self.doing), BarColumn(),
            TextColumn(f'{{task.completed:.4g}} of {{task.total:.4g}} {self.unit}'),
            TimeRemainingColumn(), console=Console(stderr=True), transient=True)
        self.bar.add_task('', total=self.total)
        self.bar.start()


@contextmanager
def compilation_shown() -> Iterator[None]:
    """Show on a terminal that kernels are being compiled, how many so far and for how long."""
    if not sys.stderr.isatty():
        yield
        return
    from ballbot_ros.compile_notice import on_compiling
    bar = _CompileBar()
    on_compiling(bar.update)
    try:
        yield
    finally:
        on_compiling(None)
        bar.update(0, False)


class _CompileBar:
    def __init__(self) -> None:
        self._begin: Optional[float] = None
        self._bar: Any = None

    def update(self, done: int, more: bool) -> None:
        """Show the number of kernels compiled so far; hide the bar when there are no more."""
        now = perf_counter()
        if not more:
            if self._bar is not None:
                self._bar.stop()
            self._begin = self._bar = None
        elif self._begin is None:
            self._begin = now
        elif self._bar is not None:
            self._bar.update(0, completed=done)
        elif now - self._begin > QUIET_TIME:
            self._start(done)

    def _start(self, done: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
        # How many a command calls is known only at the end, hence a bar without a total.
        self._bar = Progress(
            TextColumn('compiling for this machine, the first time only'), BarColumn(),
            TextColumn('{task.completed:.0f} kernels'), TimeElapsedColumn(),
            console=Console(stderr=True), transient=True)
        self._bar.add_task('', total=None, completed=done)
        self._bar.start()


@contextmanager
def watched(total: float, silent: bool, doing: str = 'simulating',
            unit: str = 's', keeps: bool = True) -> Iterator[Callable[[float], None]]:
    """
    Yield a callback that shows the progress of a task on standard error.

    Parameters
    ----------
    total : float
        Simulated time of a run [s], or the number of units.
    silent : bool
        Show nothing.
    doing, unit : str
        Name of the task, and unit of `total`.
    keeps : bool
        Ctrl-C keeps the part so far.

    """
    if silent:
        yield ignore
        return
    progress = _Progress(total, doing, unit, keeps)
    try:
        yield progress
    finally:
        if progress.bar is not None:
            progress.bar.stop()
