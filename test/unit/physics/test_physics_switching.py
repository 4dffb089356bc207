# SPDX-License-Identifier: Apache-2.0
"""A run switches to simpler models where they are valid and agrees with the full model."""
from dataclasses import replace

from contact_cases import MOVING
import numpy as np
import pytest

from ballbot_ros.physics import Actuation, load_robot, load_scene, Model, simulate, Solver, Terrain


def run(name, models, tolerance, **given):
    solver = Solver('adaptive', tolerance=tolerance, models=models)
    return load_scene(name, solver=solver).simulate(**given)


@pytest.mark.parametrize('name', MOVING)
def test_flight_in_closed_form_does_not_change_where_a_scene_ends(name):
    exact, found = run(name, 'full', 1e-12), run(name, 'auto', 1e-9)
    gap = np.hypot(found['x'] - exact['x'], found['y'] - exact['y'])
    assert np.max(gap) < 1e-6
    assert np.max(np.abs(found.energy_residual)) < 1e-5 * found.energy_in_play


def test_the_error_falls_with_the_tolerance():
    exact = run('shellball_drop', 'full', 1e-13)
    errors = [np.max(np.abs(run('shellball_drop', 'auto', tolerance)['x'] - exact['x']))
              for tolerance in (1e-6, 1e-8, 1e-10)]
    assert errors[1] < 0.3 * errors[0] and errors[2] < 0.01 * errors[0]


def test_a_drop_flies_in_closed_form_unless_the_full_model_is_selected():
    assert run('shellball_drop', 'auto', 1e-7).effort.flights > 3
    assert run('shellball_drop', 'full', 1e-7).effort.flights == 0


@pytest.mark.parametrize('models', ['auto', 'full'])
def test_the_output_step_does_not_change_the_run(models):
    coarse = run('shellball_drop', models, 1e-9, output_step=0.1)
    fine = run('shellball_drop', models, 1e-9)
    assert coarse['x'] == pytest.approx(fine['x'][::100], abs=1e-7)
    assert coarse['time'] == pytest.approx(fine['time'][::100], abs=1e-12)


def test_a_law_without_closed_form_flies_in_the_full_model():
    model = Model(load_robot('gimball'), Terrain.step(-0.1, at=0.3),
                  solver=Solver('adaptive', tolerance=1e-8))
    start = model.at_rest(0.0, 1.0)
    for law, flies in (('free', True), ('velocity', False)):
        found = simulate(model, start, Actuation(law), 0.8)
        assert np.any(found['penetration'] == 0.0)
        assert (found.effort.flights > 0) == flies


@pytest.mark.parametrize('models, flies', [('auto', True), ('full', False)])
def test_an_accurate_run_passes_the_choice_on(models, flies):
    scene = load_scene('shellball_drop')
    model = replace(scene.model, solver=Solver(models=models))
    found = simulate(model, scene.start, scene.actuation, 3.0, accuracy=1e-4)
    assert found.assurance.complete and (found.effort.flights > 0) == flies
