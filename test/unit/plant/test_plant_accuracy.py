# SPDX-License-Identifier: Apache-2.0
"""A plant with an accuracy knows, while it runs, how wrong it may be."""
import math

import pytest

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import load_scene
from ballbot_ros.plant import Plant


def run(plant, torque, periods=400):
    for _ in range(periods):
        plant.advance(torque)
    return plant


def test_the_error_is_below_the_estimate_and_that_below_the_accuracy():
    plant = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-5), 0.3)
    exact = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-9), 0.3)
    assert abs(plant.state.x - exact.state.x) < plant.error_estimate < 1e-5
    assert plant.lost_at == math.inf


def test_a_reset_starts_the_estimate_anew():
    plant = run(Plant(load_scene('fig7_top'), 500.0, accuracy=1e-5), 0.0)
    assert plant.error_estimate > 0.0
    plant.reset()
    assert plant.error_estimate == 0.0


def test_without_an_accuracy_there_is_no_estimate():
    assert math.isnan(run(Plant(load_scene('flat'), 500.0), 0.0, 5).error_estimate)


def test_an_accuracy_that_is_lost_is_told_with_the_time():
    plant = Plant(load_scene('fig7_top'), 500.0, accuracy=1e-5)
    plant._accuracy = 0.0  # as if more had been promised than the solvers were chosen for
    run(plant, 0.0)
    assert 0.0 < plant.lost_at <= plant.time


def test_an_accuracy_out_of_range_is_refused():
    with pytest.raises(ConfigurationError, match='accuracy must be at least'):
        Plant(load_scene('flat'), 500.0, accuracy=1e-15)
