# SPDX-License-Identifier: Apache-2.0
"""Gains are loaded and checked; invalid gains are refused by name."""
import pytest
from refusals import refused

from ballbot_ros.control import ControlTuning, load_tuning


def test_the_published_gains_are_those_of_the_paper():
    tuning = load_tuning('published')
    assert (tuning.position_kp, tuning.position_kd) == (40.0, 10.0)
    assert (tuning.velocity_kp, tuning.velocity_ki) == (10.0, 0.0)
    assert tuning.gravity_compensation
    assert tuning == ControlTuning()


@pytest.mark.parametrize('name, value, reason', [
    ('position_kp', -1.0, 'out_of_range'), ('position_kd', float('nan'), 'not_finite'),
    ('torque_limit', 0.0, 'out_of_range'), ('velocity_ki', float('inf'), 'not_finite'),
    ('swing_time', -1.0, 'out_of_range'), ('observer_rate', float('inf'), 'not_finite'),
    ('gravity_compensation', 1, 'wrong_type')])
def test_invalid_gains_are_refused_by_name(name, value, reason):
    with refused(reason, name):
        ControlTuning(**{name: value})


@pytest.mark.parametrize('name', ['position_kp', 'position_kd', 'velocity_kp', 'velocity_ki'])
def test_a_gain_may_be_zero_but_not_negative(name):
    assert getattr(ControlTuning(**{name: 0.0}), name) == 0.0
    with refused('out_of_range', name):
        ControlTuning(**{name: -1e-9})


def test_a_torque_limit_may_be_small():
    assert ControlTuning(torque_limit=1e-9).torque_limit == 1e-9


def test_a_misspelled_gain_is_refused_with_a_suggestion(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('positon_kp: 3.0\n')
    with refused('unknown_name', 'positon_kp') as caught:
        load_tuning(str(path))
    assert "did you mean 'position_kp'" in str(caught.value)


def test_an_unknown_tuning_is_refused_with_the_known_ones():
    with refused('unknown_name', 'tuning') as caught:
        load_tuning('aggressive')
    assert 'gentle' in str(caught.value) and 'published' in str(caught.value)
