# SPDX-License-Identifier: Apache-2.0
"""Show how far a long run has got."""
from contextlib import contextmanager
import sys
from time import perf_counter
from typing import Any, Callable, Iterator

from ballbot_ros.studies.progress import ignore

# A run shorter than this needs no progress [s].
PATIENCE = 0.5


class _Progress:
    """A bar on a terminal, one line elsewhere, nothing for a short run."""

    def __init__(self, total: float, doing: str, unit: str, keeps: bool):
        """Keep what is counted, and the time."""
        self.total, self.doing, self.unit = total, doing, unit
        self.ending = 'ends it and keeps what there is' if keeps else 'ends it'
        self.begin = perf_counter()
        self.bar: Any = None
        self.shown = False

    def __call__(self, done: float) -> None:
        """Show how much is done, of the total."""
        if self.bar is not None:
            self.bar.update(0, completed=min(done, self.total))
        elif not self.shown and perf_counter() - self.begin > PATIENCE:
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
def watched(total: float, silent: bool, doing: str = 'simulating',
            unit: str = 's', keeps: bool = True) -> Iterator[Callable[[float], None]]:
    """
    Give a callback that shows on standard error how far something has got.

    Parameters
    ----------
    total : float
        All that is to be done: of a run, its simulated time [s].
    silent : bool
        Show nothing.
    doing, unit : str
        What is done, and what `total` counts.
    keeps : bool
        What is done by then survives Ctrl-C.

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
