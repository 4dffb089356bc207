# SPDX-License-Identifier: Apache-2.0
"""Accuracy as an input: the error bound, its estimate, and its cost."""
from dataclasses import replace
from pathlib import Path
import sys

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.config.files import shipped_files
from ballbot_ros.physics import (
    Actuation, load_robot, load_scene, Model, simulate, Solver, State, Terrain)

# bench/accuracy.py measures the error bound with the same generator of random scenes.
sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'bench'))


@pytest.mark.slow
@pytest.mark.parametrize('accuracy', [1e-3, 1e-6])
def test_random_scenes_keep_the_requested_accuracy(accuracy):
    from random_scenes import DURATION, random_scene
    for seed in range(60):
        model, start, actuation = random_scene(seed)
        exact = simulate(model, start, actuation, DURATION, accuracy=1e-9)
        found = simulate(model, start, actuation, DURATION, accuracy=accuracy)
        held = found['time'] <= min(found.assurance.horizon, exact.assurance.horizon) + 1e-9
        gap = np.hypot(found['x'] - exact['x'], found['y'] - exact['y'])[held]
        assert np.max(gap) <= accuracy, f'seed {seed}'


def test_the_error_estimate_exceeds_the_actual_error():
    scene = load_scene('fig7_bottom')
    exact, found = scene.simulate(accuracy=1e-9), scene.simulate(accuracy=1e-5)
    error = np.max(np.hypot(found['x'] - exact['x'], found['y'] - exact['y']))
    assert found.assurance.complete and error < found.assurance.estimate <= 1e-5


def test_a_looser_accuracy_costs_less():
    scene = load_scene('household')
    cost = [scene.simulate(accuracy=level).effort.evaluations for level in (1e-3, 1e-8)]
    assert cost[0] < 0.8 * cost[1]


@pytest.mark.parametrize('name', sorted(path.stem for path in shipped_files('scenes')))
def test_the_solver_of_each_shipped_scene_is_accurate_to_thirty_micrometres(name):
    scene = load_scene(name)
    found = scene.simulate()
    exact = scene.simulate(accuracy=1e-7)
    assert exact.assurance.complete
    assert np.hypot(found['x'] - exact['x'], found['y'] - exact['y']).max() < 3e-5


def test_an_explicit_solver_replaces_the_accuracy_of_a_scene(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('robot: gimball\ninitial: {speed: 0.5}\nduration: 0.1\naccuracy: 1.0e-5\n')
    assert load_scene(str(path)).simulate().assurance is not None
    run = load_scene(str(path), solver=Solver('rk4', 1e-3)).simulate()
    assert run.assurance is None and run.effort.steps == 100


def test_chaotic_motion_is_reported_with_a_valid_horizon():
    # A lossless ball bounces on a sawtooth profile: errors grow with each bounce.
    saw = [[0.1 * i, 0.03 * (i % 2)] for i in range(-100, 101)]
    robot = replace(load_robot('shellball'), contact_damping=0.0, rolling_friction=0.0,
                    surface_friction=0.0, edge_friction=0.0)
    model, start = Model(robot, Terrain(saw)), State(x=0.003, y=0.2)
    fine = simulate(model, start, Actuation(), 8.0, accuracy=1e-6)
    coarse = simulate(model, start, Actuation(), 8.0, accuracy=1e-3)
    assert not fine.assurance.complete and 1.0 < fine.assurance.horizon < 8.0
    assert fine.assurance.horizon <= coarse.assurance.horizon < 8.0
    held = coarse['time'] <= fine.assurance.horizon
    assert np.max(np.abs(coarse['x'] - fine['x'])[held]) <= 1e-3 + 1e-6


@pytest.mark.parametrize('accuracy', [0.0, -1e-3, 1e-12, 1.0, float('nan')])
def test_an_accuracy_out_of_range_is_refused(accuracy):
    scene = load_scene('fig7_top')
    with refused('out_of_range', 'accuracy'):
        simulate(scene.model, scene.start, scene.actuation, 0.1, accuracy=accuracy)


@pytest.mark.parametrize('run', [0, 1])
def test_an_interrupted_run_with_an_accuracy_returns_the_samples_so_far(run):
    scene, ended = load_scene('household'), []

    def stop(elapsed):
        ended.extend([elapsed] if elapsed >= scene.run.duration else [])
        if len(ended) == run and elapsed >= 1.0:
            raise KeyboardInterrupt
    found = scene.simulate(progress=stop)
    assert 1.0 <= found['time'][-1] < scene.run.duration
    assert (found.assurance is None) == (run == 0)


def test_an_accuracy_applies_by_default_but_not_with_an_explicit_solver():
    assert load_scene('flat').simulate(0.1).assurance.accuracy == 1e-5
    assert load_scene('flat', solver=Solver('rk4')).simulate(0.1).assurance is None
