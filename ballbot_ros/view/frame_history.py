# SPDX-License-Identifier: Apache-2.0
"""The frames that a source has had, for looking back."""
from bisect import bisect_left, bisect_right
from threading import Lock
from typing import List, Optional, Sequence, Tuple

from ballbot_ros.view.frame import Frame

# Frames kept; at 50 a second those of ten minutes.
MOST = 30_000


class FrameHistory:
    """
    Frames in the order of time, the oldest dropped; for any number of threads.

    Parameters
    ----------
    most : int
        Frames kept at least; up to a tenth more lie there before they are dropped.

    Attributes
    ----------
    epoch : int
        How often `forget` was called.

    """

    def __init__(self, most: int = MOST):
        """Start empty."""
        self._most = most
        self._lock = Lock()
        self._times: List[float] = []
        self._frames: List[Frame] = []
        self.epoch = 0

    def add(self, frame: Frame) -> None:
        """Take the next frame; one that is not later than the last begins a new epoch."""
        with self._lock:
            if self._times and frame.time <= self._times[-1]:
                self._forget()
            self._times.append(frame.time)
            self._frames.append(frame)
            if len(self._times) > 1.1 * self._most:
                del self._times[:-self._most], self._frames[:-self._most]

    def forget(self) -> None:
        """Begin a new epoch, without frames."""
        with self._lock:
            self._forget()

    def _forget(self) -> None:
        self._times, self._frames = [], []
        self.epoch += 1

    @property
    def newest(self) -> Optional[Frame]:
        """Return the last frame, None before any."""
        with self._lock:
            return self._frames[-1] if self._frames else None

    @property
    def span(self) -> Tuple[float, float]:
        """Return the times of the first and the last frame, twice 0 before any [s]."""
        with self._lock:
            return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def at(self, time: float) -> Optional[Frame]:
        """Return the last frame not later than `time` [s], else the first; None before any."""
        with self._lock:
            where = max(0, bisect_right(self._times, time) - 1)
            return self._frames[where] if self._frames else None

    def since(self, time: float) -> Sequence[Frame]:
        """Return the frames later than `time` [s], oldest first."""
        with self._lock:
            return self._frames[bisect_right(self._times, time):]

    def between(self, begin: float, end: float) -> Sequence[Frame]:
        """Return the frames from `begin` to `end` [s], both included."""
        with self._lock:
            return self._frames[bisect_left(self._times, begin):bisect_right(self._times, end)]
