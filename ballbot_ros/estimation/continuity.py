# SPDX-License-Identifier: Apache-2.0
"""
Detection of encoder jumps, as distinct from impacts on the pendulum.

A step between two readings is a motion if it agrees with the prediction of the filter, with the
velocity that the drive reports, or, without one, with the rate between the previous readings.
Otherwise it is a jump.  The readings after a jump are left out, until `AGREEING` of them in a row
differ from the prediction by the same angle: then the encoder continues from a new zero.

The largest innovation of a filter with an IMU, in simulations of drops of 1 m and of walls hit at
4 m/s, is 0.006 rad at 500 Hz and 0.08 rad at 50 Hz.  Without an IMU it is 0.23 rad and more: then
only the velocity of the drive distinguishes a jump from an impact.
"""
import math
from typing import NamedTuple, Optional

# Tolerance of a step about its expected value, the sum of: this [rad],
NEAR = 0.03
# this times the time since the previous reading, for an impact between two readings [rad/s],
UNKNOWN_RATE = 5.0
# the same for the change of a rate as old as the previous reading [rad/s],
UNKNOWN_CHANGE = 25.0
# and this times the rate, because a reading may be older than its stamp [s].
UNKNOWN_TIME = 0.003
# Highest plausible joint rate [rad/s]: the jump itself has corrupted a higher estimate.
HIGHEST_JOINT_RATE = 60.0
# After a longer pause [s] the motion in between is unknown: an angle further than `OUTLIER` from
# the prediction has another zero [rad].
LONGEST_PAUSE = 0.05
OUTLIER = 0.5
# A drive that restarted counts from 0: a reading within `NEAR_RESTART` of 0 plus the motion since,
# and further than `RESTARTED` from the prediction, has a new zero [rad].
NEAR_RESTART, RESTARTED = 0.15, 0.1
# Shortest restart of a drive [s].
SHORTEST_RESTART = 0.15
# Number of consecutive readings, their shortest duration [s] and the tolerance of their common
# offset [rad] for a new zero.  The offset of delayed readings decreases.
AGREEING, AGREED_FOR, AGREE = 5, 0.0175, 0.03


class EncoderReading(NamedTuple):
    """An encoder reading and its prediction, at the joint."""

    stamp: float  # [s]
    angle: float  # [rad]
    rate: Optional[float]  # reported by the drive [rad/s]; None where it reports none
    innovation: float  # against the prediction of the filter [rad]
    expected_rate: float  # by the filter [rad/s]


class EncoderDoubt(NamedTuple):
    """Consecutive readings that do not agree with the prediction."""

    since: float  # [s]
    start: float  # first of those that agree [s]
    until: float  # the last one [s]
    innovations: tuple[float, ...]  # of those that agree [rad]

    @property
    def jump(self) -> Optional[float]:
        """Return their common offset [rad], None until enough of them agree."""
        number = len(self.innovations)
        enough = number >= AGREEING and self.until - self.start >= AGREED_FOR
        return sum(self.innovations) / number if enough else None


class Continuity(NamedTuple):
    """State from one reading to the next; `after` gives the next."""

    last: Optional[EncoderReading] = None
    step_rate: float = 0.0  # between the last two readings [rad/s]
    doubt: Optional[EncoderDoubt] = None  # None while readings are plausible

    def after(self, reading: EncoderReading) -> 'Continuity':
        """Return the state after a reading."""
        last = self.last
        pause = math.inf if last is None else reading.stamp - last.stamp
        if last is None or pause > LONGEST_PAUSE and self.doubt is None:
            far = RESTARTED if last is not None and _restarted(last, reading) else OUTLIER
            fits, step_rate = abs(reading.innovation) <= far, 0.0
            broken = not fits
        else:
            fits = _near(reading.innovation, pause, reading.expected_rate)
            step = reading.angle - last.angle
            broken = not self._explains(last, reading, step, pause)
            step_rate = self.step_rate if broken or pause <= 0.0 else step / pause
        return Continuity(reading, step_rate, self._doubt(reading, fits, broken))

    def _doubt(self, reading: EncoderReading, fits: bool,
               broken: bool) -> Optional[EncoderDoubt]:
        """Return the readings in doubt, None if the encoder is continuous (a filter error)."""
        if fits or self.doubt is None and not broken:
            return None
        doubt, stamp = self.doubt, reading.stamp
        since = stamp if doubt is None else doubt.since
        if doubt is not None and not broken:
            agreeing = (*doubt.innovations, reading.innovation)
            if max(agreeing) - min(agreeing) <= AGREE:
                return EncoderDoubt(since, doubt.start, stamp, agreeing)
        return EncoderDoubt(since, stamp, stamp, (reading.innovation,))

    def _explains(self, last: EncoderReading, reading: EncoderReading, step: float,
                  pause: float) -> bool:
        """Return whether velocities explain a step."""
        if last.rate is None or reading.rate is None:
            # Compares two steps, each between readings that may be older than their stamps.
            return _near(step - self.step_rate * pause, pause, 2.0 * self.step_rate,
                         UNKNOWN_CHANGE)
        rate = 0.5 * (last.rate + reading.rate)
        fastest = max(abs(last.rate), abs(reading.rate))
        return fastest < HIGHEST_JOINT_RATE and _near(step - rate * pause, pause, fastest)


def _restarted(last: EncoderReading, reading: EncoderReading) -> bool:
    """Return whether an encoder may count from a zero within the pause before a reading."""
    if reading.stamp - last.stamp < SHORTEST_RESTART:
        return False
    moved = reading.angle - reading.innovation - last.angle  # in the pause, by the filter
    return min(0.0, moved) - NEAR_RESTART <= reading.angle <= max(0.0, moved) + NEAR_RESTART


def _near(error: float, pause: float, rate: float, unknown: float = UNKNOWN_RATE) -> bool:
    return abs(error) <= NEAR + unknown * pause + UNKNOWN_TIME * min(
        abs(rate), HIGHEST_JOINT_RATE)
