# SPDX-License-Identifier: Apache-2.0
"""
Whether there is an IMU, by a clock that nobody sets.

A reading counts from when it came, or from its stamp where that is earlier.  One that is stamped
well ahead of the clock here, or long ago, is refused: it would keep a dead IMU alive, or all that
come after it out of order.  So a clock that is set, forward or back, costs the few readings that
come before `Clocks` follows it, and never safety.
"""
import math

from ballbot_ros.errors import MessageError
from ballbot_ros.estimation.fusion import IMU_TIMEOUT

# Clocks of the IMU and of the bridge may differ by so much [s].
AHEAD = 0.01
# An IMU is silent when nothing has come for this long beyond its timeout [s]: when this process
# itself was held up, what came meanwhile is read within it.
PATIENCE = 0.02
# After a silence an IMU is relied on when it has come for so long without a gap [s].
STEADY = 0.5


class ImuWatch:
    """
    Watches the readings of an IMU.  All times are of one steady clock and passed in [s].

    Attributes
    ----------
    silent : bool
        It fell silent, or was never there, and has not come for `STEADY` since.
    silences : int
        How often it fell silent after it had come.

    """

    def __init__(self) -> None:
        """Have no reading yet."""
        self.silent = False
        self.silences = 0
        self._fresh_until = -math.inf
        self._steady_since = -math.inf
        self._missing_since = math.inf
        self._pulling = False  # there was torque when it was first missing

    def check(self, stamp: float, now: float) -> None:
        """
        Refuse a stamp that cannot be one of now.

        Raises
        ------
        MessageError
            With reason ``from_the_future`` or ``stale``.

        """
        if stamp > now + AHEAD:
            raise MessageError(
                'from_the_future', f'IMU reading of {stamp:.3f} s refused: it is {now:.3f} s '
                'here; do both machines keep the same time, and was a clock set?')
        if not stamp >= now - IMU_TIMEOUT:
            raise MessageError(
                'stale', f'IMU reading of {stamp:.3f} s refused: it is {now:.3f} s '
                f'here, more than {IMU_TIMEOUT:g} s later; is it delayed, or do clocks differ?')

    def heard(self, stamp: float, now: float) -> None:
        """Take note of a reading that is used."""
        if now > self._fresh_until:
            self._steady_since = now if self._fresh_until > -math.inf else -math.inf
        self._fresh_until = max(self._fresh_until, min(stamp, now) + IMU_TIMEOUT)

    def has(self, now: float) -> bool:
        """Return whether there is a reading not older than the timeout."""
        return now <= self._fresh_until

    def usable(self, now: float) -> bool:
        """Return whether there is one to rely on."""
        return self.has(now) and not self.silent

    def look(self, now: float, pulling: bool) -> bool:
        """
        Look whether it has fallen silent, or come back; to be called again and again.

        Parameters
        ----------
        now : float
        pulling : bool
            Whether the motor makes a torque.

        Returns
        -------
        bool
            Whether it has just been found silent, and the motor pulled when it was last heard.

        """
        if self.has(now):
            self._missing_since = math.inf
            self.silent = self.silent and now - self._steady_since < STEADY
            return False
        if now < self._missing_since:
            self._missing_since, self._pulling = now, pulling
        if self.silent or now - self._missing_since < PATIENCE:
            return False
        self.silent = True
        self.silences += self._fresh_until > -math.inf
        return self._pulling
