# SPDX-License-Identifier: Apache-2.0
"""The analytical Jacobian of the equations of motion agrees with finite differences."""
from dataclasses import replace

from contact_cases import options
from hypothesis import assume, example, given
from hypothesis import strategies as some
import numpy as np
import pytest

from ballbot_ros.physics import Actuation, ContactOptions, load_robot, Model, State, Terrain
from ballbot_ros.physics.mechanics import modes
from ballbot_ros.physics.mechanics.contact import ContactMode
from ballbot_ros.physics.mechanics.equations import angle_trig, System
from ballbot_ros.physics.model.state import PENDULUM_ANGLE

ROBOTS = {name: load_robot(name) for name in ('gimball', 'shellball')}
ROBOTS['dissipative'] = replace(ROBOTS['gimball'], contact_law='hunt_crossley',
                                contact_dissipation=0.7)
# Two segments with a convex edge between them, and no concave corner.
RIDGE = Terrain([[-1.0, 0.0], [0.0, 0.05], [1.0, -0.1]])
DELTA = 1e-6


def rates_and_slopes(model, actuation, vector, time=0.5):
    """Return the rates of a mode as a function, the Jacobian, its completeness, the count."""
    system = System(model.parameters, model.profile, actuation.actuator(model.robot, 0.0, 0.1))
    mode, out = ContactMode.of(len(model.profile)), modes.jacobian_table()
    count = modes.find_mode(time, vector, system, mode)
    pendulum_trig = angle_trig(vector[PENDULUM_ANGLE])[1:]
    modes.write_jacobian(time, vector, pendulum_trig, system, mode, out)
    complete = modes.smooth_contacts(mode)

    def rates(moment, state):
        found = np.zeros(13)
        modes.mode_derivative(moment, state, system, mode, found)
        return found[4:8]
    return rates, out[:4], complete, count


def differences(rates, vector, time=0.5):
    """Return the Jacobian by Richardson-extrapolated central differences (fourth order)."""
    return (4.0 * central(rates, vector, time, DELTA / 2.0)
            - central(rates, vector, time, DELTA)) / 3.0


def central(rates, vector, time, delta):
    """Return the Jacobian by central differences (second order)."""
    found = np.zeros((4, 9))
    for column in range(8):
        shift = np.zeros(13)
        shift[column] = delta
        found[:, column] = (rates(time, vector + shift) - rates(time, vector - shift)) / (
            2.0 * delta)
    found[:, 8] = (rates(time + delta, vector) - rates(time - delta, vector)) / (2.0 * delta)
    return found


vectors = some.builds(
    lambda x, depth, slip, rest: np.array(
        [rest[0], rest[1], x, 0.0, slip - rest[2] / 0.226, rest[3], rest[2], rest[4],
         0.0, 0.0, 0.0, 0.0, 0.0, depth]),
    some.floats(-0.05, 0.05), some.floats(1e-5, 3e-3), some.floats(-0.1, 0.1),
    some.tuples(some.floats(-3, 3), some.floats(-3, 3), some.floats(-1, 1), some.floats(-3, 3),
                some.floats(-0.05, 0.05)))
actuations = some.builds(
    Actuation, law=some.sampled_from(['free', 'position', 'velocity', 'voltage', 'torque']),
    set_angle=some.just(0.3), set_rate=some.just(2.0), voltage=some.just(3.0),
    torque=some.just(0.5), velocity_ki=some.just(3.0), torque_limit=some.sampled_from([1e9, 0.3]))


# A contact so shallow that second-order differences have an error of 1.4e-5.
@example('gimball', np.array([0, 0, 0, 0, -1 / 0.226, 0, 1, 0, 0, 0, 0, 0, 0, 1e-5]),
         ContactOptions(pulling=False, friction_ramp='smooth', slip_lever='contact'), Actuation())
@given(some.sampled_from(sorted(ROBOTS)), vectors, options, actuations)
def test_the_jacobian_agrees_with_central_differences(name, vector, choice, actuation):
    robot = ROBOTS[name]
    actuation = actuation if robot.has_pendulum else Actuation()
    model, depth, vector = Model(robot, RIDGE, choice), vector[13], vector[:13].copy()
    near = model.at_rest(vector[2])
    vector[3] = near.y + robot.static_penetration - depth
    rates, slopes, complete, count = rates_and_slopes(model, actuation, vector)
    assert complete
    # Differences across the end of the friction ramp are invalid.
    assume(not any(abs(abs(touch_slip) / robot.slip_threshold - 1.0) < 1e-3
                   for touch_slip in slips(model, vector)))
    expected = differences(rates, vector)
    size = 1.0 + np.max(np.abs(expected), axis=1, keepdims=True)
    assert np.max(np.abs(slopes - expected) / size) < 1e-5, (count, slopes - expected)


def slips(model, vector):
    """Return the slip velocity of each contact [m/s]."""
    return [touch.slip_velocity for touch in model.touches(State(0.5, *vector))]


def test_the_jacobian_is_reported_incomplete_at_a_corner():
    floor = Terrain([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.01]])
    model = Model(ROBOTS['gimball'], floor)
    vector = np.array(model.at_rest(-0.001)[1:])
    _, _, complete, count = rates_and_slopes(model, Actuation(), vector)
    assert count == 3 and not complete


def test_the_jacobian_has_no_pendulum_entries_without_a_pendulum():
    model = Model(ROBOTS['shellball'], Terrain.flat())
    _, slopes, _, _ = rates_and_slopes(model, Actuation(), np.array(model.at_rest(0.0, 0.5)[1:]))
    assert not slopes[modes.PENDULUM].any() and not slopes[:, [0, 1, 5]].any()


def test_the_jacobian_of_a_hanging_pendulum_agrees_with_the_closed_form():
    robot = ROBOTS['gimball']
    model = Model(robot, Terrain.flat())
    vector = np.array(model.at_rest(0.0)[1:])
    _, slopes, _, _ = rates_and_slopes(model, Actuation(), vector)
    # The floor supports the weight, so gravity restores the pendulum.
    moment = robot.pendulum_mass * robot.pendulum_length
    inertia = robot.pendulum_inertia + moment * robot.pendulum_length * (
        robot.ball_mass / robot.total_mass)
    assert slopes[modes.PENDULUM, 1] == pytest.approx(-moment * robot.gravity / inertia)
    assert slopes[modes.ALONG_Y, 3] == pytest.approx(
        -robot.contact_stiffness / robot.total_mass)
    assert slopes[modes.ALONG_Y, 7] == pytest.approx(-robot.contact_damping / robot.total_mass)
