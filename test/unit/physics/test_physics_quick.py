# SPDX-License-Identifier: Apache-2.0
"""Fast implementations of frequently called functions have their stated accuracy."""
import math

from hypothesis import given, strategies as st
import pytest

from ballbot_ros.physics.mechanics.equations import angle_trig, direction_near, NEARBY
from ballbot_ros.physics.solvers.controller import fifth_root

angles = st.floats(-math.pi, math.pi)


@given(angles, st.floats(-4.0 * NEARBY, 4.0 * NEARBY))
def test_direction_near_a_known_angle_is_exact_to_rounding(known, ahead):
    angle = known + ahead
    assert direction_near(angle, angle_trig(known)) == pytest.approx(
        (math.sin(angle), math.cos(angle)), rel=0.0, abs=4e-16)


def test_direction_near_is_exact_at_the_limit_of_the_series():
    for ahead in (-NEARBY, NEARBY):
        assert direction_near(ahead, (0.0, 0.0, 1.0)) == pytest.approx(
            (math.sin(ahead), math.cos(ahead)), rel=0.0, abs=1.2e-16)


def test_the_direction_of_nan_is_nan():
    assert all(map(math.isnan, direction_near(math.nan, (0.0, 0.0, 1.0))))


@given(st.floats(1e-300, 1e300))
def test_the_fast_fifth_root_exceeds_the_exact_one_by_at_most_0_7_percent(number):
    assert -1e-12 <= fifth_root(number) / number**0.2 - 1.0 <= 0.007
