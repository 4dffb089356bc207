# SPDX-License-Identifier: Apache-2.0
"""The bound that saves guard checks never reports a mode as valid when a guard is violated."""
from contact_cases import rough
import numpy as np
import pytest

from ballbot_ros.jit import compiled
from ballbot_ros.physics import Actuation, ContactOptions, load_robot, Model, Terrain
from ballbot_ros.physics.mechanics import contact, modes
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.model.actuation import unsaturated_torque
from ballbot_ros.physics.model.state import BALL_RATE, SIZE, VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.dense import motion_at
from ballbot_ros.physics.solvers.events import holds_throughout, least, most
from ballbot_ros.physics.solvers.values import Workspace

THETAS = np.linspace(0.0, 1.0, 97)


def dense_of(workspace):
    """Return the coefficients of the dense output, one per row."""
    return workspace.work[values.DENSE:values.COLUMNS].reshape(-1, values.WIDTH)


def random_step(draw, model, workspace):
    """Write a dense output that starts on the ground, and freeze the mode of its start."""
    vector = np.zeros(SIZE)
    # One in four starts is in the notch, between two edges.
    where = 1.7 if draw.random() < 0.25 else draw.uniform(-0.5, 2.3)
    vector[:8] = model.at_rest(where)[1:9]
    vector[X] += draw.normal() * 0.003
    vector[Y] += draw.normal() * 0.002
    speed = draw.uniform(-1.0, 1.0)
    vector[VELOCITY_X] = speed
    vector[VELOCITY_Y] = draw.normal() * 0.1
    slip = draw.choice([0.3, 1.0, 10.0]) * draw.normal() * model.robot.slip_threshold
    vector[BALL_RATE] = (slip - speed) / model.robot.ball_radius
    system = System(model.parameters, model.profile, Actuation().actuator(model.robot))
    modes.find_mode(0.0, vector, system, workspace.mode)
    dense, scale = dense_of(workspace), 10.0**draw.uniform(-4.0, -1.5)
    dense[:, :8] = scale * draw.normal(size=(5, 8)) * draw.choice([0.1, 1.0], size=(5, 8))
    dense[0, :8] = vector[:8]
    return system


def says_so(system, workspace, step=1.0):
    """Return whether the bound reports a valid mode, for the features that a step checks."""
    dense, radius = dense_of(workspace), system.parameters.radius
    distance = float(np.sum(np.abs(dense[1:, X])))
    first, behind = contact.features_within(dense[0, X], radius + distance, system.ground)
    return holds_throughout(0.0, step, workspace.work, first, behind, system, workspace.mode)


@compiled
def violated_within(system, workspace, step):
    """Return whether any guard is violated at any of the sampled times within the step."""
    for theta in THETAS:
        motion_at(theta, workspace.work)
        if modes.violated_guards(
                theta * step, workspace.work[values.PROBE:], system, workspace.mode, 0,
                2 * len(system.ground) - 3, workspace.violated):
            return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize('lever, dissipation', [
    ('contact', 0.0), ('radius', 0.0), ('contact', 5.0)])
def test_no_guard_is_violated_while_the_bound_reports_a_valid_mode(lever, dissipation):
    draw = np.random.default_rng(11)
    robot = load_robot('gimball').replace(
        contact_law='hunt_crossley' if dissipation else 'kelvin_voigt',
        contact_dissipation=dissipation)
    # The face of the step is almost vertical.
    model = Model(robot, rough(face=0.901), ContactOptions(slip_lever=lever))
    workspace, said = Workspace.of(len(model.profile)), {0: 0, 1: 0, 2: 0}
    edges = 0
    for _ in range(4000):
        system = random_step(draw, model, workspace)
        if says_so(system, workspace):
            assert not violated_within(system, workspace, 1.0)
            said[modes.contact_count(workspace.mode)] += 1
            edges += workspace.mode.signs[0, contact.FEATURE] % 2
    # The bound is conclusive in the air, on a segment, and on an edge.
    assert said[0] > 100 and said[1] > 400 and edges > 50


@pytest.mark.slow
def test_the_bound_is_conclusive_for_most_small_steps():
    draw = np.random.default_rng(12)
    model = Model(load_robot('gimball'), Terrain.step(0.03, at=0.5))
    workspace, steps, said = Workspace.of(len(model.profile)), 0, 0
    for _ in range(1000):
        system = random_step(draw, model, workspace)
        dense_of(workspace)[1:, :8] *= 1e-3
        signs, count = workspace.mode.signs, modes.contact_count(workspace.mode)
        if count and np.all(signs[:count, contact.PRESSED] == 1):
            steps += 1
            said += says_so(system, workspace)
    assert said > 0.8 * steps > 200


def test_bounds_of_a_polynomial_enclose_it_and_are_exact_for_a_line():
    draw = np.random.default_rng(13)
    for _ in range(200):
        course = tuple(draw.normal(size=5))
        rest = 1.0 - THETAS
        values = course[0] + THETAS * (course[1] + rest * (
            course[2] + THETAS * (course[3] + rest * course[4])))
        assert least(course) <= values.min() + 1e-15 and values.max() - 1e-15 <= most(course)
    assert (least((1.0, -2.0, 0.0, 0.0, 0.0)), most((1.0, -2.0, 0.0, 0.0, 0.0))) == (-1.0, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize('actuation', [
    Actuation('position', set_angle=0.5), Actuation('velocity', set_rate=3.0, velocity_ki=20.0),
    Actuation('voltage', voltage=5.0), Actuation('torque', torque=0.5)], ids=lambda law: law.law)
def test_the_bound_is_valid_for_a_motor_near_its_limit(actuation):
    draw = np.random.default_rng(14)
    model = Model(load_robot('gimball'), Terrain.flat())
    workspace, said = Workspace.of(len(model.profile)), {-1: 0, 0: 0, 1: 0}
    plain = actuation.actuator(model.robot, 0.0, 0.1)
    for _ in range(3000):
        system = random_step(draw, model, workspace)
        dense_of(workspace)[1:, :8] *= 0.1
        torque = unsaturated_torque(0.0, dense_of(workspace)[0], plain)
        limit = abs(torque) * draw.choice([0.9, 0.99, 1.01, 1.1, 1.5])
        system = system._replace(actuator=plain._replace(limit=limit))
        modes.find_mode(0.0, dense_of(workspace)[0], system, workspace.mode)
        if says_so(system, workspace, 1e-3):
            assert not violated_within(system, workspace, 1e-3)
            said[workspace.mode.signs[-1, modes.MOTOR]] += 1
    assert said[0] > 100 and said[1] + said[-1] > 100


def test_the_bound_is_inconclusive_at_a_corner():
    draw = np.random.default_rng(14)
    model = Model(load_robot('gimball'), Terrain.flat())
    workspace = Workspace.of(len(model.profile))
    system = random_step(draw, model, workspace)
    dense_of(workspace)[1:] = 0.0
    assert says_so(system, workspace)
    workspace.mode.signs[-1, modes.CORNERS] = 1
    assert not says_so(system, workspace)
