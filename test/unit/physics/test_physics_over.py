# SPDX-License-Identifier: Apache-2.0
"""The rules for a completed crossing: past the edge or clear of it."""
import math

from crossing_cases import crossing_of, ground_of
import numpy as np
import pytest
from reference_search import highest_step, terrain_of
from refusals import refused

from ballbot_ros.crossing import held_at, max_step_height, rolling, Rules, Site
from ballbot_ros.crossing.attempt import attempt
from ballbot_ros.physics import Actuation, load_robot

GIMBALL, SHELLBALL = load_robot('gimball'), load_robot('shellball')
RISE = Site(slope_behind=0.05)
CLEAR = Rules(over='clear')


@pytest.mark.parametrize('site', [
    Site(), RISE, Site(-0.3, 0.7, 0.1, 0.2, 0.3), Site(0.5, -0.4, friction_edge=0.9),
    Site(friction_before=0.0), Site(friction_behind=2.0)])
@pytest.mark.parametrize('height', [1e-3, 0.03, 1.0])
def test_the_profile_of_a_site_equals_that_of_its_terrain(site, height):
    robot = GIMBALL
    expected = terrain_of(site, height).profile(robot.surface_friction, robot.edge_friction)
    assert ground_of(site, robot, height) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_on_rising_ground_the_rule_clear_gives_lower_heights():
    # The ball must climb the ground behind the edge; half a radius is 11 cm.
    heights = [1e3 * max_step_height(GIMBALL, 0.85, site=RISE, rules=rules).height for rules in (
        Rules(), CLEAR, Rules(over='clear', clearance=0.5))]
    assert heights == pytest.approx([34.5, 32.1, 29.6], abs=0.1)


def test_on_level_ground_and_downhill_both_rules_nearly_agree():
    for slope in (0.0, -0.1):
        edge, clear = (max_step_height(GIMBALL, 0.85, site=Site(slope_behind=slope), rules=rules)
                       for rules in (Rules(), CLEAR))
        assert clear.height == pytest.approx(edge.height, abs=2e-4)


@pytest.mark.parametrize('robot, actuation, site', [
    (GIMBALL, Actuation(), RISE), (SHELLBALL, Actuation(), Site(slope_behind=0.2)),
    (GIMBALL, rolling(GIMBALL)(0.6), Site(-0.05, 0.1)), (GIMBALL, held_at(0.0), RISE)])
def test_the_heights_by_the_rule_clear_agree_with_the_reference(robot, actuation, site):
    found = max_step_height(robot, 0.6, actuation, accuracy=2e-5, site=site, rules=CLEAR, scan=6)
    known = highest_step(robot, 0.6, actuation, tolerance=2e-4, site=site, rules=CLEAR)
    assert known - 4e-5 <= found.height <= known + 2.4e-4
    assert found.monotone and found.error <= 2e-5


def test_an_attempt_ends_early_only_if_the_ball_cannot_clear_the_edge():
    # A motor with zero torque gives the same motion but disables the energy criterion.
    for slope in (-0.3, 0.0, 0.1, 0.3):
        site = Site(slope_behind=slope)
        middle = max_step_height(GIMBALL, 0.7, accuracy=1e-7, site=site, rules=CLEAR).height
        shares = np.concatenate([np.linspace(0.1, 2.0, 12), [0.99, 0.999, 1.003, 1.01]])
        verdicts = []
        for law in (Actuation(), Actuation('torque', torque=0.0)):
            crossing = crossing_of(GIMBALL, 0.7, law, site, CLEAR)
            verdicts.append([
                attempt(share * middle, 1e-8, crossing)[0] > 0.0 for share in shares.tolist()])
        assert verdicts[0] == verdicts[1] == (shares < 1.0).tolist()


@pytest.mark.parametrize('reason, change', [
    ('not_a_choice', {'over': 'maybe'}), ('out_of_range', {'clearance': 0.0}),
    ('not_finite', {'clearance': math.nan})])
def test_impossible_rules_are_refused_by_name(reason, change):
    with refused(reason, next(iter(change))):
        Rules(**change)
