# SPDX-License-Identifier: Apache-2.0
"""At the extremes a run ends with a good answer or with an error that helps, and it ends."""
from dataclasses import replace
import importlib
from pathlib import Path
import sys

import numpy as np
import pytest

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)
from ballbot_ros.physics.mechanics.equations import X
from ballbot_ros.physics.simulation.integrator import Integrator
from ballbot_ros.physics.solvers.values import FINISHED, Status

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'extremes'))
BY_NAME, make_case = (
    getattr(importlib.import_module('cases'), name) for name in ('BY_NAME', 'make_case'))
judge, REFUSED, WRONG = (
    getattr(importlib.import_module('judge'), name) for name in ('judge', 'REFUSED', 'WRONG'))

SHELLBALL = load_robot('shellball')
ROUGH = Terrain([[0.001 * i, 0.0005 * (i % 2)] for i in range(1000)])


def test_a_run_gives_up_when_its_work_budget_is_used_up():
    scene = load_scene('fig7_top')
    needed = simulate(replace(scene.model, solver=Solver('adaptive')), scene.start,
                      scene.actuation, 1.0).effort.evaluations
    model = replace(scene.model, solver=Solver('adaptive', work_budget=needed // 2))
    with pytest.raises(SimulationError, match=r'work budget of \d+ right-hand sides') as caught:
        simulate(model, scene.start, scene.actuation, 1.0)
    assert 'slip_threshold' in caught.value.remedy
    assert 0.0 < caught.value.trajectory['time'][-1] <= caught.value.time < 1.0


def test_each_period_of_an_advance_has_a_work_budget_of_its_own():
    model = Model(SHELLBALL, Terrain.flat(), solver=Solver('adaptive', work_budget=1000))
    state, drive = model.at_rest(0.0, 1.0), Actuation().actuator(SHELLBALL)
    for _ in range(200):
        state = model.advance(state, drive, 50)
    with pytest.raises(SimulationError, match='work budget of 1000'):
        model.advance(state, drive, 10_000_000)


def test_looking_at_thousands_of_features_is_work_too():
    robot = replace(SHELLBALL, ball_radius=1.0)
    model = Model(robot, ROUGH, solver=Solver('adaptive', work_budget=20_000))
    start = State(x=0.5, y=1.0, velocity_x=1.0)
    with pytest.raises(SimulationError, match='work budget'):
        simulate(model, start, Actuation(), 10.0)


def test_a_thousand_elastic_bounces_keep_their_energy():
    robot = replace(SHELLBALL, contact_damping=0.0, rolling_friction=0.0)
    model = Model(robot, Terrain.flat(), solver=Solver('adaptive'))
    start = State(y=robot.ball_radius + 0.05)
    run = simulate(model, start, Actuation(), 230.0, 1e-2)
    energy = run['kinetic_energy'] + run['potential_energy'] + run['contact_energy']
    upward = run['velocity_y'] > 0.0
    assert np.sum(~upward[:-1] & upward[1:]) >= 1000
    assert np.max(np.abs(energy - energy[0])) < 1e-3 * robot.weight * 0.05


def test_a_tiny_ball_does_not_fall_through_its_floor_between_two_looks():
    robot = replace(SHELLBALL, ball_radius=1e-3, ball_inertia=1e-9, ball_mass=1e-3,
                    contact_stiffness=1e3, contact_damping=0.1, gravity=25.0)
    spike = Terrain([[-1.0, 0.0], [-1e-4, 0.0], [0.0, 5e-4], [1e-4, 0.0], [1.0, 0.0]])
    run = simulate(Model(robot, spike, solver=Solver('adaptive')),
                   State(x=1e-5, y=3e-3), Actuation(), 0.2)
    assert np.max(np.abs(run.energy_residual)) < 1e-4 * run.energy_in_play


def test_fixed_steps_beyond_the_work_budget_are_refused_before_they_start():
    model = Model(SHELLBALL, Terrain.flat(), solver=Solver('rk4', 1e-6, work_budget=10_000))
    start = model.at_rest(0.0, 1.0)
    with pytest.raises(ConfigurationError, match='work_budget of 10000'):
        simulate(model, start, Actuation(), 1.0)
    with pytest.raises(ConfigurationError, match='work_budget of 10000'):
        model.advance(start, Actuation().actuator(SHELLBALL), 2501)


@pytest.mark.parametrize('name', [name for name in BY_NAME if name != 'hour'])
def test_no_case_at_the_extremes_is_wrong(name):
    for seed in range(2 if name in ('bounces', 'control_period') else 6):
        found = judge(name, seed)
        assert found.verdict != WRONG, f'--only {name}:{seed}  {found.why}'


def test_energy_that_comes_and_goes_again_is_seen_too():
    # At its end the ledger of this run would close: each sample is looked at.
    found = judge('fixed', 811)
    assert found.verdict == REFUSED and 'the energy ledger misses' in found.why


def test_a_case_is_a_function_of_its_class_and_seed():
    assert make_case('combined', 3).start == make_case('combined', 3).start
    assert make_case('combined', 3).start != make_case('combined', 4).start


@pytest.mark.parametrize('seed', [73, 373, 516])
def test_a_contact_that_flickers_by_rounding_is_stepped_over(seed):
    # With next to no gravity, depth changes by less than its rounding between two events.
    found = judge('gravity', seed)
    assert found.verdict != WRONG, found.why


@pytest.mark.parametrize('method', ['adaptive', 'implicit', 'explicit'])
def test_a_tolerance_coarser_than_the_penetration_does_not_make_a_run_hang(method):
    scene = load_scene('shellball_drop')
    model = replace(scene.model, solver=Solver(method, tolerance=1e-3, work_budget=50_000))
    assert model.solver.tolerance > 5.0 * model.robot.static_penetration
    # It may be too coarse for the ledger, but not for an end.
    vector = np.array(scene.start[1:])
    status = Integrator(model.parameters, model.profile, model.solver).advance(
        scene.actuation.actuator(model.robot), vector, Status(FINISHED, 0.0), scene.run.duration)
    assert status.outcome == FINISHED and status.time == scene.run.duration
    assert 0.0 < vector[X] < 0.5
