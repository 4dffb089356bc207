# SPDX-License-Identifier: Apache-2.0
"""Single steps of the speed law: disturbance observer, set angle, and limits."""
import math

from hypothesis import given, strategies as st
import pytest

from ballbot_ros.control import ControlTuning, speed_law
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
SPEED_LAW = speed_law.SpeedLaw.tuned(GIMBALL, ControlTuning())
LAW = SPEED_LAW[:]
NAN = math.nan
slopes = st.floats(-0.09, 0.09)
periods = st.sampled_from([0.002, 0.01, 0.02, 0.05])


def observe(slope, angle, period, duration, speed=0.0, set_speed=0.0):
    """Return the states of the law for a pendulum held at an angle on a slope."""
    # The law neglects the slope in the coupling of ball and pendulum.
    resistance = SPEED_LAW.weight_torque * math.sin(slope)
    acceleration = SPEED_LAW.radius * (
        SPEED_LAW.gravity_torque * math.sin(angle) - resistance) / (
            SPEED_LAW.inertia - SPEED_LAW.coupling * math.cos(angle))
    state, states = speed_law.speed_law_start(speed, angle, 0.0, LAW), []
    for number in range(1, round(duration / period) + 1):
        state, _ = speed_law.speed_law_step(
            state, speed + acceleration * number * period, angle, set_speed, 1.2, period, LAW)
        states.append(state)
    return states


@given(slopes, st.floats(-1.5, 1.5), periods)
def test_the_slope_is_estimated_for_any_pendulum_angle_and_period(slope, angle, period):
    learned = observe(slope, angle, period, 3.0)[-1]
    assert speed_law.estimated_slope(learned, LAW) == pytest.approx(slope, abs=1e-4)


@given(periods)
def test_the_estimation_error_decays_with_two_poles_at_the_observer_rate(period):
    slope, pole = 0.05, math.exp(-SPEED_LAW.observer_rate * period)
    for number, state in enumerate(observe(slope, 0.3, period, 0.8), 1):
        error = 1.0 - state.resistance / (SPEED_LAW.weight_torque * math.sin(slope))
        # (1 + w t) exp(-w t), sampled
        assert error == pytest.approx((1.0 + number * (1.0 - pole)) * pole**number, abs=1e-9)


@pytest.mark.slow
@given(st.floats(-1.4, 1.4), st.floats(0.5, 5.0))
def test_the_observer_does_not_wind_up_at_the_largest_lean(lean, set_speed):
    # Far from the set speed, with the pendulum at its limit, an integral would grow.
    state = observe(0.0, lean, 0.002, 2.0, set_speed=math.copysign(set_speed + 3.0, lean))[-1]
    assert abs(speed_law.estimated_slope(state, LAW)) < 1e-6


def test_an_unmeasured_pendulum_is_predicted_with_the_lag():
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    state, set_angle = speed_law.speed_law_step(state, 0.0, NAN, 0.5, 0.7, 0.02, LAW)
    assert state.angle == 0.0 and set_angle > 0.7  # the set angle leads
    later, _ = speed_law.speed_law_step(state, 0.0, NAN, 0.5, 0.7, 0.1, LAW)
    assert later[2] == pytest.approx(set_angle * (1.0 - math.exp(-0.1 / 0.25)))
    assert later[4] == 0.0  # without a shortfall


@given(st.floats(-0.5, 0.5), st.floats(-0.6, 0.6), st.floats(0.2, 1.4))
def test_the_lead_of_the_set_angle_is_lag_over_swing_time_limited_to_level(
        set_speed, angle, lean):
    state = speed_law.speed_law_start(0.0, angle, 0.0, LAW)
    _, set_angle = speed_law.speed_law_step(state, 0.0, angle, set_speed, lean, 1e-9, LAW)
    wanted = speed_law.wanted_angle(SPEED_LAW.speed_gain * set_speed, 0.0, lean, LAW)
    leading = angle + (wanted - angle) * 0.25 / SPEED_LAW.swing_time
    assert abs(wanted) <= lean
    assert set_angle == pytest.approx(
        min(max(leading, -math.pi / 2), math.pi / 2), abs=1e-6)


def test_a_fast_law_11_needs_no_lead():
    law = speed_law.SpeedLaw.tuned(GIMBALL, ControlTuning(position_kd=2.0))[:]
    state = speed_law.speed_law_start(0.0, 0.3, 0.0, law)
    _, set_angle = speed_law.speed_law_step(state, 0.0, 0.3, 0.1, 0.7, 1e-9, law)
    assert set_angle == pytest.approx(speed_law.wanted_angle(
        SPEED_LAW.speed_gain * 0.1, 0.0, 0.7, law))


def test_the_offset_of_law_11_is_compensated_within_a_bound():
    for offset, compensated in ((0.1, 0.1), (1.0, 0.35), (-1.0, -0.35)):
        state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
        for _ in range(1000):
            angle = state.predicted - offset  # constant offset from the response of law (11)
            state, _ = speed_law.speed_law_step(state, 0.0, angle, 0.0, 0.7, 0.01, LAW)
        assert state.shortfall == pytest.approx(compensated, abs=0.03)


def test_the_bound_of_the_disturbance_exceeds_the_steepest_slope():
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    for number in range(1000):  # the ball accelerates backwards
        state, _ = speed_law.speed_law_step(
            state, -0.1 * number, 1.5, 0.0, 1.5, 0.02, LAW)
    assert state.resistance == pytest.approx(1.5 * SPEED_LAW.gravity_torque)
    assert speed_law.estimated_slope(state, LAW) > GIMBALL.slope_limit


@given(st.floats(-2.0, 2.0), slopes)
def test_at_the_target_the_place_law_equals_the_speed_law_at_rest(gap, slope):
    state = speed_law.speed_law_start(0.0, 0.0, slope, LAW)
    _, at_place = speed_law.place_law_step(state, 0.0, NAN, 0.0, 0.5, 1.4, 0.02, LAW)
    _, standing = speed_law.speed_law_step(state, 0.0, NAN, 0.0, 1.4, 0.02, LAW)
    assert at_place == standing
    _, away = speed_law.place_law_step(state, 0.0, NAN, gap, 0.5, 1.4, 0.02, LAW)
    assert (away - standing) * gap >= 0.0


@given(st.floats(0.05, 2.0), st.floats(0.05, 1.0))
def test_the_place_law_does_not_accelerate_beyond_the_top_speed(gap, top):
    state = speed_law.speed_law_start(top, 0.0, 0.0, LAW)
    _, angle = speed_law.place_law_step(state, top, 0.0, gap, top, 1.4, 0.02, LAW)
    assert angle <= 1e-9


def test_the_laws_are_antisymmetric():
    right = speed_law.speed_law_start(0.3, 0.2, 0.02, LAW)
    left = speed_law.speed_law_start(-0.3, -0.2, -0.02, LAW)
    for step in range(50):
        right, angle = speed_law.place_law_step(
            right, 0.3 - 0.004 * step, 0.1, 0.4, 0.5, 0.9, 0.02, LAW)
        left, mirrored = speed_law.place_law_step(
            left, 0.004 * step - 0.3, -0.1, -0.4, 0.5, 0.9, 0.02, LAW)
        assert mirrored == pytest.approx(-angle, abs=1e-12)


@given(slopes)
def test_the_initial_slope_estimate_is_the_given_slope(slope):
    state = speed_law.speed_law_start(0.2, 0.3, slope, LAW)
    assert speed_law.estimated_slope(state, LAW) == pytest.approx(slope)
    # At rest on the slope the estimate does not change: the lean balances the slope.
    holding = speed_law.holding_angle(slope, LAW)
    state = speed_law.speed_law_start(0.0, holding, slope, LAW)
    later, set_angle = speed_law.speed_law_step(state, 0.0, holding, 0.0, 1.5, 0.02, LAW)
    assert later == pytest.approx(state) and set_angle == pytest.approx(holding)


def test_the_shortfall_is_added_to_the_set_angle():
    plain = speed_law.speed_law_start(0.0, 0.2, 0.0, LAW)
    # Law (11) has a constant error of 0.05 rad.
    short = plain._replace(predicted=0.25, shortfall=0.05, set_angle=0.25)
    _, without = speed_law.speed_law_step(plain, 0.0, 0.2, 0.1, 1.2, 1e-9, LAW)
    _, with_it = speed_law.speed_law_step(short, 0.0, 0.2, 0.1, 1.2, 1e-9, LAW)
    assert with_it == pytest.approx(without + 0.05, abs=1e-6)


def test_the_pendulum_angle_is_interpolated_linearly_between_updates():
    # The angle is a ramp; its mean per period accelerates the ball on level ground.
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    speed, period = 0.0, 0.05
    for number in range(1, 11):
        speed += period * speed_law.acceleration(0.02 * (number - 0.5), 0.0, LAW)
        state, _ = speed_law.speed_law_step(state, speed, 0.02 * number, 0.0, 1.2, period, LAW)
        assert abs(speed_law.estimated_slope(state, LAW)) < 1e-9


@pytest.mark.slow
@given(st.floats(0.05, 0.8), st.floats(-0.03, 0.03))
def test_the_place_law_follows_its_braking_curve(speed, slope):
    # 70 % of the deceleration of the lean, including the slope but not the coupling.
    braking = 0.7 * SPEED_LAW.radius / SPEED_LAW.inertia * (
        SPEED_LAW.gravity_torque * math.sin(1.2) + SPEED_LAW.weight_torque * math.sin(slope))
    gap = speed / SPEED_LAW.speed_gain + speed**2 / (2.0 * braking)
    # d(gap)/dt = -speed on the curve
    change = -speed / (1.0 / SPEED_LAW.speed_gain + speed / braking)
    state = speed_law.speed_law_start(speed, 0.0, slope, LAW)
    _, found = speed_law.place_law_step(state, speed, 0.0, gap, 2.0, 1.2, 1e-9, LAW)
    _, expected = speed_law.motion_law_step(
        state, speed, 0.0, speed, change, 1.2, 1e-9, LAW)
    assert found == pytest.approx(expected, abs=1e-6)
    # Below the speed of the curve, the law drives at the top speed.
    _, found = speed_law.place_law_step(state, speed, 0.0, gap, 0.9 * speed, 1.2, 1e-9, LAW)
    _, expected = speed_law.speed_law_step(state, speed, 0.0, 0.9 * speed, 1.2, 1e-9, LAW)
    assert found == pytest.approx(expected, abs=1e-6)
