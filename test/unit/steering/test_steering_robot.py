# SPDX-License-Identifier: Apache-2.0
"""The section ``steering`` of a robot file is handled like the other sections."""
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.config.files import read_yaml, shipped_folder
from ballbot_ros.physics import Actuation, load_robot, Model, Robot, simulate, Terrain
from ballbot_ros.physics.model.robot import STEERING, with_parameters

GIMBALL = load_robot('gimball')
CONTENT = read_yaml(shipped_folder('config') / 'robots' / 'gimball.yaml')


def test_all_steering_parameters_of_gimball_are_assumed_with_a_range():
    for name in STEERING:
        source = GIMBALL.provenance[name]
        assert source.source == 'assumed'
        assert source.low < getattr(GIMBALL.steering, name.partition('.')[2]) < source.high


@pytest.mark.parametrize('changes, reason, field', [
    ({'largest_lean': -0.1}, 'out_of_range', 'largest_lean'),
    ({'largest_lean': 23.0}, 'out_of_range', 'largest_lean'),
    ({'largest_torque': 'much'}, 'wrong_type', 'largest_torque'),
    ({'largest_lean_rate': {'value': 90.0, 'unit': 'deg/s'}}, 'not_a_choice',
     'largest_lean_rate'),
    ({'largest_tilt': 0.2}, 'unknown_name', 'largest_tilt')])
def test_an_invalid_value_is_refused_with_its_location(changes, reason, field):
    content = {**CONTENT, 'steering': {**CONTENT['steering'], **changes}}
    with refused(reason, field) as refusal:
        Robot.from_mapping(content, 'mine.yaml')
    assert 'mine.yaml: steering' in str(refusal.value)


def test_a_robot_without_the_section_has_no_steering():
    content = {name: entry for name, entry in CONTENT.items() if name != 'steering'}
    assert Robot.from_mapping(content, 'mine.yaml').steering is None
    with refused('missing', 'steering'):
        with_parameters(load_robot('shellball'), {'steering.largest_lean': 0.3})


def test_a_parameter_is_changed_by_name():
    changed = with_parameters(GIMBALL, {'steering.largest_lean': 0.3})
    assert changed.steering.largest_lean == 0.3
    assert changed.motor == GIMBALL.motor


def test_planar_motion_and_the_digest_do_not_depend_on_steering():
    without = GIMBALL.replace(steering=None)
    assert without.digest == GIMBALL.digest
    ends = []
    for robot in (GIMBALL, without):
        model = Model(robot, Terrain.step(0.02, at=0.5))
        ends.append(simulate(model, model.at_rest(0.2, speed=0.8), Actuation(), 0.5)['x'])
    np.testing.assert_array_equal(*ends)
