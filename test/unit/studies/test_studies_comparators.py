# SPDX-License-Identifier: Apache-2.0
"""Simpler models give the textbook maximum step heights and agree in common limits."""
from dataclasses import replace
import math

from hypothesis import given, strategies as st
import numpy as np
from paper_matrices import mass_matrix
import pytest
from reference_search import crosses
from refusals import refused

from ballbot_ros.crossing import held_at
from ballbot_ros.paper.rigid_impact import (
    EDGE, FLOOR, FLYING, impact_with_restitution, RigidBall)
from ballbot_ros.physics import load_robot, State
from ballbot_ros.studies import comparators

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
LEVEL = math.pi / 2
# A solid sphere of the mass and radius of GimBall, J = 2/5 M R^2.
SOLID = replace(SHELLBALL, name='solid', ball_mass=5.4, ball_radius=0.226,
                ball_inertia=0.4 * 5.4 * 0.226**2)
ROUGH = replace(SOLID, surface_friction=10.0, edge_friction=10.0)
# Each analytical model must be monotone and consistent at all these speeds.
speeds = st.floats(0.01, 3.0)


def test_quasi_static_height_is_that_of_equation_1():
    # The centre of mass is M2 e / M = 0.0233 m off the centre of the ball.
    assert 1e3 * comparators.quasi_static(GIMBALL) == pytest.approx(1.206, abs=5e-4)
    assert comparators.quasi_static(SHELLBALL) == 0.0


def test_at_the_quasi_static_height_the_torques_about_the_edge_balance():
    height = comparators.quasi_static(GIMBALL)
    lever = math.sqrt(GIMBALL.ball_radius**2 - (GIMBALL.ball_radius - height)**2)
    assert GIMBALL.weight * lever == pytest.approx(GIMBALL.largest_gravity_torque, rel=1e-12)


def test_from_rest_the_full_model_lies_between_torque_balance_and_energy():
    # Law (11) holds the pendulum level; the published friction would be too low.
    grippy = replace(GIMBALL, edge_friction=5.0, surface_friction=5.0)
    assert crosses(grippy, 1e-3, 0.8 * comparators.quasi_static(GIMBALL), held_at(LEVEL))
    bound = comparators.energy_with_held_pendulum(GIMBALL, 1e-3, LEVEL)
    assert bound == pytest.approx(4.0 * comparators.quasi_static(GIMBALL), rel=0.01)
    assert not crosses(grippy, 1e-3, 1.2 * bound, held_at(LEVEL))


def test_the_slope_limit_is_that_of_laplante():
    # M2 e / (M R) = 0.1336 gives 7.68 degrees.
    ball = replace(GIMBALL, pendulum_length=0.1336 * 5.4 * 0.226 / 1.6)
    assert math.degrees(ball.slope_limit) == pytest.approx(7.68, abs=0.005)


def test_the_energy_height_of_a_solid_sphere_is_seven_tenths_of_v_squared_over_g():
    # h = v^2 / (2 g) (1 + 2/5)
    assert comparators.energy(SOLID, 0.9) == pytest.approx(0.7 * 0.81 / 9.81, rel=1e-12)


def test_a_held_pendulum_adds_the_work_of_its_torque():
    height = comparators.energy_with_held_pendulum(GIMBALL, 0.6, LEVEL)
    work = GIMBALL.largest_gravity_torque * math.acos(1.0 - height / GIMBALL.ball_radius)
    assert GIMBALL.weight * height == pytest.approx(
        comparators.rolling_energy(GIMBALL, 0.6) + work, rel=1e-9)
    assert comparators.energy_with_held_pendulum(GIMBALL, 0.6, 0.0) == pytest.approx(
        comparators.energy(GIMBALL, 0.6), rel=1e-9)


def test_a_plastic_impact_requires_the_textbook_speed():
    # Solid sphere, h = R/5: v = sqrt(14 g R) / 6.
    speed = math.sqrt(14.0 * 9.81 * SOLID.ball_radius) / 6.0
    assert comparators.plastic_impulse(SOLID, speed) == pytest.approx(
        SOLID.ball_radius / 5.0, rel=1e-12)
    for model in (comparators.free_pendulum_impulse, lambda robot, v:
                  comparators.plastic_impulse_with_held_pendulum(robot, v, 1.0)):
        assert model(SOLID, speed) == pytest.approx(SOLID.ball_radius / 5.0, rel=1e-9)


def impact_by_mass_matrix(robot, speed, height, angle):
    """Return the rates after a plastic impact, and the mass matrix, of all four coordinates."""
    radius = robot.ball_radius
    ahead = radius - height
    up = math.sqrt(radius**2 - ahead**2)
    mass = mass_matrix(robot, State(pendulum_angle=angle))
    before = np.array([-speed / radius, speed / radius, speed, 0.0])
    # The point of the ball at the edge, (up, -ahead) from the centre, comes to rest.
    point = np.array([[ahead, 0.0, 1.0, 0.0], [up, 0.0, 0.0, 1.0]])
    turned = np.linalg.solve(mass, point.T)
    return before - turned @ np.linalg.solve(point @ turned, point @ before), mass


@given(speeds, st.floats(-math.pi, math.pi))
def test_the_free_pendulum_impulse_agrees_with_the_mass_matrix(speed, angle):
    height = comparators.free_pendulum_impulse(GIMBALL, speed, angle)
    if height >= 0.99 * GIMBALL.ball_radius:
        return
    rates, mass = impact_by_mass_matrix(GIMBALL, speed, height, angle)
    swing = mass[1] @ rates  # joint momentum, which the impact does not change
    left_over = 0.5 * swing**2 / mass[1, 1]
    assert 0.5 * rates @ mass @ rates - left_over == pytest.approx(
        GIMBALL.weight * height, rel=1e-6)


@given(speeds)
def test_energy_bounds_every_momentum_model(speed):
    for robot in (GIMBALL, SHELLBALL):
        bound = comparators.energy(robot, speed)
        assert comparators.plastic_impulse(robot, speed) <= bound
        assert comparators.free_pendulum_impulse(robot, speed) <= bound * (1.0 + 1e-9)
    assert (comparators.plastic_impulse_with_held_pendulum(GIMBALL, speed, LEVEL)
            <= comparators.energy_with_held_pendulum(GIMBALL, speed, LEVEL))


@pytest.mark.parametrize('speed', [0.2, 0.6, 1.1])
def test_impacts_without_bounce_or_slip_agree_with_the_plastic_impulse(speed):
    assert impact_with_restitution(ROUGH, speed, 0.0, 1e-7) == pytest.approx(
        comparators.plastic_impulse(ROUGH, speed), abs=1e-6)


def test_a_perfectly_elastic_frictionless_ball_keeps_its_energy_and_turns_back():
    slippery = replace(SOLID, surface_friction=0.0, edge_friction=0.0)
    ball = RigidBall(slippery, 1.0, 0.08, 1.0)
    lean = math.acos(1.0 - 0.08 / 0.226)
    ball.touch(EDGE)
    # The velocity is reflected at the tangent: it turns by twice its angle to it.
    assert (ball.velocity_x, ball.velocity_y) == pytest.approx(
        (math.cos(2.0 * lean), math.sin(2.0 * lean)))
    assert ball.rim_speed == 1.0


def test_a_spinning_ball_that_drops_sticks_as_in_the_textbook():
    # A solid sphere with spin, dropped: sticking takes 2/7 of the rim speed.
    ball = RigidBall(ROUGH, 0.0, 0.08, 0.5)
    ball.rim_speed, ball.velocity_y = 0.7, -2.0
    ball.touch(FLOOR)
    assert (ball.velocity_x, ball.velocity_y, ball.rim_speed) == pytest.approx((0.2, 1.0, 0.2))


def test_friction_limits_the_tangential_impulse():
    ball = RigidBall(replace(SOLID, surface_friction=0.01), 0.0, 0.08, 0.5)
    ball.rim_speed, ball.velocity_y = 0.7, -2.0
    ball.touch(FLOOR)
    assert ball.velocity_x == pytest.approx(0.01 * (1.0 + 0.5) * 2.0)


def test_a_thrown_ball_lands_at_the_end_of_its_parabola():
    ball = RigidBall(SOLID, 0.0, 0.08, 0.9)
    ball.x, ball.velocity_x, ball.velocity_y, ball.on = -2.0, 0.5, 2.0, FLYING
    rising = True
    while rising or ball.velocity_y < 0.0:  # up, down, and up again after the bounce
        rising = rising and ball.velocity_y > 0.0
        ball.fly()
    assert ball.x == pytest.approx(-2.0 + 0.5 * 2.0 * 2.0 / 9.81, abs=1e-6)
    assert ball.velocity_y == pytest.approx(0.9 * 2.0, abs=1e-6)


@pytest.mark.parametrize('model', [
    comparators.energy, comparators.plastic_impulse, comparators.free_pendulum_impulse,
    impact_with_restitution])
def test_a_speed_or_gravity_out_of_range_is_refused_by_every_model(model):
    for speed in (math.nan, -0.5):
        with refused('out_of_range', 'speed'):
            model(GIMBALL, speed)
    with refused('out_of_range', 'gravity'):
        model(replace(GIMBALL, gravity=0.0), 0.5)


@pytest.mark.parametrize('model', [
    comparators.energy, comparators.plastic_impulse, comparators.free_pendulum_impulse])
def test_without_speed_no_step_is_passed_and_the_radius_bounds_all(model):
    assert model(GIMBALL, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert model(GIMBALL, 100.0) <= GIMBALL.ball_radius
