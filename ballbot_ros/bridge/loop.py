# SPDX-License-Identifier: Apache-2.0
"""The loop in a thread of its own: whatever else stands still, it goes on or stops the motor."""
import threading
from typing import Callable, Optional

from ballbot_ros.bridge.report import Report
from ballbot_ros.bridge.session import Session

# How long the end of the thread is waited for; a handshake may be under way [s].
JOIN = 3.0


class Loop:
    """
    Calls `Session.tick` at a rate, and closes the session however it ends.

    Parameters
    ----------
    session : Session
    rate : float
        [Hz]
    tell : callable
        Called in the thread with each `Report`.

    Attributes
    ----------
    failure : Exception or None
        What ended the loop, if nobody asked for its end.
    late : int
        Periods that were missed.

    """

    def __init__(self, session: Session, rate: float, tell: Callable[[Report], None]):
        """Start at once."""
        self._session, self._period, self._tell = session, 1.0 / rate, tell
        self._ending = threading.Event()
        self.failure: Optional[Exception] = None
        self.late = 0
        self._thread = threading.Thread(target=self._run, name='motor loop', daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Tell whether the thread is alive."""
        return self._thread.is_alive()

    def end(self) -> None:
        """Stop the motor, close the line and end the thread; a second time does no harm."""
        self._ending.set()
        self._thread.join(JOIN)
        self._session.close()

    def _hand_on(self, report: Optional[Report]) -> None:
        if report is not None:
            self._tell(report)

    def _run(self) -> None:
        clock, due = self._session.clock, self._session.clock()
        try:
            while True:
                self._hand_on(self._session.tick())
                due += self._period
                if due < clock():
                    # Late: go on from here, never two ticks at once.
                    self.late += 1
                    due = clock()
                while self._session.expecting and clock() < due:
                    self._hand_on(self._session.hear(due - clock()))
                if self._ending.wait(max(0.0, due - clock())):
                    return
        except Exception as error:  # noqa: BLE001 whatever it is, the owner must hear of it
            self.failure = error
        finally:
            self._session.close()
