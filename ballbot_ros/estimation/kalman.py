# SPDX-License-Identifier: Apache-2.0
r"""
An extended Kalman filter for the absolute pendulum angle.

State: absolute pendulum angle phi, joint angle theta2, rates of pendulum and ball, and the bias of
the gyro.  The ball angle is phi - theta2.

Without an IMU the motion between two encoder readings is that of a ball rolling on a level
floor.  With one the pendulum needs no such assumption: the shell carries the accelerometer, and
with its specific force s in the frame of the shell,

    (J2 + M2 e^2) phi'' = tau2 - c2 theta2' - M2 e (s_forward cos theta2 + s_upward sin theta2)

holds while the ball rolls, slips, climbs or falls.  For the absolute direction the filter
integrates the gyro, and the direction of gravity in the accelerometer corrects its drift, unless
the force differs from g by more than `gravity_gate` (a fall or an impact).

The kernels run in each period of the motor loop and change an estimate in place.  From Python,
pass ``numbers[:]`` for a `FilterNumbers`: kernels take plain tuples.
"""
from dataclasses import dataclass
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ballbot_ros.config.fields import Checked, quantity
from ballbot_ros.control.rolling_model import (
    Rolling, rolling_linearised, RollingModel, RollingNumbers)
from ballbot_ros.control.signals import JointReadings
from ballbot_ros.estimation.imu import ImuReading, turned
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array


@dataclass(frozen=True)
class FilterTuning(Checked):
    """Noise densities and standard deviations of the filter."""

    encoder_sd: float = quantity(
        'rad', 'standard deviation of an encoder reading, at the joint', default=5e-4, above=0.0)
    timing_sd: float = quantity(
        's', 'standard deviation of the time at which an encoder reading was taken',
        default=3e-4, minimum=0.0)
    gyro_sd: float = quantity(
        'rad/s', 'standard deviation of a gyro reading', default=0.01, above=0.0)
    gyro_drift: float = quantity(
        'rad/s/sqrt(s)', 'random walk of the gyro bias', default=1e-4, minimum=0.0)
    gravity_sd: float = quantity(
        'm/s2', 'standard deviation of the forward specific force from that of rolling, over '
        '0.1 s', default=3.0, above=0.0)
    gravity_gate: float = quantity(
        'm/s2', 'deviation of the specific force from g beyond which it is not used as the '
        'vertical', default=2.0, above=0.0)
    pendulum_noise: float = quantity(
        'rad/s2/sqrt(Hz)', 'noise density of the acceleration of the pendulum that the model does '
        'not include', default=0.5, above=0.0)
    ball_noise: float = quantity(
        'rad/s2/sqrt(Hz)', 'noise density of the acceleration of the ball that the model does not '
        'include', default=0.5, above=0.0)
    ball_noise_with_imu: float = quantity(
        'rad/s2/sqrt(Hz)', 'ball_noise with a gyro, large enough to track slip',
        default=30.0, above=0.0)
    pendulum_noise_with_imu: float = quantity(
        'rad/s2/sqrt(Hz)', 'pendulum_noise with an IMU, which measures the motion of the support',
        default=20.0, above=0.0)
    start_sd: float = quantity(
        'rad', 'standard deviation of the angle of a pendulum at rest', default=0.03, above=0.0)
    bias_sd: float = quantity(
        'rad/s', 'standard deviation of the bias of the gyro at the start', default=0.01,
        above=0.0)


# Order of the state.
PENDULUM, JOINT, PENDULUM_RATE, BALL_RATE, BIAS = range(5)
SIZE = 5

# A longer prediction is divided into several steps [s].
LONGEST_STEP = 0.005
# Stamps closer than this are the same [s].
STAMP_TOLERANCE = 1e-9
# Largest plausible innovation of the gyro [standard deviations].
GYRO_GATE = 5.0
# Correlation time of the error of the forward specific force [s].
STRAY_TIME = 0.1

# Whether the force on the support is measured, and its components in the axes of the shell [m/s2].
Support = Tuple[bool, float, float]
Quad = Tuple[float, float, float, float]
# The numbers of a `FilterNumbers`.
Trust = Tuple[float, float, float, float, float, float, float, float, float, float, float]


class FilterNumbers(NamedTuple):
    """Parameters of robot and tuning, in addition to those of the rolling model."""

    moment: float  # M2 e [kg m]
    radius: float  # [m]
    gravity: float  # [m/s2]
    gyro_variance: float  # [rad2/s2]
    gravity_variance: float  # [m2/s4]
    gravity_gate: float  # [m/s2]
    # Process noise per second: of both rates without an IMU and with one [rad2/s3], and of the
    # bias.
    pendulum: float
    ball: float
    pendulum_with_imu: float
    ball_with_imu: float
    bias: float


@compiled
def moved(column: Quad, step: float, by_pendulum: Quad, by_ball: Quad) -> Quad:
    """Return a small change of the first four states, propagated by a step [s]."""
    angle, joint, rate, ball_rate = column
    return (angle + step * rate, joint + step * (rate - ball_rate),
            rate + step * (by_pendulum[0] * angle + by_pendulum[1] * joint
                           + by_pendulum[2] * rate + by_pendulum[3] * ball_rate),
            ball_rate + step * (by_ball[0] * angle + by_ball[1] * joint + by_ball[2] * rate
                                + by_ball[3] * ball_rate))


@compiled
def spread(covariance: Array, step: float, by_pendulum: Quad, by_ball: Quad) -> None:
    """
    Propagate a covariance in place by a step [s] of the linearised motion: F P F^T.

    The tuples are the derivatives of phi'' and theta1'' by phi, theta2, phi', theta1'.
    """
    for i in range(SIZE):
        (covariance[0, i], covariance[1, i], covariance[2, i], covariance[3, i]) = moved(
            (covariance[0, i], covariance[1, i], covariance[2, i], covariance[3, i]),
            step, by_pendulum, by_ball)
    for i in range(SIZE):
        (covariance[i, 0], covariance[i, 1], covariance[i, 2], covariance[i, 3]) = moved(
            (covariance[i, 0], covariance[i, 1], covariance[i, 2], covariance[i, 3]),
            step, by_pendulum, by_ball)


@compiled
def step_on(mean: Array, covariance: Array, step: float, torque: float, support: Support,
            rolling: Rolling, trust: Trust) -> None:
    """Advance an estimate in place by a step [s]: trapezoidal in the angles, Euler in the rest."""
    own, model, (known, forward, upward) = FilterNumbers(*trust), RollingNumbers(*rolling), support
    angle, joint, rate, ball_rate = mean[0], mean[1], mean[2], mean[3]
    pendulum, ball = rolling_linearised(angle, rate, ball_rate, torque, rolling)
    value, from_angle, from_rate, from_ball_rate = pendulum
    from_joint = 0.0
    if known:  # the force on the support is measured
        inertia, friction = model.pendulum_inertia, model.joint_friction
        # Rotated by minus the joint angle, the force is along and across the pendulum.
        across, along = turned(forward, upward, -joint)
        value = (torque - friction * (rate - ball_rate) - own.moment * across) / inertia
        from_angle, from_joint = 0.0, -own.moment * along / inertia
        from_rate, from_ball_rate = -friction / inertia, friction / inertia
    rate_after, ball_after = rate + step * value, ball_rate + step * ball[0]
    half = 0.5 * step
    mean[0] = angle + half * (rate + rate_after)
    mean[1] = joint + half * (rate + rate_after - ball_rate - ball_after)
    mean[2], mean[3] = rate_after, ball_after
    spread(covariance, step, (from_angle, from_joint, from_rate, from_ball_rate),
           (ball[1], 0.0, ball[2], ball[3]))
    covariance[2, 2] += step * (own.pendulum_with_imu if known else own.pendulum)
    covariance[3, 3] += step * (own.ball_with_imu if known else own.ball)
    covariance[4, 4] += step * own.bias


@compiled
def advance(mean: Array, covariance: Array, now: float, stamp: float, torque: float,
            support: Support, rolling: Rolling, trust: Trust) -> float:
    """Advance an estimate in place from a time to a later one, and return the latter [s]."""
    while stamp > now + STAMP_TOLERANCE:
        step = min(stamp - now, LONGEST_STEP)
        step_on(mean, covariance, step, torque, support, rolling, trust)
        now += step
    return now


@compiled
def correct(mean: Array, covariance: Array, columns: Tuple[int, int],
            weights: Tuple[float, float], innovation: float, variance: float) -> None:
    """
    Correct an estimate in place by a measurement of a weighted sum of two states.

    Parameters
    ----------
    mean : (5,) array
    covariance : (5, 5) array
    columns : tuple of 2 ints
        Indices of the states.
    weights : tuple of 2 floats
        Weights of the states in the measurement.
    innovation : float
        Measured minus predicted value.
    variance : float
        Variance of the measurement.

    """
    (one, other), (first, second) = columns, weights
    across = (
        covariance[0, one] * first + covariance[0, other] * second,
        covariance[1, one] * first + covariance[1, other] * second,
        covariance[2, one] * first + covariance[2, other] * second,
        covariance[3, one] * first + covariance[3, other] * second,
        covariance[4, one] * first + covariance[4, other] * second)
    total = across[one] * first + across[other] * second + variance
    for i in range(SIZE):
        gain = across[i] / total
        mean[i] += gain * innovation
        for j in range(SIZE):
            covariance[i, j] -= gain * across[j]


@compiled
def correct_by_imu(mean: Array, covariance: Array, measured: Quad, period: float, trust: Trust
                   ) -> None:
    """
    Correct an estimate in place by an IMU reading; see `PendulumFilter.with_imu`.

    The reading is a turn rate [rad/s], a forward and an upward specific force [m/s2] and a turn
    acceleration [rad/s2].
    """
    own, (turn_rate, forward, upward, turn_acceleration) = FilterNumbers(*trust), measured
    correct(mean, covariance, (BALL_RATE, BIAS), (1.0, 1.0),
            turn_rate - (mean[BALL_RATE] + mean[BIAS]), own.gyro_variance)
    if abs(math.hypot(forward, upward) - own.gravity) > own.gravity_gate:
        return
    ahead, up = turned(forward, upward, mean[PENDULUM] - mean[JOINT])
    # The error varies slowly: the readings within its correlation time count as one.
    correct(mean, covariance, (PENDULUM, JOINT), (-up, up),
            -own.radius * turn_acceleration - ahead,
            own.gravity_variance * max(1.0, STRAY_TIME / max(period, 1e-6)))


# Standard deviation of both rates of a robot at rest [rad/s].
START_RATE_SD = 0.01
NO_SUPPORT: Support = (False, 0.0, 0.0)


class Estimate(NamedTuple):
    """
    State estimate at one time.

    Attributes
    ----------
    stamp : float
        [s]
    mean : (5,) array
        Pendulum angle, joint angle [rad], pendulum rate, ball rate, gyro bias [rad/s].
    covariance : (5, 5) array
    encoder_zero : float
        Encoder angle at joint angle 0 [rad].

    """

    stamp: float
    mean: Array
    covariance: Array
    encoder_zero: float

    @property
    def readings(self) -> JointReadings:
        """Return both joints, as input of the controller."""
        pendulum, joint, rate, ball_rate, _ = self.mean.tolist()
        return JointReadings(self.stamp, pendulum - joint, joint, ball_rate, rate - ball_rate)

    @property
    def joint_rate(self) -> float:
        """Return the rate of the joint [rad/s]."""
        return float(self.mean[PENDULUM_RATE] - self.mean[BALL_RATE])

    @property
    def angle_sd(self) -> float:
        """Return the standard deviation of the pendulum angle [rad]."""
        return math.sqrt(max(0.0, float(self.covariance[PENDULUM, PENDULUM])))

    @property
    def rate_sd(self) -> float:
        """Return the standard deviation of the pendulum rate [rad/s]."""
        return math.sqrt(max(0.0, float(self.covariance[PENDULUM_RATE, PENDULUM_RATE])))


class PendulumFilter:
    """
    Maps an estimate to a predicted or corrected one; has no state.

    Raises `ConfigurationError` if the robot has no pendulum.
    """

    def __init__(self, robot: Robot, tuning: FilterTuning = FilterTuning()):
        model = RollingModel(robot)
        self._tuning = tuning
        self._own = FilterNumbers(
            robot.pendulum_moment, robot.ball_radius, robot.gravity, tuning.gyro_sd**2,
            tuning.gravity_sd**2, tuning.gravity_gate, tuning.pendulum_noise**2,
            tuning.ball_noise**2, tuning.pendulum_noise_with_imu**2,
            tuning.ball_noise_with_imu**2, tuning.gyro_drift**2)
        self._rolling = model.numbers

    def start(self, stamp: float, encoder: float, imu: Optional[ImuReading] = None,
              encoder_zero: Optional[float] = None) -> Estimate:
        """
        Return the estimate of a robot at rest at a time [s].

        The pendulum of a robot at rest without torque hangs straight down: this gives the absolute
        angle.  Only an IMU together with a known `encoder_zero` needs no such assumption.

        The encoder gives the joint angle from an arbitrary zero [rad], the IMU at the ball centre
        the ball angle, which is 0 without it; `encoder_zero` is the encoder angle at joint angle 0
        [rad], of an absolute encoder.
        """
        ball = 0.0 if imu is None else math.atan2(imu.forward, imu.upward)
        joint = encoder - encoder_zero if imu is not None and encoder_zero is not None else -ball
        mean = np.array([ball + joint, joint, 0.0, 0.0, 0.0 if imu is None else imu.turn_rate])
        tuning = self._tuning
        return Estimate(stamp, mean, np.diag([
            tuning.start_sd**2, tuning.encoder_sd**2, START_RATE_SD**2, START_RATE_SD**2,
            tuning.bias_sd**2]), encoder - joint)

    def predict(self, estimate: Estimate, stamp: float, torque: float,
                imu: Optional[ImuReading] = None) -> Estimate:
        """
        Return the estimate at a later time.

        Parameters
        ----------
        estimate : Estimate
        stamp : float
            [s]; has no effect if it is before that of the estimate.
        torque : float
            Torque at the pendulum since the estimate [N m].
        imu : ImuReading, optional
            Latest reading, at the ball centre.

        """
        if not stamp > estimate.stamp + STAMP_TOLERANCE:
            return estimate
        mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
        after = advance(mean, covariance, estimate.stamp, stamp, torque,
                        NO_SUPPORT if imu is None else (True, imu.forward, imu.upward),
                        self._rolling, self._own[:])
        return Estimate(after, mean, covariance, estimate.encoder_zero)

    def with_encoder(self, estimate: Estimate, encoder: float, latency: float = 0.0) -> Estimate:
        """
        Return the estimate corrected by an encoder angle [rad].

        The time of the measurement is uniformly distributed over `latency` after the stamp of the
        estimate [s].
        """
        mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
        tuning, rate = self._tuning, estimate.joint_rate
        correct(mean, covariance, (JOINT, JOINT), (1.0, 0.0), self.innovation(estimate, encoder),
                tuning.encoder_sd**2 + (tuning.timing_sd**2 + latency**2 / 12.0) * rate**2)
        return Estimate(estimate.stamp, mean, covariance, estimate.encoder_zero)

    def innovation(self, estimate: Estimate, encoder: float) -> float:
        """Return the difference between an encoder angle and its prediction [rad]."""
        return encoder - estimate.encoder_zero - float(estimate.mean[JOINT])

    def explains(self, estimate: Estimate, imu: ImuReading) -> bool:
        """
        Return whether a turn rate is within `GYRO_GATE` of its prediction by an IMU estimate.

        Without a specific force near g (a fall or an impact) any turn rate is possible.
        """
        own, covariance = self._own, estimate.covariance
        if abs(math.hypot(imu.forward, imu.upward) - own.gravity) > own.gravity_gate:
            return True
        variance = covariance[BALL_RATE, BALL_RATE] + 2.0 * covariance[BALL_RATE, BIAS] \
            + covariance[BIAS, BIAS] + own.gyro_variance \
            + own.ball_with_imu * max(imu.stamp - estimate.stamp, 0.0)
        error = imu.turn_rate - estimate.mean[BALL_RATE] - estimate.mean[BIAS]
        return bool(error**2 <= GYRO_GATE**2 * variance)

    def with_imu(self, estimate: Estimate, imu: ImuReading, period: float) -> Estimate:
        """
        Return the estimate corrected by an IMU reading at the ball centre and the same time.

        The period is the time since the previous reading [s].
        """
        mean, covariance = estimate.mean.copy(), estimate.covariance.copy()
        correct_by_imu(
            mean, covariance, (imu.turn_rate, imu.forward, imu.upward, imu.turn_acceleration),
            period, self._own[:])
        return Estimate(estimate.stamp, mean, covariance, estimate.encoder_zero)
