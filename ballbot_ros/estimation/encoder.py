# SPDX-License-Identifier: Apache-2.0
"""
Plausibility of an encoder: jumps, and contradictions to the velocity of the drive or the torque.

`Continuity` detects jumps, as distinct from impacts on the pendulum.  A step between two readings
is a motion if it agrees with the prediction of the filter, with the velocity that the drive
reports, or, without one, with the rate between the previous readings.  Otherwise it is a jump.
The readings after a jump are rejected until `AGREEING` consecutive ones differ from the
prediction by the same angle: then the encoder continues from a new zero.

The largest innovation of a filter with an IMU, in simulations of drops of 1 m and of walls hit at
4 m/s, is 0.006 rad at 500 Hz and 0.08 rad at 50 Hz.  Without an IMU it is 0.23 rad and more: then
only the velocity of the drive distinguishes a jump from an impact.

`EncoderCheck` compares increments.  The velocity times the time between two readings is the
expected increment of the angle.  The torque times that time is the expected momentum; the measured
one is that of the motion, by the model (the momentum observer of collision detection).  A frozen
encoder, or a blocked joint, differs by the full expected increment, and an encoder that counts
backwards by twice the increment.  Friction, pushes and errors of the model cause smaller
differences, and an impact is short.

A drive measures at some time between the stamp and the arrival of its reply.  So velocity and
torque are intervals, of both velocities and of all torques that may have acted between two
readings; the uncertainty of an increment is the latency times the velocity or the torque.
"""
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.errors import EstimateLostError
from ballbot_ros.jit import compiled

# Least and largest value.
Interval = Tuple[float, float]

# Tolerance of a step about its expected value, the sum of: this [rad],
STEP_TOLERANCE = 0.03
# this times the time since the previous reading, for an impact between two readings [rad/s],
UNKNOWN_RATE = 5.0
# the same for the change of a rate as old as the previous reading [rad/s],
UNKNOWN_CHANGE = 25.0
# and the rate times the larger of this and the latency: readings may be later than stamps [s].
UNKNOWN_TIME = 0.003
# Highest plausible joint rate [rad/s]: a higher estimate was corrupted by the jump itself.
HIGHEST_JOINT_RATE = 60.0
# Largest tolerance without a velocity of the drive [rad].  After a longer pause [s], in which a
# drive can restart, an angle further than this from the prediction has another zero.
OUTLIER, SHORTEST_RESTART = 0.5, 0.15
# A drive that restarted counts from 0: a reading within `NEAR_RESTART` of 0 plus the motion since,
# and further than `RESTARTED` from the prediction, has a new zero [rad].
NEAR_RESTART, RESTARTED = 0.15, 0.1
# Number of consecutive readings, their shortest duration [s] and the tolerance of their common
# offset [rad] for a new zero.  The offset of delayed readings decreases.
AGREEING, AGREED_FOR, AGREE = 5, 0.0175, 0.03

# The sums restart after a longer pause [s]; a bridge continues the torque in shorter ones.
LONGEST_PAUSE = 0.1
# Time constant of the sums [s].
SMOOTHING = 0.1
# A difference of this fraction of the expected increments, opposite to them,
CONTRADICTED_MIN = 0.6
# where that of one reading is limited to this fraction, to weaken jumps and impacts,
DIFFERENCE_MAX = 2.5
# that lasts for this time contradicts the encoder [s]: an impact is shorter.
CONTRADICTION_TIME = 0.04
# The checks apply from this velocity of the joint [rad/s],
VELOCITY_MIN = 0.5
# and from this fraction of the largest torque, more than weight and friction oppose at rest.
TORQUE_MIN = 0.5


class EncoderReading(NamedTuple):
    """
    An encoder reading and the torques before it, at the joint.

    Attributes
    ----------
    stamp : float
        Earliest time of the measurement [s].
    angle : float
        Relative to an arbitrary zero [rad].
    torque : float
        Mean torque at the pendulum since the previous reading [N m].
    rate : float, optional
        Joint rate that the drive reports [rad/s].
    latency : float
        Time from the stamp to the arrival of the reply [s].
    torques : tuple of 2 floats, optional
        Least and largest torque that may have acted since then [N m]; `torque` if None.

    """

    stamp: float
    angle: float
    torque: float = 0.0
    rate: Optional[float] = None
    latency: float = 0.0
    torques: Optional[Interval] = None


class EncoderDoubt(NamedTuple):
    """Consecutive readings that do not agree with the prediction."""

    since: float  # time of the first [s]
    start: float  # time of the first that agrees with the last [s]
    until: float  # time of the last [s]
    innovations: tuple[float, ...]  # from `start` to `until` [rad]

    @property
    def jump(self) -> Optional[float]:
        """Return their common offset [rad], None until enough of them agree."""
        number = len(self.innovations)
        enough = number >= AGREEING and self.until - self.start >= AGREED_FOR
        return sum(self.innovations) / number if enough else None


class Continuity(NamedTuple):
    """State of the detection of jumps from one reading to the next; `after` gives the next."""

    last: Optional[EncoderReading] = None
    step_rate: float = 0.0  # between the last two readings [rad/s]
    doubt: Optional[EncoderDoubt] = None  # None while readings are plausible

    def after(self, reading: EncoderReading, innovation: float,
              expected_rate: float) -> 'Continuity':
        """
        Return the state after a reading.

        The innovation is the difference from the prediction of the filter [rad], the expected rate
        the joint rate of the filter [rad/s].
        """
        last = self.last
        pause = math.inf if last is None else reading.stamp - last.stamp
        late = max(UNKNOWN_TIME, reading.latency, 0.0 if last is None else last.latency)
        if last is None or pause > SHORTEST_RESTART and self.doubt is None:
            far = RESTARTED if last is not None and _restarted(last, reading, innovation) \
                else OUTLIER
            fits, step_rate = _near(innovation, far, expected_rate, late), 0.0
            broken = not fits
        else:
            fits = _near(
                innovation, STEP_TOLERANCE + UNKNOWN_RATE * pause, expected_rate, late)
            step = reading.angle - last.angle
            broken = not self._explains(last, reading, step, pause, late)
            step_rate = self.step_rate if broken or pause <= 0.0 else step / pause
        return Continuity(
            reading, step_rate, self._pending_jump(reading.stamp, innovation, fits, broken))

    def _pending_jump(self, stamp: float, innovation: float, fits: bool,
                      broken: bool) -> Optional[EncoderDoubt]:
        """Return the readings in doubt, None if the encoder is continuous (a filter error)."""
        if fits or self.doubt is None and not broken:
            return None
        doubt = self.doubt
        since = stamp if doubt is None else doubt.since
        if doubt is not None and not broken:
            agreeing = (*doubt.innovations, innovation)
            if max(agreeing) - min(agreeing) <= AGREE:
                return EncoderDoubt(since, doubt.start, stamp, agreeing)
        return EncoderDoubt(since, stamp, stamp, (innovation,))

    def _explains(self, last: EncoderReading, reading: EncoderReading, step: float,
                  pause: float, late: float) -> bool:
        if last.rate is None or reading.rate is None:
            # Compares two steps, each between readings that may be later than their stamps.
            return _near(step - self.step_rate * pause,
                         min(STEP_TOLERANCE + UNKNOWN_CHANGE * pause, OUTLIER),
                         2.0 * self.step_rate, late)
        rate = 0.5 * (last.rate + reading.rate)
        fastest = max(abs(last.rate), abs(reading.rate))
        return fastest < HIGHEST_JOINT_RATE and _near(
            step - rate * pause, STEP_TOLERANCE + UNKNOWN_RATE * pause, fastest, late)


def _restarted(last: EncoderReading, reading: EncoderReading, innovation: float) -> bool:
    """Return whether an encoder may have restarted from 0 in the pause before a reading."""
    moved = reading.angle - innovation - last.angle  # in the pause, by the filter
    return min(0.0, moved) - NEAR_RESTART <= reading.angle <= max(0.0, moved) + NEAR_RESTART


def _near(error: float, tolerance: float, rate: float, late: float) -> bool:
    """Return whether a tolerance, and a reading that is late at a rate, explain an error."""
    return abs(error) <= tolerance + late * min(abs(rate), HIGHEST_JOINT_RATE)


# Expected increments, the difference of the measured ones, its tolerance, its uncertainty by late
# readings, and the time for which the encoder has been contradicted [s].
Increments = Tuple[float, float, float, float, float]
NO_INCREMENTS: Increments = (0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def increments_after(sums: Increments, pause: float, latency: float, rates: Interval,
                     measured: float, smallest: float, missing: float) -> Increments:
    """
    Return the sums after a reading.

    Parameters
    ----------
    sums : tuple of 5 floats
    pause : float
        Time since the previous reading [s].
    latency : float
        Uncertainty of the times of both readings [s].
    rates : tuple of 2 floats
        Least and largest expected increment per second.
    measured : float
        Measured increment per second.
    smallest : float
        Mean expected increment per second from which the comparison applies.
    missing : float
        Fraction of this expected increment that may be missing.

    """
    expected, difference, tolerance, late, contradicted_for = sums
    least, largest = rates
    keep, fastest = math.exp(-pause / SMOOTHING), max(-least, largest)
    limit = DIFFERENCE_MAX * fastest
    error = measured - min(max(measured, least), largest)
    # The rate of the interval that is closest to zero.
    closest = max(least, min(largest, 0.0))
    expected = keep * expected + pause * closest
    tolerance = keep * tolerance + pause * (missing + CONTRADICTED_MIN) * abs(closest)
    difference = keep * difference + pause * min(max(error, -limit), limit)
    late = max(keep * late, latency * max(fastest, min(abs(measured), limit)))
    contradicted = abs(expected) >= smallest * SMOOTHING and math.copysign(
        1.0, -expected) * difference >= tolerance + late
    return (expected, difference, tolerance, late,
            contradicted_for + pause if contradicted else 0.0)


class EncoderCheck(NamedTuple):
    """
    State of the comparisons with velocity and torque.

    `after` returns the next one for a reading, and then `moved` for its motion by the model.
    """

    last: Optional[EncoderReading] = None
    pause: float = 0.0  # before the last reading [s]; 0 after a restart
    latency: float = 0.0  # of the last two readings [s]
    rate: float = 0.0  # between the last two readings [rad/s]
    velocity: Increments = NO_INCREMENTS
    torque: Increments = NO_INCREMENTS

    def after(self, reading: EncoderReading) -> 'EncoderCheck':
        """
        Return the check after a reading.

        Raises `EstimateLostError` with reason ``encoder_velocity`` if the encoder contradicts the
        velocity of the drive.
        """
        last = self.last
        if last is None or not 0.0 < reading.stamp - last.stamp <= LONGEST_PAUSE:
            return EncoderCheck(reading)
        pause, latency = reading.stamp - last.stamp, max(last.latency, reading.latency)
        rate = (reading.angle - last.angle) / pause
        velocity = NO_INCREMENTS
        if last.rate is not None and reading.rate is not None:
            velocity = increments_after(
                self.velocity, pause, latency,
                (min(last.rate, reading.rate), max(last.rate, reading.rate)), rate, VELOCITY_MIN,
                0.0)
            *_, contradicted_for = velocity
            if contradicted_for >= CONTRADICTION_TIME:
                raise EstimateLostError(
                    'the encoder contradicts the velocity that the drive reports: it is frozen, '
                    'reversed or slips; check its cable, its magnet and its settings in the '
                    'drive; let the robot come to rest', 'encoder_velocity', 'encoder')
        return EncoderCheck(reading, pause, latency, rate, velocity, self.torque)

    def moved(self, torque: float, largest_torque: float, highest_rate: float) -> 'EncoderCheck':
        """
        Return the check after the motion that the last reading shows.

        By the model, `torque` explains the motion; `largest_torque` scales a threshold [N m].  A
        motor that turns in the direction of its torque delivers less of it the faster it turns:
        all may be missing at `highest_rate` [rad/s], but never more.  Raises `EstimateLostError`
        with reason ``joint_torque`` if the commanded torques differ.
        """
        last = self.last
        if last is None or not self.pause:
            return self
        missing = math.copysign(1.0, last.torque) * self.rate / highest_rate
        after = increments_after(
            self.torque, self.pause, self.latency, last.torques or (last.torque, last.torque),
            torque, TORQUE_MIN * largest_torque, min(max(missing, 0.0), 1.0))
        expected, difference, _, _, contradicted_for = after
        if contradicted_for >= CONTRADICTION_TIME:
            raise EstimateLostError(
                'the joint does not follow its torque: '
                f'{expected / SMOOTHING:.2f} N m were commanded and '
                f'{difference / SMOOTHING:.2f} N m are unexplained, so the encoder or the IMU '
                'is frozen, reversed or in other units, or the joint is blocked; check both '
                'sensors, the coupling and `direction` of the hardware file; let the robot come '
                'to rest', 'joint_torque', 'encoder')
        return self._replace(torque=after)
