# SPDX-License-Identifier: Apache-2.0
"""Decisions of the cubic planner: golden cases, margins, limits and invalid input."""
from dataclasses import replace
import math
import re

from hypothesis import given, strategies
import pytest

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import (
    Decision, Face, Kind, Knowledge, load_curve, load_decision_tuning, Motion, Plan, PLANNERS,
    Profile, Reason, Situation, Strategy)
from ballbot_ros.decision.planning import cubic
from ballbot_ros.decision.planning.safety_filter import with_safety_filter
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
CURVE = load_curve('gimball_down')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWN = Knowledge(GIMBALL, CURVE, TUNING)
anything = strategies.floats(allow_nan=True, allow_infinity=True)
heights = strategies.floats(-0.05, 0.12)
distances = strategies.floats(0.0, 4.0)
speeds = strategies.floats(-0.5, 1.5)


def planner():
    """Return a planner without a plan."""
    return with_safety_filter(PLANNERS['cubic'](KNOWN), KNOWN)


def on(height=0.031, distance=0.8, speed=0.8, *, sd=0.0005, now=0.0, stamp=None,
       rejection=None, previous=None, decide=None):
    """Return the decision on a step at `distance` ahead of a ball at 0, by a new planner."""
    step = Face(1, distance, height, 0.01, sd)
    return (decide or planner())(Situation(
        Motion(now, 0.0, speed), Profile(now if stamp is None else stamp, (step,),
                                         rejection=rejection, explanation='it is a test')),
        previous)


def crossing(**numbers):
    return Decision(Kind.CROSS, Reason.WITHIN_CURVE, 0.9, '', step=1,
                    plan=Plan(Strategy.ACCELERATE, 0.0, 0.9, edge=0.0), **numbers)


@pytest.mark.parametrize('height, distance, speed, kind, reason', [
    (0.031, 0.80, 0.80, 'cross', 'committed'),       # too late to stop
    (0.031, 0.80, 0.40, 'stop', 'no_room'),
    (0.031, 1.30, 0.40, 'cross', 'within_curve'),
    (0.031, 1.20, 0.00, 'cross', 'within_curve'),    # the paper's run-up
    (0.005, 0.30, 0.40, 'cross', 'committed'),
    (0.005, 0.60, 0.40, 'cross', 'within_curve'),
    (0.000, 1.00, 0.40, 'cross', 'within_curve'),    # a line on the floor
    (0.031, 0.40, 0.30, 'stop', 'no_room'),
    (0.035, 0.50, 0.40, 'stop', 'no_room'),
    (0.056, 3.00, 0.40, 'go_round', 'too_high'),
    (0.080, 1.20, 0.00, 'go_round', 'too_high'),
    (0.500, 1.20, 0.00, 'go_round', 'wall'),
    (0.031, 0.20, 1.40, 'stop', 'too_fast'),
    (-0.03, 1.00, 0.40, 'stop', 'drop')])
def test_golden_cases(height, distance, speed, kind, reason):
    answer = on(height, distance, speed)
    assert (answer.kind.value, answer.reason.value) == (kind, reason)
    assert answer.explanation


@pytest.mark.parametrize('where, numbers', [
    # Height [mm], distance, set speed, swing, probability, required speed, touch speed, limit.
    ({'distance': 1.3, 'speed': 0.5},
     ['31', '1.30', '0.98', '0', '0.28', '100', '0.93', '0.95']),
    ({'height': -0.03, 'distance': 1.8}, ['30', '1.80']),
    ({'height': 0.08}, ['80', '0.80', '0', '90', '40']),
    ({'height': 2.0}, ['2000', '0.80']),
    ({'height': -2.0}, ['2000', '0.80']),
    ({'distance': 0.2, 'speed': 1.4}, ['31', '0.20', '0.93', '1.38']),
    ({'distance': 0.4, 'speed': 0.3}, ['31', '0.40', '0', '90', '0.93', '0.59', '18']),
    ({'now': 1.0, 'stamp': 0.3}, ['0.70', '0.6']),
    ({'now': 1.0, 'stamp': 1.7}, ['0.70', '0.6'])])
def test_the_explanation_contains_the_numbers(where, numbers):
    assert re.findall(r'\d+\.?\d*', on(**where).explanation) == numbers


def test_an_observation_from_the_future_is_not_called_old():
    old, early = (on(now=1.0, stamp=stamp).explanation for stamp in (0.3, 1.7))
    assert 'old' in old and 'ahead' in early and 'old' not in early


def test_the_answer_contains_the_numbers_of_the_step_and_its_margins():
    answer = on(0.031, 1.3, 0.5, sd=0.001)
    assert (answer.height, answer.distance, answer.step) == (0.031, 1.3, 1)
    # Two standard deviations including the bias, plus 2 mm of height and 8 % of speed.
    conservative = 0.031 + 2.0 * math.hypot(0.001, TUNING.height_bias_sd) + 0.002
    assert answer.required_speed == pytest.approx(1.08 * CURVE.required_speed(conservative))
    room = 1.3 - touch_distance(GIMBALL.ball_radius, 0.031)
    assert answer.reachable_speed == KNOWN.braking.touch_speed(0.5, 1.1, room, 0.0)
    # The outlook uses the driven speed, not the reachable one.
    driven = KNOWN.braking.touch_speed(0.5, answer.set_speed, room, 0.0)
    assert answer.required_speed <= driven < answer.reachable_speed
    assert answer.outlook.touch_speed == driven
    assert answer.height_margin == answer.outlook.height_limit - 0.031 > 0.0


def test_the_probability_is_that_of_the_band_at_the_driven_speed():
    rule = cubic.CurveRule(CURVE, replace(TUNING, speed_margin=0.0, height_bias_sd=0.0))

    def probability(speed, height, sd):
        return rule.probability(speed, Face(1, 1.0, height, 0.01, sd))
    for speed, height in ((0.7, 0.0256), (0.9, 0.036), (1.05, 0.0443)):
        assert probability(speed, height, 0.0) == pytest.approx(
            CURVE.band.probability_of_passing(speed, height))
    # Uncertainty of the height moves the probability towards one half.
    assert 0.5 < probability(0.7, 0.024, 0.002) < probability(0.7, 0.024, 0.0)
    assert 0.5 > probability(0.7, 0.027, 0.002) > probability(0.7, 0.027, 0.0)
    answer = on(0.031, 1.3, 0.5)
    assert TUNING.required_probability < answer.outlook.probability <= 1.0
    assert answer.outlook.required == TUNING.required_probability
    assert answer.outlook.height_limit == CURVE.band.quantile(
        answer.outlook.touch_speed, 1.0 - TUNING.required_probability)


def test_a_higher_required_probability_requires_more_speed():
    def required(probability):
        return cubic.CurveRule(CURVE, replace(
            TUNING, required_probability=probability, sigma_margin=0.0, height_margin=0.001)
        ).required_speed(Face(1, 3.0, 0.03, 0.01, 0.001))

    speeds = [required(probability) for probability in (0.5, 0.9, 0.99, 0.999)]
    assert speeds == sorted(speeds) and speeds[-1] > speeds[0] + 0.02


def test_the_margin_is_unknown_below_the_curve_and_negative_above_it():
    assert math.isnan(on(0.031, 0.13, 0.0).height_margin)
    assert on(0.08, 2.0).height_margin < -0.035


def test_a_negative_standard_deviation_is_refused():
    assert on(sd=-0.01).reason is Reason.BAD_OBSERVATION
    assert on(sd=0.01).reason is not Reason.BAD_OBSERVATION


def test_a_ball_that_rolls_back_reaches_the_same_speed_as_one_at_rest():
    assert on(speed=-0.4).reachable_speed == on(speed=0.0).reachable_speed


@pytest.mark.parametrize('where, speed', [
    ({'height': 0.0}, 0.4),                         # the cruise speed
    ({}, 0.98),                                     # headroom above the required speed
    ({'height': 0.0375, 'distance': 1.5}, 1.1),     # the highest speed
    ({'distance': 0.4, 'speed': 0.3}, 0.0), ({'distance': 0.2, 'speed': 1.4}, 0.0)])
def test_the_set_speed(where, speed):
    assert on(**where).set_speed == pytest.approx(speed, abs=0.005)


@pytest.mark.parametrize('height, kind', [(0.08, 'go_round'), (-0.03, 'stop'), (0.5, 'go_round')])
def test_the_ball_stops_with_the_gap_before_a_refused_step(height, kind):
    answer = on(height, 2.0)
    assert (answer.kind.value, answer.set_speed) == (kind, TUNING.cruise_speed)
    assert answer.plan.stop_position == 2.0 - GIMBALL.ball_radius - TUNING.stop_gap
    near = on(height, 0.6, 0.2)
    assert 0.0 < near.set_speed < TUNING.cruise_speed
    # Without that room it stops immediately, and does not roll back over unknown ground.
    immediate = on(height, 0.4, 0.2)
    assert immediate.set_speed == 0.0 and immediate.plan.stop_position == math.inf
    step = Face(1, 0.4, height, 0.01, 0.0)
    free = planner()(Situation(Motion(0.0, 0.0, 0.1), Profile(0.0, (step,)), free_from=-0.2), None)
    assert free.plan.stop_position == pytest.approx(0.4 - GIMBALL.ball_radius - TUNING.stop_gap)


def test_a_drop_stops_the_ball():
    assert on(-0.0051, 1.5).reason is Reason.DROP
    answer = on(-0.03, 1.5)
    assert (answer.height, answer.distance, answer.step) == (-0.03, 1.5, 1)


@pytest.mark.parametrize('height', [-0.03, -0.1])
def test_past_the_last_braking_point_the_ball_brakes_before_a_step_down(height):
    answer = on(height, 0.4, 0.8)
    assert (answer.reason, answer.set_speed, answer.plan.stop_position) == (
        Reason.DROP, 0.0, math.inf)


@pytest.mark.parametrize('reason', ['now', 'rejection'])
def test_a_stop_because_of_an_observation_still_names_the_step(reason):
    answer = on(**{'now': {'now': 1.0, 'stamp': 0.0},
                   'rejection': {'rejection': Reason.CONTRADICTORY}}[reason])
    assert (answer.step, answer.distance, answer.set_speed) == (1, 0.8, 0.0)


def test_an_old_observation_without_a_step_is_refused():
    answer = planner()(Situation(Motion(1.0, 0.0, 0.4), Profile(0.0)), None)
    assert (answer.reason, answer.step) == (Reason.STALE, 0)
    assert math.isnan(answer.distance)


def test_without_a_step_ahead_the_ball_cruises():
    answer = planner()(Situation(Motion(0.1, 0.0, 0.4), Profile(0.0)), None)
    assert answer.kind is Kind.CLEAR and answer.set_speed == TUNING.cruise_speed
    assert on(distance=0.0).kind is Kind.CLEAR and on(distance=1e-6).kind is not Kind.CLEAR


@given(heights, distances, speeds, strategies.floats(0.0, 0.01))
def test_a_crossing_requires_sufficient_speed_at_touch(height, distance, speed, sd):
    answer = on(height, distance, speed, sd=sd)
    if answer.kind is not Kind.CROSS:
        assert 0.0 <= answer.set_speed <= TUNING.cruise_speed
        return
    late = answer.reason is Reason.COMMITTED
    if height < 0.0:
        assert late and answer.set_speed <= TUNING.cruise_speed
        return
    if not late:
        assert answer.required_speed <= answer.outlook.touch_speed
        assert answer.height_margin >= -1e-9
        assert answer.set_speed >= answer.required_speed
        assert CURVE.height(min(answer.required_speed, 1.2)) >= height + 2.0 * sd
    assert answer.outlook.probability >= (0.5 if late else 0.9) - 1e-3
    room = max(0.0, distance - touch_distance(GIMBALL.ball_radius, height))
    assert answer.outlook.touch_speed**2 <= max(
        max(speed, 0.0), answer.set_speed)**2 + 1e-9
    assert answer.reachable_speed**2 <= max(speed, 0.0)**2 + 0.92 * room + 1e-9


@given(heights, heights, distances, speeds)
def test_a_higher_step_is_never_easier(one, other, distance, speed):
    low, high = on(min(one, other), distance, speed), on(max(one, other), distance, speed)
    # A higher step is also touched earlier, with less room: both make it harder.
    if high.kind is Kind.CROSS and high.reason is not Reason.COMMITTED \
            and low.reason is not Reason.DROP:
        # There is more room to brake before a low step: the touch can only be slower.
        # The ball also loses less speed: the next face may be too near.
        assert low.kind is Kind.CROSS or low.reason is Reason.LANDING
        assert low.required_speed <= high.required_speed


@given(anything, anything, anything, anything, anything, anything)
def test_no_step_is_crossed_if_a_value_is_not_finite(height, distance, speed, sd, now, stamp):
    answer = on(height, distance, speed, sd=sd, now=now, stamp=stamp)
    if not all(map(math.isfinite, (height, distance, speed, sd, now, stamp))):
        assert answer.kind is Kind.STOP
    assert math.isfinite(answer.set_speed)


@pytest.mark.parametrize('name', ['height', 'distance', 'sd'])
@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_a_step_with_a_value_that_is_not_finite_stops_the_ball(name, bad):
    answer = on(**{name: bad}, previous=crossing())
    assert (answer.kind, answer.reason) == (Kind.STOP, Reason.BAD_OBSERVATION)


@pytest.mark.parametrize('speed, now', [(math.nan, 0.0), (math.inf, 0.0), (0.4, math.nan)])
def test_odometry_that_is_not_finite_stops_the_ball(speed, now):
    assert on(speed=speed, now=now).reason is Reason.BAD_OBSERVATION


def test_old_missing_and_future_observations_stop_the_ball():
    assert on(now=10.0, stamp=9.41).kind is Kind.CROSS
    for stamp in (9.39, 0.0, 10.7):
        answer = on(now=10.0, stamp=stamp)
        assert (answer.kind, answer.reason) == (Kind.STOP, Reason.STALE)
    answer = planner()(Situation(Motion(0.0, 0.0, 0.4)), None)
    assert (answer.kind, answer.reason) == (Kind.STOP, Reason.STALE)


@pytest.mark.parametrize('reason', [Reason.BAD_OBSERVATION, Reason.CONTRADICTORY])
def test_a_rejected_observation_stops_the_ball_with_its_reason(reason):
    answer = on(rejection=reason)
    assert (answer.kind, answer.reason) == (Kind.STOP, reason)
    assert 'it is a test' in answer.explanation


def test_a_plan_is_kept_while_it_is_sufficiently_probable():
    assert on(distance=0.87, speed=0.4).reason is Reason.NO_ROOM
    decide = planner()
    first = on(distance=0.92, speed=0.4, decide=decide)
    assert (first.kind, first.reason) == (Kind.CROSS, Reason.WITHIN_CURVE)
    kept = on(distance=0.87, speed=0.4, previous=first, decide=decide)
    assert (kept.kind, kept.set_speed) == (Kind.CROSS, first.set_speed)
    assert kept.outlook.probability >= 0.85
    # The ball is far too slow now, and can still stop.
    assert on(distance=0.5, speed=0.3, previous=kept, decide=decide).kind is Kind.STOP
    # If the step is measured much lower, the set speed falls.
    decide = planner()
    fast = on(0.0375, 1.5, decide=decide)
    assert fast.set_speed == 1.1
    assert on(0.01, 1.4, previous=fast, decide=decide).set_speed < 0.7


def test_past_the_last_braking_point_a_step_is_crossed_if_the_speed_suffices():
    assert on(distance=0.15, speed=0.88).reason is Reason.COMMITTED
    assert on(distance=0.15, speed=0.7).kind is Kind.STOP


def test_a_refused_crossing_is_resumed_only_for_a_lower_step():
    decide = planner()
    refused = on(distance=0.87, speed=0.4, decide=decide)
    assert refused.kind is Kind.STOP
    assert on(distance=0.92, speed=0.4, previous=refused, decide=decide).kind is Kind.STOP
    assert on(0.026, 0.92, 0.4, previous=refused, decide=decide).kind is Kind.CROSS


def test_two_steps_too_close_to_stop_between_are_not_crossed_together():
    faces = Face(1, 2.0, 0.02, 0.01, 0.0005), Face(2, 2.15, 0.015, 0.01, 0.0005)
    answer = planner()(Situation(Motion(0.0, 0.0, 0.4), Profile(0.0, faces)), None)
    assert (answer.kind, answer.reason) == (Kind.STOP, Reason.LANDING)


def test_a_steep_stretch_before_the_next_step_limits_the_room_behind_this_one():
    faces = Face(1, 2.0, 0.02, 0.01, 0.0005), Face(2, 6.0, 0.02, 0.01, 0.0005)
    points = (-1.0, 0.0), (2.0, 0.0), (2.0, 0.02), (6.0, 0.02), (6.0, 0.04), (8.0, 0.04)
    for steep, reason in ((), Reason.WITHIN_CURVE), (((2.2, -0.2),), Reason.LANDING):
        profile = Profile(0.0, faces, points, seen_to=8.0, slope=0.0, slope_sd=0.001, steep=steep)
        answer = planner()(Situation(Motion(0.0, 0.0, 0.4), profile), None)
        assert answer.reason is reason


def test_near_the_end_of_the_observed_terrain_the_explanation_states_the_lower_set_speed():
    profile = Profile(0.0, (), seen_to=0.7)
    answer = planner()(Situation(Motion(0.0, 0.0, 0.3), profile), None)
    assert answer.kind is Kind.CLEAR and answer.set_speed < TUNING.cruise_speed
    assert f'{answer.set_speed:.2f} m/s' in answer.explanation


def test_a_plan_applies_to_one_step_only():
    decide = planner()
    first = on(distance=0.92, speed=0.4, decide=decide)
    step = Face(2, 0.87, 0.031, 0.01, 0.0005)
    assert decide(Situation(Motion(0.0, 0.0, 0.4), Profile(0.0, (step,))), first).kind is Kind.STOP


def in_contact(decide):
    """Return the decision of a ball at 0.1 m/s in contact with a step that it crosses."""
    started = on(distance=1.3, speed=0.5, decide=decide)
    return on(distance=0.1, speed=0.1, now=1.0, previous=started, decide=decide)


def test_in_contact_the_ball_pushes_until_its_centre_has_passed():
    decide = planner()
    answer = in_contact(decide)
    assert (answer.kind, answer.reason) == (Kind.CROSS, Reason.COMMITTED)
    assert (answer.contact_since, answer.distance) == (1.0, 0.1)
    # Low speed, age and contradictions do not matter with the face below the ball.
    answer = on(distance=0.05, speed=0.0, now=2.0, stamp=0.0, previous=answer, decide=decide,
                rejection=Reason.CONTRADICTORY)
    assert answer.kind is Kind.CROSS and answer.contact_since == 1.0


@pytest.mark.parametrize('now, kind', [(3.9, Kind.CROSS), (4.1, Kind.STOP), (0.9, Kind.STOP)])
def test_pushing_has_a_timeout_and_ends_if_the_clock_is_set_back(now, kind):
    decide = planner()
    pushing = in_contact(decide)
    assert on(distance=0.1, speed=0.0, now=now, previous=pushing, decide=decide).kind is kind


@pytest.mark.parametrize('height, behind, crossed', [
    (-0.01, 0.12, True),  # too close to stop before it
    (-0.01, 0.40, False), (0.01, 0.12, False), (-0.2, 0.12, False)])
def test_a_crossing_includes_a_close_step_down_that_is_observed_from_the_step(
        height, behind, crossed):
    decide = planner()
    answer = in_contact(decide)
    answer = replace(answer, plan=replace(answer.plan, edge=0.11))
    for moved in 0.0, 0.03:  # the edge is farther away than it seemed
        edge = 0.1 + behind + moved
        answer = decide(Situation(Motion(1.02 + moved, 0.0, 0.1), Profile(1.02, (
            Face(1, 0.1, 0.031, 0.01, 0.0005), Face(2, edge, height, 0.01, 0.0005)))), answer)
        assert answer.kind is Kind.CROSS and (answer.plan.edge > edge) is crossed


def test_without_a_crossing_the_ball_does_not_push():
    assert on(distance=0.1, speed=0.1).kind is Kind.STOP


def test_touch_is_where_the_sphere_meets_the_edge():
    assert touch_distance(0.2, 0.0) == touch_distance(0.2, -0.1) == 0.0
    assert touch_distance(0.2, 0.2) == touch_distance(0.2, 3.0) == 0.2
    # Centre at height R, edge at height h: the distance between them is R.
    assert math.hypot(touch_distance(0.226, 0.03), 0.226 - 0.03) == pytest.approx(0.226)
