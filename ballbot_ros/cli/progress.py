# SPDX-License-Identifier: Apache-2.0
"""Tell how far a long run has got."""
from contextlib import contextmanager
import sys
from time import perf_counter
from typing import Any, Callable, Iterator, Optional

# A run shorter than this needs no progress [s].
PATIENCE = 0.5


class _Progress:
    """A bar on a terminal, one line elsewhere, nothing for a short run."""

    def __init__(self, duration: float):
        """Start the clock."""
        self.duration = duration
        self.begin = perf_counter()
        self.bar: Any = None
        self.told = False

    def __call__(self, done: float) -> None:
        """Take note of the simulated time [s]."""
        if self.bar is not None:
            self.bar.update(0, completed=min(done, self.duration))
        elif not self.told and perf_counter() - self.begin > PATIENCE:
            self.told = True
            if sys.stderr.isatty():
                self._start()
            else:
                print(f'simulating {self.duration:g} s; Ctrl-C ends it and keeps what there is',
                      file=sys.stderr, flush=True)

    def _start(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
        self.bar = Progress(
            TextColumn('simulating'), BarColumn(),
            TextColumn('{task.completed:.4g} of {task.total:.4g} s'), TimeRemainingColumn(),
            console=Console(stderr=True), transient=True)
        self.bar.add_task('', total=self.duration)
        self.bar.start()


@contextmanager
def watched(duration: float, silent: bool) -> Iterator[Optional[Callable[[float], None]]]:
    """
    Give a callback that shows the progress of a run on standard error.

    Parameters
    ----------
    duration : float
        Simulated time of the whole run [s].
    silent : bool
        Show nothing and give None.

    """
    progress = None if silent else _Progress(duration)
    try:
        yield progress
    finally:
        if progress is not None and progress.bar is not None:
            progress.bar.stop()
