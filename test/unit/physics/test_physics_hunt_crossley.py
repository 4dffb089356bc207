# SPDX-License-Identifier: Apache-2.0
"""Hunt-Crossley contact: closed-form restitution, energy balance, and selection of the law."""
import math

from contact_cases import MOVING
import numpy as np
import pytest
from refusals import refused
from scipy.optimize import brentq

from ballbot_ros.crossing import max_step_height
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.simulation.scene import read_scene

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
CLOSED = {'contact_law': 'hunt_crossley'}


def restitution(dissipation, speed):
    """
    Return the coefficient of restitution of N = k p (1 + lambda p') at an impact speed.

    With w = p': dw / dp = -(k / m) p (1 + lambda w) / w, so the integral of w / (1 + lambda w)
    over the impact is zero: w - ln(1 + lambda w) / lambda is the same before and after.
    """
    def gap(share):
        before, after = dissipation * speed, -dissipation * share * speed
        return (before - math.log1p(before)) - (after - math.log1p(after))
    return brentq(gap, 0.0, min(1.0, (1.0 - 1e-12) / (dissipation * speed)))


@pytest.mark.parametrize('method', ['adaptive', 'explicit', 'implicit', 'rk4', 'trapezoidal'])
@pytest.mark.parametrize('dissipation, speed', [(0.2, 0.5), (1.0, 0.5), (1.0, 2.0), (5.0, 1.0)])
def test_the_restitution_agrees_with_the_closed_form(method, dissipation, speed):
    robot = SHELLBALL.replace(gravity=0.0, surface_friction=0.0, rolling_friction=0.0,
                              contact_dissipation=dissipation, **CLOSED)
    solver = Solver(method, 1e-5, 1e-11)
    model = Model(robot, Terrain.flat(), solver=solver)
    start = State(y=robot.ball_radius + 1e-3, velocity_y=-speed)
    run = simulate(model, start, Actuation(), 0.1)
    tolerance = 1e-4 if method in ('rk4', 'trapezoidal') else 1e-6
    assert run['velocity_y'][-1] / speed == pytest.approx(
        restitution(dissipation, speed), abs=tolerance)


def test_the_force_is_continuous_at_first_contact_and_never_pulls():
    robot = SHELLBALL.replace(contact_dissipation=3.0, **CLOSED)
    model = Model(robot, Terrain.flat())
    start = State(y=robot.ball_radius + 1e-3, velocity_y=-1.0)
    run = simulate(model, start, Actuation(), 0.05, 1e-5)
    force = run['surface_normal_force']
    assert np.min(force) >= 0.0 and np.max(np.abs(np.diff(force))) < 0.02 * np.max(force)
    damped = simulate(Model(SHELLBALL, Terrain.flat()), start, Actuation(), 0.05, 1e-5)
    jump = np.abs(np.diff(damped['surface_normal_force']))
    assert np.max(jump) == pytest.approx(SHELLBALL.contact_damping, rel=0.05)  # kd at 1 m/s


@pytest.mark.parametrize('name', MOVING)
def test_the_energy_balance_of_every_scene_closes(name):
    scene = load_scene(name)
    scene = load_scene(
        scene, robot=scene.model.robot.replace(contact_dissipation=0.5, **CLOSED))
    run = scene.simulate(accuracy=1e-6)
    assert np.max(np.abs(run.energy_residual)) < 1e-6 * run.energy_in_play


def test_a_scene_file_selects_the_hunt_crossley_law():
    scene = read_scene({'robot': 'gimball', 'duration': 0.1, 'robot_changes': {
        'contact_law': 'hunt_crossley', 'contact_dissipation': 0.5}}, 'here', 'mine')
    assert scene.model.parameters.dissipation == 0.5 * GIMBALL.contact_stiffness
    assert scene.model.robot.digest != GIMBALL.digest
    assert GIMBALL.replace(contact_law='hunt_crossley').digest != GIMBALL.digest


def test_a_dissipation_without_its_law_is_refused():
    with refused('inconsistent', 'contact_dissipation'):
        GIMBALL.replace(contact_dissipation=0.5)


@pytest.mark.slow
def test_the_maximum_step_height_depends_little_on_the_law_at_equal_restitution():
    for speed in (0.3, 0.6):
        dissipation = brentq(
            lambda value: restitution(value, speed) - GIMBALL.restitution, 1e-3, 10.0)
        other = GIMBALL.replace(contact_dissipation=dissipation, **CLOSED)
        one, two = (max_step_height(robot, speed) for robot in (GIMBALL, other))
        assert two.height == pytest.approx(one.height, rel=0.05)
        assert two.error <= 5e-5
