# SPDX-License-Identifier: Apache-2.0
"""Gains are read, checked and refused by name."""
import pytest

from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.errors import ConfigurationError


def test_published_gains_are_those_of_the_paper():
    tuning = load_tuning('published')
    assert (tuning.position_kp, tuning.position_kd) == (40.0, 10.0)
    assert (tuning.velocity_kp, tuning.velocity_ki) == (10.0, 0.0)
    assert tuning.gravity_compensation
    assert tuning == ControlTuning()


@pytest.mark.parametrize('name, value', [
    ('position_kp', -1.0), ('position_kd', float('nan')), ('torque_limit', 0.0),
    ('velocity_ki', float('inf')), ('gravity_compensation', 1)])
def test_impossible_gains_are_refused_by_name(name, value):
    with pytest.raises(ConfigurationError, match=name):
        ControlTuning(**{name: value})


@pytest.mark.parametrize('name', ['position_kp', 'position_kd', 'velocity_kp', 'velocity_ki'])
def test_a_gain_may_be_zero_and_not_negative(name):
    assert getattr(ControlTuning(**{name: 0.0}), name) == 0.0
    with pytest.raises(ConfigurationError, match=name):
        ControlTuning(**{name: -1e-9})


def test_a_torque_limit_may_be_small():
    assert ControlTuning(torque_limit=1e-9).torque_limit == 1e-9


def test_misspelt_gain_gets_a_suggestion(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('positon_kp: 3.0\n')
    with pytest.raises(ConfigurationError, match="did you mean 'position_kp'"):
        load_tuning(str(path))


def test_unknown_tuning_lists_the_known_ones():
    with pytest.raises(ConfigurationError, match='gentle.*published'):
        load_tuning('aggressive')
