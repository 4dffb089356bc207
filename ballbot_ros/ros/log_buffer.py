# SPDX-License-Identifier: Apache-2.0
"""From Python's logging, where modules without ROS write, to the log of a node."""
import logging
from typing import List

# A node that does not look is spared the rest.
MOST = 20


class LogBuffer(logging.Handler):
    """
    Keeps what is logged until it is taken: a loop that drives a motor does not wait for a log.

    What goes wrong again and again is kept once.

    Parameters
    ----------
    name : str
        Of the logger; those below it count, too.

    """

    def __init__(self, name: str):
        """Begin to keep."""
        super().__init__()
        self._waiting: List[str] = []
        self._last = ''
        self._logger = logging.getLogger(name)
        self._logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a sentence, unless it was kept just before."""
        sentence = record.getMessage()
        if sentence != self._last and len(self._waiting) < MOST:
            self._waiting.append(sentence)
        self._last = sentence

    def take(self) -> List[str]:
        """Return what waits, and keep it no longer."""
        taken, self._waiting = self._waiting, []
        return taken

    def close(self) -> None:
        """Keep nothing more."""
        self._logger.removeHandler(self)
        super().close()
