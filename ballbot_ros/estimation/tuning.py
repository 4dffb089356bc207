# SPDX-License-Identifier: Apache-2.0
"""Noise of the sensors and models of the filter, with units and ranges."""
from dataclasses import dataclass

from ballbot_ros.config.fields import Checked, quantity


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
        'rad/s/sqrt(s)', 'how fast the bias of the gyro wanders', default=1e-4, minimum=0.0)
    gravity_sd: float = quantity(
        'm/s2', 'how far the forward specific force strays from that of rolling, for 0.1 s',
        default=3.0, above=0.0)
    gravity_gate: float = quantity(
        'm/s2', 'difference of the specific force from g beyond which it does not show where down '
        'is', default=2.0, above=0.0)
    pendulum_noise: float = quantity(
        'rad/s2/sqrt(Hz)', 'acceleration of the pendulum that the model does not include, '
        'per root of bandwidth', default=0.5, above=0.0)
    ball_noise: float = quantity(
        'rad/s2/sqrt(Hz)', 'acceleration of the ball that the model does not include, per '
        'root of bandwidth', default=0.5, above=0.0)
    ball_noise_with_imu: float = quantity(
        'rad/s2/sqrt(Hz)', 'ball_noise where a gyro measures the ball, so that slip can be '
        'followed',
        default=30.0, above=0.0)
    pendulum_noise_with_imu: float = quantity(
        'rad/s2/sqrt(Hz)', 'pendulum_noise where an IMU measures the motion of its support',
        default=20.0, above=0.0)
    start_sd: float = quantity(
        'rad', 'how far from straight down a pendulum at rest may hang', default=0.03, above=0.0)
    bias_sd: float = quantity(
        'rad/s', 'standard deviation of the bias of the gyro at the start', default=0.01,
        above=0.0)
