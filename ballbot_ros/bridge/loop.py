# SPDX-License-Identifier: Apache-2.0
"""The loop in a thread of its own: whatever else stands still, it goes on or stops the motor."""
import threading
from time import sleep
from typing import Callable, Optional

from ballbot_ros.bridge.observer import Level
from ballbot_ros.bridge.pacer import Periods
from ballbot_ros.bridge.realtime import Scheduling
from ballbot_ros.bridge.session import Report, Session

# How long the end of the thread is waited for; a handshake may be under way [s].
JOIN = 3.0
# A larger part of missed periods is reported.
MISSED_MAX = 0.01
# The end is looked for so often at least [s].
LONGEST_SLEEP = 0.02


class Loop:
    """
    Calls `Session.tick` at a rate, and closes the session however it ends.

    Parameters
    ----------
    session : Session
    rate : float
        [Hz]
    *publish : callable
        Called in the thread with each `Report`, in this order.
    scheduling : Scheduling, optional
        That was prepared; the thread enters it.

    Attributes
    ----------
    failure : Exception or None
        What ended the loop, if nobody asked for its end.

    """

    def __init__(self, session: Session, rate: float, *publish: Callable[[Report], None],
                 scheduling: Scheduling = Scheduling()):
        """Start at once."""
        self._session, self._publish, self._scheduling = session, publish, scheduling
        self._periods = Periods(1.0 / rate, session.clock())
        self._checked = (session.clock(), 0)  # at the last call of `delayed`
        self._ending = False
        self.failure: Optional[Exception] = None
        self._thread = threading.Thread(target=self._run, name='motor loop', daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Return whether the thread is alive."""
        return self._thread.is_alive()

    def delayed(self) -> str:
        """Return that other programs delay the loop, if so since the last call; else empty."""
        now, late = self._session.clock(), self._periods.late
        (then, before), self._checked = self._checked, (now, late)
        missed, periods = late - before, (now - then) / self._periods.period
        if missed <= MISSED_MAX * periods:
            return ''
        return (f'the machine delays the loop, {missed} of {periods:.0f} periods were missed; it '
                f'runs {self._scheduling.in_words}: see docs/realtime.md')

    @property
    def late(self) -> int:
        """Return the number of periods that were missed."""
        return self._periods.late

    def end(self) -> None:
        """Stop the motor, close the line and end the thread; a second time does no harm."""
        self._ending = True
        self._thread.join(JOIN)
        self._session.close()

    def _hand_on(self, report: Optional[Report]) -> None:
        if report is not None:
            for publish in self._publish:
                publish(report)

    def _run(self) -> None:
        clock = self._session.clock
        try:
            self._scheduling.enter()
            while True:
                self._hand_on(self._session.tick())
                self._periods = self._periods.next(clock())
                due = self._periods.due
                while self._session.expecting and clock() < due:
                    self._hand_on(self._session.await_answer(due - clock()))
                # A plain sleep costs half of what waiting for an event does.
                while not self._ending and (left := due - clock()) > 0.0:
                    sleep(left if left < LONGEST_SLEEP else LONGEST_SLEEP)
                if self._ending:
                    return
        except Exception as error:  # noqa: BLE001 whatever it is, the owner must know it
            self.failure = error
            self._session.observer.event(f'the loop ended: {error!r}', Level.FAULT)
        finally:
            self._session.close()
