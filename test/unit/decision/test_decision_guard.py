# SPDX-License-Identifier: Apache-2.0
"""The safety filter around planners: decisions that no planner may return."""
from dataclasses import replace
import math

from hypothesis import given, strategies
import pytest

from ballbot_ros.decision import (
    Decision, Face, Kind, Knowledge, load_curve, load_decision_tuning, Motion, Plan, Profile,
    Reason, Situation, Strategy)
from ballbot_ros.decision.planning.safety_filter import (
    checked, energy_bound, with_safety_filter)
from ballbot_ros.physics.model.robot import load_robot

KNOWN = Knowledge(load_robot('gimball'), load_curve('gimball_down'),
                  load_decision_tuning('decision_default'))
GIMBALL, TUNING = KNOWN.robot, KNOWN.tuning
STEP = Face(3, 0.8, 0.03, 0.01, 0.001)
CROSSING = Decision(Kind.CROSS, Reason.WITHIN_CURVE, 0.9, '', step=3,
                    plan=Plan(Strategy.SWING, speed=0.9, swing_angle=1.5))
anything = strategies.floats(allow_nan=True, allow_infinity=True)


def situation(face=STEP, age=0.0, **changes):
    return Situation(Motion(10.0, 0.0, 0.4), Profile(10.0 - age, (face,), **changes))


def test_the_energy_bound_is_the_height_that_uses_all_energy():
    # Without a pendulum: M g h = M v^2 / 2 (1 + J1 / M R^2).
    alone = replace(GIMBALL, pendulum_mass=1e-9, ball_mass=5.4)
    rotation = 1.0 + 0.080 / (5.4 * 0.226**2)
    assert energy_bound(alone, 0.7, 0.0) == pytest.approx(0.49 * rotation / 2.0 / 9.81)
    bound = energy_bound(GIMBALL, 0.7, 1.0)
    push = 1.6 * 9.81 * 0.0787
    assert 5.4 * 9.81 * bound == pytest.approx(
        5.4 * 0.49 * rotation / 2.0 + push * (1.0 - math.cos(1.0) + math.acos(1 - bound / 0.226)))
    assert energy_bound(GIMBALL, 3.0, 1.0) == GIMBALL.ball_radius


@given(strategies.floats(0.2, 1.2), strategies.floats(0.0, 0.5), strategies.floats(0.0, 2.0))
def test_the_energy_bound_grows_and_is_above_what_simulations_cross(speed, more, swing):
    bound = energy_bound(GIMBALL, speed, swing)
    assert energy_bound(GIMBALL, speed + more, swing) >= bound
    assert energy_bound(GIMBALL, speed, swing + more) >= bound
    level = load_curve('gimball_horizontal').height(speed)
    assert level < energy_bound(GIMBALL, speed, math.pi / 2.0) <= GIMBALL.ball_radius


def test_a_crossing_within_all_limits_is_unchanged():
    assert checked(CROSSING, situation(), KNOWN) is CROSSING


@pytest.mark.parametrize('change, face, reason', [
    ({}, replace(STEP, height=0.2), Reason.TOO_HIGH),
    ({}, replace(STEP, height=math.nan), Reason.TOO_HIGH),
    ({'step': 4}, STEP, Reason.BAD_OBSERVATION),
    ({'set_speed': 1.11}, STEP, Reason.BAD_OBSERVATION),
    ({'set_speed': -0.01}, STEP, Reason.BAD_OBSERVATION),
    ({'set_speed': math.nan}, STEP, Reason.BAD_OBSERVATION),
    ({'kind': Kind.CLEAR}, STEP, Reason.BAD_OBSERVATION),
    ({'plan': replace(CROSSING.plan, speed=1.2)}, STEP, Reason.BAD_OBSERVATION),
    ({'plan': replace(CROSSING.plan, speed=math.nan)}, STEP, Reason.BAD_OBSERVATION),
    ({'plan': replace(CROSSING.plan, swing_angle=3.0)}, STEP, Reason.BAD_OBSERVATION),
    ({'plan': replace(CROSSING.plan, swing_angle=math.nan)}, STEP, Reason.BAD_OBSERVATION)])
def test_a_crossing_beyond_a_limit_is_replaced_by_a_stop(change, face, reason):
    answer = checked(replace(CROSSING, **change), situation(face), KNOWN)
    assert (answer.kind, answer.reason, answer.set_speed) == (Kind.STOP, reason, 0.0)
    assert answer.explanation


@pytest.mark.parametrize('reason, kind', [
    (Reason.COMMITTED, Kind.CROSS), (Reason.LIKELY, Kind.STOP)])
def test_a_crossing_without_its_face_continues_only_if_committed(reason, kind):
    crossing = replace(CROSSING, reason=reason, plan=replace(CROSSING.plan, edge=0.8), step=4)
    assert checked(crossing, situation(), KNOWN).kind is kind


def test_backing_off_stays_on_ground_known_to_be_free():
    back = Decision(Kind.BACK_OFF, Reason.RUN_UP, 0.2, '', plan=Plan(Strategy.BACK_OFF, -0.5))
    known = replace(situation(), free_from=-0.5)
    assert checked(back, known, KNOWN) is back
    for nowhere in (situation(), replace(known, free_from=0.05)):
        assert checked(back, nowhere, KNOWN).reason is Reason.NO_ROOM
    # If the estimate of the face moves, the start moves too, but stays on free ground.
    moved = checked(back, replace(known, free_from=-0.45), KNOWN)
    assert moved.kind is Kind.BACK_OFF and moved.plan.start == -0.45
    nowhere = replace(back, plan=Plan(Strategy.BACK_OFF, math.nan))
    assert checked(nowhere, known, KNOWN).reason is Reason.NO_ROOM


@pytest.mark.parametrize('what', [
    {'age': 0.31 + TUNING.observation_timeout}, {'age': -0.1 - TUNING.observation_timeout},
    {'rejection': Reason.CONTRADICTORY}, {'face': replace(STEP, position=math.nan)}])
def test_a_planner_is_not_called_with_invalid_input(what):
    def never(situation, previous):
        raise AssertionError('the planner was called')

    answer = with_safety_filter(never, KNOWN)(situation(**what), CROSSING)
    assert (answer.kind, answer.set_speed) == (Kind.STOP, 0.0)
    nothing = Situation(Motion(0.0, 0.0, 0.0))
    assert with_safety_filter(never, KNOWN)(nothing, None).reason is Reason.STALE


def test_old_observations_do_not_stop_a_committed_ball():
    committed = replace(CROSSING, reason=Reason.COMMITTED)
    planner = with_safety_filter(lambda situation, previous: previous, KNOWN)
    assert planner(situation(age=5.0), committed) is committed
    assert planner(situation(age=5.0), CROSSING).reason is Reason.STALE
    other = replace(committed, step=4)
    assert planner(situation(age=5.0), other).reason is Reason.STALE
    bad = replace(situation(), motion=Motion(10.0, math.nan, 0.4))
    assert planner(bad, committed).reason is Reason.BAD_OBSERVATION


def test_decisions_do_not_alternate_at_a_latency_near_the_limit():
    timeout = TUNING.observation_timeout
    planner = with_safety_filter(lambda situation, previous: CROSSING, KNOWN)

    def after(delay, age):
        scene = situation(age=age)
        motion = replace(scene.motion, stamp=scene.motion.stamp + delay)
        profile = replace(scene.profile, stamp=motion.stamp - age)
        return planner(replace(scene, motion=motion, profile=profile), None)

    assert after(0.0, 0.99 * timeout) is CROSSING
    assert after(0.1, 1.01 * timeout).reason is Reason.STALE
    assert after(0.1 + 0.99 * timeout, 0.5 * timeout).reason is Reason.STALE
    assert after(0.1 + 1.01 * timeout, 0.5 * timeout) is CROSSING


@given(*[anything] * 9)
def test_no_plan_exceeds_a_limit(
        now, position, speed, place, height, sd, asked, planned, swing):
    bold = Decision(Kind.CROSS, Reason.LIKELY, asked, '', step=1,
                    plan=Plan(Strategy.SWING, speed=planned, swing_angle=swing))
    scene = Situation(Motion(now, position, speed),
                      Profile(0.0, (Face(1, place, height, sd, sd),)))
    answer = with_safety_filter(lambda situation, previous: bold, KNOWN)(scene, None)
    if answer.kind is Kind.CROSS:
        assert 0.0 <= asked <= TUNING.highest_speed and abs(swing) <= TUNING.largest_swing
        assert height <= energy_bound(GIMBALL, max(speed, TUNING.highest_speed), math.pi)
    else:
        assert answer.set_speed == 0.0
