# SPDX-License-Identifier: Apache-2.0
"""A session keeps the position of its ball, even if the drive is configured again."""
import math

import pytest
from virtual_robot import VirtualRobot


def test_odometry_follows_a_ball_under_torque():
    robot = VirtualRobot().ready()
    before = robot.plant.state.x
    start = robot.session.odometry.position
    robot.run(2.0, torque=0.5)
    found = robot.session.odometry
    distance = robot.plant.state.x - before
    assert distance > 0.3
    assert abs(found.position - start - distance) < 3.0 * math.sqrt(found.position_variance) < 0.1
    assert found.speed == pytest.approx(robot.plant.state.velocity_x, abs=0.02)


def test_without_an_imu_the_newest_odometry_is_reported():
    robot = VirtualRobot(imu=False).ready()
    robot.run(0.5, torque=0.2)
    assert robot.session.odometry is robot.session.sensing.odometry


def test_the_position_is_kept_when_the_drive_is_configured_again():
    robot = VirtualRobot().ready()
    robot.run(1.0, torque=0.5)
    before = robot.session.odometry
    robot.session.configure()
    robot.run(0.1)
    after = robot.session.odometry
    assert after.stamp > before.stamp
    assert after.position == pytest.approx(before.position, abs=0.3)
    assert after.position_variance > 0.0
