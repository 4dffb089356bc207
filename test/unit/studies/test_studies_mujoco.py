# SPDX-License-Identifier: Apache-2.0
"""Comparison with MuJoCo: the mechanics agree to rounding, the contacts approximately."""
from dataclasses import replace
import math
import sys

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.paper import mujoco_check
from ballbot_ros.paper.cases import Case, holding, LEVEL, step_height
from ballbot_ros.paper.rigid_impact import impact_with_restitution
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.studies import free_ball
from ballbot_ros.studies.comparators import free_pendulum_impulse

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
STEP = 2e-4

with_mujoco = pytest.mark.skipif(
    not free_ball.installed(),
    reason=f'MuJoCo is not installed ({free_ball.HOW_TO_INSTALL}); it has no wheels for '
    'Python 3.10')

# The crossings of Fig. 7, a failure, and the ball without a pendulum.
CROSSINGS = {
    'top': (holding(GIMBALL, 0.0), 0.76, 0.021),
    'middle': (Case(GIMBALL, Actuation(law='voltage', voltage=5.7)), 0.78, 0.031),
    'bottom': (holding(GIMBALL, LEVEL), 1.09, 0.056),
    'rolling at a joint rate': (
        Case(GIMBALL, Actuation(law='velocity', set_rate=3.5)), 0.8, 0.025),
    'fails': (Case(GIMBALL), 0.78, 0.035),
    'shellball': (Case(SHELLBALL), 0.8, 0.027),
    'Hunt and Crossley': (Case(GIMBALL.replace(
        contact_law='hunt_crossley', contact_dissipation=0.3)), 0.78, 0.025)}


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('name', CROSSINGS)
def test_under_the_same_forces_both_motions_agree(name):
    # The requirement is 1e-6 m; with the same scheme and step only rounding remains.
    case, speed, height = CROSSINGS[name]
    assert mujoco_check.largest_difference(case, speed, height, 0.6, STEP) < 1e-9


@with_mujoco
def test_the_comparison_detects_a_mechanical_difference():
    case, speed, height = CROSSINGS['fails']
    ball = mujoco_check.MujocoRun(case, speed, height, STEP)
    good = ball.run(0.4, 2e-3)
    ball.model.body('pendulum').inertia[:] *= 1.01
    assert np.abs(ball.run(0.4, 2e-3) - good).max() > 1e-6


@with_mujoco
def test_the_penetration_of_a_ball_at_rest_is_its_weight_over_the_stiffness():
    for robot in (GIMBALL, SHELLBALL):
        ball = mujoco_check.MujocoRun(Case(robot), 0.01, 0.05, STEP, 'implicitfast', 'matched')
        ball.data.qpos[0], ball.data.qvel[:] = -1.0, 0.0
        ball.advance(20_000)
        assert robot.ball_radius - ball.centre[1] == pytest.approx(
            robot.static_penetration, rel=5e-3)


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('robot', [GIMBALL, SHELLBALL], ids=['gimball', 'shellball'])
def test_without_friction_the_contact_of_mujoco_gives_the_same_height(robot):
    smooth = replace(robot, surface_friction=0.0, edge_friction=0.0)
    found = mujoco_check.mujoco_height(Case(smooth), 0.8, 1e-4, tolerance=1e-5)
    assert found == pytest.approx(step_height(Case(smooth), 0.8), abs=1e-4)


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('robot', [GIMBALL, SHELLBALL], ids=['gimball', 'shellball'])
def test_with_friction_the_contact_of_mujoco_agrees_within_a_third_of_a_millimetre(robot):
    for speed in (0.4, 1.2):
        found = mujoco_check.mujoco_height(Case(robot), speed, 2e-4)
        assert found == pytest.approx(step_height(Case(robot), speed), abs=3.5e-4)


@with_mujoco
def test_steeper_friction_raises_the_heights_of_mujoco_and_not_ours():
    ours = [step_height(Case(replace(SHELLBALL, slip_threshold=slip)), 1.2)
            for slip in (0.01, 0.001)]
    assert ours[1] == pytest.approx(ours[0], abs=3e-4)
    theirs = [mujoco_check.mujoco_height(Case(replace(SHELLBALL, slip_threshold=slip)), 1.2, 2e-4)
              for slip in (0.01, 0.001)]
    assert theirs[1] > theirs[0] + 2e-3


@pytest.mark.slow
@with_mujoco
def test_the_default_contact_of_mujoco_is_a_plastic_impact():
    # The contact is critically damped: there is no bounce for any shell material.
    for speed in (0.6, 1.2):
        found = mujoco_check.mujoco_height(Case(GIMBALL), speed, 5e-4, law='default')
        assert found == pytest.approx(free_pendulum_impulse(GIMBALL, speed), abs=1.1e-3)
        found = mujoco_check.mujoco_height(Case(SHELLBALL), speed, 5e-4, law='default')
        assert found == pytest.approx(impact_with_restitution(SHELLBALL, speed, 0.0), abs=1.1e-3)


@with_mujoco
def test_an_unknown_contact_is_refused():
    with refused('not_a_choice', 'law'):
        mujoco_check.MujocoRun(Case(GIMBALL), 0.8, 0.02, STEP, law='soft')


def test_without_mujoco_the_check_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    assert not free_ball.installed()
    with refused('not_installed', 'mujoco'):
        mujoco_check.MujocoRun(Case(GIMBALL), 0.8, 0.02, STEP)


def test_the_model_file_contains_the_parameters_of_the_robot():
    text = mujoco_check.write_model(GIMBALL, 0.03, 1e-3, 'RK4', own_contact=True)
    for number in (GIMBALL.ball_mass, GIMBALL.pendulum_length, GIMBALL.joint_friction,
                   GIMBALL.edge_friction, 0.03 - 1.0):
        assert f"'{number}" in text or f' {number}' in text or f'-{number}' in text
    assert 'pendulum' not in mujoco_check.write_model(
        SHELLBALL, 0.03, 1e-3, 'RK4', own_contact=False)
    assert math.isfinite(float(text.split("timestep='")[1].split("'")[0]))
