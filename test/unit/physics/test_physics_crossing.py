# SPDX-License-Identifier: Apache-2.0
"""The published crossings succeed, and the thresholds match an independent program."""
import math

import numpy as np
import pytest
from reference_search import CASES, crosses, highest_step
from refusals import refused
from tiers import pairs

from ballbot_ros.crossing import held_at, max_step_heights, rolling, Rules, try_step
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.physics import ContactOptions, load_robot, load_scene

GIMBALL = load_robot('gimball')
SPEEDS = [0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2]

# Maximum step height [mm] at each speed, from an independent C program that was written before
# this package (physics-notes, section 2.1).  Nothing here was fitted to it.
TABLE = {
    'shellball free': [
        3.12, 6.78, 11.11, 15.58, 19.94, 24.00, 27.69, 30.95, 33.81, 36.31, 38.48],
    'gimball free': [
        2.33, 5.20, 9.41, 14.44, 20.00, 25.86, 31.78, 37.56, 43.11, 48.34, 53.23],
    'gimball down': [
        2.34, 5.20, 9.36, 14.33, 19.77, 25.42, 31.05, 36.50, 41.64, 46.44, 50.88],
    'gimball level': [
        8.36, 13.14, 18.72, 24.69, 30.84, 37.00, 43.00, 48.72, 54.06, 59.00, 63.53]}
# The C program starts 2 mm before the touch; a level pendulum accelerates the ball until then.
ITS_RULES = Rules(lead=0.002)


@pytest.mark.slow
@pytest.mark.parametrize('case', TABLE)
def test_thresholds_agree_with_the_independent_program(case):
    robot, actuation = CASES[case]
    found = [1e3 * highest_step(robot, speed, actuation, rules=ITS_RULES) for speed in SPEEDS]
    np.testing.assert_allclose(found, TABLE[case], atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize('case', TABLE)
def test_with_the_lever_of_that_program_thresholds_agree_within_both_brackets(case):
    # That program uses the printed R in eq. (8), and a clamp; each bracket is 0.05 mm wide.
    robot, actuation = CASES[case]
    options = ContactOptions(slip_lever='radius')
    found = [1e3 * highest_step(robot, speed, actuation, options=options, rules=ITS_RULES)
             for speed in SPEEDS]
    np.testing.assert_allclose(found, TABLE[case], atol=0.07)
    fast = max_step_heights(robot, SPEEDS, actuation, options=options, rules=ITS_RULES)
    np.testing.assert_allclose([1e3 * item.height for item in fast], TABLE[case], atol=0.07)


@pytest.mark.slow
@pytest.mark.parametrize('case', TABLE)
@pytest.mark.parametrize('speed', [0.4, 1.0])
def test_the_literal_paper_has_nearly_the_same_thresholds(case, speed):
    robot, actuation = CASES[case]
    literal = ContactOptions(pulling=True, slip_lever='radius')
    own = highest_step(robot, speed, actuation)
    assert highest_step(robot, speed, actuation, options=literal) == pytest.approx(own, abs=4e-4)
    smooth = ContactOptions(friction_ramp='smooth')
    assert highest_step(robot, speed, actuation, options=smooth) == pytest.approx(own, abs=1e-4)


@pytest.mark.parametrize('case, speed', pairs(list(TABLE), [0.3, 0.8, 1.2]))
def test_every_step_below_the_threshold_is_crossed_and_none_above(case, speed):
    robot, actuation = CASES[case]
    threshold = highest_step(robot, speed, actuation)
    for share in (0.2, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99):
        assert crosses(robot, speed, share * threshold, actuation)
    for share in (1.01, 1.02, 1.05, 1.1, 1.3, 2.0):
        assert not crosses(robot, speed, share * threshold, actuation)


def test_the_threshold_lies_within_the_requested_bracket():
    for tolerance in (1e-3, 5e-5, 1e-6):
        low = highest_step(GIMBALL, 0.7, tolerance=tolerance)
        assert crosses(GIMBALL, 0.7, low)
        assert not crosses(GIMBALL, 0.7, low + tolerance)


def test_the_threshold_rises_with_speed_and_with_a_level_pendulum():
    found = {case: np.array([item.height for item in max_step_heights(robot, SPEEDS, actuation)])
             for case, (robot, actuation) in CASES.items()}
    assert all(np.all(np.diff(heights) > 0.0) for heights in found.values())
    assert np.all(found['gimball level'] > found['gimball down'] + 5e-3)


@pytest.mark.parametrize('speed, height, actuation', [
    (0.76, 0.021, held_at(0.0)), (0.78, 0.031, rolling(GIMBALL)(0.78)),
    (1.09, 0.056, held_at(math.pi / 2))], ids=['top', 'middle', 'bottom'])
def test_the_crossings_of_figure_7_succeed(speed, height, actuation):
    assert crosses(GIMBALL, speed, height, actuation)


@pytest.mark.parametrize('row', ['top', 'middle', 'bottom'])
def test_the_scenes_of_figure_7_succeed(row):
    scene = load_scene(f'fig7_{row}')
    run = scene.simulate()
    face = scene.model.terrain.vertices[1, 0]
    upper = scene.model.terrain.vertices[-1, 1]
    over = np.flatnonzero(run['x'] > face + 0.05)
    assert len(over) and (run['x'][over[0]:] > face).all()
    assert (run['y'][over] > upper + 0.9 * scene.model.robot.ball_radius).all()


def test_the_pendulum_angles_agree_with_figure_7():
    top, middle, bottom = (
        load_scene(f'fig7_{row}').simulate() for row in ('top', 'middle', 'bottom'))
    assert np.degrees(np.abs(top['pendulum_angle']).max()) < 40.0
    assert np.degrees(middle['pendulum_angle'].max()) > 45.0
    assert np.degrees(np.abs(bottom['pendulum_angle'] - math.pi / 2).max()) < 40.0


def test_the_touch_distance_is_where_the_ball_first_contacts_the_edge():
    for height in (0.005, 0.031, 0.1, 0.226, 0.5):
        below = min(height, 0.226)
        assert (0.226 - below)**2 + touch_distance(0.226, height)**2 == pytest.approx(
            0.226**2, rel=1e-12)
    assert touch_distance(0.226, 0.03, 0.0016) > touch_distance(0.226, 0.03)
    for slope, height in ((0.2, 0.03), (-0.2, 0.03), (0.2, 0.5)):
        ahead = touch_distance(0.226, height, slope=slope)
        centre = 0.226 / math.cos(slope) - ahead * math.tan(slope)  # above the foot
        assert math.hypot(ahead, min(height - centre, 0.0)) == pytest.approx(0.226, rel=1e-12)


@pytest.mark.parametrize('reason, name, arguments', [
    ('out_of_range', 'speed', (0.0, 0.01)), ('out_of_range', 'speed', (-1.0, 0.01)),
    ('not_finite', 'speed', (math.nan, 0.01)), ('out_of_range', 'height', (0.5, 0.0)),
    ('not_finite', 'height', (0.5, math.inf))])
def test_impossible_crossings_are_refused_by_name(reason, name, arguments):
    with refused(reason, name):
        try_step(GIMBALL, *arguments)
