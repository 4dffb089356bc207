# SPDX-License-Identifier: Apache-2.0
"""One line for the drivers of several axes; each has a view with all that arrives."""
from typing import Callable, Optional, TypeVar

from ballbot_ros.drives.contract import SerialLine
from ballbot_ros.errors import LinkError

Result = TypeVar('Result')


class SharedLine:
    """
    Opens a line for its first view and closes it with the last one, or when it fails.

    A driver skips the replies to another axis, so the protocol must distinguish them; see
    `Driver.shares_line`.

    Parameters
    ----------
    open_it : callable
        Returns a line.

    """

    def __init__(self, open_it: Callable[[], SerialLine]):
        self._open = open_it
        self._line: Optional[SerialLine] = None
        self._views: list['LineView'] = []

    def view(self) -> 'LineView':
        """Return a view of the line, which is opened if necessary; raises as `open_it` does."""
        if self._line is None:
            self._line, self._views = self._open(), []
        self._views.append(LineView(self, self._line))
        return self._views[-1]

    def distribute(self, line: SerialLine) -> None:
        """Pass the received data to each view."""
        data = line.read()
        if data:
            for view in self._views:
                view.arrived += data

    def drop(self, view: 'LineView') -> None:
        """Remove a view."""
        self._views = [one for one in self._views if one is not view]
        if not self._views:
            self.close(view.line)

    def close(self, line: SerialLine) -> None:
        """Close a line; it is opened again for the next view."""
        line.close()
        if line is self._line:
            self._line = None


class LineView:
    """The line as the driver of one axis has it; a `SerialLine`."""

    def __init__(self, shared: SharedLine, line: SerialLine):
        self._shared, self.line = shared, line
        self.port = line.port
        self.arrived = b''  # and not read yet
        self._closed = False

    def write(self, data: bytes) -> None:
        """Write all."""
        self._attempt(lambda: self.line.write(data))

    def read(self) -> bytes:
        """Return the data received since the last read of this view."""
        self._attempt(lambda: self._shared.distribute(self.line))
        data, self.arrived = self.arrived, b''
        return data

    def wait(self, seconds: float, least: int = 1) -> bool:
        """Wait for bytes, and return whether there are any."""
        return bool(self.arrived) or self._attempt(lambda: self.line.wait(seconds, least))

    def close(self) -> None:
        """Close the view; closing twice is allowed."""
        if not self._closed:
            self._closed = True
            self._shared.drop(self)

    def _attempt(self, action: Callable[[], Result]) -> Result:
        """Return the result of an action on the line; one that fails is closed for all views."""
        if self._closed:
            raise LinkError(f'{self.port} has been closed', 'closed', 'port')
        try:
            return action()
        except LinkError:
            self._shared.close(self.line)
            raise
