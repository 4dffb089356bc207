# SPDX-License-Identifier: Apache-2.0
"""
The executor that all nodes here run on.

rclpy's older executors prepare every service, timer and subscription of the node again before
each wait; at 500 Hz that takes more of the processor than all callbacks.  The one that is driven
by events does not.  It came to Jazzy with rclpy 7.1.5; before that, an older one does as well,
only slower.

It is left to itself for a while, not asked for each message: a call of it costs as much as
taking a message does.
"""
from typing import Any, Callable, Optional

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor

try:
    from rclpy.experimental import EventsExecutor
except ImportError:
    EventsExecutor = SingleThreadedExecutor


def new_executor(context: Optional[Context] = None) -> Executor:
    """Return an executor of one thread, the fastest that this rclpy has."""
    return EventsExecutor(context=context)


class Stop:
    """
    Ends what an executor does, from a signal handler or a callback.

    The executor takes it for a future.  One of rclpy has a lock, at which a signal handler might
    wait for what it has interrupted.

    Attributes
    ----------
    given : bool

    """

    def __init__(self) -> None:
        """Not given yet."""
        self.given = False
        self._wake: Optional[Callable[[Any], None]] = None

    def give(self) -> None:
        """End it now, and before it has begun if it has not."""
        self.given = True
        if self._wake is not None:
            self._wake(self)

    def done(self) -> bool:
        """Return whether it was given."""
        return self.given

    def cancelled(self) -> bool:
        """Return False: it is given or not."""
        return False

    def add_done_callback(self, wake: Callable[[Any], None]) -> None:
        """Call this when it is given; there is one executor."""
        self._wake = wake
        if self.given:
            wake(self)

    def remove_done_callback(self, wake: Callable[[Any], None]) -> None:
        """Call nobody any more."""
        self._wake = None


def spin(executor: Executor, stop: Stop, longest: float) -> None:
    """
    Let an executor work until it is told to stop, or has had nothing to do when the time is over.

    Parameters
    ----------
    executor : Executor
    stop : Stop
    longest : float
        [s]; while there is work all the time it may take longer.

    """
    executor.spin_until_future_complete(stop, timeout_sec=longest)  # type: ignore[arg-type]
