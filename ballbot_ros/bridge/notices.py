# SPDX-License-Identifier: Apache-2.0
"""What a session has to say, for its owner to log."""
from typing import List

# An owner that does not look is spared the rest.
MOST = 20


class Notices:
    """
    Sentences in their order; what goes wrong again and again is said once.

    Attributes
    ----------
    waiting : list of str
        Not taken yet.

    """

    def __init__(self) -> None:
        """Start with nothing to say."""
        self.waiting: List[str] = []
        self._last = ''

    def add(self, sentence: str) -> None:
        """Say something, unless it was said just before."""
        if sentence != self._last and len(self.waiting) < MOST:
            self.waiting.append(sentence)
        self._last = sentence

    def take(self) -> List[str]:
        """Return what waits, and keep it no longer."""
        taken, self.waiting = self.waiting, []
        return taken
