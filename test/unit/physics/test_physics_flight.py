# SPDX-License-Identifier: Apache-2.0
"""Closed-form flight agrees with the full model and never passes a touchdown."""
from dataclasses import replace
import math

from contact_cases import rough
from hypothesis import example, given, settings
from hypothesis import strategies as some
import numpy as np
import pytest

from ballbot_ros.physics import Actuation, load_robot, Model, simulate, Solver, State, Terrain
from ballbot_ros.physics.mechanics import contact, equations, modes
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, JOINT_LOSS, PENDULUM_RATE, ROLLING_LOSS, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.solvers import flight

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
ROUGH = rough(notch=-0.3)
LAWS = [Actuation(), Actuation('torque', torque=0.5), Actuation('voltage', voltage=4.0)]
START = State(x=0.0, y=1.0, pendulum_angle=0.5, velocity_x=1.0, velocity_y=0.5, ball_rate=-7.0,
              pendulum_rate=3.0)


def fly(model, start, actuation, time):
    """Return the state vector after the given flight time [s]."""
    actuator, vector = actuation.actuator(model.robot), np.array(start[1:])
    out = np.zeros(SIZE)
    spin = flight.spin_start(vector, model.parameters, actuator)
    flight.fly(vector, time, spin, model.parameters, out)
    flight.add_to_ledger(vector, time, spin, model.parameters, actuator, out)
    return out


def touch(model, start, actuation, most=3.0, width=1e-12):
    vector = np.array(start[1:])
    spin = flight.spin_start(vector, model.parameters, actuation.actuator(model.robot))
    return flight.time_of_touch(vector, most, width, spin, model.parameters, model.profile)


@pytest.mark.parametrize('changes', [
    {}, {'rolling_friction': 0.0}, {'joint_friction': 0.0}, {'joint_friction': 8.0},
    {'rolling_friction': 0.0, 'joint_friction': 0.0}, {'pendulum_length': 0.0}], ids=str)
@pytest.mark.parametrize('actuation', LAWS, ids=lambda law: law.law)
def test_closed_form_flight_equals_the_full_model_without_contact(changes, actuation):
    solver = Solver('adaptive', tolerance=1e-13, models='full')
    model = Model(replace(GIMBALL, **changes), Terrain([[0.0, -9.0], [1.0, -9.0]]), solver=solver)
    full = simulate(model, START, actuation, 0.4, 0.1)
    for row in full.rows:
        found = fly(model, START, actuation, row[0])
        assert found == pytest.approx(row[1:-1], abs=2e-9)


def test_a_ball_without_pendulum_follows_a_parabola_and_its_spin_decays():
    start = State(y=2.0, velocity_x=1.0, ball_rate=-10.0)
    found = fly(Model(SHELLBALL, Terrain.flat()), start, Actuation(), 0.5)
    decay = math.exp(-SHELLBALL.rolling_friction / SHELLBALL.ball_inertia * 0.5)
    assert found[X] == pytest.approx(0.5, abs=1e-15)
    assert found[Y] == pytest.approx(2.0 - 0.125 * SHELLBALL.gravity, abs=1e-14)
    assert found[BALL_RATE] == pytest.approx(-10.0 * decay, rel=1e-13)
    lost = 0.5 * SHELLBALL.ball_inertia * 100.0 * (1.0 - decay * decay)
    assert found[ROLLING_LOSS] == pytest.approx(lost, rel=1e-9)


@given(some.floats(1e-6, 0.6), some.sampled_from(LAWS), some.floats(-9, 9), some.floats(-9, 9))
@example(0.0117, Actuation(), 1.1e-159, 1.1e-159)
@example(4e-6, Actuation(), 20.2, 20.2)
def test_the_energy_balance_of_a_flight_closes(time, actuation, ball_rate, pendulum_rate):
    model = Model(GIMBALL, Terrain.flat())
    start = START._replace(ball_rate=ball_rate, pendulum_rate=pendulum_rate)

    def ledger(vector):
        return (equations.kinetic_energy(vector, model.parameters)
                + equations.potential_energy(vector, model.parameters)
                + vector[8:12].sum() - vector[12])
    found = fly(model, start, actuation, time)
    assert ledger(found) == pytest.approx(ledger(np.array(start[1:])), abs=1e-10)
    assert found[JOINT_LOSS] >= 0.0 and found[ROLLING_LOSS] >= 0.0


def test_the_time_of_a_drop_follows_the_law_of_free_fall():
    start = State(y=SHELLBALL.ball_radius + 0.7)
    found = touch(Model(SHELLBALL, Terrain.flat()), start, Actuation())
    assert found == pytest.approx(math.sqrt(2.0 * 0.7 / SHELLBALL.gravity), abs=2e-12)


@settings(max_examples=60)
@given(some.floats(-0.5, 2.2), some.floats(0.45, 1.5), some.floats(-3, 3), some.floats(-2, 3),
       some.floats(-9, 9), some.booleans())
def test_the_first_contact_is_found_and_not_passed(x, y, velocity_x, velocity_y, swing, ball):
    robot = SHELLBALL if ball else GIMBALL
    start = State(x=x, y=y, velocity_x=velocity_x, velocity_y=velocity_y,
                  pendulum_rate=0.0 if ball else swing)
    model = Model(robot, ROUGH)
    table = contact.contact_table(len(model.profile))

    def contacts(time):
        found = fly(model, start, Actuation(), time)
        return contact.find_contacts(found[X], found[Y], robot.ball_radius,
                                     model.profile, table)
    found = touch(model, start, Actuation())
    assert found < math.inf
    assert not any(contacts(time) for time in np.linspace(0.0, found - 1e-11, 300))
    assert contacts(found + 1e-9)


@pytest.mark.slow
def test_a_released_ball_is_force_free_until_its_next_contact():
    draw, flown, refused = np.random.default_rng(5), 0, 0
    for _ in range(2000):
        robot = SHELLBALL if draw.random() < 0.5 else GIMBALL
        model = Model(robot, ROUGH)
        system = System(model.parameters, model.profile, Actuation().actuator(robot))
        vector = np.array(model.at_rest(draw.uniform(-0.5, 1.2))[1:])
        slow = draw.choice([0.003, 0.03, 0.3, 1.0])
        vector[Y] += robot.static_penetration
        vector[X:Y + 1] += draw.normal(size=2) * 0.001 * slow
        vector[VELOCITY_X:VELOCITY_Y + 1] = slow * np.array([draw.normal(), abs(draw.normal())])
        if robot is GIMBALL:
            vector[PENDULUM_RATE] = draw.normal() * 9.0
        mode = contact.ContactMode.of(len(model.profile))
        if modes.find_mode(0.0, vector, system, mode) == 0 or not flight.is_released(
                mode, model.parameters):
            continue
        spin = flight.spin_start(vector, model.parameters, system.actuator)
        found = flight.time_of_touch(
            vector, 3.0, 1e-12, spin, model.parameters, model.profile)
        if found < flight.SHORT_FLIGHT:
            refused += 1
            continue
        later = np.zeros(SIZE)
        for time in np.linspace(0.0, found - 1e-11, 100):
            flight.fly(vector, time, spin, model.parameters, later)
            assert contact.contact_loads(
                later, model.parameters, model.profile, mode)[:2] == (0.0, 0.0)
        flown += 1
    assert flown > 100 and refused > 10  # a slow ball may fall back onto the ground


@pytest.mark.parametrize('robot', [SHELLBALL, GIMBALL], ids=lambda robot: robot.name)
def test_a_bouncing_ball_loses_the_spring_energy_at_release(robot):
    start = State(y=robot.ball_radius + 0.05, velocity_x=0.5, ball_rate=3.0)
    auto, full = (simulate(
        Model(robot, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-12, models=models)),
        start, Actuation(), 0.3, 1e-4) for models in ('auto', 'full'))
    assert auto.rows == pytest.approx(full.rows, abs=2e-8)
    assert auto.effort.flights > 1 and full.effort.flights == 0
    pulled = (auto['penetration'] > 0.0) & (auto['surface_normal_force'] == 0.0)
    assert np.sum(pulled) > 3


def test_only_flights_within_the_motor_limit_have_a_closed_form():
    weak, strong = (Actuation('voltage', voltage=9.0, torque_limit=limit).actuator(GIMBALL)
                    for limit in (1.0, 9.0))
    parameters, vector = Model(GIMBALL, Terrain.flat()).parameters, np.array(START[1:])
    for actuator, fine in ((weak, False), (strong, True), (Actuation().actuator(GIMBALL), True)):
        spin = flight.spin_start(vector, parameters, actuator)
        assert flight.within_limit(vector, 0.3, spin, parameters, actuator) == fine
    assert not flight.has_closed_form(parameters, Actuation('velocity').actuator(GIMBALL))


@pytest.mark.parametrize('accuracy', [1e-5, 1e-2, 1e-1])
def test_a_run_in_flight_alone_is_simulated_to_any_accuracy(accuracy):
    model = Model(GIMBALL, Terrain.flat())
    run = simulate(model, State(x=0.0, y=5.0, velocity_x=1.0), Actuation(), 0.5, 0.1,
                   accuracy=accuracy)
    assert run['y'][-1] == pytest.approx(5.0 - 0.5 * GIMBALL.gravity * 0.5**2, abs=1e-9)
    assert run.effort.evaluations == 0
