# SPDX-License-Identifier: Apache-2.0
"""Time that waits: how many periods may run, and for whose answer they wait."""
from typing import Optional

from rclpy.task import Future


class Allowance:
    """
    How many control periods may still run: none (paused), some (stepping) or no end.

    Parameters
    ----------
    paused : bool

    """

    def __init__(self, paused: bool):
        """Start running or paused."""
        self._left: Optional[int] = 0 if paused else None
        self._done: Optional[Future] = None

    @property
    def running(self) -> bool:
        """Tell whether a period may run now."""
        return self._left is None or self._left > 0

    @property
    def paused(self) -> bool:
        """Tell whether time stands still until told otherwise."""
        return self._left == 0

    def pause(self) -> None:
        """Run no more."""
        self._end(False)
        self._left = 0

    def resume(self) -> None:
        """Run without end."""
        self._end(False)
        self._left = None

    def step(self, periods: int) -> Future:
        """Run so many periods, then pause; the future holds whether all were run."""
        self._end(False)
        self._left = periods
        self._done = Future()
        return self._done

    def spend(self) -> None:
        """Note that a period has run."""
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                self._end(True)

    def _end(self, complete: bool) -> None:
        if self._done is not None:
            self._done.set_result(complete)
            self._done = None
