# SPDX-License-Identifier: Apache-2.0
"""Pause, resume and step: how many control periods a simulation may still run."""
from typing import Optional

from rclpy.task import Future


class RunControl:
    """
    Paused, stepping through so many control periods, or running without end.

    Parameters
    ----------
    paused : bool

    """

    def __init__(self, paused: bool):
        """Start paused or running."""
        self._left: Optional[int] = 0 if paused else None
        self._done: Optional[Future] = None

    @property
    def running(self) -> bool:
        """Return whether a period may run now."""
        return self._left is None or self._left > 0

    @property
    def paused(self) -> bool:
        """Return whether no period may run until `resume` or `step`."""
        return self._left == 0

    def pause(self) -> None:
        """Let no period run."""
        self._end(False)
        self._left = 0

    def resume(self) -> None:
        """Let periods run without end."""
        self._end(False)
        self._left = None

    def step(self, periods: int) -> Future:
        """Let so many periods run, then pause; the future holds whether all were run."""
        self._end(False)
        self._left = periods
        self._done = Future()
        return self._done

    def count_period(self) -> None:
        """Count a period that has run."""
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                self._end(True)

    def _end(self, complete: bool) -> None:
        if self._done is not None:
            self._done.set_result(complete)
            self._done = None
