# SPDX-License-Identifier: Apache-2.0
"""Synchronise simulated time with wall time, and count skipped time on a slow machine."""
import math

from ballbot_ros.errors import ConfigurationError


def periods_per(slow_rate: float, base_rate: float, name: str) -> int:
    """
    Return the number of periods of the base rate per period of the slow rate.

    Raises `ConfigurationError` if it is not a whole number; the message names the nearest rates
    that fit.
    """
    ratio = base_rate / slow_rate
    periods = round(ratio)
    if periods < 1 or abs(ratio - periods) > 1e-9 * ratio:
        above = base_rate / max(1, math.floor(ratio))
        below = base_rate / (max(1, math.floor(ratio)) + 1)
        raise ConfigurationError(
            f'{name} must divide control_rate ({base_rate:g} Hz) into a whole number of '
            f'periods, got {slow_rate:g} Hz; {below:g} Hz and {above:g} Hz do',
            'inconsistent', name)
    return periods


class Pace:
    """
    Counts the control periods that are due by the wall clock.

    `period` is in simulated seconds, and `factor` is simulated seconds per wall second.  When the
    machine is too slow, each call returns at most `most` periods; the rest is `dropped`, so
    simulated time falls behind, but the backlog does not grow.
    """

    def __init__(self, period: float, factor: float, most: int = 10):
        """Initialize; counting starts at the first `restart` or `due`."""
        self._wall_period = period / factor
        self._most = most
        self._origin = math.inf
        self._done = 0
        self.dropped = 0

    def restart(self, now: float) -> None:
        """Count from `now` [s of wall time], for instance after a pause."""
        self._origin = now
        self._done = 0

    def due(self, now: float) -> int:
        """Return the number of periods to run at `now` [s of wall time]."""
        if not math.isfinite(self._origin):
            self.restart(now)
        wanted = math.floor((now - self._origin) / self._wall_period) - self._done
        if wanted <= 0:
            return 0
        # Time beyond the cap is skipped: count it as done.
        self._done += wanted
        self.dropped += max(0, wanted - self._most)
        return min(wanted, self._most)


class Speedometer:
    """Measures the real-time factor over a window of wall time."""

    def __init__(self, window: float = 1.0):
        self._window = window
        self._mark = (math.nan, math.nan)
        self.factor = math.nan

    def note(self, simulated: float, wall: float) -> None:
        """Record a reading of both clocks [s]."""
        since_simulated, since_wall = self._mark
        if not simulated >= since_simulated:  # the first reading, or time went back
            self._mark = (simulated, wall)
        elif wall - since_wall >= self._window:
            self.factor = (simulated - since_simulated) / (wall - since_wall)
            self._mark = (simulated, wall)
