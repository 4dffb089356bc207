# SPDX-License-Identifier: Apache-2.0
"""The formulas of the speed law and its refused gains."""
import math

from hypothesis import given, strategies as st
import pytest

from ballbot_ros.control import ControlTuning, RollingModel, speed_law
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
LAW = speed_law.SpeedLaw.tuned(GIMBALL, ControlTuning())[:]
leans = st.floats(0.2, 1.5)
slopes = st.floats(-0.05, 0.05)


def test_the_acceleration_on_level_ground_agrees_with_the_rolling_model():
    for angle in (-1.4, -0.3, 0.0, 0.7, 1.5):
        assert speed_law.acceleration(angle, 0.0, LAW) == pytest.approx(
            RollingModel(GIMBALL).held_acceleration(angle), rel=1e-12)


def test_the_steepest_slope_is_the_slope_limit_of_the_robot():
    assert speed_law.steepest_slope(math.pi / 2.0, LAW) == pytest.approx(GIMBALL.slope_limit)
    assert math.degrees(GIMBALL.slope_limit) == pytest.approx(5.92, abs=0.01)
    assert math.isnan(speed_law.holding_angle(GIMBALL.slope_limit + 1e-3, LAW))


@given(leans)
def test_the_steepest_slope_for_a_lean_is_held_by_that_lean(lean):
    slope = speed_law.steepest_slope(lean, LAW)
    assert speed_law.holding_angle(slope, LAW) == pytest.approx(lean)
    assert speed_law.holding_angle(-slope, LAW) == pytest.approx(-lean)
    assert speed_law.acceleration(lean, slope, LAW) == pytest.approx(0.0, abs=1e-12)


@given(st.floats(-0.5, 0.5), slopes)
def test_the_wanted_angle_gives_the_wanted_acceleration(wanted, slope):
    resistance = LAW[1] * math.sin(slope)
    angle = speed_law.wanted_angle(wanted, resistance, math.pi / 2.0, LAW)
    if abs(angle) < 1.5:
        # The law neglects the slope in the inertial coupling, which is a tenth of the inertia.
        assert speed_law.acceleration(angle, slope, LAW) == pytest.approx(wanted, abs=3e-3)


@given(st.floats(0.0, 2.0), slopes, leans, st.floats(0.0, 0.5))
def test_from_the_stopping_speed_the_ball_stops_within_the_gap(gap, slope, lean, reaction):
    speed = speed_law.stopping_speed(gap, slope, lean, reaction, LAW)
    if speed > 0.0:
        assert speed_law.braking_distance(speed, slope, lean, reaction, LAW) == pytest.approx(
            gap, rel=1e-6, abs=1e-9)
    elif gap > 0.0:
        assert speed_law.acceleration(-lean, slope, LAW) >= 0.0
        assert speed_law.braking_distance(0.1, slope, lean, reaction, LAW) == math.inf


def test_the_braking_distance_is_infinite_if_the_slope_is_too_steep():
    down = -speed_law.steepest_slope(0.7, LAW) - 1e-3
    assert speed_law.braking_distance(0.3, down, 0.7, 0.1, LAW) == math.inf
    assert speed_law.stopping_speed(5.0, down, 0.7, 0.1, LAW) == 0.0
    assert speed_law.stopping_speed(-1.0, 0.0, 0.7, 0.1, LAW) == 0.0
    assert speed_law.braking_distance(-1.0, 0.0, 0.7, 0.1, LAW) == 0.0


def test_the_lag_is_that_of_law_11():
    assert speed_law.SpeedLaw.tuned(GIMBALL, ControlTuning()).lag == 0.25
