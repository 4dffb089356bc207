# SPDX-License-Identifier: Apache-2.0
"""One sender at a time commands, so that two cannot pull the robot to and fro."""
import math
from typing import Optional

from ballbot_ros.errors import ConfigurationError, MessageError


class Authority:
    """
    Whose commands are followed: those of the first, until it has been silent for long enough.

    All times are of one clock and passed in.

    Parameters
    ----------
    timeout : float
        Silence of the one in authority after which another may have it [s].

    Attributes
    ----------
    holder : str or None
        The sender in authority, None before there was one and after `clear`.
    refused : int
        Messages of others.
    contest : str
        Who commands beside whom, when that was last so; see `contested`.

    Raises
    ------
    ConfigurationError
        If the timeout is not a positive number.

    """

    def __init__(self, timeout: float):
        """Let whoever comes first command."""
        if not (math.isfinite(timeout) and timeout > 0.0):
            raise ConfigurationError(
                f'timeout of an authority must be above 0 s and finite, got {timeout!r}')
        self._timeout = timeout
        self._last = -math.inf  # when the holder was last there
        self.holder: Optional[str] = None
        self.refused = 0
        self._contested_at, self.contest = -math.inf, ''

    def check(self, sender: str, now: float) -> None:
        """
        Take note of a message.

        Parameters
        ----------
        sender : str
            Who sent it, in words; empty where that is not known yet, which gives no authority.
        now : float
            When it came [s].

        Raises
        ------
        MessageError
            With reason ``other_sender`` if another is in authority; it is counted.

        """
        if sender != self.holder and 0.0 <= now - self._last <= self._timeout:
            self.refused += 1
            self._contested_at = now
            self.contest = f'{sender or "another"} commands, too, and {self.holder} did first'
            raise MessageError(
                'other_sender', f'{self.contest}: one at a time; end one of them, or let the '
                f'first be silent for {self._timeout:g} s')
        if sender:
            self.holder, self._last = sender, now

    def contested(self, now: float, lately: float = 1.0) -> bool:
        """Return whether one was refused within the last seconds."""
        return now - self._contested_at <= lately

    def clear(self) -> None:
        """Let whoever comes next command."""
        self.holder, self._last = None, -math.inf
