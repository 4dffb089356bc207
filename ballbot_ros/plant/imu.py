# SPDX-License-Identifier: Apache-2.0
"""The simulated IMU: readings of a gyro and an accelerometer in the shell."""
import math
from typing import NamedTuple

import numpy as np

from ballbot_ros.physics.model.state import State


class ImuSample(NamedTuple):
    """A reading in the frame of the shell; ball angle 0 has z up."""

    time: float  # [s]
    turn_rate: float  # counter-clockwise positive [rad/s]
    forward: float  # specific force along the shell's x and z axes [m/s2]
    upward: float


class Imu:
    """
    Returns the mean over each sampling period, like an IMU with an anti-aliasing filter.

    The noise of sample number n depends only on the seed and n.  `place` is its position ahead of
    and above the ball centre, in the frame of the shell [m]; `gyro_sd` and `force_sd` are the
    white noise per sample [rad/s], [m/s2], and `bias` is that of the gyro [rad/s].
    """

    def __init__(self, gravity: float, place: tuple[float, float] = (0.0, 0.0),
                 gyro_sd: float = 0.0, force_sd: float = 0.0, bias: float = 0.0, seed: int = 0):
        self._gravity, self._place = gravity, place
        self._gyro_sd, self._force_sd, self._bias, self._seed = gyro_sd, force_sd, bias, seed

    def sample(self, before: State, after: State, number: int) -> ImuSample:
        """Return the reading between two states; `number` determines the noise."""
        period = after.time - before.time
        rate = 0.5 * (before.ball_rate + after.ball_rate)
        turning = (after.ball_rate - before.ball_rate) / period
        forward = (after.velocity_x - before.velocity_x) / period
        upward = (after.velocity_y - before.velocity_y) / period + self._gravity
        angle = 0.5 * (before.ball_angle + after.ball_angle)
        sine, cosine = math.sin(angle), math.cos(angle)
        ahead, above = self._place
        gyro = noise_x = noise_y = 0.0
        if self._gyro_sd or self._force_sd:  # creating a generator takes as long as a plant period
            gyro, noise_x, noise_y = np.random.default_rng(
                [self._seed, number]).standard_normal(3).tolist()
        return ImuSample(
            after.time, rate + self._bias + self._gyro_sd * gyro,
            forward * cosine + upward * sine - rate**2 * ahead - turning * above
            + self._force_sd * noise_x,
            upward * cosine - forward * sine - rate**2 * above + turning * ahead
            + self._force_sd * noise_y)
