# SPDX-License-Identifier: Apache-2.0
"""Which question a reply answers, though some replies get lost and some are read late."""
from collections import deque
import math
from typing import Any, NamedTuple, Optional

# Questions that may be under way.
MOST = 1000
# A write that takes longer than this was held up, and nobody knows when the bytes left [s].
HELD_UP = 0.001
# A question younger than this part of the usual time has not been answered yet.
LEAST = 0.5
# The usual time follows each answer by this factor, up or down: it becomes the median.
FOLLOW = 1.1


class Question(NamedTuple):
    """What was asked, and when its bytes left at the earliest and at the latest [s]."""

    request: object
    sent: float
    written: float


class Asked(NamedTuple):
    """
    When that was asked which a reply answers.

    Attributes
    ----------
    asked : float
        The question is not older than this [s]: safety rests on it.  Minus infinity where
        nobody asked.
    measured : float or None
        When the question was sent, as far as can be told: measurements are stamped with it [s].

    """

    asked: float = -math.inf
    measured: Optional[float] = None


class Questions:
    """
    The questions under way to a drive whose replies do not say what they answer.

    Replies come in the order of their questions, but some never come, so the oldest question is
    the earliest that a reply can answer, and only that.  Likely it answers the newest one that
    has had time to be answered; of replies that are read together, as after the process was
    held up, the last one answers that, and those before it the ones before.

    Parameters
    ----------
    timeout : float
        After which an answer counts as lost [s].

    Attributes
    ----------
    usual : float
        Median time from a question to its answer [s]; 0 before there was one.

    """

    def __init__(self, timeout: float):
        """Start with none."""
        self._timeout = timeout
        self._queue: deque[Question] = deque(maxlen=MOST)
        self._unsent: list[object] = []
        self._claimed = -math.inf  # the newest question that a reply was likely an answer to
        self._lost = 0
        self.usual = 0.0

    def __bool__(self) -> bool:
        """Return whether an answer is to come."""
        return bool(self._queue or self._unsent)

    @property
    def requests(self) -> set[Any]:
        """Return what answers are to come to."""
        return {question.request for question in self._queue}.union(self._unsent)

    def ask(self, request: object) -> None:
        """Take note of a question whose bytes are written next."""
        self._unsent.append(request)

    def written(self, before: float, after: float) -> None:
        """Take note of when a write began and ended that held all that was asked since [s]."""
        for request in self._unsent:
            self._queue.append(Question(request, before, after))
        self._unsent.clear()

    def clear(self) -> None:
        """Expect no answer any more; those that are to come count as lost."""
        self._lost += len(self._queue)
        self._queue.clear()
        self._unsent.clear()

    def answered(self, request: object, now: float, alike: int = 1) -> Asked:
        """
        Take a reply.

        Parameters
        ----------
        request : object
            What it answers.
        now : float
            When it was read [s].
        alike : int
            Replies to such requests that were read together with it, and not taken yet; it is
            one of them.

        """
        open_ones = [question for question in self._queue
                     if question.request == request and question.sent > self._claimed]
        while self._queue and self._queue[0].request != request:
            self._queue.popleft()
            self._lost += 1
        if not self._queue:
            return Asked()
        oldest = self._queue.popleft()
        if not open_ones:  # none was lost: a reply that was late was taken for the next one
            return Asked(oldest.sent, self._claimed)
        had_time = sum(now - question.sent >= LEAST * self.usual for question in open_ones)
        likely = open_ones[max(0, had_time - alike)]
        self._claimed = likely.sent
        if len(open_ones) == alike == 1:
            self._learn(now - likely.sent)
        known = likely.written - likely.sent <= HELD_UP
        return Asked(oldest.sent, likely.sent if known else None)

    def take_lost(self, now: float) -> int:
        """Give up what is overdue; return how many were lost since this was last called."""
        while self._queue and self._queue[0].sent < now - self._timeout:
            self._queue.popleft()
            self._lost += 1
        lost, self._lost = self._lost, 0
        return lost

    def _learn(self, age: float) -> None:
        """Let the usual time follow one answer."""
        if not self.usual:
            self.usual = age
        elif age != self.usual:
            self.usual *= FOLLOW if age > self.usual else 1.0 / FOLLOW
