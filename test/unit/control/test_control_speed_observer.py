# SPDX-License-Identifier: Apache-2.0
"""One step of the speed law at a time: what it learns, follows and limits."""
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


def watch(slope, angle, period, duration, speed=0.0, set_speed=0.0):
    """Let the law watch a pendulum that is held at an angle on a slope; return its states."""
    # The law leaves the slope out of the coupling of ball and pendulum.
    resisting = SPEED_LAW.weight_torque * math.sin(slope)
    gained = SPEED_LAW.radius * (SPEED_LAW.gravity_torque * math.sin(angle) - resisting) / (
        SPEED_LAW.inertia - SPEED_LAW.coupling * math.cos(angle))
    state, states = speed_law.speed_law_start(speed, angle, 0.0, LAW), []
    for number in range(1, round(duration / period) + 1):
        state, _ = speed_law.speed_law_step(
            state, speed + gained * number * period, angle, set_speed, 1.2, period, LAW)
        states.append(state)
    return states


@given(slopes, st.floats(-1.5, 1.5), periods)
def test_the_slope_is_learnt_for_any_motion_of_the_pendulum_and_any_number_of_updates(
        slope, angle, period):
    learnt = watch(slope, angle, period, 3.0)[-1]
    assert speed_law.estimated_slope(learnt, LAW) == pytest.approx(slope, abs=1e-4)


@given(periods)
def test_the_estimation_error_decays_with_two_poles_at_the_observer_rate(period):
    slope, pole = 0.05, math.exp(-SPEED_LAW.observer_rate * period)
    for number, state in enumerate(watch(slope, 0.3, period, 0.8), 1):
        lacking = 1.0 - state.resistance / (SPEED_LAW.weight_torque * math.sin(slope))
        # (1 + w t) exp(-w t), sampled
        assert lacking == pytest.approx((1.0 + number * (1.0 - pole)) * pole**number, abs=1e-9)


@pytest.mark.slow
@given(st.floats(-1.4, 1.4), st.floats(0.5, 5.0))
def test_it_does_not_wind_up_at_the_largest_lean(lean, set_speed):
    # Far from the set speed, with the pendulum as far as it goes: an integral would grow.
    state = watch(0.0, lean, 0.002, 2.0, set_speed=math.copysign(set_speed + 3.0, lean))[-1]
    assert abs(speed_law.estimated_slope(state, LAW)) < 1e-6


def test_a_pendulum_that_is_not_measured_follows_the_set_angle_with_the_lag():
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    state, set_angle = speed_law.speed_law_step(state, 0.0, NAN, 0.5, 0.7, 0.02, LAW)
    assert state.angle == 0.0 and set_angle > 0.7  # it leads
    later, _ = speed_law.speed_law_step(state, 0.0, NAN, 0.5, 0.7, 0.1, LAW)
    assert later[2] == pytest.approx(set_angle * (1.0 - math.exp(-0.1 / 0.25)))
    assert later[4] == 0.0  # of which nothing falls short


@given(st.floats(-0.5, 0.5), st.floats(-0.6, 0.6), st.floats(0.2, 1.4))
def test_the_set_angle_leads_the_wanted_one_by_lag_over_swing_time_up_to_level(
        set_speed, angle, lean):
    state = speed_law.speed_law_start(0.0, angle, 0.0, LAW)
    _, set_angle = speed_law.speed_law_step(state, 0.0, angle, set_speed, lean, 1e-9, LAW)
    wanted = speed_law.wanted_angle(SPEED_LAW.speed_gain * set_speed, 0.0, lean, LAW)
    leading = angle + (wanted - angle) * 0.25 / SPEED_LAW.swing_time
    assert abs(wanted) <= lean
    assert set_angle == pytest.approx(
        min(max(leading, -math.pi / 2), math.pi / 2), abs=1e-6)


def test_a_law_11_that_is_quick_is_not_slowed_down():
    law = speed_law.SpeedLaw.tuned(GIMBALL, ControlTuning(position_kd=2.0))[:]
    state = speed_law.speed_law_start(0.0, 0.3, 0.0, law)
    _, set_angle = speed_law.speed_law_step(state, 0.0, 0.3, 0.1, 0.7, 1e-9, law)
    assert set_angle == pytest.approx(speed_law.wanted_angle(
        SPEED_LAW.speed_gain * 0.1, 0.0, 0.7, law))


def test_the_offset_of_law_11_is_compensated_within_a_bound():
    for short, made_up in ((0.1, 0.1), (1.0, 0.35), (-1.0, -0.35)):
        state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
        for _ in range(1000):
            angle = state.predicted - short  # always so far behind what is expected of law (11)
            state, _ = speed_law.speed_law_step(state, 0.0, angle, 0.0, 0.7, 0.01, LAW)
        assert state.shortfall == pytest.approx(made_up, abs=0.03)


def test_the_estimated_disturbance_is_bounded_above_that_of_the_steepest_slope():
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    for number in range(1000):  # it is pushed back ever faster
        state, _ = speed_law.speed_law_step(
            state, -0.1 * number, 1.5, 0.0, 1.5, 0.02, LAW)
    assert state.resistance == pytest.approx(1.5 * SPEED_LAW.gravity_torque)
    assert speed_law.estimated_slope(state, LAW) > GIMBALL.slope_limit


@given(st.floats(-2.0, 2.0), slopes)
def test_at_its_place_the_ball_is_only_held(gap, slope):
    state = speed_law.speed_law_start(0.0, 0.0, slope, LAW)
    _, at_place = speed_law.place_law_step(state, 0.0, NAN, 0.0, 0.5, 1.4, 0.02, LAW)
    _, standing = speed_law.speed_law_step(state, 0.0, NAN, 0.0, 1.4, 0.02, LAW)
    assert at_place == standing
    _, away = speed_law.place_law_step(state, 0.0, NAN, gap, 0.5, 1.4, 0.02, LAW)
    assert (away - standing) * gap >= 0.0


@given(st.floats(0.05, 2.0), st.floats(0.05, 1.0))
def test_the_way_to_a_place_is_driven_at_the_top_speed_at_most(gap, top):
    state = speed_law.speed_law_start(top, 0.0, 0.0, LAW)
    _, angle = speed_law.place_law_step(state, top, 0.0, gap, top, 1.4, 0.02, LAW)
    assert angle <= 1e-9


def test_the_sides_are_alike():
    right = speed_law.speed_law_start(0.3, 0.2, 0.02, LAW)
    left = speed_law.speed_law_start(-0.3, -0.2, -0.02, LAW)
    for step in range(50):
        right, angle = speed_law.place_law_step(
            right, 0.3 - 0.004 * step, 0.1, 0.4, 0.5, 0.9, 0.02, LAW)
        left, mirrored = speed_law.place_law_step(
            left, 0.004 * step - 0.3, -0.1, -0.4, 0.5, 0.9, 0.02, LAW)
        assert mirrored == pytest.approx(-angle, abs=1e-12)


@given(slopes)
def test_it_starts_with_the_slope_that_is_expected(slope):
    state = speed_law.speed_law_start(0.2, 0.3, slope, LAW)
    assert speed_law.estimated_slope(state, LAW) == pytest.approx(slope)
    # Standing on it, nothing is learnt: the pendulum holds what resists.
    holding = speed_law.holding_angle(slope, LAW)
    state = speed_law.speed_law_start(0.0, holding, slope, LAW)
    later, set_angle = speed_law.speed_law_step(state, 0.0, holding, 0.0, 1.5, 0.02, LAW)
    assert later == pytest.approx(state) and set_angle == pytest.approx(holding)


def test_the_shortfall_is_added_to_the_set_angle():
    plain = speed_law.speed_law_start(0.0, 0.2, 0.0, LAW)
    # Law (11) is 0.05 behind, as always.
    short = plain._replace(predicted=0.25, shortfall=0.05, set_angle=0.25)
    _, without = speed_law.speed_law_step(plain, 0.0, 0.2, 0.1, 1.2, 1e-9, LAW)
    _, with_it = speed_law.speed_law_step(short, 0.0, 0.2, 0.1, 1.2, 1e-9, LAW)
    assert with_it == pytest.approx(without + 0.05, abs=1e-6)


def test_between_two_looks_the_pendulum_is_taken_to_have_moved_evenly():
    # A ramp of the angle, by whose mean the ball is accelerated on the level.
    state = speed_law.speed_law_start(0.0, 0.0, 0.0, LAW)
    speed, period = 0.0, 0.05
    for number in range(1, 11):
        speed += period * speed_law.acceleration(0.02 * (number - 0.5), 0.0, LAW)
        state, _ = speed_law.speed_law_step(state, speed, 0.02 * number, 0.0, 1.2, period, LAW)
        assert abs(speed_law.estimated_slope(state, LAW)) < 1e-9


@pytest.mark.slow
@given(st.floats(0.05, 0.8), st.floats(-0.03, 0.03))
def test_on_its_braking_curve_to_a_place_the_ball_follows_the_curve(speed, slope):
    # 70 % of what the lean gives, against or with the slope; the coupling is left out.
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
    # And where it may not go so fast, it goes on at the top speed.
    _, found = speed_law.place_law_step(state, speed, 0.0, gap, 0.9 * speed, 1.2, 1e-9, LAW)
    _, expected = speed_law.speed_law_step(state, speed, 0.0, 0.9 * speed, 1.2, 1e-9, LAW)
    assert found == pytest.approx(expected, abs=1e-6)
