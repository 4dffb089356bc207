# SPDX-License-Identifier: Apache-2.0
"""The filter in textbook matrix form, the reference for the kernels."""
import math

import numpy as np

from ballbot_ros.control import RollingModel
from ballbot_ros.estimation import Estimate, FilterTuning

LONGEST_STEP, STRAY_TIME = 0.005, 0.1


def turned(x, y, angle):
    """Return a vector rotated counter-clockwise by `angle` [rad]."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return x * cosine - y * sine, x * sine + y * cosine


class MatrixFilter:
    """Same filter as `PendulumFilter`, with hand-derived Jacobians of the accelerations."""

    def __init__(self, robot, tuning=FilterTuning()):
        self._robot, self._tuning, self._model = robot, tuning, RollingModel(robot)
        self._inertia = self._model.own[:2]
        self._moment = self._model.robot.pendulum_moment

    def predict(self, estimate, stamp, torque, imu=None):
        """Return the estimate predicted to a later time."""
        while stamp > estimate.stamp + 1e-9:
            step = min(stamp - estimate.stamp, LONGEST_STEP)
            estimate = self._step(estimate, step, torque, imu)
        return estimate

    def _slopes(self, state, torque):
        """Return phi'' and theta1'', and their derivatives by phi, theta2, phi' and theta1'."""
        robot, (pendulum, ball) = self._robot, self._inertia
        angle, _, rate, ball_rate, _ = state
        lever = self._moment * robot.ball_radius
        weight = self._moment * robot.gravity
        sine, cosine = math.sin(angle), math.cos(angle)
        mass = np.array([[pendulum, -lever * cosine], [-lever * cosine, ball]])
        joint = torque - robot.joint_friction * (rate - ball_rate)
        force = np.array([joint - weight * sine,
                          -joint - robot.rolling_friction * ball_rate - lever * sine * rate**2])
        acceleration = np.linalg.solve(mass, force)
        by_angle = np.array([-weight * cosine, -lever * cosine * rate**2]) \
            - np.array([[0.0, lever * sine], [lever * sine, 0.0]]) @ acceleration
        friction = robot.joint_friction
        by_rate = np.array([-friction, friction - 2.0 * lever * sine * rate])
        by_ball_rate = np.array([friction, -friction - robot.rolling_friction])
        columns = np.linalg.solve(mass, np.array([by_angle, by_rate, by_ball_rate]).T)
        return acceleration, np.insert(columns, 1, 0.0, axis=1)

    def _step(self, estimate, step, torque, imu):
        tuning, robot, state = self._tuning, self._robot, estimate.mean
        (swing, roll), slopes = self._slopes(state, torque)
        noises = tuning.pendulum_noise, tuning.ball_noise
        if imu is not None:
            inertia, friction = self._inertia[0], robot.joint_friction
            across, along = turned(imu.forward, imu.upward, -state[1])
            swing = (torque - friction * (state[2] - state[3]) - self._moment * across) / inertia
            slopes[0] = np.array(
                [0.0, -self._moment * along, -friction, friction]) / inertia
            noises = tuning.pendulum_noise_with_imu, tuning.ball_noise_with_imu
        before = state[2:4]
        after = before + step * np.array([swing, roll])
        middle = 0.5 * (before + after)
        mean = np.array([state[0] + step * middle[0],
                         state[1] + step * (middle[0] - middle[1]), *after, state[4]])
        motion = np.zeros((5, 5))
        motion[0, 2] = motion[1, 2] = 1.0
        motion[1, 3] = -1.0
        motion[2:4, :4] = slopes
        transition = np.eye(5) + step * motion
        covariance = transition @ estimate.covariance @ transition.T + step * np.diag(
            [0.0, 0.0, noises[0]**2, noises[1]**2, tuning.gyro_drift**2])
        return Estimate(estimate.stamp + step, mean, covariance, estimate.encoder_zero)

    def with_encoder(self, estimate, encoder, latency):
        """Return the estimate updated with an encoder angle [rad]."""
        timing_variance = self._tuning.timing_sd**2 + latency**2 / 12.0
        return updated(estimate, np.array([0.0, 1.0, 0.0, 0.0, 0.0]),
                       encoder - estimate.encoder_zero - estimate.mean[1],
                       self._tuning.encoder_sd**2
                       + timing_variance * (estimate.mean[2] - estimate.mean[3])**2)

    def with_imu(self, estimate, imu, period):
        """Return the estimate updated with an IMU reading."""
        tuning, robot = self._tuning, self._robot
        estimate = updated(estimate, np.array([0.0, 0.0, 0.0, 1.0, 1.0]),
                           imu.turn_rate - estimate.mean[3] - estimate.mean[4],
                           tuning.gyro_sd**2)
        if abs(math.hypot(imu.forward, imu.upward) - robot.gravity) > tuning.gravity_gate:
            return estimate
        forward, upward = turned(imu.forward, imu.upward, estimate.mean[0] - estimate.mean[1])
        return updated(estimate, np.array([-upward, upward, 0.0, 0.0, 0.0]),
                       -robot.ball_radius * imu.turn_acceleration - forward,
                       tuning.gravity_sd**2 * max(1.0, STRAY_TIME / max(period, 1e-6)))


def updated(estimate, row, innovation, variance):
    """Return the estimate after a scalar measurement with a row, innovation and variance."""
    across = estimate.covariance @ row
    gain = across / (row @ across + variance)
    return estimate._replace(mean=estimate.mean + gain * innovation,
                             covariance=estimate.covariance - np.outer(gain, across))
