# SPDX-License-Identifier: Apache-2.0
"""Watchdog and rate monitor; time is passed in."""
from bisect import bisect_left, insort
from collections import deque
import math
from typing import Deque, List, Optional

from ballbot_ros.errors import ConfigurationError, MessageError


def _finite(now: float) -> float:
    """Return `now`; refuse a time that is not finite."""
    if not math.isfinite(now):
        raise MessageError(f'time must be finite, got {now!r}', 'not_finite', 'stamp')
    return now


class Watchdog:
    """
    Expires when a periodic signal has timed out.

    Feed it on arrival of the monitored signal, a command for instance, never from a timer.  It is
    conservative: it is expired before the first feed, and after a backward jump of the clock
    until the next feed.

    Parameters
    ----------
    timeout : float
        Longest time between two feeds [s].

    Raises
    ------
    ConfigurationError
        If the timeout is not a positive number.

    """

    def __init__(self, timeout: float):
        if not (math.isfinite(timeout) and timeout > 0.0):
            raise ConfigurationError(
                f'watchdog timeout must be more than 0 s and finite, got {timeout!r}; '
                '0.25 s suits this robot', 'out_of_range', 'timeout')
        self.timeout = timeout
        self._last: Optional[float] = None

    @property
    def fed(self) -> bool:
        """Return whether it was ever fed: before the first feed, the watchdog is also expired."""
        return self._last is not None

    def feed(self, now: float) -> None:
        """Restart the timeout at `now` [s]; raise `MessageError` if that is not finite."""
        self._last = _finite(now)

    def reset(self) -> None:
        """Return to the state before the first feed."""
        self._last = None

    def silence(self, now: float) -> float:
        """Return the time since the last feed, infinite if there was none [s]."""
        return math.inf if self._last is None else _finite(now) - self._last

    def expired(self, now: float) -> bool:
        """Return whether the timeout has passed at `now` [s], or the clock jumped back."""
        return not 0.0 <= self.silence(now) <= self.timeout


class RateMonitor:
    """
    Measures the rate of a signal: the median period of the last stamps.

    The median ignores a single late message, which is not a slow publisher.

    Parameters
    ----------
    size : int
        Number of stamps kept, at least 2.
    least : int
        Number of stamps needed for a rate, from 2 to `size`: the median of one or two periods
        is not robust.

    Raises
    ------
    ConfigurationError
        If the numbers are out of range.

    """

    def __init__(self, size: int = 21, least: int = 2):
        if not 2 <= least <= size:
            raise ConfigurationError(
                f'a rate needs at least 2 stamps, got size {size!r} and least {least!r}',
                'out_of_range', 'least')
        self._size, self._least = size, least
        self._last: Optional[float] = None
        # In order of arrival, and sorted: each joint state needs the median.
        self._periods: Deque[float] = deque()
        self._sorted: List[float] = []

    def add(self, stamp: float) -> None:
        """
        Add the stamp of an arrival; ignore a repeated one, restart after a backward jump.

        Parameters
        ----------
        stamp : float
            [s]

        Raises
        ------
        MessageError
            If the stamp is not finite.

        """
        last, self._last = self._last, _finite(stamp)
        if last is None or stamp == last:
            return
        if stamp < last:
            self._periods.clear()
            self._sorted.clear()
            return
        self._periods.append(stamp - last)
        insort(self._sorted, stamp - last)
        if len(self._periods) >= self._size:
            del self._sorted[bisect_left(self._sorted, self._periods.popleft())]

    @property
    def period(self) -> Optional[float]:
        """Return the median period [s], None with fewer than `least` stamps."""
        number = len(self._sorted)
        if number + 1 < self._least:
            return None
        return 0.5 * (self._sorted[(number - 1) // 2] + self._sorted[number // 2])

    @property
    def rate(self) -> Optional[float]:
        """Return the median rate [Hz], None with fewer than `least` stamps."""
        period = self.period
        return None if period is None else 1.0 / period
