# SPDX-License-Identifier: Apache-2.0
"""What an analysis says cannot happen does not happen; and it says so where that is plain."""
from dataclasses import replace
import math
from pathlib import Path
import sys

import numpy as np
import pytest

from ballbot_ros.physics import Actuation, load_robot, load_scene, Model, simulate, Solver, Terrain
from ballbot_ros.physics.simulation.reachability import analyse

# The generator of random scenes that bench/accuracy.py measures the promise with.
sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'bench'))

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
ADAPTIVE = Solver('adaptive', tolerance=1e-8)


def check(model, start, actuation, duration):
    """Compare an analysis with the run; return both."""
    found = analyse(model, start, actuation, duration)
    run = simulate(replace(model, solver=ADAPTIVE), start, actuation, duration)
    speed = np.hypot(run['velocity_x'], run['velocity_y'])
    assert np.max(speed) <= found.speed * (1.0 + 1e-9) + 1e-9
    assert np.max(run['kinetic_energy']) <= found.energy * (1.0 + 1e-9) + 1e-12
    assert found.leftmost - 1e-9 <= np.min(run['x']) <= np.max(run['x']) <= found.rightmost + 1e-9
    if not found.flight:
        assert np.all(run['penetration'] > 0.0)
    if not found.sliding:
        assert np.max(np.abs(run['slip_velocity'])) < model.robot.slip_threshold
    if not found.several_contacts:
        touches = [len(model.touches(run.state(index))) for index in range(0, len(run), 20)]
        assert max(touches) <= 1
    if found.edges == 0:
        assert np.all(run['edge_normal_force'] == 0.0)
    return found, run


def test_no_random_scene_does_what_was_called_impossible():
    from random_scenes import DURATION, random_scene
    for seed in range(60):
        check(*random_scene(seed), DURATION)


@pytest.mark.parametrize('name', ['flat', 'fig7_top', 'household', 'ramp_release',
                                  'shellball_drop', 'voltage_start'])
def test_no_scene_of_the_package_does_either(name):
    scene = load_scene(name)
    check(scene.model, scene.start, scene.actuation, scene.run.duration)


def test_slow_rolling_on_a_floor_is_known_to_stay_simple():
    model = Model(SHELLBALL, Terrain.flat())
    found, run = check(model, model.at_rest(0.0, 0.5), Actuation(), 5.0)
    assert not (found.flight or found.sliding or found.several_contacts)
    # With what the spin holds, energy allows for more than the ball ever has.
    bound = 0.5 * math.sqrt(1.0 + SHELLBALL.ball_inertia / (
        SHELLBALL.ball_mass * SHELLBALL.ball_radius**2))
    assert found.speed == pytest.approx(bound, rel=2e-3)
    assert found.rightmost == pytest.approx(5.0 * found.speed)
    assert (found.segments, found.edges, found.corners) == (1, 0, 0)
    assert np.max(run['x']) < found.rightmost


def test_a_step_that_is_too_high_for_the_energy_ends_the_reach():
    model = Model(SHELLBALL, Terrain.step(0.1, at=1.0))
    start = model.at_rest(0.0, 0.5)
    assert analyse(model, start, Actuation(), 10.0).rightmost == 1.0
    assert analyse(model, start._replace(velocity_x=2.0), Actuation(), 10.0).rightmost > 10.0


def test_a_motor_without_limit_gives_no_bound_and_is_said_to():
    model = Model(GIMBALL, Terrain.step(0.02, at=1.0))
    start = model.at_rest(0.0, 0.5)
    found = analyse(model, start, Actuation('position', set_angle=1.0), 1.0)
    assert found.energy > 1e12 and found.flight and found.edges == 1 and not found.closed_form
    weak = analyse(model, start, Actuation('position', set_angle=1.0, torque_limit=1.0), 1.0)
    assert weak.speed < 30.0


@pytest.mark.parametrize('length, joint', [(0.0787, 0.0), (0.01, 0.01), (0.0, 0.124)])
def test_the_pendulum_moves_the_centre_by_less_than_the_bound(length, joint):
    robot = replace(GIMBALL, pendulum_length=length, joint_friction=joint,
                    pendulum_mass=0.2, ball_mass=5.2)
    ends, bounds = [], []
    no_pendulum = replace(
        robot, ball_mass=robot.total_mass, pendulum_mass=0.0, pendulum_inertia=0.0,
        pendulum_length=0.0, joint_friction=0.0, motor=None)
    for item in (robot, no_pendulum):
        model = Model(item, Terrain.flat(), solver=ADAPTIVE)
        angle = 0.3 if item.has_pendulum else 0.0
        start = model.at_rest(0.0, 0.5, angle)
        bounds.append(analyse(model, start, Actuation(), 1.0).pendulum)
        ends.append(simulate(model, start, Actuation(), 1.0)['x'])
    assert bounds[1] is None and math.isfinite(bounds[0])
    assert np.max(np.abs(ends[0] - ends[1])) < bounds[0]


def test_where_there_are_obstacles_the_pendulum_is_said_to_matter():
    scene = load_scene('fig7_middle')
    found = analyse(scene.model, scene.start, scene.actuation, 1.0)
    assert found.pendulum == math.inf and found.several_contacts
