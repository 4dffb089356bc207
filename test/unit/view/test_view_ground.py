# SPDX-License-Identifier: Apache-2.0
"""The step ahead is found, and can change without moving the ground below the ball."""
import numpy as np
import pytest
from refusals import refused

from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.view.ground import NEW_STEP_DISTANCE, step_ahead, with_step

RADIUS = 0.226


@pytest.fixture
def doorstep():
    return load_scene('doorstep').model.terrain


def test_the_step_ahead_is_the_next_one(doorstep):
    assert step_ahead(doorstep, 0.0, RADIUS) == pytest.approx((0.726, 0.031))
    assert step_ahead(doorstep, 1.0, RADIUS) == pytest.approx((3.726, 0.080))
    assert step_ahead(doorstep, 5.0, RADIUS) is None


def test_a_drop_ahead_is_shown_by_its_sign():
    assert step_ahead(Terrain.step(-0.1, at=1.0), 0.0, RADIUS) == pytest.approx((1.0, -0.1))


def test_a_slope_is_not_a_step():
    assert step_ahead(Terrain.slope(0.1), 0.0, RADIUS) is None


def test_another_height_moves_the_ground_behind_the_step_only(doorstep):
    changed = with_step(doorstep, 0.0, RADIUS, 0.050)
    assert step_ahead(changed, 0.0, RADIUS) == pytest.approx((0.726, 0.050))
    assert step_ahead(changed, 1.0, RADIUS) == pytest.approx((3.726, 0.080))
    places = np.array([-1.0, 0.5, 2.0])
    assert changed.height(places) - doorstep.height(places) == pytest.approx([0.0, 0.0, 0.019])


def test_a_step_can_become_a_drop_or_be_removed(doorstep):
    assert step_ahead(with_step(doorstep, 0.0, RADIUS, -0.04), 0.0, RADIUS).height \
        == pytest.approx(-0.04)
    without = with_step(doorstep, 0.0, RADIUS, 0.0)
    assert step_ahead(without, 0.0, RADIUS) == pytest.approx((3.726, 0.080))


@pytest.mark.parametrize('ground, x', [
    (Terrain.flat(), 0.0), (Terrain.flat(), -5.0), (Terrain.flat(), 7.0),
    (Terrain.slope(0.05), 2.0)])
def test_a_step_is_added_if_none_is_ahead(ground, x):
    changed = with_step(ground, x, RADIUS, 0.03)
    made = step_ahead(changed, x, RADIUS)
    assert made == pytest.approx((x + NEW_STEP_DISTANCE, 0.03))
    before, behind = x + NEW_STEP_DISTANCE - 0.5, x + NEW_STEP_DISTANCE + 3.0
    assert changed.height(before) == pytest.approx(ground.height(before))
    assert changed.height(behind) == pytest.approx(ground.height(behind) + 0.03)


def test_a_step_of_zero_height_is_not_added():
    flat = Terrain.flat()
    assert with_step(flat, 0.0, RADIUS, 0.0) is flat


def test_the_friction_of_the_ground_is_kept():
    terrain = load_scene('household').model.terrain
    changed = with_step(terrain, 0.3, RADIUS, 0.02)
    frictions = terrain.surface_friction[~np.isnan(terrain.surface_friction)]
    assert changed.surface_friction[~np.isnan(changed.surface_friction)] \
        == pytest.approx(frictions)


def test_the_ground_does_not_move_beneath_the_ball(doorstep):
    with refused('inconsistent', 'step_height'):
        with_step(doorstep, 0.626, RADIUS, 0.05)
