# SPDX-License-Identifier: Apache-2.0
"""Values of controls are checked before they reach the source."""
import pytest
from refusals import refused

from ballbot_ros.view.source import checked, Control

CONTROLS = {
    'speed': Control(1.0, 0.1, 4.0), 'pause': Control(False),
    'law': Control('free', choices=('free', 'hold')),
    'reset': Control(refusal='a recording cannot start again'),
    'step_height': Control(0.03, -0.2, 0.2, 'm')}


@pytest.mark.parametrize('name, value', [
    ('speed', 2), ('pause', True), ('law', 'hold'), ('step_height', -0.1)])
def test_an_allowed_value_is_passed_on(name, value):
    assert checked(CONTROLS, name, value) == value


@pytest.mark.parametrize('name, value, reason, words', [
    ('speed', 5.0, 'out_of_range', 'at least 0.1 and at most 4'),
    ('speed', float('nan'), 'not_finite', 'at least'),
    ('speed', float('inf'), 'not_finite', 'at least'),
    ('speed', 'fast', 'wrong_type', "'fast'"), ('speed', True, 'wrong_type', 'True'),
    ('pause', 1.0, 'wrong_type', 'true or false'), ('law', 'swim', 'not_a_choice', 'free, hold'),
    ('step_height', 0.5, 'out_of_range', 'at most 0.2 m'),
    ('reset', True, 'unavailable', 'cannot start again'), ('seek', 1.0, 'unknown_name', "'seek'")])
def test_other_values_are_refused_with_the_allowed_ones(name, value, reason, words):
    with refused(reason, name) as caught:
        checked(CONTROLS, name, value)
    assert words in str(caught.value)


def test_an_end_of_a_range_is_not_refused_for_rounding():
    assert checked(CONTROLS, 'speed', 4.0 + 1e-12) == 4.0
