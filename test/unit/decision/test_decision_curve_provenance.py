# SPDX-License-Identifier: Apache-2.0
"""The shipped curves are what our own simulation gives, not numbers from somewhere."""
import math

import pytest

from ballbot_ros.crossing import held_at, max_step_height
from ballbot_ros.decision import load_curve
from ballbot_ros.physics import Actuation, load_robot

MADE_WITH = {
    'gimball_down': (held_at(0.0), 0.0), 'gimball_free': (Actuation(), 0.0),
    'gimball_horizontal': (held_at(math.pi / 2), math.pi / 2),
    'shellball_free': (Actuation(), 0.0)}


@pytest.mark.parametrize('speed', [0.3, 0.75, 1.15])
@pytest.mark.parametrize('name', MADE_WITH)
def test_a_shipped_curve_gives_the_simulated_height_within_its_stated_residual(name, speed):
    curve = load_curve(name)
    actuation, angle = MADE_WITH[name]
    simulated = max_step_height(load_robot(curve.robot), speed, actuation, angle).height
    # Half a bracket of the search, and what lies between the fitted speeds.
    assert curve.height(speed) == pytest.approx(simulated, abs=curve.residual + 1e-4)
