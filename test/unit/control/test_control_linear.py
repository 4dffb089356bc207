# SPDX-License-Identifier: Apache-2.0
"""The rolling model follows from its energies, its linearisation from the model."""
import math

import numpy as np
import pytest
import sympy

from ballbot_ros.control import held_acceleration, linear_rolling, rolling_accelerations
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
ANGLES = [0.0, 0.4, math.pi / 2, 2.5, math.pi]


def lagrange():
    """Return phi'' and theta1'' from positions and energies alone, as a function."""
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
    wanted = [phi.diff(time, 2), theta.diff(time, 2)]
    solved = sympy.solve(equations, wanted, dict=True)[0]
    names = sympy.symbols('angle rate ball_rate')
    plain = [solved[item].subs({phi.diff(time): names[1], theta.diff(time): names[2]})
             .subs(phi, names[0]) for item in wanted]
    return sympy.lambdify((*names, torque), plain)


def test_accelerations_are_those_of_the_lagrangian():
    truth = lagrange()
    random = np.random.default_rng(1)
    for state in random.uniform(-3.0, 3.0, (50, 4)):
        assert rolling_accelerations(GIMBALL, *state) == pytest.approx(
            truth(*state), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('angle', ANGLES)
def test_linear_model_is_the_derivative_of_the_exact_one(angle):
    matrix, column = linear_rolling(GIMBALL, angle)
    # The torque under which the pendulum stays where it is while the ball accelerates.
    lever = GIMBALL.pendulum_mass * GIMBALL.pendulum_length
    held = (GIMBALL.largest_gravity_torque * math.sin(angle)
            + lever * math.cos(angle) * held_acceleration(GIMBALL, angle))
    point = np.array([angle, 0.0, 0.0, held])
    assert rolling_accelerations(GIMBALL, *point)[0] == pytest.approx(0.0, abs=1e-9)
    for index in range(4):
        step = np.zeros(4)
        step[index] = 1e-5
        slope = (np.array(rolling_accelerations(GIMBALL, *(point + step)))
                 - np.array(rolling_accelerations(GIMBALL, *(point - step)))) / 2e-5
        predicted = matrix[1:, index] if index < 3 else column[1:]
        assert slope == pytest.approx(predicted, rel=1e-6, abs=1e-6)


def test_held_pendulum_accelerates_the_ball_as_energy_says():
    # Level pendulum: R M2 g e / (J1 + M R^2), there is no coupling at 90 degrees.
    inertia = GIMBALL.ball_inertia + GIMBALL.total_mass * GIMBALL.ball_radius**2
    expected = GIMBALL.ball_radius * GIMBALL.largest_gravity_torque / inertia
    assert held_acceleration(GIMBALL, math.pi / 2) == pytest.approx(expected)
    assert held_acceleration(GIMBALL, -math.pi / 2) == pytest.approx(-expected)


def test_robot_without_pendulum_is_refused():
    with pytest.raises(ConfigurationError, match='no pendulum'):
        linear_rolling(load_robot('shellball'), 0.0)
