# SPDX-License-Identifier: Apache-2.0
"""
Time of measurement of readings that arrive at a fixed rate without a time stamp.

The sensor sends at even intervals of its own clock; readings arrive delayed by the line, the USB
adapter and the scheduler, never early.  So the send times are a straight line that no arrival lies
below: an earlier arrival moves the line down immediately, a later one moves it up slowly.
"""
import math

# Largest rise of the line per period, in periods: for a sensor clock that is slow.
DRIFT = 0.01
# A delay of more periods than this means lost readings: the line restarts at the arrival.
LOST = 4.0


class ArrivalClock:
    """
    Estimates when each reading was sent.

    Parameters
    ----------
    period : float
        Between two [s].

    """

    def __init__(self, period: float):
        self._period = period
        self.reset()

    def reset(self) -> None:
        """Restart: the next arrival counts as without delay."""
        self._last = -math.inf

    def sent(self, arrival: float) -> float:
        """
        Return when a reading was sent that arrived now [s]; never decreases.

        Arrivals must not decrease.
        """
        expected = self._last + self._period
        late = arrival - expected
        if late > LOST * self._period:
            self._last = arrival
        else:
            self._last = max(expected + min(late, DRIFT * self._period), self._last)
        return self._last
