# SPDX-License-Identifier: Apache-2.0
"""Each integrator has its stated order, and first order at the kinks of the contact law."""
from dataclasses import replace
import math

import numpy as np
import pytest

from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, Model, Solver, State, Terrain)
from ballbot_ros.physics.simulation.solver import METHODS

GIMBALL = load_robot('gimball')
SHELLBALL = load_robot('shellball')
FIXED = [name for name, method in METHODS.items() if method.fixed]

# (start, actuation) of smooth motions; the start None selects a rolling ball.
SMOOTH = {
    'flight under law (11)': (
        State(y=9.0, velocity_x=1.0, ball_rate=-5.0, pendulum_angle=0.3, pendulum_rate=2.0),
        Actuation('position', set_angle=1.0, position_kp=2.0, position_kd=0.05)),
    'flight under law (12)': (
        State(y=9.0, velocity_x=1.0, ball_rate=-5.0, pendulum_angle=0.3, pendulum_rate=2.0),
        Actuation('velocity', set_rate=3.0, velocity_kp=0.1, velocity_ki=1.0)),
    'rolling': (None, Actuation())}


def end_state(name, method, steps):
    """Return the state after one second of a smooth motion, as an array."""
    start, actuation = SMOOTH[name]
    start = start or Model(GIMBALL, Terrain.flat()).at_rest(0.0, 0.5, 0.6)
    # The slip of eq. (9) decays too fast for the coarse steps, so the threshold is increased.
    robot = replace(GIMBALL, slip_threshold=0.5, contact_damping=500.0)
    model = Model(robot, Terrain.flat(), ContactOptions(friction_ramp='smooth'),
                  Solver(method, 1.0 / steps))
    return np.array(model.advance(start, actuation.actuator(robot, 0.0, 0.3), steps)[1:9])


@pytest.mark.parametrize('method, order', [('semi_implicit', 1.0), ('rk4', 4.0)])
@pytest.mark.parametrize('name', SMOOTH)
def test_a_fixed_step_method_has_its_theoretical_order(name, method, order):
    counts = [400, 800, 1600] if method == 'rk4' else [8000, 16000, 32000]
    truth = end_state(name, 'rk4', 20000)
    errors = [np.abs(end_state(name, method, count) - truth).max() for count in counts]
    orders = -np.diff(np.log2(errors))
    assert orders == pytest.approx(order, abs=0.15)


def bounced(method, step, drop):
    """Return the speed after a bounce; `drop` sets the time of contact within a step."""
    model = Model(SHELLBALL, Terrain.flat(), solver=Solver(method, step))
    start = State(y=SHELLBALL.ball_radius + drop, velocity_y=-1.0)
    return model.advance(start, Actuation().actuator(SHELLBALL), round(0.03 / step)).velocity_y


@pytest.mark.parametrize('method', FIXED)
def test_the_kinks_of_a_bounce_reduce_the_order_to_one(method):
    # The damper force of eq. (7) jumps at a time within a step; average over that time.
    drops = np.linspace(1e-4, 3e-4, 23)
    steps = [1e-4, 5e-5, 2.5e-5, 1.25e-5]
    truth = np.array([bounced('rk4', 5e-7, drop) for drop in drops])
    errors = [np.mean(np.abs([bounced(method, step, drop) for drop in drops] - truth))
              for step in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.15)


def test_semi_implicit_euler_bounds_the_energy_error_of_an_undamped_spring():
    robot = replace(SHELLBALL, contact_damping=0.0)
    model = Model(robot, Terrain.flat(), solver=Solver('semi_implicit', 5e-4))
    state = model.at_rest(0.0)._replace(velocity_y=0.01)
    drive = Actuation().actuator(robot)
    before = model.energies(state).total
    misses = []
    for _ in range(400):
        state = model.advance(state, drive, 50)
        misses.append(abs(model.energies(state).total - before))
    kinetic = 0.5 * robot.ball_mass * 0.01**2
    assert max(misses[:20]) < 0.2 * kinetic
    assert max(misses) < 1.1 * max(misses[:20])


def test_a_time_dependent_law_is_evaluated_within_the_step():
    # Law (12) with an integral: the reference advances during the step.
    model = Model(GIMBALL, Terrain.flat(), solver=Solver(step=2e-3))
    fine = replace(model, solver=Solver(step=1e-4))
    drive = Actuation('velocity', set_rate=30.0, velocity_kp=0.0, velocity_ki=5.0,
                      gravity_compensation=False).actuator(GIMBALL)
    start = State(y=9.0)
    coarse, exact = model.advance(start, drive, 50), fine.advance(start, drive, 1000)
    assert coarse.pendulum_rate == pytest.approx(exact.pendulum_rate, rel=1e-6)
    assert math.isclose(coarse.time, exact.time, rel_tol=1e-12)
