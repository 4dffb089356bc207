# SPDX-License-Identifier: Apache-2.0
"""
The rate term of a law on board, closed in the drive: what is sent instead of a torque alone.

With a law whose torque falls by ``gain`` per rate of the joint, what is left of it at rate zero,
its level, changes slowly: position, gravity and the turning of the ball.  The drive is sent the
level, as a torque and the rate at which that torque is due, and subtracts ``gain`` times the rate
that it measures itself, thousands of times a second, within its own torque limit.  So law (11)
needs the computer no faster than its position term does.

The torque limit of the bridge and that of the drive are the same, see the settings of the drive.
`torque_rate_limit` holds for the level: what the rate term does between two commands, the drive
does not know to limit.
"""
import math
from typing import Optional, Tuple


class Cascade:
    """
    Keeps the level that the drive works about.  All times are of one clock [s].

    Parameters
    ----------
    gain : float
        [N m s/rad]; 0 for a drive that is sent torque alone.
    rate_limit : float
        Fastest change of the level [N m/s].
    longest_step : float
        After a longer pause the level changes by no more than over this time [s].

    """

    def __init__(self, gain: float, rate_limit: float, longest_step: float):
        """Start without a law."""
        self.gain, self._rate_limit, self._longest_step = gain, rate_limit, longest_step
        self._answered: Optional[Tuple[float, float]] = None
        self._level: Optional[float] = None
        self._at = -math.inf

    def answered(self, rate: float, excess: Optional[float]) -> None:
        """
        Take note of what the torque in force answers.

        Parameters
        ----------
        rate : float
            Of the joint [rad/s].
        excess : float, optional
            What the torque limit cut off [N m]; None for a law whose torque falls otherwise.

        """
        self._answered = None if excess is None else (rate, excess)

    def forget(self) -> None:
        """Start without a law again."""
        self._answered = self._level = None

    def rate(self, now: float, torque: float, asked: float) -> Optional[float]:
        """
        Return the rate of the joint at which a torque is due [rad/s], None to send it alone.

        Parameters
        ----------
        now : float
            [s]
        torque, asked : float
            Decided, and asked for by the law within its torque limit [N m].

        """
        if self._answered is None or torque == 0.0:
            self._level = None
            return None
        rate, excess = self._answered
        level = asked + excess + self.gain * rate
        before = torque + self.gain * rate if self._level is None else self._level
        most = self._rate_limit * min(max(now - self._at, 0.0), self._longest_step)
        self._level = before + min(max(level - before, -most), most)
        self._at = now
        return (self._level - torque) / self.gain
