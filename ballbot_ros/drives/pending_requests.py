# SPDX-License-Identifier: Apache-2.0
"""
Matches replies to requests, so that a time stamp is never later than its measurement.

A drive replies in the order of the requests; some replies are lost, and any may be delayed.  So a
reply answers the oldest pending request of its kind, and requests before that one have lost their
replies.  After a loss stamps are too old by a request, never too new, until a reply to a kind that
was requested once since the loss shows which requests are complete.  Drivers send such requests in
turn, each at most once in `LONGEST_LATENCY`.  A longer interruption ends in a stop, and without
power requests are dropped: see `may_send`.

Where replies name their request (VESC), each request is a separate kind.
"""
from collections import deque
import math
from typing import Any, NamedTuple, Optional

LARGEST_NUMBER = 1000  # of pending requests
# Requests are dropped when no reply has arrived for this time: longer than the bridge waits
# before it stops the motor [s].
LONGEST_LATENCY = 0.11
# After a longer write the time at which its bytes were sent is unknown [s].
LONGEST_WRITE = 0.001


class PendingRequest(NamedTuple):
    """A request, with the earliest and the latest time at which its bytes were sent [s]."""

    kind: object
    sent: float
    written: float


class Match(NamedTuple):
    """
    The request that a reply answers.

    Attributes
    ----------
    sent : float
        Earliest time at which it was sent [s]; minus infinity for a reply to no request.
    measured : float or None
        The same as the time of the measurement in the reply [s]; None if it is not known, or the
        reply counts as lost.

    """

    sent: float = -math.inf
    measured: Optional[float] = None


class PendingRequests:
    """
    The requests that have no reply yet, oldest first.

    Parameters
    ----------
    timeout : float
        After which a reply counts as lost [s].
    named : bool
        Whether each request is a separate kind.

    """

    def __init__(self, timeout: float, named: bool = False):
        self._timeout, self._named = timeout, named
        self._replied = -math.inf  # when the last reply arrived [s]
        self._queue: deque[PendingRequest] = deque(maxlen=LARGEST_NUMBER)
        self._unsent: list[object] = []
        self._overdue = 0  # requests at the front of the queue that are counted as lost
        self._lost = 0

    def __bool__(self) -> bool:
        return bool(self._queue or self._unsent)

    @property
    def kinds(self) -> set[Any]:
        """Return the kinds of the pending requests."""
        return {request.kind for request in self._queue}.union(self._unsent)

    def may_send(self, now: float) -> bool:
        """
        Return whether further requests may be sent to a motor without power.

        Not while a reply is overdue: first all pending replies must arrive or, if none arrives
        any more, be dropped.
        """
        if self._named or not self._queue or now - self._queue[0].sent <= self._timeout:
            return True
        if now - max(self._queue[-1].written, self._replied) <= LONGEST_LATENCY:
            return False
        self.clear()
        return True

    def add(self, kind: object) -> None:
        """Add a request whose bytes are written next."""
        self._unsent.append(kind)

    def written(self, before: float, after: float) -> None:
        """Stamp the added requests with the start and the end of their write [s]."""
        self._queue.extend(PendingRequest(kind, before, after) for kind in self._unsent)
        self._unsent.clear()

    def clear(self) -> None:
        """Drop all requests."""
        self._drop(len(self._queue))
        self._unsent.clear()

    def match(self, kind: object, now: float) -> Match:
        """Take a reply to a request of a kind, read at a time [s], and return the request."""
        for index, request in enumerate(self._queue):
            if request.kind == kind:
                self._drop(index)
                self._queue.popleft()
                self._overdue = max(0, self._overdue - 1)
                self._replied = now
                known = request.written - request.sent <= LONGEST_WRITE \
                    and now - request.sent <= self._timeout
                return Match(request.sent, request.sent if known else None)
        return Match()

    def take_lost(self, now: float) -> int:
        """Return how many replies were lost since the last call."""
        while self._overdue < len(self._queue) \
                and self._queue[self._overdue].sent < now - self._timeout:
            self._overdue += 1
            self._lost += 1
        while self._named and self._queue and self._queue[0].sent < now - LONGEST_LATENCY:
            self._drop(1)
        lost, self._lost = self._lost, 0
        return lost

    def _drop(self, number: int) -> None:
        """Remove requests at the front; those not yet counted as lost are now."""
        self._lost += max(0, number - self._overdue)
        self._overdue = max(0, self._overdue - number)
        for _ in range(number):
            self._queue.popleft()
