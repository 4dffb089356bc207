# SPDX-License-Identifier: Apache-2.0
r"""
Where the ball has rolled to, and how well that is known.

The way is that of rolling, minus the radius times the ball angle, and what the ball slid beside
it.  The ball angle is that of the estimate, which gravity keeps from drifting where there is an
IMU.  How fast it slides is the speed of the centre that the accelerometer carries on, against that
of rolling::

    slip = v + R theta1',    slip' = a + R theta1''

with a the horizontal part of the specific force.  A ball that stands on the floor rolls: as long
as the force is near g, slip is measured to be none, to a part of the speed.  In a blow and in the
air nothing says so, and what the accelerometer gets wrong adds up, in the slip and in its
variance.  Way and slip with their variances are a Kalman filter of two states.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.estimation.imu import ImuReading, turned
from ballbot_ros.estimation.kalman import Estimate
from ballbot_ros.estimation.kernels import BALL_RATE, JOINT, PENDULUM
from ballbot_ros.physics.model.robot import Robot

# How long slip strays in one direction, and the accelerometer likewise [s].
STRAY_TIME = 0.1
# Two IMU readings that are not farther apart leave nothing unfelt [s].
FELT = 0.01
# A longer pause between two IMU readings is one in which nothing was felt [s].
LONGEST_PAUSE = 0.1
# The ball angle does not move so far in a step by what readings correct [rad].
RECOUNTED = 0.2
# What a lost estimate may have made of the way [m].
LOST_WAY = 1.0


@dataclass(frozen=True)
class OdometryTuning(Checked):
    """How far rolling is trusted to tell the way."""

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
    """What the ball has slid, and how well that is known: the state of the filter."""

    way: float  # [m]
    slip: float  # how much faster to +x than it rolls [m/s]
    way_variance: float
    covariance: float  # of the two
    slip_variance: float


class OdometryState(NamedTuple):
    """Where the ball is at one moment, and how well that is known."""

    stamp: float  # [s]
    position: float  # of the centre, from where it started, along x [m]
    speed: float  # likewise [m/s]
    position_variance: float  # [m2]
    speed_variance: float  # [m2/s2]
    ball_angle: float  # NaN where the next one counts from elsewhere [rad]
    ball_rate: float  # [rad/s]
    rolled: float  # part of the position that is not slid [m]
    start_variance: float  # of the ball angle at the start
    slide: Slide
    felt_stamp: float  # of the IMU reading that was used last [s]
    felt_rate: float  # of the ball then [rad/s]


class OdometryFilter:
    """
    Maps odometry to that of the next estimate; keeps nothing itself.

    Parameters
    ----------
    robot : Robot
    tuning : OdometryTuning, optional

    """

    def __init__(self, robot: Robot, tuning: OdometryTuning = OdometryTuning()):
        """Keep what does not change."""
        self._radius, self._gravity, self._tuning = robot.ball_radius, robot.gravity, tuning

    def start(self, estimate: Estimate) -> OdometryState:
        """Return the odometry of a ball at position 0, as fast as it rolls."""
        # Where angle 0 is, is known as well as the first angle: later ones are against it.
        return self._told(estimate, 0.0, Slide(0.0, 0.0, 0.0, 0.0, 0.0), _variances(estimate)[0],
                          -math.inf, 0.0)

    def lost(self, before: OdometryState) -> OdometryState:
        """Return the odometry whose estimate is lost: the next one goes on from here, unsure."""
        slide = before.slide
        return before._replace(ball_angle=math.nan, slide=slide._replace(
            way_variance=slide.way_variance + LOST_WAY**2))

    def advance(self, before: OdometryState, estimate: Estimate,
                imu: Optional[ImuReading] = None) -> OdometryState:
        """
        Return the odometry at the time of an estimate.

        Parameters
        ----------
        before : OdometryState
        estimate : Estimate
            One that is not later moves nothing.
        imu : ImuReading, optional
            At the ball centre, where the estimate is the one after it.  To be given each once:
            what was pushed in a blow is in one reading alone, however long the next one takes.

        """
        state = before
        if estimate.stamp > before.stamp:
            state = self._moved(before, estimate)
        if imu is not None and imu.stamp > state.felt_stamp:
            state = self._felt(state, estimate, imu)
        return state

    def _moved(self, before: OdometryState, estimate: Estimate) -> OdometryState:
        """Return the odometry later, the slip being what it was."""
        step = estimate.stamp - before.stamp
        angle, rate = _ball(estimate)
        turned_by, expected = angle - before.ball_angle, 0.5 * step * (rate + before.ball_rate)
        slide, lost = before.slide, 0.0
        if not abs(turned_by - expected) <= RECOUNTED:
            # The angle counts from elsewhere; only the rate still tells the way.
            turned_by, lost = expected, (self._radius * expected)**2
        slide = Slide(
            slide.way + step * slide.slip, slide.slip,
            slide.way_variance + lost + step * (
                2.0 * slide.covariance + step * slide.slip_variance),
            slide.covariance + step * slide.slip_variance, slide.slip_variance)
        if estimate.stamp - before.felt_stamp > LONGEST_PAUSE:
            part = self._tuning.slip_unseen
            slide = slide._replace(slip_variance=slide.slip_variance + step * (
                part * self._radius * rate)**2 / STRAY_TIME)
            slide = self._rolling(slide, step, rate, part)
        return self._told(estimate, before.rolled - self._radius * turned_by, slide,
                          before.start_variance, before.felt_stamp, before.felt_rate)

    def _felt(self, before: OdometryState, estimate: Estimate,
              imu: ImuReading) -> OdometryState:
        """Return the odometry after what an IMU felt since it felt something last."""
        tuning, (angle, rate) = self._tuning, _ball(estimate)
        slide, period = before.slide, imu.stamp - before.felt_stamp
        if period <= LONGEST_PAUSE:
            forward, _ = turned(imu.forward, imu.upward, angle)
            shock = abs(math.hypot(imu.forward, imu.upward) - self._gravity)
            faster = period * forward + self._radius * (rate - before.felt_rate)
            # An IMU reading may have been lost, and a blow with it.
            unfelt = max(0.0, period - FELT) * (
                tuning.slip_unseen * self._radius * rate)**2 / STRAY_TIME
            slide = slide._replace(
                # As if it had grown over the period, whose end this is.
                way=slide.way + 0.5 * period * faster, slip=slide.slip + faster,
                slip_variance=slide.slip_variance + unfelt + period * (
                    tuning.force_sd**2 * STRAY_TIME + (tuning.shock_part * shock)**2 * period))
            if shock <= tuning.contact_gate:
                slide = self._rolling(slide, period, rate, tuning.slip_part)
        return self._told(estimate, before.rolled, slide, before.start_variance, imu.stamp,
                          rate)._replace(ball_angle=before.ball_angle)

    def _rolling(self, slide: 'Slide', step: float, rate: float, part: float) -> 'Slide':
        """Return what the ball has slid if it rolls, to a part of its speed."""
        # What is said in 0.1 s strays together and counts as one.
        sd = self._tuning.slip_at_rest + part * abs(self._radius * rate)
        total = slide.slip_variance + sd**2 * max(1.0, STRAY_TIME / step)
        way_gain, gain = slide.covariance / total, slide.slip_variance / total
        return Slide(
            slide.way - way_gain * slide.slip, slide.slip - gain * slide.slip,
            # The accelerometer may be right all the same.
            slide.way_variance - way_gain * slide.covariance
            + 2.0 * step * STRAY_TIME * slide.slip**2,
            slide.covariance - gain * slide.covariance,
            slide.slip_variance - gain * slide.slip_variance)

    def _told(self, estimate: Estimate, rolled: float, slide: 'Slide', start_variance: float,
              felt_stamp: float, felt_rate: float) -> OdometryState:
        radius, (angle, rate) = self._radius, _ball(estimate)
        of_angle, of_rate = _variances(estimate)
        wrong = self._tuning.radius_error
        return OdometryState(
            estimate.stamp, rolled + slide.way, slide.slip - radius * rate,
            slide.way_variance + radius**2 * (of_angle + start_variance) + (wrong * rolled)**2,
            slide.slip_variance + slide.slip**2 + radius**2 * of_rate
            + (wrong * radius * rate)**2,
            angle, rate, rolled, start_variance, slide, felt_stamp, felt_rate)


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
