# SPDX-License-Identifier: Apache-2.0
r"""
An extended Kalman filter for the absolute pendulum angle.

State: pendulum angle phi (absolute), joint angle theta2, their ball and pendulum rates, and the
bias of the gyro.  The ball angle is phi - theta2.

Without an IMU the motion between two encoder readings is that of a ball rolling on a level
floor.  With one the pendulum needs no such assumption: the shell carries the accelerometer, and
with s its specific force turned into the frame of the shell,

    (J2 + M2 e^2) phi'' = tau2 - c2 theta2' - M2 e (s_forward cos theta2 + s_upward sin theta2)

holds while rolling, slipping, climbing, falling.  The absolute direction remains: the filter
integrates the gyro, and the direction of gravity in the accelerometer corrects its drift, unless
the force differs from g by more than `gravity_gate` (a fall or an impact).
"""
import math
from typing import NamedTuple, Optional

import numpy as np

from ballbot_ros.control.rolling_model import Array, RollingModel
from ballbot_ros.control.signals import JointReadings
from ballbot_ros.estimation.imu import ImuReading
from ballbot_ros.estimation.kernels import (
    BALL_RATE, FilterNumbers, JOINT, PENDULUM, PENDULUM_RATE, predicted, SAME, SIZE, Support,
    with_felt, with_joint_angle)
from ballbot_ros.estimation.tuning import FilterTuning
from ballbot_ros.physics.model.robot import Robot

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
        model = RollingModel(robot)
        self._tuning = tuning
        self._trust = FilterNumbers(
            model.pendulum_moment, robot.ball_radius, robot.gravity, tuning.gyro_sd**2,
            tuning.gravity_sd**2, tuning.gravity_gate, tuning.pendulum_noise**2,
            tuning.ball_noise**2, tuning.pendulum_noise_with_imu**2,
            tuning.ball_noise_with_imu**2, tuning.gyro_drift**2)[:]
        self._numbers = model.numbers, self._trust

    def start(self, stamp: float, encoder: float, imu: Optional[ImuReading] = None,
              encoder_zero: Optional[float] = None) -> Estimate:
        """
        Return the estimate of a robot at rest.

        The pendulum of a robot at rest without torque hangs straight down: this gives the
        absolute angle.  Only an IMU together with a known `encoder_zero` needs no such assumption.

        Parameters
        ----------
        stamp : float
            [s]
        encoder : float
            Joint angle from an arbitrary zero [rad].
        imu : ImuReading, optional
            At the ball centre; gives the ball angle, which is 0 without it.
        encoder_zero : float, optional
            Encoder angle at joint angle 0 [rad], of an absolute encoder.

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
            [s]; one before that of the estimate has no effect.
        torque : float
            At the pendulum since then [N m].
        imu : ImuReading, optional
            The latest, at the ball centre.

        """
        if not stamp > estimate.stamp + SAME:
            return estimate
        mean, covariance = np.empty(SIZE), np.empty((SIZE, SIZE))
        return Estimate(
            predicted(estimate[:3], stamp, torque,
                      NO_SUPPORT if imu is None else (True, imu.forward, imu.upward),
                      self._numbers, mean, covariance),
            mean, covariance, estimate.encoder_zero)

    def with_encoder(self, estimate: Estimate, encoder: float, latency: float = 0.0) -> Estimate:
        """
        Return the estimate corrected by an encoder angle.

        Parameters
        ----------
        estimate : Estimate
        encoder : float
            [rad]
        latency : float
            The angle may have been measured as much later [s], at a time of uniform probability.

        """
        mean, covariance = np.empty(SIZE), np.empty((SIZE, SIZE))
        tuning, rate = self._tuning, estimate.joint_rate
        with_joint_angle(
            estimate[1:3], self.innovation(estimate, encoder),
            tuning.encoder_sd**2 + (tuning.timing_sd**2 + latency**2 / 12.0) * rate**2,
            mean, covariance)
        return Estimate(estimate.stamp, mean, covariance, estimate.encoder_zero)

    def innovation(self, estimate: Estimate, encoder: float) -> float:
        """Return the difference between an encoder angle and its prediction [rad]."""
        return encoder - estimate.encoder_zero - float(estimate.mean[JOINT])

    def with_imu(self, estimate: Estimate, imu: ImuReading, period: float) -> Estimate:
        """
        Return the estimate corrected by an IMU reading.

        Parameters
        ----------
        estimate : Estimate
            At the time of the reading.
        imu : ImuReading
            At the ball centre.
        period : float
            Since the previous reading [s].

        """
        mean, covariance = np.empty(SIZE), np.empty((SIZE, SIZE))
        with_felt(
            estimate[1:3], (imu.turn_rate, imu.forward, imu.upward, imu.turn_acceleration), period,
            self._trust, mean, covariance)
        return Estimate(estimate.stamp, mean, covariance, estimate.encoder_zero)
