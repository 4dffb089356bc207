# SPDX-License-Identifier: Apache-2.0
"""Faces in a single observation of the ground ahead."""
from dataclasses import replace
import math

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.decision import TerrainObservation
from ballbot_ros.errors import MessageError
from ballbot_ros.navigation.sensing import faces_in


def scan(slope_deg, step=0.0, sd=0.0, seed=0):
    """Return an observation of a ramp that starts at 0.5 m, with a step at 1.5 m."""
    x = np.arange(0.0, 3.0, 0.02)
    z = math.tan(math.radians(slope_deg)) * np.maximum(x - 0.5, 0.0) + np.where(x < 1.5, 0.0, step)
    z = z + sd * np.random.default_rng(seed).standard_normal(len(x))
    return TerrainObservation(0.0, tuple(x.tolist()), tuple(z.tolist()), (sd,) * len(x),
                              float(x[0]), float(x[-1]))


@pytest.mark.parametrize('slope_deg', [-4.3, 0.0, 4.3])
@pytest.mark.parametrize('sd', [0.0, 0.001])
def test_only_the_step_on_a_ramp_is_a_face(slope_deg, sd):
    for seed in range(5):
        assert faces_in(scan(slope_deg, sd=sd, seed=seed)) == ()
        (at, height), = faces_in(scan(slope_deg, 0.02, sd, seed))
        assert at == pytest.approx(1.5, abs=0.03) and height == pytest.approx(0.02, abs=0.004)


@pytest.mark.parametrize('height', [0.008, 0.03])
def test_both_faces_of_a_bar_are_found(height):
    x = np.arange(0.0, 3.0, 0.01)
    z = np.where((x > 1.0) & (x < 1.06), height, 0.0)
    found = faces_in(TerrainObservation(
        0.0, tuple(x.tolist()), tuple(z.tolist()), (), float(x[0]), float(x[-1])))
    assert [round(at, 1) for at, _ in found] == [1.0, 1.1]
    assert [rise for _, rise in found] == pytest.approx([height, -height], rel=0.1)


@pytest.mark.parametrize('change', [
    {'z': (0.0,) * 9}, {'z_sd': (0.0,) * 9}, {'frame': 'camera'},
    {'x': tuple(0.02 * number for number in range(149)) + (1e13,)}],
    ids=['heights', 'deviations', 'frame', 'far'])
def test_an_invalid_observation_is_refused(change):
    with refused('bad_observation', 'terrain_observation', MessageError):
        faces_in(replace(scan(0.0, 0.02), **change))
