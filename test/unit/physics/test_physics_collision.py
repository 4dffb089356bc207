# SPDX-License-Identifier: Apache-2.0
"""A rigid collision never adds energy and is the hard-contact limit of the full model."""
from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as some
import pytest
from rigid_collision import collide, restitution

from ballbot_ros.physics import Actuation, load_robot, Model, simulate, Solver, State, Terrain

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')


def full_collision(robot, start, harder):
    """Return the state after an impact in the full model with a contact stiffened by a factor."""
    stiff = replace(robot, contact_stiffness=harder * robot.contact_stiffness,
                    contact_damping=math.sqrt(harder) * robot.contact_damping,
                    slip_threshold=robot.slip_threshold / harder, rolling_friction=0.0,
                    joint_friction=0.0, gravity=0.0)
    model = Model(stiff, Terrain.flat(), solver=Solver('adaptive', tolerance=1e-12))
    period = math.pi * math.sqrt(robot.total_mass / stiff.contact_stiffness)
    run = simulate(model, start._replace(y=robot.ball_radius), Actuation(), 1.5 * period,
                   0.5 * period)
    assert run['penetration'][-1] == 0.0
    return run.state(-1), model


def speeds(state):
    return [state.ball_rate, state.pendulum_rate, state.velocity_x, state.velocity_y]


impacts = some.builds(
    State, y=some.just(0.2), pendulum_angle=some.floats(-4, 4), ball_rate=some.floats(-9, 9),
    pendulum_rate=some.floats(-9, 9), velocity_x=some.floats(-2, 2),
    velocity_y=some.floats(-3, -0.01))


@given(impacts, some.floats(0, 2), some.floats(-1, 1), some.floats(-0.5, 0.5), some.booleans())
def test_a_collision_never_adds_energy_and_never_pulls(state, friction, bounce, slope, ball):
    model = Model(SHELLBALL if ball else GIMBALL, Terrain.flat())
    normal = -math.sin(slope), math.cos(slope)
    if state.velocity_x * normal[0] + state.velocity_y * normal[1] >= -1e-6:
        return
    found = collide(model, state, *normal, friction, bounce)
    assert found.lost >= -1e-9
    assert found.normal_impulse > 0.0
    assert abs(found.friction_impulse) <= friction * found.normal_impulse * (1.0 + 1e-9) + 1e-15
    leaving = found.state.velocity_x * normal[0] + found.state.velocity_y * normal[1]
    assert leaving >= -1e-9


@given(impacts)
def test_a_frictionless_lossless_collision_conserves_energy(state):
    assert collide(Model(GIMBALL, Terrain.flat()), state, 0.0, 1.0, 0.0, 1.0).lost == \
        pytest.approx(0.0, abs=1e-9)


def test_sliding_and_sticking_impacts_match_the_textbook_formulas():
    state = State(velocity_x=1.0, velocity_y=-2.0)
    model = Model(SHELLBALL, Terrain.flat())
    slides = collide(model, state, 0.0, 1.0, 0.01, 0.5)
    assert not slides.sticks
    assert slides.state.velocity_y == pytest.approx(1.0)
    assert slides.state.velocity_x == pytest.approx(1.0 - 0.01 * 3.0)
    sticks = collide(model, state, 0.0, 1.0, 1.0, 0.5)
    shape = SHELLBALL.ball_inertia / (SHELLBALL.ball_mass * SHELLBALL.ball_radius**2)
    assert sticks.sticks
    assert sticks.state.velocity_x == pytest.approx(1.0 / (1.0 + shape))


@pytest.mark.parametrize('damping', [0.0, 5.0, 50.0, 300.0, 542.96, 800.0])
def test_the_restitution_of_the_spring_and_damper_equals_that_of_the_full_model(damping):
    robot = replace(SHELLBALL, contact_damping=damping)
    after, _ = full_collision(robot, State(velocity_y=-1.0), 1.0)
    assert after.velocity_y == pytest.approx(restitution(robot, 1.0 / robot.ball_mass), abs=1e-6)


@pytest.mark.parametrize('start', [
    State(velocity_x=1.5, velocity_y=-1.0),  # slides throughout
    State(velocity_x=1.5, velocity_y=-1.0, pendulum_angle=1.1),
    State(velocity_x=0.5, velocity_y=-1.0, ball_rate=-0.5 / GIMBALL.ball_radius,
          pendulum_angle=0.6, pendulum_rate=2.0)], ids=['slides', 'slides, angle', 'sticks'])
def test_the_full_model_converges_to_the_rigid_collision_as_the_contact_hardens(start):
    errors = []
    for harder in (1e2, 1e4):
        after, model = full_collision(GIMBALL, start, harder)
        found = collide(model, start._replace(y=GIMBALL.ball_radius), 0.0, 1.0,
                        GIMBALL.surface_friction)
        errors.append(max(abs(one - other) for one, other in zip(
            speeds(found.state), speeds(after))))
    assert errors[1] < 0.15 * errors[0] and errors[1] < 0.01


def test_an_impact_that_begins_to_stick_is_close_to_the_full_model():
    start = State(velocity_x=0.9, velocity_y=-1.5, pendulum_angle=0.8)
    after, model = full_collision(GIMBALL, start, 1e4)
    found = collide(model, start._replace(y=GIMBALL.ball_radius), 0.0, 1.0,
                    GIMBALL.surface_friction)
    for one, other in zip(speeds(found.state), speeds(after)):
        assert one == pytest.approx(other, rel=0.03, abs=0.03)
