# SPDX-License-Identifier: Apache-2.0
"""Gear, encoder and inertial sensor between the drive and the ball."""
import math

import pytest
from refusals import refused

from ballbot_ros.drives.emulated_device import Sensed
from ballbot_ros.emulator.ball import Ball, settings_for
from ballbot_ros.physics.simulation.scene import load_scene, read_scene


@pytest.fixture
def settings(gimball):
    """Return a drive that fits GimBall."""
    return settings_for(gimball)


def scene(**initial):
    """Return GimBall on a level floor."""
    return read_scene({'robot': 'gimball', 'initial': initial, 'duration': 1.0}, 'test', 'test')


def test_the_torque_at_the_pendulum_is_that_of_the_motor_through_its_gear(settings, gimball):
    ball = Ball(load_scene('flat'), settings)
    motor = gimball.motor
    assert ball.pendulum_torque(0.01) == pytest.approx(
        0.01 * motor.gear_ratio * motor.gear_efficiency)
    assert ball.pendulum_torque(settings.torque_limit) == pytest.approx(motor.maximum_torque)


def test_a_torque_at_the_shaft_accelerates_the_pendulum_through_the_gear(settings, gimball):
    ball = Ball(load_scene('flat'), settings)
    torque = 0.01
    ball.advance(torque)
    # phi'' = tau / (J2 + M2 e^2 M1 / M) from rest; see physics/mechanics/equations.py.
    own = gimball.pendulum_mass * gimball.pendulum_length**2
    inertia = gimball.pendulum_inertia + own * gimball.ball_mass / gimball.total_mass
    assert ball.state.pendulum_rate == pytest.approx(
        ball.pendulum_torque(torque) / inertia * 1e-3, rel=0.05)


def test_the_encoder_reads_the_joint_in_counts_of_the_motor_shaft(settings):
    ball = Ball(scene(pendulum_angle_deg=30.0), settings)
    sensed = ball.sensed(Sensed())
    exact = 50.0 * math.radians(30.0)
    assert 0.0 <= exact - sensed.position < math.tau / 4096
    assert sensed.position / (math.tau / 4096) == pytest.approx(
        round(sensed.position / (math.tau / 4096)))
    assert ball.sensed(Sensed(), jump=math.pi).position - sensed.position == pytest.approx(
        math.pi, abs=2e-3)


def test_at_rest_the_sensor_reads_gravity_along_y(settings):
    ball = Ball(load_scene('flat'), settings)
    for _ in range(10):
        ball.advance(0.0)
    imu = ball.imu()
    assert (imu.turn_rate, imu.forward) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert imu.upward == pytest.approx(9.81, abs=1e-3)


def test_in_free_fall_the_sensor_reads_nothing_but_the_pendulum(settings, gimball):
    ball = Ball(scene(x=0.0, y=5.0), settings)
    for _ in range(10):
        ball.advance(0.0)
    imu = ball.imu()
    assert math.hypot(imu.forward, imu.upward) == pytest.approx(0.0, abs=1e-6)


def test_the_axes_of_the_sensor_turn_with_the_shell(settings):
    ball = Ball(scene(speed=0.5), settings)
    for _ in range(300):
        ball.advance(0.0)
    imu, state = ball.imu(), ball.state
    assert imu.turn_rate == pytest.approx(state.ball_rate, rel=1e-2)
    # Rotated back, gravity is again along the y axis of the world.
    up = math.cos(state.ball_angle) * imu.upward + math.sin(state.ball_angle) * imu.forward
    assert state.ball_angle < -0.5 and up == pytest.approx(9.81, abs=0.3)


def test_a_robot_without_a_motor_is_refused(shellball):
    with refused('missing', 'robot'):
        settings_for(shellball)


@pytest.mark.slow
def test_a_lean_that_is_no_longer_driven_never_stops_the_ball(settings):
    """Beyond a tilt of 90 degrees the lateral model is not valid."""
    ball = Ball(scene(speed=0.4), settings)
    newton_metre = 1.0 / ball.pendulum_torque(1.0)
    for period in range(16000):
        torque = newton_metre * math.sin(3e-3 * period) if period < 1000 else 0.0
        ball.advance(0.0, torque)
        assert abs(ball.lateral.tilt) < 0.5 * math.pi
    assert all(map(math.isfinite, ball.lateral))


def test_a_lean_turns_the_course_and_a_straight_ball_keeps_to_the_x_axis(settings):
    ball, straight = Ball(scene(speed=0.4), settings), Ball(scene(speed=0.4), settings)
    newton_metre = 1.0 / ball.pendulum_torque(1.0)
    for _ in range(1000):
        ball.advance(0.0, 0.05 * newton_metre)
        straight.advance(0.0)
    assert straight.course.pose == pytest.approx((straight.state.x, 0.0, 0.0))
    assert ball.course.pose[2] == ball.lateral.heading != 0.0
    assert ball.course.y * ball.lateral.heading > 0.0
