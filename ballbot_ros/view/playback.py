# SPDX-License-Identifier: Apache-2.0
"""Where a playback is: a place in time that moves with the clock on the wall."""
from threading import Lock
from time import monotonic
from typing import Callable


class Playback:
    """
    A place in time that goes on at some speed, from a begin to an end that may grow.

    No thread moves it: where it is follows from when it was asked.  For any number of threads.

    Parameters
    ----------
    span : callable
        Returns begin and end [s].
    clock : callable
        Returns seconds.

    """

    def __init__(self, span: Callable[[], tuple[float, float]],
                 clock: Callable[[], float] = monotonic):
        """Play from the begin."""
        self._span, self._clock = span, clock
        self._lock = Lock()
        self._from, self._since = span()[0], clock()
        self._speed, self._paused = 1.0, False

    @property
    def place(self) -> float:
        """Return the time to show [s]."""
        with self._lock:
            return self._place()

    @property
    def speed(self) -> float:
        """Return seconds played per second of the clock."""
        return self._speed

    @property
    def paused(self) -> bool:
        """Return whether it stands, because someone paused it or at the end."""
        with self._lock:
            return self._paused or self._place() >= self._span()[1]

    def pause(self, paused: bool) -> None:
        """Stand or play; at the end, play from the begin again."""
        with self._lock:
            place, (begin, end) = self._place(), self._span()
            self._stand(begin if not paused and place >= end else place)
            self._paused = paused

    def seek(self, place: float) -> None:
        """Stand at a time [s]."""
        with self._lock:
            self._stand(place)
            self._paused = True

    def restart(self) -> None:
        """Go back to the begin; play on, or stand as before."""
        with self._lock:
            self._stand(self._span()[0])

    def set_speed(self, speed: float) -> None:
        """Go on at another speed."""
        with self._lock:
            self._stand(self._place())
            self._speed = speed

    def _place(self) -> float:
        begin, end = self._span()
        gone = 0.0 if self._paused else self._speed * (self._clock() - self._since)
        return min(max(self._from + gone, begin), end)

    def _stand(self, place: float) -> None:
        self._from, self._since = place, self._clock()
