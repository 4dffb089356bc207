# SPDX-License-Identifier: Apache-2.0
"""Learned data of a floor: outcomes are counted, and files of earlier versions are read."""
import json

import pytest

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


def test_a_file_with_a_row_for_each_attempt_gives_the_same_probability(tmp_path):
    path = tmp_path / 'learned.json'
    path.write_text(json.dumps(
        {'version': 2, 'heights': [], 'obstacles': [], 'outcomes': ATTEMPTS}))
    learned = Learned.read(path)
    # Prior of 5 attempts; successes apply to longer run-ups, failures to shorter ones.
    assert learned.probability(3, 1, 0.5, 0.8) == pytest.approx((5 * 0.8 + 4) / 9)
    assert learned.probability(3, 1, 0.2, 0.8) == pytest.approx((5 * 0.8 + 0) / 7)
    assert learned.probability(3, -1, 0.35, 0.8) == pytest.approx((5 * 0.8 + 0) / 6)
    assert learned.probability(4, 1, 0.5, 0.8) == 0.8
