# SPDX-License-Identifier: Apache-2.0
r"""
Position of the ball with its variance.

The distance travelled is that of rolling, minus the radius times the ball angle, plus that of
sliding.  The ball angle is that of the estimate; with an IMU, gravity corrects its drift.  The
slip is the speed of the centre, integrated from the accelerometer, less that of rolling::

    slip = v + R theta1',    slip' = a + R theta1''

with a the horizontal part of the specific force.  A ball that rests on the floor rolls: while the
force is near g, a pseudo-measurement sets the slip to zero, with a standard deviation proportional
to the speed.  During an impact and in the air there is no such measurement, and the error of the
accelerometer accumulates, in the slip and in its variance.  Distance and slip are the two states
of a Kalman filter.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.estimation.imu import ImuReading, turned
from ballbot_ros.estimation.kalman import BALL_RATE, Estimate, JOINT, PENDULUM
from ballbot_ros.physics.model.robot import Robot

# Correlation time of the slip and of the error of the accelerometer [s].
CORRELATION_TIME = 0.1
# Two IMU readings within this time miss no impact [s].
IMPACT_INTERVAL_MAX = 0.01
# A longer pause between two IMU readings has no measurement of the force [s].
LONGEST_PAUSE = 0.1
# A larger change of the ball angle in a step than predicted is a new zero, not a correction [rad].
ZERO_CHANGE_MIN = 0.2
# Standard deviation of the position after a lost estimate [m].
LOST_POSITION_SD = 1.0


@dataclass(frozen=True)
class OdometryTuning(Checked):
    """Noise of the odometry."""

    radius_error: float = quantity(
        '1', 'standard deviation of the rolling radius, as a part of it', default=0.005,
        minimum=0.0, maximum=1.0)
    slip_part: float = quantity(
        '1', 'how much slower or faster than it rolls a ball moves on the floor, for 0.1 s, as a '
        'part of the speed', default=0.03, minimum=0.0, maximum=1.0)
    slip_at_rest: float = quantity(
        'm/s', 'slip speed of a ball that rocks on the spot, standard deviation for 0.1 s',
        default=0.002, above=0.0)
    slip_unseen: float = quantity(
        '1', 'slip_part of a robot without an IMU', default=0.3, minimum=0.0, maximum=1.0)
    force_sd: float = quantity(
        'm/s2', 'how far the horizontal specific force is wrong, for 0.1 s: an IMU that leans by '
        '0.02 rad is wrong by 0.2', default=0.3, above=0.0)
    shock_part: float = quantity(
        '1', 'how far it is wrong in a blow, as a part of the force', default=0.1, minimum=0.0,
        maximum=1.0)
    contact_gate: float = quantity(
        'm/s2', 'difference of the specific force from g beyond which the ball need not roll',
        default=2.0, above=0.0)


class Slide(NamedTuple):
    """Distance and speed of sliding with their covariance: the state of the filter."""

    way: float  # [m]
    slip: float  # speed to +x less that of rolling [m/s]
    way_variance: float
    covariance: float  # of the two
    slip_variance: float


class OdometryState(NamedTuple):
    """Position and speed of the ball at one time, with variances."""

    stamp: float  # [s]
    position: float  # of the centre, from where it started, along x [m]
    speed: float  # likewise [m/s]
    position_variance: float  # [m2]
    speed_variance: float  # [m2/s2]
    ball_angle: float  # NaN if the next one counts from another zero [rad]
    ball_rate: float  # [rad/s]
    rolled: float  # part of the position from rolling [m]
    start_variance: float  # of the ball angle at the start
    slide: Slide
    imu_stamp: float  # of the last IMU reading used [s]
    imu_rate: float  # of the ball then [rad/s]


class OdometryFilter:
    """Maps odometry to that of the next estimate; has no state."""

    def __init__(self, robot: Robot, tuning: OdometryTuning = OdometryTuning()):
        self._radius, self._gravity, self._tuning = robot.ball_radius, robot.gravity, tuning

    def start(self, estimate: Estimate) -> OdometryState:
        """Return the odometry of a ball at position 0 that rolls."""
        # Later angles are relative to the first one, whose variance is that of the zero.
        return self._result(estimate, 0.0, Slide(0.0, 0.0, 0.0, 0.0, 0.0), _variances(estimate)[0],
                            -math.inf, 0.0)

    def lost(self, before: OdometryState) -> OdometryState:
        """Return the odometry after a lost estimate, with an increased variance."""
        slide = before.slide
        return before._replace(ball_angle=math.nan, slide=slide._replace(
            way_variance=slide.way_variance + LOST_POSITION_SD**2))

    def advance(self, before: OdometryState, estimate: Estimate,
                imu: Optional[ImuReading] = None) -> OdometryState:
        """
        Return the odometry at the time of an estimate; one that is not later has no effect.

        The IMU reading is that at the ball centre before the estimate, if there is one.  Pass each
        reading once: a single reading may contain the impulse of an impact.
        """
        state = before
        if estimate.stamp > before.stamp:
            state = self._moved(before, estimate)
        if imu is not None and imu.stamp > state.imu_stamp:
            state = self._by_imu(state, estimate, imu)
        return state

    def _moved(self, before: OdometryState, estimate: Estimate) -> OdometryState:
        """Return the odometry at the time of the estimate, with an unchanged slip."""
        step = estimate.stamp - before.stamp
        angle, rate = _ball(estimate)
        turned_by, expected = angle - before.ball_angle, 0.5 * step * (rate + before.ball_rate)
        slide, lost = before.slide, 0.0
        if not abs(turned_by - expected) <= ZERO_CHANGE_MIN:
            # The angle counts from another zero; only the rate gives the distance.
            turned_by, lost = expected, (self._radius * expected)**2
        slide = Slide(
            slide.way + step * slide.slip, slide.slip,
            slide.way_variance + lost + step * (
                2.0 * slide.covariance + step * slide.slip_variance),
            slide.covariance + step * slide.slip_variance, slide.slip_variance)
        if estimate.stamp - before.imu_stamp > LONGEST_PAUSE:
            part = self._tuning.slip_unseen
            slide = slide._replace(slip_variance=slide.slip_variance + step * (
                part * self._radius * rate)**2 / CORRELATION_TIME)
            slide = self._rolling(slide, step, rate, part)
        return self._result(estimate, before.rolled - self._radius * turned_by, slide,
                            before.start_variance, before.imu_stamp, before.imu_rate)

    def _by_imu(self, before: OdometryState, estimate: Estimate,
                imu: ImuReading) -> OdometryState:
        """Return the odometry after an IMU reading, integrated since the previous one."""
        tuning, (angle, rate) = self._tuning, _ball(estimate)
        slide, period = before.slide, imu.stamp - before.imu_stamp
        if period <= LONGEST_PAUSE:
            forward, _ = turned(imu.forward, imu.upward, angle)
            shock = abs(math.hypot(imu.forward, imu.upward) - self._gravity)
            faster = period * forward + self._radius * (rate - before.imu_rate)
            # An IMU reading may have been lost, and an impact with it.
            unmeasured = max(0.0, period - IMPACT_INTERVAL_MAX) * (
                tuning.slip_unseen * self._radius * rate)**2 / CORRELATION_TIME
            slide = slide._replace(
                # The slip changes linearly over the period.
                way=slide.way + 0.5 * period * faster, slip=slide.slip + faster,
                slip_variance=slide.slip_variance + unmeasured + period * (
                    tuning.force_sd**2 * CORRELATION_TIME
                    + (tuning.shock_part * shock)**2 * period))
            if shock <= tuning.contact_gate:
                slide = self._rolling(slide, period, rate, tuning.slip_part)
        return self._result(estimate, before.rolled, slide, before.start_variance, imu.stamp,
                            rate)._replace(ball_angle=before.ball_angle)

    def _rolling(self, slide: 'Slide', step: float, rate: float, part: float) -> 'Slide':
        """Return the slide corrected by zero slip, with a deviation of a part of the speed."""
        # The measurements within the correlation time count as one.
        sd = self._tuning.slip_at_rest + part * abs(self._radius * rate)
        total = slide.slip_variance + sd**2 * max(1.0, CORRELATION_TIME / step)
        way_gain, gain = slide.covariance / total, slide.slip_variance / total
        return Slide(
            slide.way - way_gain * slide.slip, slide.slip - gain * slide.slip,
            # The accelerometer may be correct nevertheless.
            slide.way_variance - way_gain * slide.covariance
            + 2.0 * step * CORRELATION_TIME * slide.slip**2,
            slide.covariance - gain * slide.covariance,
            slide.slip_variance - gain * slide.slip_variance)

    def _result(self, estimate: Estimate, rolled: float, slide: 'Slide', start_variance: float,
                imu_stamp: float, imu_rate: float) -> OdometryState:
        radius, (angle, rate) = self._radius, _ball(estimate)
        of_angle, of_rate = _variances(estimate)
        wrong = self._tuning.radius_error
        return OdometryState(
            estimate.stamp, rolled + slide.way, slide.slip - radius * rate,
            slide.way_variance + radius**2 * (of_angle + start_variance) + (wrong * rolled)**2,
            slide.slip_variance + slide.slip**2 + radius**2 * of_rate
            + (wrong * radius * rate)**2,
            angle, rate, rolled, start_variance, slide, imu_stamp, imu_rate)


def _ball(estimate: Estimate) -> Tuple[float, float]:
    """Return angle and rate of the ball [rad], [rad/s]."""
    pendulum, joint, _, rate, _ = estimate.mean.tolist()
    return pendulum - joint, rate


def _variances(estimate: Estimate) -> Tuple[float, float]:
    """Return the variances of angle and rate of the ball."""
    spread = estimate.covariance
    angle = float(spread[PENDULUM, PENDULUM]) + float(spread[JOINT, JOINT]) \
        - 2.0 * float(spread[PENDULUM, JOINT])
    return max(angle, 0.0), max(float(spread[BALL_RATE, BALL_RATE]), 0.0)
