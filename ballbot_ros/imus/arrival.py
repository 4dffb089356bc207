# SPDX-License-Identifier: Apache-2.0
"""
When something was measured that comes at a rate and carries no time.

It was sent at even intervals of a clock that nobody reads, and arrives late by what the line, the
USB adapter and other programs take, never early.  So the moments are a straight line that no
arrival lies below: the line goes down to each that does, at once, and up by a little.
"""
import math

# By so much of a period the line may go up in a period: a clock that is slower than believed.
DRIFT = 0.01
# So many periods late in a row, and something was lost: the line begins anew.
LOST = 4.0


class ArrivalClock:
    """
    Gives each arrival the moment that it was sent at.

    Parameters
    ----------
    period : float
        Between two [s].

    """

    def __init__(self, period: float):
        """Start with nothing received."""
        self._period = period
        self.reset()

    def reset(self) -> None:
        """Begin anew: the next arrival counts as in time."""
        self._last = -math.inf

    def sent(self, arrival: float) -> float:
        """
        Return when something was sent that arrived now [s]; never earlier than the one before.

        Arrivals are not older than those before.
        """
        expected = self._last + self._period
        late = arrival - expected
        if late > LOST * self._period:
            self._last = arrival
        else:
            self._last = max(expected + min(late, DRIFT * self._period), self._last)
        return self._last
