# SPDX-License-Identifier: Apache-2.0
"""The camera presets show the whole ball in windows of all shapes."""
import math

import numpy as np
import pytest

pytest.importorskip('viser', reason='viser is not installed')

from ballbot_ros.view.stage import camera_of, CAMERAS, FIELD_OF_VIEW, tiles  # noqa: I100, I202

RADIUS = 0.226


def seen(name, aspect, point):
    """Return the position of a point: right and up, relative to half of width and height."""
    position, target = (np.array(item) for item in camera_of(name, aspect))
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up, ray = np.cross(right, forward), np.array(point) - position
    scale = math.tan(0.5 * FIELD_OF_VIEW) * (ray @ forward)
    return ray @ right / (aspect * scale), ray @ up / scale


@pytest.mark.parametrize('name', CAMERAS)
@pytest.mark.parametrize('aspect, width, bottom', [
    (390 / 844, 1.0, -0.2), (360 / 640, 1.0, -0.2), (820 / 1180, 1 / 3, -1.0),
    (262 / 1180, 1.0, -1.0), (16 / 9, 0.57, -1.0)])
def test_the_ball_is_completely_visible_between_or_above_the_panels(name, aspect, width, bottom):
    for angle in np.linspace(0.0, 2.0 * math.pi, 24):
        right, up = seen(name, aspect, (
            RADIUS * math.cos(angle), 0.0, RADIUS * (1.0 + math.sin(angle))))
        assert abs(right) < width and bottom < up < 1.0


@pytest.mark.parametrize('face', [0.25, 0.5, 0.6])
def test_no_tile_slopes_beside_a_face(face):
    line = np.array([[0.0, 0.0], [face, 0.0], [face, 0.1], [1.0, 0.1]])
    sides = tiles(line, 0.5, 0.25).triangles
    level, rise = np.ptp(sides[..., 2], axis=1), np.ptp(sides[..., 0], axis=1)
    assert (np.minimum(level, rise) < 1e-12).all()
