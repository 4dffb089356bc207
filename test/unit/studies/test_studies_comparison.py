# SPDX-License-Identifier: Apache-2.0
"""Comparison of simpler models with the full model: accuracy, table and command."""
import json
import math

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.cli import main
from ballbot_ros.paper.cases import Case, holding
from ballbot_ros.paper.comparison import compare, spans
from ballbot_ros.physics import Actuation, load_robot

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')


def heights(case, speeds):
    """Return the heights of each model by name [m]."""
    found = compare(case, np.array(speeds))
    return {curve.name: curve.heights for curve in (found.full, *found.others)}


def test_the_free_pendulum_impulse_is_within_3_mm_where_the_lumped_one_is_not():
    found = heights(Case(GIMBALL), (0.4, 0.8, 1.2))
    full = found['full model']
    assert np.all(abs(found['impulse, free pendulum'] - full) < 3e-3)
    assert np.any(abs(found['plastic impulse'] - full) > 3e-3)


def test_quasi_static_and_energy_bracket_the_full_model():
    found = heights(Case(GIMBALL), (0.4, 0.8, 1.2))
    assert np.all(found['quasi-static'] < found['full model'])
    assert np.all(found['energy'] > found['full model'])


def test_each_case_is_compared_with_the_models_that_apply():
    assert 'quasi-static' not in heights(Case(SHELLBALL), (0.4,))
    held = heights(holding(GIMBALL, math.pi / 2), (0.4,))
    assert {'energy, held pendulum', 'plastic impulse, held pendulum'} <= set(held)
    assert 'energy' not in held and 'impulse, free pendulum' not in held


def test_an_actuation_that_the_models_do_not_have_is_refused():
    with refused('not_a_choice', 'law'):
        compare(Case(GIMBALL, Actuation(law='velocity', set_rate=3.0)), np.array([0.4]))


def test_selected_speeds_are_grouped_into_ranges():
    speeds = np.array([0.2, 0.4, 0.6, 0.8])
    assert spans(speeds, np.array([True, True, False, True])) == [(0.2, 0.4), (0.8, 0.8)]
    assert spans(speeds, np.zeros(4, bool)) == []
    assert spans(speeds, np.ones(4, bool)) == [(0.2, 0.8)]


@pytest.fixture
def few(monkeypatch):
    """Compare at two speeds only."""
    monkeypatch.setattr('ballbot_ros.paper.cases.SPEEDS', np.array([0.3, 0.9]))


def test_the_command_prints_a_row_for_each_model(capsys, few):
    assert main(['compare-models', '--robot', 'shellball']) == 0
    out = capsys.readouterr().out
    assert out.startswith('shellball: 2 speeds from 0.3 to 0.9 m/s, full model to 0.02 mm\n')
    rows = out.splitlines()[2:]
    assert [row.split('  ')[0] for row in rows] == [
        'model', 'full model', 'energy', 'plastic impulse', 'impacts and flight']


def test_the_command_prints_all_heights_as_json(capsys, few):
    assert main(['compare-models', '--actuation', 'held', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['speeds'] == [0.3, 0.9]
    assert all(len(model['heights']) == 2 and model['cost'] > 0.0 for model in found['models'])
