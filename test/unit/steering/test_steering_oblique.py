# SPDX-License-Identifier: Apache-2.0
"""Oblique steps: the shipped table and refused inputs."""
import math

import pytest
from refusals import refused

from ballbot_ros.config.files import read_yaml, shipped_folder
from ballbot_ros.steering import height_factor, load_oblique_steps, ObliqueSteps

TABLE = load_oblique_steps()
CONTENT = read_yaml(shipped_folder('config') / 'oblique' / 'gimball.yaml')


def test_the_factor_decreases_with_the_angle_on_both_sides():
    factors = [height_factor(math.radians(angle)) for angle in range(0, 46, 5)]
    assert factors[0] == 1.0
    assert factors == sorted(factors, reverse=True)
    assert height_factor(-0.3) == height_factor(0.3)


def test_the_factor_is_the_lowest_of_all_cases():
    for angle, low, high in zip(TABLE.angles_deg, TABLE.lowest_factor, TABLE.highest_factor):
        assert height_factor(math.radians(angle)) == pytest.approx(low)
        assert low <= high


def test_the_factor_is_close_to_that_of_the_speed_normal_to_the_edge():
    # The reason why it is also used for other robots.
    for degrees in range(0, 46, 5):
        angle = math.radians(degrees)
        assert 0.98 < height_factor(angle) / math.cos(angle)**2 < 1.04


@pytest.mark.parametrize('degrees', [46.0, 90.0, 180.0, math.nan])
def test_beyond_the_table_no_crossing_is_permitted(degrees):
    assert height_factor(math.radians(degrees)) == 0.0


@pytest.mark.parametrize('field, value, reason', [
    ('lowest_factor', [1.0], 'wrong_length'), ('angles_deg', [0, 30, 15, 45], 'inconsistent'),
    ('height_shares', 'all', 'wrong_type'), ('highest_factor', [1, 1, math.nan, 1], 'wrong_type'),
    ('lowest_course_change_deg', [[0, 0, 0]], 'wrong_length'), ('source', 'guessed',
                                                               'not_a_choice')])
def test_an_inconsistent_table_is_refused(field, value, reason):
    with refused(reason, field):
        ObliqueSteps.from_mapping({**CONTENT, field: value}, 'mine.yaml')
