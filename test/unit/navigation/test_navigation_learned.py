# SPDX-License-Identifier: Apache-2.0
"""Learned data of a floor: outcomes are counted, and belong to the features of the map."""
from dataclasses import replace
import json

import pytest
from refusals import refused

from ballbot_ros.floors.floor import Feature
from ballbot_ros.navigation.learned import Learned

ATTEMPTS = [(3, 1, 0.5, True)] * 4 + [(3, 1, 0.2, False)] * 2 + [(3, -1, 0.5, False)]


def test_the_number_of_stored_outcomes_does_not_grow_with_the_attempts(tmp_path):
    learned = Learned()
    for attempt in 100 * ATTEMPTS:
        learned = learned.with_outcome(*attempt)
    assert set(learned.outcomes) == {
        (3, 1, 0.5, True, 400), (3, 1, 0.2, False, 200), (3, -1, 0.5, False, 100)}
    learned.write(tmp_path / 'learned.json')
    assert Learned.read(tmp_path / 'learned.json') == learned


def test_outcomes_weigh_against_a_prior_of_5_attempts():
    learned = Learned()
    for attempt in ATTEMPTS:
        learned = learned.with_outcome(*attempt)
    # Prior of 5 attempts; successes apply to longer run-ups, failures to shorter ones.
    assert learned.probability(3, 1, 0.5, 0.8) == pytest.approx((5 * 0.8 + 4) / 9)
    assert learned.probability(3, 1, 0.2, 0.8) == pytest.approx((5 * 0.8 + 0) / 7)
    assert learned.probability(3, -1, 0.35, 0.8) == pytest.approx((5 * 0.8 + 0) / 6)
    assert learned.probability(4, 1, 0.5, 0.8) == 0.8


def test_learned_data_stay_with_their_feature_when_the_floor_changes(tmp_path):
    sill, cord, rug = (Feature(kind=kind, line=[[0.0, y], [1.0, y]], height=0.01)
                       for kind, y in (('step', 0.5), ('cord', 1.0), ('threshold', 1.5)))
    before = replace(Learned().on([sill, cord]), obstacles=((0.2, 0.3),)) \
        .with_height(0, 0.02).with_height(1, 0.03).with_outcome(1, -1, 0.5, False)
    before.write(tmp_path / 'learned.json')
    after = Learned.read(tmp_path / 'learned.json').on([rug, replace(cord, name='cable')])
    assert (after.heights, after.outcomes) == (((1, 0.03),), ((1, -1, 0.5, False, 1),))
    assert after.obstacles == before.obstacles


@pytest.mark.parametrize('corrected', [{'height': 0.02}, {'width': 0.08}])
def test_a_corrected_feature_of_the_map_replaces_what_was_learned_of_it(corrected, tmp_path):
    cord, sill = (Feature(kind='cord', line=[[0.0, y], [1.0, y]], height=0.01)
                  for y in (0.5, 1.0))
    Learned().on([cord, sill]).with_height(0, 0.03).with_height(1, 0.03) \
        .with_outcome(0, -1, 0.5, False).write(tmp_path / 'learned.json')
    after = Learned.read(tmp_path / 'learned.json').on([replace(cord, **corrected), sill])
    assert (after.heights, after.outcomes) == (((1, 0.03),), ())


def test_a_damaged_file_is_refused(tmp_path):
    path = tmp_path / 'learned.json'
    for content in ('', '{}', json.dumps({'version': 1}), json.dumps({
            'version': 2, 'heights': [], 'obstacles': [], 'outcomes': [[0, 1, 0.5, True]],
            'places': []})):
        path.write_text(content)
        with refused('unreadable', str(path)):
            Learned.read(path)
