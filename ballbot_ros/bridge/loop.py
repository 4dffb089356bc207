# SPDX-License-Identifier: Apache-2.0
"""The control loop in its own thread: if others block, it continues or stops the motor."""
import math
import threading
from time import sleep
from typing import Callable, Optional

from ballbot_ros.bridge.observer import Level
from ballbot_ros.bridge.realtime import NAME, PAGE, Scheduling
from ballbot_ros.bridge.session import Report, Session
from ballbot_ros.estimation import Estimate

# Timeout of the join [s]; a handshake may be in progress.
JOIN_TIMEOUT = 3.0
# Larger fractions of missed periods are reported.
MISSED_MAX = 0.01
# Longest time between two checks for the end of the loop [s].
LONGEST_SLEEP = 0.02


class Loop:
    """
    Calls `Session.tick` at a rate [Hz], and closes the session at every exit.

    The thread enters the prepared scheduling, and calls each of `publish` with each `Report`, in
    this order.  `late` is the number of missed periods, `failure` the error that ended the loop,
    or None.
    """

    def __init__(self, session: Session, rate: float, *publish: Callable[[Report], None],
                 scheduling: Scheduling = Scheduling()):
        self._session, self._publish, self._scheduling = session, publish, scheduling
        self._period, self.late = 1.0 / rate, 0
        self._checked = (session.clock(), 0)  # at the last call of `delayed`
        self._ending = False
        self.failure: Optional[Exception] = None
        self._thread = threading.Thread(target=self._run, name=NAME, daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Return whether the thread is alive."""
        return self._thread.is_alive()

    def delayed(self) -> str:
        """Return a warning if periods were missed since the last call; else an empty string."""
        now, late = self._session.clock(), self.late
        (then, before), self._checked = self._checked, (now, late)
        missed, periods = late - before, (now - then) / self._period
        if missed <= MISSED_MAX * periods:
            return ''
        return (f'the machine delays the loop, {missed} of {periods:.0f} periods were missed; it '
                f'runs {self._scheduling.in_words}: {PAGE}')

    def end(self) -> None:
        """Stop the motor, close the link and end the thread; a second call has no effect."""
        self._ending = True
        self._thread.join(JOIN_TIMEOUT)
        self._session.close()

    def _report(self, estimate: Optional[Estimate]) -> None:
        report = self._session.report(estimate)
        if report is not None:
            for publish in self._publish:
                publish(report)

    def _run(self) -> None:
        clock = self._session.clock
        try:
            self._scheduling.enter()
            due = clock()
            while True:
                late, estimate = self._session.tick(), None
                due, now = due + self._period, clock()
                if due < now:  # missed periods are not made up for
                    self.late += math.ceil((now - due) / self._period)
                    due = now
                if late is not None:
                    self._report(late)
                while self._session.expecting and clock() < due:
                    estimate = self._session.await_answer(due - clock()) or estimate
                if estimate is not None or late is None:
                    self._report(estimate)
                # A plain sleep takes half the CPU time of waiting for an event.
                while not self._ending and (left := due - clock()) > 0.0:
                    sleep(left if left < LONGEST_SLEEP else LONGEST_SLEEP)
                if self._ending:
                    return
        except Exception as error:  # noqa: BLE001 reported to the owner
            self.failure = error
            self._session.observer.event(f'the loop ended: {error!r}', Level.FAULT)
        finally:
            self._session.close()
