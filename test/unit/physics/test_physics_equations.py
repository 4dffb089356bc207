# SPDX-License-Identifier: Apache-2.0
"""The printed matrices follow from the energies, and the closed form from the matrices."""
from functools import cache
import math

import numpy as np
import paper_matrices as matrices
import pytest

from ballbot_ros.physics import ContactOptions, load_robot, State, Terrain
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.actuation import Actuator, TORQUE
from ballbot_ros.physics.model.robot import Parameters, Robot
from ballbot_ros.physics.model.state import (
    BALL_RATE, MOTOR_WORK, PENDULUM_RATE, SIZE, VELOCITY_X, VELOCITY_Y)

MATRICES = ('A', 'B', 'C', 'D', 'G')


@cache
def lagrange():
    """Return A, B, C, D and G derived from eqs. (4) and (5) for alpha = 0, and their symbols."""
    import sympy
    symbols = sympy.symbols('phi M1 M2 J1 J2 e c1 c2 g')
    phi, mass1, mass2, inertia1, inertia2, length, friction1, friction2, gravity = symbols
    time = sympy.symbols('t')
    coordinates = [sympy.Function(name)(time) for name in ('th1', 'th2', 'x', 'y')]
    angle = coordinates[0] + coordinates[1]
    rates = [item.diff(time) for item in coordinates]
    ball, joint, velocity_x, velocity_y = rates
    swing = ball + joint
    kinetic = (inertia1 * ball**2 + mass1 * (velocity_x**2 + velocity_y**2)
               + mass2 * (velocity_x + length * swing * sympy.cos(angle))**2
               + mass2 * (velocity_y + length * swing * sympy.sin(angle))**2
               + inertia2 * swing**2) / 2
    potential = (mass1 * gravity * coordinates[3]
                 + mass2 * gravity * (coordinates[3] - length * sympy.cos(angle)))
    # Friction dissipates c1 th1'^2 + c2 th2'^2: twice this Rayleigh function.
    dissipation = (friction1 * ball**2 + friction2 * joint**2) / 2
    accelerations = sympy.symbols('a1:5')
    plain = sympy.symbols('w1:5')
    rows = []
    for coordinate, rate in zip(coordinates, rates):
        row = (kinetic.diff(rate).diff(time) - (kinetic - potential).diff(coordinate)
               + dissipation.diff(rate))
        row = row.subs([(one.diff(time, 2), two) for one, two in zip(coordinates, accelerations)])
        row = row.subs(list(zip(rates, plain)))
        rows.append(sympy.expand(row.subs(coordinates[1], phi - coordinates[0])))
    products = {'A': accelerations, 'B': [item**2 for item in plain],
                'C': [plain[0] * plain[1], plain[1] * plain[2], plain[2] * plain[3],
                      plain[2] * plain[0]], 'D': plain}
    found, rest = {}, list(rows)
    for name, columns in products.items():
        matrix = sympy.zeros(4, 4)
        for line in range(4):
            poly = sympy.Poly(rows[line], *accelerations, *plain)
            for column, item in enumerate(columns):
                matrix[line, column] = sympy.simplify(poly.coeff_monomial(item))
                rest[line] -= matrix[line, column] * item
        found[name] = matrix
    found['G'] = sympy.Matrix([sympy.simplify(item) for item in rest])
    return found, symbols


@pytest.mark.slow
def test_the_five_matrices_contain_all_terms_of_the_lagrangian():
    # G above is the remainder after the four matrices: it must not contain rates.
    found, symbols = lagrange()
    assert found['G'].free_symbols <= {*symbols}


@pytest.mark.slow
@pytest.mark.parametrize('name', MATRICES)
def test_each_matrix_element_follows_from_the_lagrangian(name):
    import sympy
    found, symbols = lagrange()
    numeric = sympy.lambdify(symbols, found[name])
    random = np.random.default_rng(1)
    for _ in range(20):
        values = random.uniform(0.1, 2.0, 8)
        bot = Robot(
            'any', *values[[0, 2]], 3.0, *values[[1, 3, 4, 5, 6]], 1e4, 10.0, 0.2, 0.1,
            gravity=values[7])
        state = State(pendulum_angle=random.uniform(-4.0, 4.0))
        state = state._replace(ball_angle=random.uniform(-9.0, 9.0))
        own = {'A': lambda: matrices.mass_matrix(bot, state),
               'B': lambda: matrices.centrifugal_matrix(bot, state),
               'C': lambda: matrices.coriolis_matrix(bot, state),
               'D': lambda: matrices.friction_matrix(bot),
               'G': lambda: matrices.gravity_vector(bot, state)}[name]()
        expected = np.array(numeric(state.pendulum_angle, *values), dtype=float)
        expected = expected.reshape(own.shape)
        np.testing.assert_allclose(own, expected, rtol=1e-13, atol=1e-15)
        # A zero in the paper is an exact zero here, not a small number.
        assert np.array_equal(own == 0.0, expected == 0.0)


def random_case(random):
    """Return a robot, a state pressed into a corner, an actuator, the ground and the options."""
    mass, own = random.uniform(0.2, 6.0, 2)
    inertia, swing = random.uniform(0.005, 0.2, 2)
    radius = random.uniform(0.1, 0.4)
    bot = Robot('any', mass, inertia, radius, own, swing, radius * random.uniform(0.0, 1.0),
                random.uniform(0.0, 0.1), random.uniform(0.0, 0.3), random.uniform(1e3, 1e5),
                random.uniform(0.0, 200.0), random.uniform(0.0, 1.0), random.uniform(0.0, 1.0))
    ground = Terrain.step(2.0 * radius).profile(bot.surface_friction, bot.edge_friction)
    state = State(0.0, *random.uniform(-9.0, 9.0, 2), *(
        radius * random.uniform(0.9, 1.02, 2) * [-1.0, 1.0]), *random.uniform(-9.0, 9.0, 2),
        *random.uniform(-2.0, 2.0, 2))
    drive = Actuator(TORQUE, random.uniform(-9.0, 9.0))
    return bot, state, drive, ground, ContactOptions(pulling=bool(random.integers(2)))


def rates_and_loads(bot, state, actuator, ground, options):
    """Return the derivative of the state vector and the contact loads."""
    parameters, mode = Parameters.of(bot, options), contact.ContactMode.of(len(ground))
    vector, rates = np.array(state[1:]), np.zeros(SIZE)
    equations.derivative(0.0, vector, System(parameters, ground, actuator), mode, rates)
    return rates, contact.contact_loads(vector, parameters, ground, mode)


def test_the_closed_form_solves_equation_13():
    random = np.random.default_rng(13)
    pressed = 0
    for _ in range(1000):
        bot, state, drive, ground, options = random_case(random)
        rates, (force_x, force_y, torque, _, _) = rates_and_loads(
            bot, state, drive, ground, options)
        pressed += force_x != 0.0 and force_y != 0.0
        solved = matrices.accelerations_by_solve(
            bot, state, torque, drive.set_value, force_x, force_y)
        closed = rates[[BALL_RATE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y]]
        closed[1] -= closed[0]  # theta2'' is that of the joint
        error = np.abs(closed - solved)
        assert error[:2].max() <= 1e-12 * np.abs(solved[:2]).max()
        assert error[2:].max() <= 1e-12 * np.abs(solved[2:]).max()
    assert pressed > 600  # most of them with forces in both directions


def test_the_closed_form_of_the_empty_ball_obeys_newtons_second_law(shellball):
    random = np.random.default_rng(2)
    for _ in range(200):
        _, state, _, _, options = random_case(random)
        state = state._replace(
            x=-shellball.ball_radius * random.uniform(0.99, 1.0),
            y=shellball.ball_radius * random.uniform(0.99, 1.0))
        ground = Terrain.step(1.0).profile(
            shellball.surface_friction, shellball.edge_friction)
        rates, (force_x, force_y, torque, _, _) = rates_and_loads(
            shellball, state, Actuator(), ground, options)
        assert rates[VELOCITY_X] == pytest.approx(force_x / 1.1, rel=1e-14)
        assert rates[VELOCITY_Y] == pytest.approx(force_y / 1.1 - 9.81, rel=1e-14)
        assert rates[BALL_RATE] == pytest.approx(
            (torque - 0.005 * state.ball_rate) / 0.011, rel=1e-14)
        assert rates[PENDULUM_RATE] == rates[MOTOR_WORK] == 0.0


def test_mass_matrix_of_the_empty_ball_is_singular(shellball):
    matrix = matrices.mass_matrix(shellball, State())
    assert np.linalg.matrix_rank(matrix) == 3
    assert not matrix[1].any()


def test_the_determinant_is_the_divisor_of_the_closed_form(gimball):
    numbers = Parameters.of(gimball, ContactOptions())
    for angle in np.linspace(-math.pi, math.pi, 13):
        assert np.linalg.det(matrices.mass_matrix(
            gimball, State(pendulum_angle=angle))) == pytest.approx(
                numbers.ball_inertia * numbers.mass**2 * numbers.swing_inertia, rel=1e-12)


def test_the_energies_agree_with_equations_4_and_5():
    random = np.random.default_rng(4)
    bot = load_robot('gimball')
    numbers = Parameters.of(bot, ContactOptions())
    for _ in range(50):
        state = State(0.0, *random.uniform(-3.0, 3.0, 8))
        swing, angle = state.pendulum_rate, state.pendulum_angle
        velocity = np.array([state.velocity_x, state.velocity_y])
        tip = velocity + bot.pendulum_length * swing * np.array(
            [math.cos(angle), math.sin(angle)])
        kinetic = 0.5 * (bot.ball_mass * velocity @ velocity
                         + bot.ball_inertia * state.ball_rate**2
                         + bot.pendulum_mass * tip @ tip + bot.pendulum_inertia * swing**2)
        tip_height = state.y - bot.pendulum_length * math.cos(angle)
        potential = bot.gravity * (bot.ball_mass * state.y + bot.pendulum_mass * tip_height)
        vector = np.array(state[1:])
        assert equations.kinetic_energy(vector, numbers) == pytest.approx(kinetic, rel=1e-12)
        assert equations.potential_energy(vector, numbers) == pytest.approx(potential, rel=1e-12)
