# SPDX-License-Identifier: Apache-2.0
"""Comparison of lateral model and table with an independent three-dimensional simulator."""
import importlib
import math
from pathlib import Path
import sys

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.crossing import max_step_height
from ballbot_ros.physics import load_robot
from ballbot_ros.steering import load_oblique_steps, yaw_rate_limit
from ballbot_ros.studies import free_ball
from ballbot_ros.studies.free_ball import compare

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / 'scripts'))

oblique_steps = importlib.import_module('oblique_steps')

GIMBALL = load_robot('gimball')
DEGREE = math.radians(1.0)

with_mujoco = pytest.mark.skipif(
    not free_ball.installed(), reason=f'MuJoCo is not installed ({free_ball.HOW_TO_INSTALL})')


def deviation(found, name):
    """Return the root mean square difference of the models."""
    return np.sqrt(np.mean((found.mujoco[name] - found.model[name])**2))


def heading_error(found):
    """Return the largest heading difference [rad]."""
    return np.abs(found.mujoco['heading'] - found.model['heading']).max()


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('speed', [0.1, 0.4, 1.2])
@pytest.mark.parametrize('lean, heading', [(0.1, 0.5), (0.2, 1.0), (0.3, 2.5), (0.4, 5.0)])
def test_a_step_input_of_the_lean_turns_the_ball_as_in_mujoco(speed, lean, heading):
    found = compare(GIMBALL, speed, lean)
    assert deviation(found, 'tilt') < 0.7 * DEGREE
    assert deviation(found, 'yaw_rate') < 0.03
    assert heading_error(found) < heading * DEGREE
    assert np.ptp(found.mujoco['heading']) > 10.0 * DEGREE


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('speed', [0.1, 0.4, 1.2])
@pytest.mark.parametrize('share', [-0.5, 1.0])
def test_the_steering_law_tracks_the_yaw_rate_in_mujoco(speed, share):
    wanted = share * yaw_rate_limit(GIMBALL, speed)
    found = compare(GIMBALL, speed, yaw_rate=wanted)
    assert heading_error(found) < 0.5 * DEGREE
    assert deviation(found, 'yaw_rate') < 3e-3
    # The speed falls in the turn, and with it the yaw rate if the lean limits it.
    at_the_end = min(abs(wanted), yaw_rate_limit(GIMBALL, found.mujoco['speed'][-1]))
    assert abs(found.mujoco['yaw_rate'][-1]) == pytest.approx(at_the_end, rel=0.02)
    late = found.mujoco['tilt'][len(found.time) // 2:]
    assert np.ptp(late) < 2.0 * DEGREE


@pytest.mark.slow
@with_mujoco
def test_the_comparison_detects_another_pendulum():
    other = GIMBALL.replace(pendulum_length=1.1 * GIMBALL.pendulum_length)
    good, bad = (compare(robot, 0.8, 0.2) for robot in (GIMBALL, other))
    assert np.abs(good.mujoco['heading'] - bad.model['heading']).max() > 3.0 * heading_error(good)


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('speed', [0.5, 1.1])
def test_at_right_angles_the_maximum_height_is_that_of_the_planar_model(speed):
    found = oblique_steps.maximum_height(oblique_steps.ObliqueApproach(GIMBALL, speed))
    assert found == pytest.approx(max_step_height(GIMBALL, speed).height, abs=1.2e-4)


@pytest.fixture(scope='module')
def measured():
    return oblique_steps.measure(GIMBALL, 0.8, None, angles=(0, 15, 45))


@pytest.mark.slow
@with_mujoco
@pytest.mark.parametrize('number, degrees', [(1, 15), (2, 45)])
def test_the_table_agrees_with_the_simulation(measured, number, degrees):
    table = load_oblique_steps()
    factor = measured.heights[number] / measured.heights[0]
    column = list(table.angles_deg).index(degrees)
    assert table.lowest_factor[column] - 0.005 <= factor <= table.highest_factor[column] + 0.005
    for changes, low, high in (
            (measured.course_changes, table.lowest_course_change_deg,
             table.highest_course_change_deg),
            (measured.heading_changes, table.lowest_heading_change_deg,
             table.highest_heading_change_deg)):
        # The last fraction is so close to the limit that rounding of the height has an effect.
        turned = np.degrees(changes[number])[:2]
        assert (np.array(low[column])[:2] - 0.5 <= turned).all()
        assert (turned <= np.array(high[column])[:2] + 0.5).all()


def test_without_mujoco_the_comparison_is_refused(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    with refused('not_installed', 'mujoco'):
        compare(GIMBALL, 0.4, 0.2)
