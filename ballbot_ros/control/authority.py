# SPDX-License-Identifier: Apache-2.0
"""One sender at a time commands, so that two senders cannot alternate."""
import math
from typing import Optional

from ballbot_ros.errors import ConfigurationError, MessageError


class Authority:
    """
    Accepts the commands of one sender: the first, until it times out.

    All times are of one clock and passed in.

    Parameters
    ----------
    timeout : float
        Time without a command of the holder after which another sender may take over [s].

    Attributes
    ----------
    holder : str or None
        The sender in authority, None before there was one.
    contest : str
        The refused sender and the holder at the last refusal; see `contested`.

    Raises
    ------
    ConfigurationError
        If the timeout is not a positive number.

    """

    def __init__(self, timeout: float):
        if not (math.isfinite(timeout) and timeout > 0.0):
            raise ConfigurationError(
                f'timeout of an authority must be above 0 s and finite, got {timeout!r}',
                'out_of_range', 'timeout')
        self._timeout = timeout
        self._last = -math.inf  # when the holder was last there
        self.holder: Optional[str] = None
        self._contested_at, self.contest = -math.inf, ''

    def check(self, sender: str, now: float) -> None:
        """
        Register a message.

        Parameters
        ----------
        sender : str
            Name of the sender; an empty name (not discovered yet) gives no authority.
        now : float
            Time of arrival [s].

        Raises
        ------
        MessageError
            With reason ``other_sender`` if another sender holds authority.

        """
        if sender != self.holder and 0.0 <= now - self._last <= self._timeout:
            self._contested_at = now
            self.contest = f'{sender or "another node"} commands, but {self.holder} has authority'
            raise MessageError(
                f'{self.contest}: end one of them, or let the '
                f'first be silent for {self._timeout:g} s', 'other_sender', 'publisher')
        if sender:
            self.holder, self._last = sender, now

    def contested(self, now: float, lately: float = 1.0) -> bool:
        """Return whether a message was refused within the last `lately` seconds."""
        return now - self._contested_at <= lately
