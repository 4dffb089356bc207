# SPDX-License-Identifier: Apache-2.0
"""Unobservable quantities: the null space of the observability matrix."""
from typing import List

import numpy as np

from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.physics.model.robot import Robot

# Columns of the matrix below.
NAMES = ('pendulum angle', 'pendulum rate', 'ball rate', 'joint angle', 'constant torque',
         'slope of the floor')
# Singular values below this fraction of the largest count as zero.
THRESHOLD = 1e-9


def unobservable(robot: Robot, imu: bool, angle: float = 0.0) -> List[str]:
    """
    Return the quantities that readings over time do not determine, for linearised motion.

    The unknowns are the state of the rolling ball, a constant torque error (unmodelled
    friction, a wrong torque constant) and the slope of the floor.

    Parameters
    ----------
    robot : Robot
    imu : bool
        Whether a gyro and an accelerometer are available in addition to the encoder.
    angle : float
        Pendulum angle about which to linearise [rad].

    Returns
    -------
    list of str
        Quantities in an unobservable combination.

    """
    model = RollingModel(robot)
    size = len(NAMES)
    motion = np.zeros((size, size))
    motion[:3, :3], motion[:3, 4] = model.about_held(angle)
    # The weight on a slope acts as a torque M g R per radian about the contact point.
    motion[1:3, 5] = model.response(angle, 0.0, robot.weight * robot.ball_radius)
    pendulum_angle, pendulum_rate, ball_rate, joint_angle, _, _ = np.eye(size)
    motion[3] = pendulum_rate - ball_rate
    readings = [joint_angle]
    if imu:
        # Direction of the specific force: ball angle times g, and the acceleration of rolling.
        readings += [ball_rate, robot.gravity * (pendulum_angle - joint_angle)
                     - robot.ball_radius * motion[2]]
    # The time unit is a tenth of a second, which scales the high powers of the matrix.
    rows = np.vstack([readings @ np.linalg.matrix_power(motion / 10.0, power)
                      for power in range(size)])
    _, strengths, directions = np.linalg.svd(rows)
    missing = directions[strengths < THRESHOLD * strengths[0]]
    weights = np.abs(missing).max(axis=0, initial=0.0)
    return [name for name, weight in zip(NAMES, weights) if weight > 1e-6]
