# SPDX-License-Identifier: Apache-2.0
"""The evaluation of navigation: houses, report, and resuming."""
from concurrent.futures import ThreadPoolExecutor
import math

import numpy as np
import pytest

from ballbot_ros.decision import nominal_knowledge
from ballbot_ros.studies.navigation import evaluation
from ballbot_ros.studies.navigation.evaluation import (
    drive, NavigationEvaluation, page, report, run_evaluation)
from ballbot_ros.studies.navigation.houses import draw_house


@pytest.mark.parametrize('number', range(12))
def test_houses_are_reproducible_and_start_and_goal_are_free(number):
    one, two = (draw_house(nominal_knowledge().robot, 4, number) for _ in range(2))
    assert (one.truth.cells == two.truth.cells).all() and one.start == two.start
    assert one.truth.features == two.truth.features and one.map.features == two.map.features
    for x, y in (one.start[:2], one.goal):
        row, column = one.truth.cell_of((x, y))
        assert not one.truth.cells[row - 4:row + 5, column - 4:column + 5].any()
    # The map lacks only obstacles.
    assert (one.truth.cells >= one.map.cells).all()
    assert len(one.truth.features) == len(one.map.features)


def test_maps_deviate_from_the_true_heights():
    pairs = [(true.height, known.height) for number in range(30)
             for house in [draw_house(nominal_knowledge().robot, 1, number)]
             for true, known in zip(house.truth.features, house.map.features)]
    errors = np.diff(np.array(pairs), axis=1)
    assert 0.001 < np.median(np.abs(errors)) < 0.003 and np.abs(errors).max() > 0.008


def row(planner, number, **more):
    return {'number': number, 'planner': planner, 'outcome': 'succeeded', 'reason': '',
            'message': '', 'hit': 0.0, 'fell': False, 'time': 30.0, 'expected': 25.0, 'away': 0.1,
            'crossings': 1, 'replans': 0, 'cpu_s': 1.0, **more}


def test_the_report_counts_arrivals_and_correct_refusals():
    figures = report([
        row('run_up', 0), row('run_up', 1, outcome='failed', reason='no_route', expected=None),
        row('run_up', 2, outcome='failed', reason='no_route'), row('run_up', 3, away=1.0),
        row('run_up', 4, hit=0.2, fell=True, time=50.0)])['run_up']
    assert (figures['arrived'], figures['impossible'], figures['right']) == (2, 1, 3)
    assert (figures['hits'], figures['falls'], figures['time_ratio']) == (1, 1, 1.6)
    assert [item[0] for item in figures['wrong']] == [2, 3]


def test_the_page_marks_missed_targets_and_lists_wrong_results():
    rows = [row('run_up', number) for number in range(100)]
    rows.append(row('run_up', 100, outcome='failed', message='no way through the hall'))
    text = page(report([*rows, row('wall', 0)]), 7, 'ballbot evaluate-navigation --seed 7')
    assert '| 99 % | 99.0 %, 100 of 101 | met |' in text and '**missed**' not in text
    assert '* 100: failed: no way through the hall' in text and '| wall | 1 | 1 |' in text
    rows.append(row('run_up', 101, hit=0.2, outcome='failed'))
    text = page(report(rows), 7, 'ballbot evaluate-navigation --seed 7')
    assert '| 98.0 %, 100 of 102 | **missed** |' in text
    assert '| 1 in 1,000 | 1 of 102 | **missed** |' in text


def test_an_interrupted_evaluation_resumes(tmp_path, monkeypatch):
    drives = []

    def counted(house, planner):
        drives.append(house.number)
        return row(planner, house.number)
    monkeypatch.setattr(evaluation, 'drive', counted)
    with ThreadPoolExecutor(1) as pool:
        for count, new in ((4, 4), (6, 2)):
            drives.clear()
            rows = run_evaluation(NavigationEvaluation((('wall', count),)), tmp_path, pool, 1)
            assert len(drives) == new and len(rows) == count


@pytest.mark.slow
def test_a_drive_returns_a_row_of_results():
    found = drive(draw_house(nominal_knowledge().robot, 5, 3), 'run_up')
    assert found['outcome'] == 'succeeded' and found['hit'] < 0.1 and not found['fell']
    assert math.isfinite(found['time']) and found['away'] < 0.3
