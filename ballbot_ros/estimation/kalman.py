# SPDX-License-Identifier: Apache-2.0
r"""
An extended Kalman filter for the absolute pendulum angle.

State: pendulum angle phi (absolute), joint angle theta2, their ball and pendulum rates, and the
bias of the gyro.  The ball angle is phi - theta2.

Without an IMU the motion between two encoder readings is that of a ball rolling on a level
floor.  With one the pendulum needs no such assumption: the shell carries the accelerometer, and
with s its specific force turned into the frame of the shell,

    (J2 + M2 e^2) phi'' = tau2 - c2 theta2' - M2 e (s_forward cos theta2 + s_upward sin theta2)

holds while rolling, slipping, climbing, falling.  What remains is which way is down: the gyro
carries that on, and the direction of gravity in the accelerometer corrects its drift, unless
the force differs so much from g that the ball must be falling or hitting something.
"""
import math
from typing import NamedTuple, Optional, Tuple

import numpy as np

from ballbot_ros.control.rolling_model import Acceleration, Array, RollingModel
from ballbot_ros.control.signals import JointReadings
from ballbot_ros.estimation.imu import ImuReading, turned
from ballbot_ros.estimation.tuning import FilterTuning
from ballbot_ros.physics.model.robot import Robot

# Order of the state.
PENDULUM, JOINT, PENDULUM_RATE, BALL_RATE, BIAS = range(5)
SIZE = 5

# Longer pauses than this are bridged in several steps [s].
LONGEST_STEP = 0.005
# How well a robot at rest is known to be at rest: standard deviation of both rates [rad/s].
START_RATE_SD = 0.01
# How long the forward specific force strays in one direction [s].
STRAY_TIME = 0.1


class Estimate(NamedTuple):
    """
    What is known at one moment.

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
        """Return both joints, as the controller takes them."""
        pendulum, joint, rate, ball_rate, _ = self.mean.tolist()
        return JointReadings(self.stamp, pendulum - joint, joint, ball_rate, rate - ball_rate)

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
    Maps an estimate to a later or better one; keeps nothing itself.

    Parameters
    ----------
    robot : Robot
        With a pendulum.
    tuning : FilterTuning, optional

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """

    def __init__(self, robot: Robot, tuning: FilterTuning = FilterTuning()):
        """Work out what does not change."""
        self._model = RollingModel(robot)
        self._tuning = tuning

    def start(self, stamp: float, encoder: float, imu: Optional[ImuReading] = None,
              encoder_zero: Optional[float] = None) -> Estimate:
        """
        Return the estimate of a robot at rest.

        The pendulum of a robot at rest without torque hangs straight down: this is where the
        absolute angle comes from.  Only an IMU together with a known `encoder_zero` does
        without.

        Parameters
        ----------
        stamp : float
            [s]
        encoder : float
            Joint angle from an arbitrary zero [rad].
        imu : ImuReading, optional
            At the ball centre; gives the ball angle, which otherwise is called 0.
        encoder_zero : float, optional
            Encoder angle at joint angle 0 [rad], of an encoder that remembers it.

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
            [s]; an earlier one than that of the estimate changes nothing.
        torque : float
            At the pendulum since then [N m].
        imu : ImuReading, optional
            The newest, at the ball centre.

        """
        while stamp > estimate.stamp + 1e-9:
            step = min(stamp - estimate.stamp, LONGEST_STEP)
            estimate = self._step(estimate, step, torque, imu)
        return estimate

    def _step(self, estimate: Estimate, step: float, torque: float,
              imu: Optional[ImuReading]) -> Estimate:
        """Return the estimate one step later [s]: trapezoidal in the angles, Euler in the rest."""
        tuning = self._tuning
        angle, joint, rate, ball_rate, bias = estimate.mean.tolist()
        pendulum, ball = self._model.linearised(angle, rate, ball_rate, torque)
        by_joint, noises = 0.0, (tuning.pendulum_noise, tuning.ball_noise)
        if imu is not None:
            pendulum, by_joint = self._carried(joint, rate - ball_rate, torque, imu)
            noises = tuning.pendulum_noise_with_imu, tuning.ball_noise_with_imu
        rate_after, ball_after = rate + step * pendulum.value, ball_rate + step * ball.value
        half = 0.5 * step
        mean = np.array([
            angle + half * (rate + rate_after),
            joint + half * (rate + rate_after - ball_rate - ball_after),
            rate_after, ball_after, bias])
        transition = np.eye(SIZE)
        transition[PENDULUM, PENDULUM_RATE] = transition[JOINT, PENDULUM_RATE] = step
        transition[JOINT, BALL_RATE] = -step
        for row, acceleration in ((PENDULUM_RATE, pendulum), (BALL_RATE, ball)):
            transition[row, PENDULUM] += step * acceleration.by_angle
            transition[row, PENDULUM_RATE] += step * acceleration.by_rate
            transition[row, BALL_RATE] += step * acceleration.by_ball_rate
        transition[PENDULUM_RATE, JOINT] = step * by_joint
        covariance = transition @ estimate.covariance @ transition.T
        covariance[PENDULUM_RATE, PENDULUM_RATE] += step * noises[0]**2
        covariance[BALL_RATE, BALL_RATE] += step * noises[1]**2
        covariance[BIAS, BIAS] += step * tuning.gyro_drift**2
        return Estimate(estimate.stamp + step, mean, covariance, estimate.encoder_zero)

    def _carried(self, joint: float, joint_rate: float, torque: float, imu: ImuReading
                 ) -> Tuple[Acceleration, float]:
        """Return phi'' where the force on the support is measured, and its slope by the joint."""
        moment, inertia = self._model.pendulum_moment, self._model.pendulum_inertia
        friction = self._model.robot.joint_friction
        # Turned by minus the joint angle, the force is along and across the pendulum.
        across, along = turned(imu.forward, imu.upward, -joint)
        value = (torque - friction * joint_rate - moment * across) / inertia
        return (Acceleration(value, 0.0, -friction / inertia, friction / inertia),
                -moment * along / inertia)

    def with_encoder(self, estimate: Estimate, encoder: float) -> Estimate:
        """Return the estimate improved by an encoder angle [rad]."""
        turned_meanwhile = self._tuning.timing_sd * float(
            estimate.mean[PENDULUM_RATE] - estimate.mean[BALL_RATE])
        return _updated(estimate, np.array([0.0, 1.0, 0.0, 0.0, 0.0]),
                        self.innovation(estimate, encoder),
                        self._tuning.encoder_sd**2 + turned_meanwhile**2)

    def innovation(self, estimate: Estimate, encoder: float) -> float:
        """Return how far an encoder angle is from the one predicted [rad]."""
        return encoder - estimate.encoder_zero - float(estimate.mean[JOINT])

    def with_imu(self, estimate: Estimate, imu: ImuReading, period: float) -> Estimate:
        """
        Return the estimate improved by an IMU reading.

        Parameters
        ----------
        estimate : Estimate
            At the time of the reading.
        imu : ImuReading
            At the ball centre.
        period : float
            Since the reading before [s].

        """
        tuning, robot = self._tuning, self._model.robot
        estimate = _updated(
            estimate, np.array([0.0, 0.0, 0.0, 1.0, 1.0]),
            imu.turn_rate - float(estimate.mean[BALL_RATE] + estimate.mean[BIAS]),
            tuning.gyro_sd**2)
        if abs(math.hypot(imu.forward, imu.upward) - robot.gravity) > tuning.gravity_gate:
            return estimate
        angle, joint = estimate.mean[:2].tolist()
        forward, upward = turned(imu.forward, imu.upward, angle - joint)
        # Straying is slow: many readings in a row stray together and count as one.
        variance = tuning.gravity_sd**2 * max(1.0, STRAY_TIME / max(period, 1e-6))
        return _updated(
            estimate, np.array([-upward, upward, 0.0, 0.0, 0.0]),
            -robot.ball_radius * imu.turn_acceleration - forward, variance)


def _updated(estimate: Estimate, row: Array, innovation: float, variance: float) -> Estimate:
    """Return the estimate after a scalar measurement: its row, innovation and variance."""
    across = estimate.covariance @ row
    gain = across / (float(row @ across) + variance)
    return estimate._replace(mean=estimate.mean + gain * innovation,
                             covariance=estimate.covariance - np.outer(gain, across))
