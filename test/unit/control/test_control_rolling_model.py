# SPDX-License-Identifier: Apache-2.0
"""The rolling model agrees with its Lagrangian, and its linearisation with the model."""
import math

from hypothesis import given, strategies
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.control import ControlTuning, PendulumController, RollingModel
from ballbot_ros.control.rolling_model import rolling_accelerations, rolling_linearised
from ballbot_ros.control.speed_law import SpeedLaw
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant

GIMBALL = load_robot('gimball')
MODEL = RollingModel(GIMBALL)
ANGLES = [0.0, 0.4, math.pi / 2, 2.5, math.pi]
angles = strategies.floats(-3.0, 3.0)
rates = strategies.floats(-20.0, 20.0)
torques = strategies.floats(-4.0, 4.0)


def lagrange():
    """Return a function for phi'' and theta1'', derived from the Lagrangian."""
    import sympy
    time = sympy.symbols('t')
    phi, theta = sympy.Function('phi')(time), sympy.Function('theta')(time)
    torque = sympy.symbols('tau')
    bot = GIMBALL
    mass, length, radius = bot.pendulum_mass, bot.pendulum_length, bot.ball_radius
    ball_x = -radius * theta
    x, y = ball_x + length * sympy.sin(phi), -length * sympy.cos(phi)
    kinetic = (bot.ball_inertia * theta.diff(time)**2 + bot.ball_mass * ball_x.diff(time)**2
               + bot.pendulum_inertia * phi.diff(time)**2
               + mass * (x.diff(time)**2 + y.diff(time)**2)) / 2
    energy = kinetic - mass * bot.gravity * y
    joint = torque - bot.joint_friction * (phi.diff(time) - theta.diff(time))
    forces = {phi: joint, theta: -joint - bot.rolling_friction * theta.diff(time)}
    equations = [energy.diff(angle.diff(time)).diff(time) - energy.diff(angle) - force
                 for angle, force in forces.items()]
    unknowns = [phi.diff(time, 2), theta.diff(time, 2)]
    solved = sympy.solve(equations, unknowns, dict=True)[0]
    names = sympy.symbols('angle rate ball_rate')
    plain = [solved[item].subs({phi.diff(time): names[1], theta.diff(time): names[2]})
             .subs(phi, names[0]) for item in unknowns]
    return sympy.lambdify((*names, torque), plain)


@pytest.mark.slow
def test_the_accelerations_agree_with_the_lagrangian():
    truth = lagrange()
    random = np.random.default_rng(1)
    for state in random.uniform(-3.0, 3.0, (50, 4)):
        assert rolling_accelerations(*state, MODEL.numbers) == pytest.approx(
            truth(*state), rel=1e-9, abs=1e-9)


@pytest.mark.slow
def test_the_full_model_agrees_with_the_rolling_model():
    # Stiff ground makes the penetration negligible.
    scene = read_scene({
        'robot': 'gimball', 'robot_changes': {'contact_stiffness': 1e8},
        'terrain': [{'flat': {'length': 30.0}}], 'initial': {'x': 1.0}, 'duration': 1.0}, '', '')
    plant, rolling = Plant(scene, 500.0), np.zeros(3)
    for number in range(500):
        torque = 1.2 * math.sin(6.0 * plant.time)
        state = plant.advance(torque)
        middle = rolling
        for _ in range(3):  # implicit midpoint
            swing, roll = rolling_accelerations(*middle, torque, MODEL.numbers)
            middle = rolling + 0.001 * np.array([middle[1], swing, roll])
        rolling = 2.0 * middle - rolling
    assert abs(state.pendulum_angle) > 0.2
    assert (state.pendulum_angle, state.pendulum_rate, state.ball_rate) == pytest.approx(
        rolling, abs=5e-3)


@given(angles, rates, rates, torques)
def test_the_derivatives_agree_with_finite_differences(angle, rate, ball_rate, torque):
    point, step = np.array([angle, rate, ball_rate]), 1e-5
    for row, acceleration in enumerate(rolling_linearised(*point, torque, MODEL.numbers)):
        assert acceleration[0] == rolling_accelerations(*point, torque, MODEL.numbers)[row]
        for index, slope in enumerate(acceleration[1:]):
            shift = step * np.eye(3)[index]
            ahead, behind = (rolling_accelerations(*near, torque, MODEL.numbers)[row]
                             for near in (point + shift, point - shift))
            assert slope == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-4, abs=1e-3)


@given(angles, rates, rates, torques)
def test_the_power_is_that_of_the_motor_less_friction(angle, rate, ball_rate, torque):
    pendulum, ball = rolling_accelerations(angle, rate, ball_rate, torque, MODEL.numbers)
    bot, slip = GIMBALL, rate - ball_rate
    moment, radius = bot.pendulum_mass * bot.pendulum_length, bot.ball_radius
    swing = bot.pendulum_inertia + moment * bot.pendulum_length
    power = (swing * rate * pendulum
             + (bot.ball_inertia + bot.total_mass * radius**2) * ball_rate * ball
             - moment * radius * math.cos(angle) * (ball * rate + ball_rate * pendulum)
             + moment * radius * math.sin(angle) * rate * ball_rate * rate
             + moment * bot.gravity * math.sin(angle) * rate)
    expected = (torque * slip - bot.joint_friction * slip**2
                - bot.rolling_friction * ball_rate**2)
    assert power == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize('angle', ANGLES)
def test_about_held_is_the_derivative_of_the_model(angle):
    matrix, column = MODEL.about_held(angle)
    # The torque that keeps the pendulum angle constant while the ball accelerates.
    lever = GIMBALL.pendulum_mass * GIMBALL.pendulum_length
    held = (GIMBALL.largest_gravity_torque * math.sin(angle)
            + lever * math.cos(angle) * MODEL.held_acceleration(angle))
    pendulum, ball = rolling_accelerations(angle, 0.0, 0.0, held, MODEL.numbers)
    assert pendulum == pytest.approx(0.0, abs=1e-9)
    assert -GIMBALL.ball_radius * ball == pytest.approx(MODEL.held_acceleration(angle))
    assert matrix[0].tolist() == [0.0, 1.0, 0.0] and column[0] == 0.0
    pushed = np.array(rolling_accelerations(angle, 0.0, 0.0, held + 2.0, MODEL.numbers))
    assert 2.0 * column[1:] == pytest.approx(pushed - (pendulum, ball))
    for row, acceleration in enumerate(rolling_linearised(angle, 0.0, 0.0, held, MODEL.numbers)):
        assert matrix[row + 1] == pytest.approx(acceleration[1:])


def test_a_level_pendulum_accelerates_the_ball_by_its_weight_only():
    # R M2 g e / (J1 + M R^2): the inertial coupling is zero at 90 degrees.
    inertia = GIMBALL.ball_inertia + GIMBALL.total_mass * GIMBALL.ball_radius**2
    expected = GIMBALL.ball_radius * GIMBALL.largest_gravity_torque / inertia
    assert MODEL.held_acceleration(math.pi / 2) == pytest.approx(expected)
    assert MODEL.held_acceleration(-math.pi / 2) == pytest.approx(-expected)


@pytest.mark.parametrize('make', [
    RollingModel, lambda robot: PendulumController(robot, ControlTuning()),
    lambda robot: SpeedLaw.tuned(robot, ControlTuning())])
def test_a_robot_without_a_pendulum_is_refused(make, shellball):
    with refused('inconsistent', 'pendulum_mass'):
        make(shellball)
