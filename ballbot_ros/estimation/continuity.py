# SPDX-License-Identifier: Apache-2.0
"""
An encoder that jumps, told from a pendulum that is hit.

A step between two readings is a motion where something else knows of it: the filter, whose
prediction the reading then fits, or the velocity that the drive itself reports, or, without one,
the rate between the readings before.  What none of them explains is a jump.  Readings after it
are left out, until so many of them in a row lie off the prediction by the same angle that the
encoder may count on from its new zero.

The largest innovation of a filter with an IMU, in simulations of drops of 1 m and of walls hit at
4 m/s, is 0.006 rad at 500 Hz and 0.08 rad at 50 Hz.  Without an IMU it is 0.23 rad and more: then
the velocity of the drive tells one from the other.
"""
import math
from typing import NamedTuple, Optional

# A step is explained where it is nearer to what was to be expected than the sum of: this [rad],
NEAR = 0.03
# this times the time since the reading before, for what a hit does between two readings [rad/s],
UNKNOWN_RATE = 5.0
# for what it does to a rate that is as old as a reading [rad/s],
UNKNOWN_CHANGE = 25.0
# and this times the rate, for a reading may be older than it says [s].
UNKNOWN_TIME = 0.003
# No joint turns faster [rad/s]: an estimator that says so has been hit by the jump itself.
HIGHEST_JOINT_RATE = 60.0
# After a longer pause nobody can say what happened meanwhile [s]; then an angle further than this
# from the predicted one is none of this zero [rad].
LONGEST_PAUSE = 0.05
OUTLIER = 0.5
# A drive that was off meanwhile counts from 0 again: where the encoder is this near to what it may
# show then, an angle further than that from the predicted one is none of the old zero [rad].
NEAR_RESTART, RESTARTED = 0.15, 0.1
# None is back sooner [s].
SHORTEST_RESTART = 0.15
# So many readings in a row, over so long [s], that lie off by the same, give or take this [rad],
# make a new zero.  Answers that a busy machine was late to ask for lie off by less and less.
AGREEING, AGREED_FOR, AGREE = 5, 0.0175, 0.03


class EncoderReading(NamedTuple):
    """An encoder reading and what was to be expected of it, at the joint."""

    stamp: float  # [s]
    angle: float  # [rad]
    rate: Optional[float]  # reported by the drive [rad/s]; None where it reports none
    innovation: float  # against the prediction of the filter [rad]
    expected_rate: float  # by the filter [rad/s]


class EncoderDoubt(NamedTuple):
    """Readings that do not fit."""

    since: float  # [s]
    begun: float  # since when they agree [s]
    until: float  # the last one [s]
    innovations: tuple[float, ...]  # of those that agree [rad]

    @property
    def jump(self) -> Optional[float]:
        """Return by how much they all lie off [rad], None until enough of them agree."""
        number = len(self.innovations)
        enough = number >= AGREEING and self.until - self.begun >= AGREED_FOR
        return sum(self.innovations) / number if enough else None


class Continuity(NamedTuple):
    """What is remembered from one reading to the next; `after` gives the next."""

    last: Optional[EncoderReading] = None
    step_rate: float = 0.0  # between the last two readings [rad/s]
    doubt: Optional[EncoderDoubt] = None  # None while readings are believed

    def after(self, reading: EncoderReading) -> 'Continuity':
        """Return what is to be remembered after a reading."""
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
        """Return the readings in doubt; where the encoder goes on smoothly, the filter errs."""
        if fits or self.doubt is None and not broken:
            return None
        doubt, stamp = self.doubt, reading.stamp
        since = stamp if doubt is None else doubt.since
        if doubt is not None and not broken:
            agreeing = (*doubt.innovations, reading.innovation)
            if max(agreeing) - min(agreeing) <= AGREE:
                return EncoderDoubt(since, doubt.begun, stamp, agreeing)
        return EncoderDoubt(since, stamp, stamp, (reading.innovation,))

    def _explains(self, last: EncoderReading, reading: EncoderReading, step: float,
                  pause: float) -> bool:
        """Return whether velocities explain a step."""
        if last.rate is None or reading.rate is None:
            # Two steps are compared, each between readings that may be older than they say.
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
