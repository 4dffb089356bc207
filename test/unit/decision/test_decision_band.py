# SPDX-License-Identifier: Apache-2.0
"""Bands: interpolation in a table of heights, without extrapolation."""
import math

from hypothesis import given, strategies
import pytest
from refusals import refused

from ballbot_ros.decision import load_curve
from ballbot_ros.decision.planning.curve import Band
from ballbot_ros.errors import ConfigurationError

FINE = {'samples': 2, 'seed': 0, 'varied': {}, 'speeds': [0.2, 0.4],
        'probabilities': [0.0, 1.0], 'heights': [[0.01, 0.02], [0.03, 0.04]]}


@given(strategies.floats(0.2, 1.2), strategies.floats(0.0, 0.1), strategies.floats(0.0, 0.01))
def test_probability_falls_with_height_and_quantiles_invert_it(speed, height, more):
    band = load_curve('gimball_down').band
    chance = band.probability_of_passing(speed, height)
    assert 0.0 <= band.probability_of_passing(speed, height + more) <= chance <= 1.0
    if 0.0 < chance < 1.0:
        assert band.quantile(speed, 1.0 - chance) == pytest.approx(height, abs=1e-9)


@pytest.mark.parametrize('change', [
    {'speeds': [0.4, 0.2]}, {'probabilities': [0.0, 0.5]}, {'heights': [[0.01, 0.02]]},
    {'heights': [[0.02, 0.01], [0.03, 0.04]]}, {'heights': 3.0}, {'samples': 1},
    {'heights': [[0.01, math.nan], [0.03, 0.04]]}, {'speeds': ['a', 'b']}, {'colour': 'red'},
    {'speeds': [0.2], 'heights': [[0.01, 0.02]]},
    {'probabilities': [0.0], 'heights': [[0.01], [0.03]]},
    {'probabilities': [1.0], 'heights': [[0.01], [0.03]]},
    {'speeds': [0.2, 0.2]}, {'speeds': [0.2, math.inf]}, {'speeds': [[0.2, 0.4]]},
    {'probabilities': [0.1, 1.0]}, {'probabilities': [[0.0, 1.0]]}, {'seed': -1},
    {'probabilities': [0.0, 0.5, 0.5, 1.0], 'heights': 2 * [[0.01, 0.02, 0.03, 0.04]]}])
def test_a_band_that_is_not_a_table_of_increasing_numbers_is_refused(change):
    Band.from_mapping(FINE, 'here')
    with pytest.raises(ConfigurationError, match='here: '):
        Band.from_mapping({**FINE, **change}, 'here')


def test_bands_are_not_extrapolated():
    band = Band.from_mapping(FINE, 'here')
    for speed in (0.1, 0.5, math.nan):
        with refused('out_of_range', 'speed'):
            band.probability_of_passing(speed, 0.02)
    with refused('not_finite', 'height'):
        band.probability_of_passing(0.3, math.nan)


@pytest.mark.parametrize('name', FINE)
def test_a_table_with_a_missing_field_is_refused(name):
    with refused('missing', name):
        Band.from_mapping({key: value for key, value in FINE.items() if key != name}, 'here')


def test_the_table_is_interpolated_linearly_in_speed_and_probability():
    band = Band.from_mapping(FINE, 'here')
    assert band.quantile(0.3, 0.25) == pytest.approx(0.0225)
    assert (band.quantile(0.2, 0.0), band.quantile(0.4, 1.0)) == (0.01, 0.04)
    assert band.probability_of_passing(0.3, 0.0275) == pytest.approx(0.25)
    assert band.probability_of_passing(0.2, 0.01) == 1.0
    assert band.probability_of_passing(0.2, 0.02) == 0.0
    assert band.probability_of_passing(0.2, 0.05) == 0.0
    for probability in (-0.01, 1.01, math.nan):
        with refused('out_of_range', 'probability'):
            band.quantile(0.3, probability)


def test_lists_of_a_file_and_computed_tuples_give_equal_bands():
    assert Band.from_mapping(FINE, 'here') == Band(
        2, 0, {}, (0.2, 0.4), (0.0, 1.0), ((0.01, 0.02), (0.03, 0.04)))


def test_at_a_height_of_several_quantiles_the_lowest_probability_is_returned():
    band = Band.from_mapping({**FINE, 'probabilities': [0.0, 0.2, 0.6, 1.0],
                              'heights': 2 * [[0.01, 0.02, 0.02, 0.03]]}, 'here')
    assert band.probability_of_passing(0.3, 0.02) == pytest.approx(0.4)
