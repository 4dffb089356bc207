# SPDX-License-Identifier: Apache-2.0
r"""
Position of the ball with its variance.

The distance travelled is the sum of that from rolling, -R theta1, and that from sliding.  The ball
angle is that of the estimate; with an IMU, gravity corrects its drift.  The slip is the speed of
the centre, integrated from the accelerometer, minus that of rolling::

    slip = v + R theta1',    slip' = a + R theta1''

where a is the horizontal specific force.  A ball on the floor rolls: while the magnitude of the
force is near g, a pseudo-measurement sets the slip to zero, with a standard deviation proportional
to the speed.  During an impact and in the air there is no such measurement, and the error of the
accelerometer accumulates, in the slip and in its variance.  Distance and slip are the two states
of a Kalman filter.
"""
from dataclasses import astuple, dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.estimation.imu import ImuReading, turned
from ballbot_ros.estimation.kalman import BALL_RATE, Estimate, JOINT, PENDULUM
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array

# Correlation time of the slip and of the error of the accelerometer [s].
CORRELATION_TIME = 0.1
# No impact is missed between two IMU readings within this time [s].
IMPACT_INTERVAL_MAX = 0.01
# Longest pause between two IMU readings over which the force is integrated [s].
LONGEST_PAUSE = 0.1
# A larger deviation of the ball angle from its prediction is a new zero, not a correction [rad].
ZERO_CHANGE_MIN = 0.2
# Standard deviation of the position after a lost estimate [m].
LOST_POSITION_SD = 1.0


@dataclass(frozen=True)
class OdometryTuning(Checked):
    """Noise of the odometry."""

    radius_error: float = quantity(
        '1', 'relative standard deviation of the rolling radius', default=0.005,
        minimum=0.0, maximum=1.0)
    slip_part: float = quantity(
        '1', 'standard deviation of the slip speed on the floor over 0.1 s, as a fraction of the '
        'speed', default=0.03, minimum=0.0, maximum=1.0)
    slip_at_rest: float = quantity(
        'm/s', 'standard deviation of the slip speed of a ball that rocks on the spot, over 0.1 s',
        default=0.002, above=0.0)
    slip_unseen: float = quantity(
        '1', 'slip_part without an IMU', default=0.3, minimum=0.0, maximum=1.0)
    force_sd: float = quantity(
        'm/s2', 'standard deviation of the horizontal specific force over 0.1 s; an IMU tilted by '
        '0.02 rad has an error of 0.2', default=0.3, above=0.0)
    shock_part: float = quantity(
        '1', 'standard deviation of the force in an impact, as a fraction of it', default=0.1,
        minimum=0.0, maximum=1.0)
    contact_gate: float = quantity(
        'm/s2', 'deviation of the specific force from g beyond which rolling is not assumed',
        default=2.0, above=0.0)


class OdometryState(NamedTuple):
    """Position and speed of the ball at one time, with variances, and the state of the filter."""

    stamp: float  # [s]
    position: float  # of the centre along x, from the start [m]
    speed: float  # of the centre along x [m/s]
    position_variance: float  # [m2]
    speed_variance: float  # [m2/s2]
    ball_angle: float  # NaN if the next one counts from another zero [rad]
    ball_rate: float  # [rad/s]
    rolled: float  # part of the position from rolling [m]
    start_variance: float  # of the ball angle at the start [rad2]
    imu_stamp: float  # of the last IMU reading used [s]
    imu_rate: float  # ball rate at that time [rad/s]
    way: float  # part of the position from sliding [m]
    slip: float  # speed to +x minus that of rolling [m/s]
    way_variance: float
    covariance: float  # of way and slip
    slip_variance: float


# Way, slip and their covariance; the numbers of an `OdometryState`; radius, gravity and the fields
# of an `OdometryTuning`.
Slide = Tuple[float, float, float, float, float]
Numbers = Tuple[float, ...]


@compiled
def ball_variances(covariance: Array) -> Tuple[float, float]:
    """Return the variances of angle and rate of the ball."""
    angle = covariance[PENDULUM, PENDULUM] + covariance[JOINT, JOINT] \
        - 2.0 * covariance[PENDULUM, JOINT]
    return max(angle, 0.0), max(covariance[BALL_RATE, BALL_RATE], 0.0)


@compiled
def without_slip(slide: Slide, step: float, sd: float) -> Slide:
    """Return a slide after a pseudo-measurement of zero slip, of a sd [m/s], over a step [s]."""
    way, slip, way_variance, covariance, slip_variance = slide
    # The measurements within the correlation time count as one.
    total = slip_variance + sd**2 * max(1.0, CORRELATION_TIME / step)
    way_gain, gain = covariance / total, slip_variance / total
    return (way - way_gain * slip, slip - gain * slip,
            # The accelerometer may be right: then the ball slips.
            way_variance - way_gain * covariance + 2.0 * step * CORRELATION_TIME * slip**2,
            covariance - gain * covariance, slip_variance - gain * slip_variance)


@compiled
def odometry_of(stamp: float, mean: Array, covariance: Array, angle: float, rolled: float,
                start_variance: float, imu_stamp: float, imu_rate: float, slide: Slide,
                numbers: Numbers) -> Numbers:
    """Return the odometry of an estimate with a ball angle [rad]."""
    radius, radius_error = numbers[0], numbers[2]
    of_angle, of_rate = ball_variances(covariance)
    rate, (way, slip, way_variance, _, slip_variance) = mean[BALL_RATE], slide
    return (stamp, rolled + way, slip - radius * rate,
            way_variance + radius**2 * (of_angle + start_variance) + (radius_error * rolled)**2,
            slip_variance + slip**2 + radius**2 * of_rate + (radius_error * radius * rate)**2,
            angle, rate, rolled, start_variance, imu_stamp, imu_rate) + slide


@compiled
def moved(before: Numbers, stamp: float, mean: Array, covariance: Array, numbers: Numbers
          ) -> Numbers:
    """Return the odometry at the time of an estimate, with an unchanged slip."""
    own, (radius, _, _, _, slip_at_rest, slip_unseen, _, _, _) = OdometryState(*before), numbers
    step, angle, rate = stamp - own.stamp, mean[PENDULUM] - mean[JOINT], mean[BALL_RATE]
    turned_by, expected = angle - own.ball_angle, 0.5 * step * (rate + own.ball_rate)
    lost = 0.0
    if not abs(turned_by - expected) <= ZERO_CHANGE_MIN:
        # The angle counts from another zero; only the rate gives the distance.
        turned_by, lost = expected, (radius * expected)**2
    unseen = stamp - own.imu_stamp > LONGEST_PAUSE
    slip_sd = slip_unseen * abs(radius * rate)
    slide = (own.way + step * own.slip, own.slip,
             own.way_variance + lost + step * (2.0 * own.covariance + step * own.slip_variance),
             own.covariance + step * own.slip_variance,
             own.slip_variance + (step * slip_sd**2 / CORRELATION_TIME if unseen else 0.0))
    if unseen:
        slide = without_slip(slide, step, slip_at_rest + slip_sd)
    return odometry_of(stamp, mean, covariance, angle, own.rolled - radius * turned_by,
                       own.start_variance, own.imu_stamp, own.imu_rate, slide, numbers)


@compiled
def by_imu(before: Numbers, stamp: float, mean: Array, covariance: Array, imu_stamp: float,
           forward: float, upward: float, numbers: Numbers) -> Numbers:
    """Return the odometry after an IMU reading, integrated since the previous one."""
    own, rate = OdometryState(*before), mean[BALL_RATE]
    (radius, gravity, _, slip_part, slip_at_rest, slip_unseen, force_sd, shock_part,
     contact_gate) = numbers
    slide: Slide = (own.way, own.slip, own.way_variance, own.covariance, own.slip_variance)
    period = imu_stamp - own.imu_stamp
    if period <= LONGEST_PAUSE:
        ahead, _ = turned(forward, upward, mean[PENDULUM] - mean[JOINT])
        shock = abs(math.hypot(forward, upward) - gravity)
        faster = period * ahead + radius * (rate - own.imu_rate)
        # An IMU reading may have been lost, and an impact with it.
        unmeasured = max(0.0, period - IMPACT_INTERVAL_MAX) * (
            slip_unseen * radius * rate)**2 / CORRELATION_TIME
        # The slip changes linearly over the period.
        slide = (own.way + 0.5 * period * faster, own.slip + faster, own.way_variance,
                 own.covariance, own.slip_variance + unmeasured + period * (
                     force_sd**2 * CORRELATION_TIME + (shock_part * shock)**2 * period))
        if shock <= contact_gate:
            slide = without_slip(slide, period, slip_at_rest + slip_part * abs(radius * rate))
    return odometry_of(stamp, mean, covariance, own.ball_angle, own.rolled, own.start_variance,
                       imu_stamp, rate, slide, numbers)


class OdometryFilter:
    """Maps odometry to the odometry at the next estimate; has no state."""

    def __init__(self, robot: Robot, tuning: OdometryTuning = OdometryTuning()):
        self._numbers = robot.ball_radius, robot.gravity, *astuple(tuning)

    def start(self, estimate: Estimate) -> OdometryState:
        """Return the odometry of a ball at position 0 that rolls."""
        # Later angles are relative to the first one, whose variance is that of the zero.
        return OdometryState(*odometry_of(
            *estimate[:3], estimate.readings.ball_angle, 0.0,
            ball_variances(estimate.covariance)[0], -math.inf, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0),
            self._numbers))

    def lost(self, before: OdometryState) -> OdometryState:
        """Return the odometry after a lost estimate, with an increased variance."""
        return before._replace(
            ball_angle=math.nan, way_variance=before.way_variance + LOST_POSITION_SD**2)

    def advance(self, before: OdometryState, estimate: Estimate,
                imu: Optional[ImuReading] = None) -> OdometryState:
        """
        Return the odometry at the time of an estimate, which has no effect unless it is later.

        `imu` is the reading at the ball centre before the estimate, if there is one.  Pass each
        reading once: a single reading may contain the impulse of an impact.
        """
        state = before
        if estimate.stamp > before.stamp:
            state = OdometryState(*moved(state[:], *estimate[:3], self._numbers))
        if imu is not None and imu.stamp > state.imu_stamp:
            state = OdometryState(*by_imu(
                state[:], *estimate[:3], imu.stamp, imu.forward, imu.upward, self._numbers))
        return state
