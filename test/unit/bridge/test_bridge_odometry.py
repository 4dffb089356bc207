# SPDX-License-Identifier: Apache-2.0
"""A session keeps the position of its ball, even if the drive is configured again."""
import math

import pytest
from virtual_robot import STEP, VirtualRobot

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.sensing import Sensing
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot


def take(sensing, time):
    """Feed an answer of a drive whose motor is at rest."""
    sensing.take(Telemetry(time=time, measured=time, position=0.0))


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


def test_speed_is_reported_at_the_last_imu_reading_unless_that_is_stale():
    sensing = Sensing(load_hardware('gimball_odrive'), load_robot('gimball'))
    sensing.begin(10.0)
    for number in range(1, 11):
        sensing.fusion.imu(ImuReading(10.0 + number * STEP, 0.0, 0.0, 9.81))
        take(sensing, 10.0 + number * STEP)
    for number in range(11, 20):  # the IMU is late
        take(sensing, 10.0 + number * STEP)
    steady, newest = sensing.steady_odometry(), sensing.odometry
    assert steady.stamp == pytest.approx(10.02) and newest.stamp == pytest.approx(10.038)
    assert steady.speed_variance < 0.01 * newest.speed_variance
    take(sensing, 10.06)
    assert sensing.steady_odometry() is sensing.odometry
    sensing.fusion.imu(ImuReading(10.061, 0.0, 0.0, 9.81))
    take(sensing, 10.062)
    assert sensing.steady_odometry().stamp == pytest.approx(10.061)


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
