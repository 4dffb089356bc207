# SPDX-License-Identifier: Apache-2.0
"""Requests to an ODrive for single properties, whose replies do not name their request."""
import math
from typing import Optional

from ballbot_ros.drives.odrive import codec

MARKER = 'marker'


class Requests:
    """
    Asks for one property at a time, and knows whether a value that comes is the answer.

    Where a value is overdue, or one comes that was not asked for, it is out of sync: a numbered
    marker is sent, and no value is accepted until that has been answered.

    Parameters
    ----------
    timeout : float
        After which an answer counts as lost [s].

    Attributes
    ----------
    asked : str or None
        Property whose value is to come.
    asked_at : float
        When it, or the last one, was asked for [s].
    value : float or None
        The last answer; None for what is no number, such as "invalid property".

    """

    def __init__(self, timeout: float):
        """Start in sync."""
        self.asked: Optional[str] = None
        self.asked_at = -math.inf
        self.value: Optional[float] = None
        self._timeout = timeout
        self._marker = codec.MARKERS[0]
        self._marked_at: Optional[float] = None  # None: in sync

    @property
    def in_sync(self) -> bool:
        """Return whether the next value is an answer to what was asked."""
        return self._marked_at is None

    @property
    def free(self) -> bool:
        """Return whether a property can be asked for now."""
        return self.in_sync and self.asked is None

    def lose_sync(self) -> None:
        """Accept no value until a marker, still to be sent, has been answered."""
        self.asked = None
        self._marked_at = -math.inf

    def ask(self, name: str, path: str, now: float) -> bytes:
        """
        Return the request for a property, a marker where one is needed, or nothing yet.

        Parameters
        ----------
        name, path : str
            What the property is called here, and by the drive.
        now : float
            [s]

        """
        if self.free:
            self.asked, self.asked_at = name, now
            return codec.read(path)
        if self._marked_at is not None and now - self._marked_at > self._timeout:
            following = self._marker + 1
            self._marker = following if following in codec.MARKERS else codec.MARKERS[0]
            self._marked_at = now
            return codec.marker(self._marker)
        return b''

    def take(self, text: str) -> Optional[str]:
        """
        Take a reply; return the property that it answers, `MARKER`, or None if it answers none.

        Text that answers a request says that there is no such property.
        """
        value = codec.parse_number(text)
        if not self.in_sync and value == self._marker:
            self._marked_at = None
            return MARKER
        if self.free or not self.in_sync:
            if value is not None and self.in_sync:
                self.lose_sync()
            return None
        name, self.asked, self.value = self.asked, None, value
        return name

    def overdue(self, now: float) -> bool:
        """Return whether an answer has become overdue; then it is out of sync."""
        if self.asked is None or now - self.asked_at <= self._timeout:
            return False
        self.lose_sync()
        return True
