# SPDX-License-Identifier: Apache-2.0
"""Only an IMU separates the slope of the floor, the lean of the pendulum and a torque error."""
import math

import numpy as np
import pytest
from scipy.linalg import expm

from ballbot_ros.control import RollingModel
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')


@pytest.mark.parametrize('imu', [False, True])
@pytest.mark.parametrize('angle', [0.0, 0.2, 1.0, -1.3, 2.8])
def test_the_rank_of_the_observability_gramian_of_one_second(imu, angle):
    # Linear motion about the held pendulum; the unknowns are angles, rates, a torque and a slope.
    # The unobservable directions over one second are the null space of the Gramian.
    model, bot = RollingModel(GIMBALL), GIMBALL
    matrix, column = model.about_held(angle)
    motion = np.zeros((6, 6))
    motion[:3, :3], motion[:3, 4] = matrix, column
    on_slope = 1e-6  # [rad]; gravity is rotated, so that phi is relative to the floor normal
    weight = bot.total_mass * bot.gravity * math.sin(on_slope) * bot.ball_radius
    motion[1:3, 5] = np.array(model.response(angle, 0.0, weight)) / on_slope
    motion[3, 1:3] = 1.0, -1.0
    outputs = [[0, 0, 0, 1, 0, 0]]
    if imu:
        force = np.array([bot.gravity, 0, 0, -bot.gravity, 0, 0]) - bot.ball_radius * motion[2]
        outputs += [[0, 0, 1, 0, 0, 0], force]
    rows = np.vstack([outputs @ expm(motion * time) for time in np.linspace(0.0, 1.0, 60)])
    _, strengths, directions = np.linalg.svd(rows)
    rank = int((strengths > 1e-8 * strengths[0]).sum())
    assert rank == (6 if imu else 5)
    if not imu:
        assert (np.abs(directions[-1]) > 1e-6).tolist() == [True, False, False, False, True, True]
