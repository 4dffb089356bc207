# SPDX-License-Identifier: Apache-2.0
"""
Availability of the IMU, by a monotonic clock.

The age of a reading counts from its arrival, or from its stamp if that is earlier.  A reading
stamped in the future or too far in the past is refused: it would hide a dead IMU, or put all later
readings out of order.  So a clock step, forward or back, causes the loss of the readings before
`Clocks` follows it, but does not affect safety.
"""
import math

from ballbot_ros.errors import MessageError
from ballbot_ros.estimation.fusion import IMU_TIMEOUT

# Allowed difference between the clocks of the IMU and of the bridge [s].
AHEAD = 0.01
# Grace period after the timeout of the IMU [s]: after a preemption of this process, queued
# readings are read within it.
MISSING_TIMEOUT = 0.02
# Time of readings without a gap before an IMU is usable again after a timeout [s].
STEADY = 0.5


class ImuWatch:
    """
    Monitors the readings of an IMU.  All times are of one steady clock and passed in [s].

    Attributes
    ----------
    silent : bool
        Whether it timed out or never sent, and has not sent for `STEADY` since.
    silences : int
        Number of timeouts after a first reading.

    """

    def __init__(self) -> None:
        self.silent = False
        self.silences = 0
        self._fresh_until = -math.inf
        self._steady_since = -math.inf
        self._missing_since = math.inf
        self._pulling = False  # whether there was torque at the start of the timeout

    def check(self, stamp: float, now: float) -> None:
        """
        Refuse a stamp in the future or too far in the past.

        Raises
        ------
        MessageError
            With reason ``from_the_future`` or ``stale``.

        """
        if stamp > now + AHEAD:
            raise MessageError(
                f'IMU reading of {stamp:.3f} s refused: it is {now:.3f} s '
                'here; are the clocks of both machines synchronised, and was one set?',
                'from_the_future', 'stamp')
        if not stamp >= now - IMU_TIMEOUT:
            raise MessageError(
                f'IMU reading of {stamp:.3f} s refused: it is {now:.3f} s '
                f'here, more than {IMU_TIMEOUT:g} s later; is it delayed, or do clocks differ?',
                'stale', 'stamp')

    def reading_received(self, stamp: float, now: float) -> None:
        """Record the arrival of an accepted reading."""
        if now > self._fresh_until:
            self._steady_since = now if self._fresh_until > -math.inf else -math.inf
        self._fresh_until = max(self._fresh_until, min(stamp, now) + IMU_TIMEOUT)

    def has(self, now: float) -> bool:
        """Return whether the latest reading is within the timeout."""
        return now <= self._fresh_until

    def usable(self, now: float) -> bool:
        """Return whether the IMU is present and steady."""
        return self.has(now) and not self.silent

    def look(self, now: float, pulling: bool) -> bool:
        """
        Check for a timeout or a recovery; call this in each period.

        Parameters
        ----------
        now : float
        pulling : bool
            Whether the motor has torque.

        Returns
        -------
        bool
            Whether a timeout was just detected that started while the motor had torque.

        """
        if self.has(now):
            self._missing_since = math.inf
            self.silent = self.silent and now - self._steady_since < STEADY
            return False
        if now < self._missing_since:
            self._missing_since, self._pulling = now, pulling
        if self.silent or now - self._missing_since < MISSING_TIMEOUT:
            return False
        self.silent = True
        self.silences += self._fresh_until > -math.inf
        return self._pulling
