# SPDX-License-Identifier: Apache-2.0
"""What a control is given is checked before the source sees it."""
import pytest

from ballbot_ros.errors import ConfigurationError
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


@pytest.mark.parametrize('name, value, words', [
    ('speed', 5.0, 'at least 0.1 and at most 4'), ('speed', float('nan'), 'at least'),
    ('speed', float('inf'), 'at least'), ('speed', 'fast', "'fast'"), ('speed', True, 'True'),
    ('pause', 1.0, 'true or false'), ('law', 'swim', 'free, hold'),
    ('step_height', 0.5, 'at most 0.2 m'), ('reset', True, 'cannot start again'),
    ('seek', 1.0, "'seek' is not a control here")])
def test_anything_else_is_refused_with_what_is_allowed(name, value, words):
    with pytest.raises(ConfigurationError, match=words):
        checked(CONTROLS, name, value)


def test_an_end_of_a_range_is_not_refused_for_rounding():
    assert checked(CONTROLS, 'speed', 4.0 + 1e-12) == 4.0
