# SPDX-License-Identifier: Apache-2.0
"""Selects the command that the motor follows: the latest fresh one from one sender, or none."""
from collections import Counter
import math
from typing import Optional

from ballbot_ros.control.signals import refuse_not_finite
from ballbot_ros.errors import MessageError

# Clocks of sender and receiver may differ by this much before a stamp counts as "from the
# future" [s].
CLOCK_SKEW_MAX = 0.05


class CommandGate:
    """
    Accepts torque commands, refuses invalid ones with a reason, and drops expired ones.

    All times are of one clock and passed in.

    Parameters
    ----------
    timeout : float
        Age at which a command expires, above 0 [s]; the age of a command stamped in the future
        counts from its arrival.

    Attributes
    ----------
    accepted : int
    refused : Counter
        Numbers of refused commands by reason.

    """

    def __init__(self, timeout: float):
        self.timeout = timeout
        self.accepted = 0
        self.refused: Counter[str] = Counter()
        self.stamp: Optional[float] = None
        self._since = 0.0  # arrival, or the stamp if that is earlier
        self._torque = self._lean = 0.0

    def offer(self, torque: float, stamp: float, now: float, lean: float = 0.0) -> None:
        """
        Accept a torque [N m] and a set-point of the lean of the pendulum [rad].

        The stamp is that of the joint state from which they were computed [s].  Raises
        `MessageError` with reason ``not_finite``, ``stale``, ``from_the_future`` or
        ``out_of_order``; `refused` counts it, and the active command remains.
        """
        try:
            self._check(torque, stamp, now, lean)
        except MessageError as error:
            self.refused[error.reason] += 1
            raise
        self.accepted += 1
        self.stamp, self._since, self._torque = stamp, min(stamp, now), torque
        self._lean = lean

    def refuse(self, reason: str) -> None:
        """Count a command that the caller refused."""
        self.refused[reason] += 1

    def _check(self, torque: float, stamp: float, now: float, lean: float) -> None:
        refuse_not_finite('command', effort=torque, lean=lean)
        age = now - stamp
        if not age <= self.timeout:
            raise MessageError(
                f'the command answers a state of {stamp:.3f} s, but the time is {now:.3f} s: '
                f'older than {self.timeout:g} s; stamp commands with the stamp of the '
                'joint_states they answer', 'stale', 'stamp')
        if age < -CLOCK_SKEW_MAX:
            raise MessageError(
                f'the command is stamped {stamp:.3f} s, but the local time is {now:.3f} s: '
                'does the sender use wall time instead of simulated time?',
                'from_the_future', 'stamp')
        if self.stamp is not None and stamp < self.stamp:
            raise MessageError(
                f'the command is stamped {stamp:.6f} s, but one of '
                f'{self.stamp:.6f} s arrived before', 'out_of_order', 'stamp')

    def torque(self, now: float) -> float:
        """Return the torque to apply at `now` [N m]: 0 without a fresh command."""
        return 0.0 if self.stamp is None or self.expired(now) else self._torque

    def lean(self, now: float) -> float:
        """Return the set-point of the lean at `now` [rad]: 0 without a fresh command."""
        return 0.0 if self.stamp is None or self.expired(now) else self._lean

    def expired(self, now: float) -> bool:
        """Return whether the last command has expired."""
        return self.stamp is not None and now - self._since > self.timeout

    def clear(self) -> None:
        """Drop the active command; the counts remain."""
        self.stamp, self._torque, self._lean = None, 0.0, 0.0


class Authority:
    """
    Accepts the commands of one sender: the first, until it times out.

    All times are of one clock and passed in.

    Parameters
    ----------
    timeout : float
        Time without a command from the holder after which another sender may take over, above 0
        [s].

    Attributes
    ----------
    holder : str or None
        The sender with authority, None before the first command.
    contest : str
        The refused sender and the holder at the last refusal; see `contested`.

    """

    def __init__(self, timeout: float):
        self._timeout = timeout
        self._last = -math.inf  # time of the last message from the holder
        self.holder: Optional[str] = None
        self._contested_at, self.contest = -math.inf, ''

    def check(self, sender: str, now: float) -> None:
        """
        Register a message that arrived now [s] from a sender.

        A sender with an empty name (not discovered yet) gets no authority.  Raises `MessageError`
        with reason ``other_sender`` if another sender holds authority.
        """
        if sender != self.holder and 0.0 <= now - self._last <= self._timeout:
            self._contested_at = now
            self.contest = f'{sender or "another node"} commands, but {self.holder} has authority'
            raise MessageError(
                f'{self.contest}: stop one of them, or let the '
                f'first send nothing for {self._timeout:g} s', 'other_sender', 'publisher')
        if sender:
            self.holder, self._last = sender, now

    def contested(self, now: float) -> bool:
        """Return whether a message was refused within the last second."""
        return now - self._contested_at <= 1.0
