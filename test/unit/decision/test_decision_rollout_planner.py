# SPDX-License-Identifier: Apache-2.0
"""The rollout planner: gentle plans where they suffice, refusals with reasons, no errors."""
from dataclasses import replace
from functools import cache, partial
import math

from hypothesis import given, settings, strategies
import numpy as np
import pytest

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import (
    Decision, Face, Kind, Knowledge, load_curve, load_decision_tuning, Motion, PLANNERS, Profile,
    Reason, Situation)
from ballbot_ros.decision.planning.ahead import faces_ahead, look_ahead
from ballbot_ros.decision.planning.rollout.search import good
from ballbot_ros.decision.planning.rollout.worlds import Tally
from ballbot_ros.decision.planning.safety_filter import with_safety_filter
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.values import After, Failure, Plan, Strategy
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.5)
KNOWLEDGE = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)
# Distance from the centre of a ball to its front.
RADIUS = GIMBALL.ball_radius
new_planner = partial(PLANNERS['rollout'], KNOWLEDGE)
kept = cache(new_planner)  # sampling its worlds is slow
anything = strategies.floats(-1e3, 1e3)


def seen(*faces, points=(), **more):
    return Profile(0.0, faces, points, **more)


def ahead_of(profile, unseen_room=1.0):
    """Return the terrain ahead of a ball at rest at -1 m."""
    return look_ahead(Situation(Motion(0.0, -1.0, 0.0), profile), profile.faces, RADIUS,
                      replace(TUNING, unseen_room=unseen_room))


def step(height, sd=0.0005, position=0.0, number=1):
    return Face(number, position, height, 0.004, sd)


def decide(*faces, room=1.2, speed=0.0, answers=60, knowledge=KNOWLEDGE, failures=(),
           free_from=math.inf, **more):
    """Return the decision of a ball with its front `room` before 0, after `answers` calls."""
    plan, decision = PLANNERS['rollout'](knowledge), None
    for number in range(answers):
        situation = Situation(
            Motion(0.02 * number, -room - RADIUS, speed), replace(seen(*faces, **more)),
            failures, free_from)
        decision = plan(situation, decision)
    return decision


def test_the_step_of_the_paper_is_crossed_gently():
    answer = decide(step(0.031))
    assert answer.kind is Kind.CROSS and answer.reason is Reason.LIKELY
    assert answer.outlook.probability >= 0.9 and answer.outlook.attempts >= 200
    assert answer.outlook.touch_speed < 0.85
    assert 0.031 < answer.outlook.height_limit < 0.045
    # From rest it stops where it is: the touch is nearer than the face.
    assert 1.2 < answer.outlook.braking_room < 1.2 + RADIUS


def test_a_higher_step_requires_more_speed():
    speeds = [decide(step(height)).outlook.touch_speed for height in (0.012, 0.025, 0.045)]
    assert speeds == sorted(speeds) and speeds[2] > speeds[0] + 0.2


def test_a_swing_replaces_a_longer_run_up():
    # An earlier planner crossed only 14 mm from there.
    answer = decide(step(0.027), room=0.3)
    assert answer.kind is Kind.CROSS and answer.plan.strategy is Strategy.SWING
    assert math.isfinite(answer.plan.swing_position)


@pytest.mark.parametrize('height, kind, reason', [
    (0.07, Kind.GO_ROUND, Reason.TOO_HIGH), (0.5, Kind.GO_ROUND, Reason.WALL),
    (-0.1, Kind.STOP, Reason.DROP)])
def test_an_impassable_step_is_refused_with_a_stop_position(height, kind, reason):
    answer = decide(step(height), speed=0.4)
    assert (answer.kind, answer.reason) == (kind, reason)
    # The front of the ball keeps the stop gap.
    assert answer.plan.stop_position == pytest.approx(-RADIUS - TUNING.stop_gap)


def test_a_face_that_may_also_be_a_drop_is_approached_as_neither_a_wall_nor_a_step():
    answer = decide(step(0.04, sd=0.05), speed=0.4)
    assert (answer.kind, answer.reason) == (Kind.STOP, Reason.NOT_LIKELY)
    assert answer.set_speed > 0.0


def test_no_step_is_crossed_before_the_slope_has_been_estimated():
    plan, decision, kinds = new_planner(), None, []
    for number in range(150):
        motion = Motion(0.02 * number, -1.9 + 0.004 * number, 0.2,
                        slope_sd=0.045 if number < 75 else 0.01)
        decision = plan(Situation(motion, seen(step(0.03))), decision)
        kinds.append(decision.kind)
    assert set(kinds[:75]) == {Kind.STOP} and decision.kind is Kind.CROSS


def test_a_refusal_does_not_alternate_while_the_estimated_height_varies():
    plan, decision, reasons = new_planner(), None, []
    for number in range(200):
        height = 0.058 if number < 60 or number >= 130 else 0.052
        motion = Motion(0.02 * number, -0.6 - RADIUS, 0.05)
        decision = plan(Situation(motion, seen(step(height))), decision)
        reasons.append(decision.reason)
    refused = [reason for reason in reasons if reason is not Reason.EVALUATING]
    assert set(refused) == {Reason.TOO_HIGH}


def test_without_room_the_ball_backs_off_for_a_longer_run_up_where_the_ground_is_free():
    assert decide(step(0.045), room=0.3).reason is Reason.NO_ROOM
    answer = decide(step(0.045), room=0.3, free_from=-2.5)
    assert (answer.kind, answer.reason) == (Kind.BACK_OFF, Reason.RUN_UP)
    assert -2.5 <= answer.plan.start < -0.3 - RADIUS
    # Backing off is not a crossing: the safety filter limits it to the cruise speed.
    assert answer.set_speed <= TUNING.cruise_speed and answer.plan.speed <= TUNING.cruise_speed


def test_a_longer_run_up_is_evaluated_again_at_its_start_not_while_backing_off():
    plan, height, decision = new_planner(), 0.045, None
    here = start = -0.3 - RADIUS
    for number in range(200):
        motion = Motion(0.02 * number, here, -0.2 if height > 0.045 and here > start else 0.0)
        decision = plan(Situation(motion, seen(step(height)), (), -2.5), decision)
        if decision.kind is Kind.BACK_OFF:
            height, start = 0.07, decision.plan.start
            here = max(here - 0.02, start)
        elif height > 0.045:
            assert here == start
    assert (decision.kind, decision.reason) == (Kind.GO_ROUND, Reason.TOO_HIGH)


def test_after_backing_off_the_ball_crosses_immediately_as_planned():
    plan, here, decision, back = new_planner(), -0.3 - RADIUS, None, None
    for number in range(50):  # 1 s, for the search
        motion = Motion(0.02 * number, here, 0.0)
        decision = plan(Situation(motion, seen(step(0.045)), (), -2.5), decision)
        if back is not None:
            break
        if decision.kind is Kind.BACK_OFF:
            back, here = decision, decision.plan.start
    assert decision.kind is Kind.CROSS and decision.outlook.probability >= 0.9
    assert decision.plan.swing_angle == back.plan.swing_angle
    assert decision.plan.swing_position == pytest.approx(back.plan.swing_position)
    assert decision.plan.speed >= back.plan.speed


def test_the_ball_crosses_at_the_end_of_the_free_ground_if_the_step_is_nearer_than_estimated():
    plan, here, free, place, decision = new_planner(), -0.3 - RADIUS, -2.5, 0.0, None
    for number in range(100):
        motion = Motion(0.02 * number, here, 0.0)
        decision = plan(Situation(motion, seen(step(0.045, position=place)), (), free), decision)
        if decision.kind is Kind.BACK_OFF and place == 0.0:
            here = free = decision.plan.start
            place = -0.09
    assert place < 0.0 and decision.kind is Kind.CROSS


@pytest.mark.parametrize('room', [0.2, 0.3, 0.4])
def test_a_search_that_ends_past_the_last_braking_point_does_not_back_off(room):
    plan, decision, late = new_planner(), None, False
    for number in range(int((room - 0.01) / 0.008)):
        motion = Motion(0.02 * number, -room - RADIUS + 0.008 * number, 0.4)
        decision = plan(Situation(motion, seen(step(0.045)), (), -2.5), decision)
        if decision.outlook.braking_room < 0.0:
            late = True
            assert decision.kind is not Kind.BACK_OFF
    assert late


def test_a_drop_close_behind_the_edge_is_not_risked():
    drop = Face(2, 0.2, -0.1, 0.01, 0.002)
    answer = decide(step(0.03), drop)
    assert answer.kind in (Kind.STOP, Kind.GO_ROUND) and answer.reason is Reason.LANDING
    far = decide(step(0.02), replace(drop, position=1.2))
    assert far.kind is Kind.CROSS and far.plan.after is After.STOP
    assert far.outlook.falls <= 0.01


@pytest.mark.parametrize('unseen_room, kind, reason', [
    (1.5, Kind.CROSS, Reason.LIKELY), (0.0, Kind.STOP, Reason.LANDING)])
def test_a_step_down_is_crossed_where_floor_below_it_is_granted(unseen_room, kind, reason):
    knowledge = replace(KNOWLEDGE, tuning=replace(TUNING, unseen_room=unseen_room))
    answer = decide(step(-0.03), knowledge=knowledge)
    assert (answer.kind, answer.reason) == (kind, reason)


@pytest.mark.parametrize('unseen_room, slower', [(1.0, False), (0.9, True)])
def test_a_step_down_is_crossed_below_cruise_speed_if_the_ball_then_stops_in_time(
        unseen_room, slower):
    knowledge = replace(KNOWLEDGE, tuning=replace(TUNING, unseen_room=unseen_room))
    answer = decide(step(-0.04), knowledge=knowledge)
    assert (answer.kind, answer.reason) == (Kind.CROSS, Reason.LIKELY)
    assert (answer.plan.speed < TUNING.cruise_speed) is slower


def test_a_plan_that_falls_in_one_world_is_not_selected():
    assert good(Tally(over=199.0, stuck=1.0), 0.9)
    assert good(Tally(over=199.0, stuck=1.0, beyond=4.0), 0.9)
    assert not good(Tally(over=199.0, stuck=1.0, beyond=5.0), 0.9)
    assert not good(Tally(over=199.0, falls=1.0), 0.9)
    assert good(Tally(over=199.0, falls=1.0), 0.9, sigmas=2.0)  # if it has been selected


def test_a_plan_carries_the_ball_over_a_threshold():
    answer = decide(step(0.02), Face(2, 0.1, -0.02, 0.01, 0.001))
    assert answer.kind is Kind.CROSS and answer.plan.edge > 0.1


def test_no_plan_ends_between_two_edges_where_the_ball_cannot_stand():
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, 0.02), (0.1, 0.02), (0.1, 0.0), (3.0, 0.0)]
    profile = seen(step(0.02), Face(2, 0.1, -0.02, 0.01, 0.001), points=floor, seen_to=3.0)
    assert [end.faces for end in ahead_of(profile, 0.0).ends] == [2]


@pytest.mark.parametrize('drop, kind', [(-0.01, Kind.CROSS), (-0.18, Kind.STOP)])
@pytest.mark.parametrize('edges', [2, 4, 6])
def test_a_drop_behind_many_low_edges_is_considered(edges, drop, kind):
    heights, places = [], []
    for number in range(edges):
        places.append(0.06 * (number // 2) + 0.05 * (number % 2))
        heights.append(-0.012 if number % 2 else 0.012)
    places, heights = [*places, places[-1] + 0.24], [*heights, drop]
    floor = [(-3.0, 0.0)]
    for place, height in zip(places, heights):
        level = floor[-1][1]
        floor += [(place, level), (place, level + height)]
    answer = decide(*(step(height, 0.001, place, number)
                      for number, (place, height) in enumerate(zip(places, heights), 1)),
                    points=[*floor, (3.0, drop)], seen_to=3.0)
    assert answer.kind is kind


def test_observing_more_of_the_floor_does_not_reduce_the_room_behind_an_edge():
    rooms = []
    for end in (0.1, 0.3, 0.8, 1.2):
        profile = seen(step(0.02), points=[(-3.0, 0.0), (0.0, 0.0), (0.0, 0.02), (end, 0.02)],
                       seen_to=end)
        rooms.append(ahead_of(profile).room_to)
    assert rooms == sorted(rooms) and rooms[0] < rooms[-1]


@pytest.mark.parametrize('highest, kind', [(0.05, Kind.STOP), (0.08, Kind.CROSS)])
def test_the_tuning_states_which_step_down_is_a_drop(highest, kind):
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, -0.06), (3.0, -0.06)]
    answer = decide(step(-0.06), points=floor, seen_to=3.0, knowledge=replace(
        KNOWLEDGE, tuning=replace(TUNING, highest_descent=highest)))
    assert answer.kind is kind


@pytest.mark.parametrize('rise, ends', [(0.1, True), (0.01, False)])
def test_a_drop_is_a_trench_only_if_the_ground_behind_it_is_high_enough(rise, ends):
    faces = step(-0.1), step(rise, position=0.15, number=2)
    assert bool(ahead_of(seen(*faces)).ends) == ends


def test_past_the_last_braking_point_a_small_step_down_is_crossed_immediately():
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, -0.01), (3.0, -0.01)]
    answer = decide(step(-0.01), room=0.1 - RADIUS, speed=0.6, answers=1, points=floor,
                    seen_to=3.0)
    assert (answer.kind, answer.reason) == (Kind.CROSS, Reason.COMMITTED)
    assert answer.set_speed <= TUNING.cruise_speed


def test_a_committed_step_down_stays_committed_if_the_measured_speed_falls():
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, -0.045), (3.0, -0.045)]
    room = 0.9 * StopLines(KNOWLEDGE).braking.distance(0.5, 0.0, emergency=True)
    plan, decision = new_planner(), None
    for number, speed in enumerate((0.5, 0.4, 0.5, 0.4)):
        motion = Motion(0.02 * number, -room, speed)
        decision = plan(Situation(motion, seen(step(
            -0.045, sd=0.001 if number == 0 else 0.003), points=floor, seen_to=3.0)), decision)
        assert (decision.kind, decision.reason) == (Kind.CROSS, Reason.COMMITTED)


def test_the_stop_behind_an_edge_lasts_until_the_ball_is_clear_of_it():
    planner = with_safety_filter(new_planner(), KNOWLEDGE)
    decision = Decision(Kind.CROSS, Reason.COMMITTED, 0.5, '', plan=Plan(
        Strategy.CRUISE, speed=0.5, edge=0.01, after=After.STOP))
    for position in 0.02, 0.05, 0.1:  # too fast to stop before the step down
        decision = planner(Situation(Motion(0.0, position, 0.5), seen(
            step(-0.02, position=0.45))), decision)
        assert (decision.kind, decision.reason) == (Kind.STOP, Reason.LANDING)
    decision = planner(Situation(Motion(0.0, 0.13, 0.5), seen(
        step(-0.02, position=0.45))), decision)
    assert decision.kind is Kind.CROSS


def test_the_speed_before_a_stop_allows_for_the_uncertainty_of_the_slope():
    def speed(slope, slope_sd):
        motion = Motion(0.0, 0.0, 0.3, slope=slope, slope_sd=slope_sd)
        return StopLines(KNOWLEDGE).speed_before(0.5, Situation(motion, seen()))
    assert speed(0.0, 0.0) > speed(0.0, 0.01) > speed(0.0, 0.03)
    assert speed(0.0, 0.01) == pytest.approx(speed(-0.01 * TUNING.sigma_margin, 0.0))


def test_a_plan_is_committed_once_the_weakest_robot_cannot_stop():
    needed = StopLines(KNOWLEDGE).braking.distance(0.6, 0.0, emergency=True)
    for run_up, reason in (needed + 0.1, Reason.LIKELY), (needed, Reason.COMMITTED):
        answer = decide(step(0.01), room=run_up - RADIUS + touch_distance(RADIUS, 0.01), speed=0.6)
        assert (answer.kind, answer.reason) == (Kind.CROSS, reason)


def test_past_the_last_braking_point_the_better_of_braking_and_crossing_is_selected():
    needed = StopLines(KNOWLEDGE).braking.distance(0.8, 0.0, emergency=True)
    faces = step(0.03), step(0.2, position=0.7, number=2)  # the second cannot be crossed
    for part, kind in (0.85, Kind.STOP), (0.4, Kind.CROSS):
        room = part * needed - RADIUS + touch_distance(RADIUS, 0.03)
        answer = decide(*faces, room=room, speed=0.8)
        assert answer.outlook.braking_room < 0.0 and answer.kind is kind


def test_a_plan_that_no_longer_crosses_the_step_ends_at_the_last_braking_point():
    planner, decision = new_planner(), None
    needed = StopLines(KNOWLEDGE).braking.distance(0.5, 0.0, emergency=True)
    approach = -0.1 - needed - RADIUS
    for height, position, answers, kind, reason in (
            (0.012, approach, 60, Kind.CROSS, Reason.LIKELY),
            (0.029, approach, 5, Kind.CROSS, Reason.EVALUATING),
            (0.029, approach + 0.2, 1, Kind.STOP, Reason.EVALUATING)):
        for _ in range(answers):
            decision = planner(Situation(Motion(0.0, position, 0.5), seen(step(height))), decision)
        assert (decision.kind, decision.reason) == (kind, reason)
    assert decision.outlook.braking_room < 0.0


def test_a_face_that_appears_past_the_last_braking_point_does_not_end_a_crossing():
    planner, decision, near = new_planner(), None, step(0.009, position=-0.1, number=2)
    for number in range(60):
        decision = planner(Situation(Motion(0.02 * number, -0.8, 0.8), seen(step(0.03))), decision)
    assert (decision.kind, decision.reason) == (Kind.CROSS, Reason.COMMITTED)
    after = planner(Situation(Motion(1.2, -0.5, 0.8), seen(near, step(0.03))), decision)
    assert (after.kind, after.plan) == (Kind.CROSS, decision.plan)
    assert (after.step, after.distance) == (decision.step, pytest.approx(0.5))
    for number in range(30):
        after = planner(Situation(Motion(1.22, -0.5, 0.8), seen(near, step(0.03))), after)
    assert after.kind is Kind.CROSS and after.step == near.number


def test_a_crossing_of_a_deep_trench_continues_between_its_edges():
    planner, decision = with_safety_filter(new_planner(), KNOWLEDGE), None
    near, far = step(-0.15), step(0.15, position=0.15, number=2)  # above the energy bound
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, -0.15), (0.15, -0.15), (0.15, 0.0), (3.0, 0.0)]
    for position in [*60 * [-0.65], -0.002, 0.02, 0.08, 0.14]:
        faces = [face for face in (near, far) if face.position > position]
        decision = planner(Situation(Motion(0.0, position, 0.6), seen(
            *faces, points=floor, seen_to=3.0)), decision)
        assert decision.kind is Kind.CROSS or position == -0.65
        assert position == -0.65 or decision.plan.edge == pytest.approx(0.16)


@pytest.mark.parametrize('height, run', [
    (0.03, 0.0), (0.03, 0.02), (0.045, 0.093), (0.03, 0.15), (0.3, 0.0), (0.3, 0.05)])
@pytest.mark.parametrize('slope', [-0.05, 0.0, 0.05])
def test_the_touch_of_a_face_is_where_the_ball_is_a_radius_away_from_it(height, run, slope):
    situation = Situation(Motion(0.0, -1.0, 0.0, slope=slope), seen(
        replace(step(height), run=run)))
    touch = look_ahead(situation, situation.profile.faces, RADIUS, TUNING).touch
    face = np.linspace((0.0, 0.0), (run, height), 2001)
    centre = touch, (touch * math.sin(slope) + RADIUS) / math.cos(slope)
    assert np.hypot(*(face - centre).T).min() == pytest.approx(RADIUS, abs=1e-5)


def test_past_the_last_braking_point_a_plan_keeps_its_end_if_another_face_is_observed():
    up, down, behind = step(0.015), step(-0.03, position=0.14, number=2), step(
        0.016, position=0.42, number=3)
    halves = step(-0.015, position=0.14, number=2), step(-0.015, position=0.19, number=4)
    wall = step(0.2, position=1.4, number=5)
    for one, other in ((down,), halves), (halves, (down,)):
        planner, decision = new_planner(), None
        for number in range(100):
            decision = planner(Situation(
                Motion(0.02 * number, -0.65, 0.6), seen(up, *one, behind, wall)), decision)
        assert decision.committed and decision.plan.edge == pytest.approx(0.43)
        after = planner(Situation(
            Motion(2.0, -0.65, 0.6), seen(up, *other, behind, wall)), decision)
        assert after.committed and after.plan.edge == pytest.approx(0.43)


def test_a_plan_across_a_step_does_not_continue_down_what_may_be_a_drop():
    floor = [(-3.0, 0.0), (0.0, 0.0), (0.0, 0.02), (0.45, 0.02), (0.45, -0.035), (3.0, -0.035)]
    planner, decision = new_planner(), None
    for number in range(120):
        drop = step(-0.055, 0.008, 0.45, 2)
        faces = (step(0.02),) if number < 60 else (step(0.02), drop)
        decision = planner(Situation(Motion(0.02 * number, -1.0, 0.3), seen(
            *faces, points=floor, seen_to=3.0)), decision)
        assert decision.kind is not Kind.CROSS or decision.plan.edge < 0.45 or number < 60


def test_a_ball_at_rest_keeps_its_run_up_while_plans_are_evaluated():
    resting, rolling = (decide(step(0.03), speed=speed, answers=1) for speed in (0.0, 0.4))
    assert resting.reason is rolling.reason is Reason.EVALUATING
    assert not resting.refuses and resting.set_speed == 0.0 < rolling.set_speed
    assert decide(step(0.03), answers=30).kind is Kind.CROSS


def test_a_face_whose_foot_the_ball_has_passed_is_not_ahead():
    below, ahead = Face(1, -0.2, 0.01, 0.02, 0.0005, run=1.0), step(0.02, position=1.0, number=2)
    assert faces_ahead(seen(below, ahead), 0.0) == (ahead,)


def test_the_decision_before_a_step_without_room_behind_does_not_alternate():
    planner = PLANNERS['rollout'](replace(KNOWLEDGE, tuning=replace(TUNING, unseen_room=0.0)))
    decision, kinds = planner(Situation(Motion(0.0, -3.5, 0.4), seen()), None), []
    for number in range(1, 400):
        position, speed = -3.5 + 0.008 * number, 0.4
        decision = planner(Situation(Motion(0.02 * number, position, speed),
                                     seen(step(0.02))), decision)
        kinds.append(decision.kind)
        if decision.set_speed < 0.1:
            break
    assert decision.set_speed < 0.1 and set(kinds) == {Kind.STOP}


def test_a_failed_plan_is_followed_by_a_stronger_one():
    before = decide(step(0.03))
    failure = Failure(0.0, before.plan, before.outlook.touch_speed)
    after = decide(step(0.03), failures=(failure,))
    assert after.kind is Kind.CROSS
    assert (after.plan.speed > before.plan.speed
            or after.plan.swing_angle > before.plan.swing_angle)
    best = Plan(Strategy.SWING, speed=1.1, swing_position=-0.5, swing_angle=TUNING.largest_swing)
    last = decide(step(0.03), failures=(failure, replace(failure, plan=best)))
    assert last.kind is Kind.GO_ROUND and last.reason is Reason.FAILED_BEFORE


def test_a_failed_plan_is_not_repeated_after_a_run_up_of_the_same_length():
    high = partial(decide, step(0.045), room=0.3, free_from=-2.5)
    before = high()
    assert before.kind is Kind.BACK_OFF
    # At its start, the plan becomes one from the present position.
    executed = replace(before.plan, strategy=Strategy.SWING, start=-math.inf,
                       speed=TUNING.highest_speed)
    failure = Failure(0.0, executed, before.outlook.touch_speed,
                      -touch_distance(RADIUS, 0.045) - before.plan.start)
    assert high(failures=(failure,)).reason is Reason.FAILED_BEFORE
    assert high(failures=(replace(failure, run_up=0.5),)).kind is Kind.BACK_OFF


def test_a_faster_plan_with_less_swing_follows_a_failed_swing():
    swing = Plan(Strategy.SWING, speed=0.5, swing_position=-0.5, swing_angle=TUNING.largest_swing)
    after = decide(step(0.045), room=0.3, free_from=-2.5,
                   failures=(Failure(0.0, swing, 0.5, 0.2),))
    assert after.kind is Kind.BACK_OFF and after.outlook.touch_speed > 0.6
    assert after.plan.swing_angle < TUNING.largest_swing


def test_a_crossing_meets_a_higher_required_probability_or_is_refused():
    bold = decide(step(0.04))
    careful = decide(step(0.04), knowledge=replace(
        KNOWLEDGE, tuning=replace(TUNING, required_probability=0.99)))
    assert bold.kind is Kind.CROSS
    assert careful.kind is not Kind.CROSS or careful.outlook.probability >= 0.98


def test_the_same_situations_give_the_same_decisions_to_the_bit():
    assert repr(decide(step(0.035))) == repr(decide(step(0.035)))


@pytest.mark.parametrize('height', [0.035, 0.046, 0.05])
def test_another_search_of_the_same_situation_has_the_same_result(height):
    planner, outlooks = new_planner(), []
    for _ in range(2):
        planner(Situation(Motion(0.0, -1.2 - RADIUS, 0.0), seen()), None)  # ends the search
        decision = None
        for number in range(60):
            decision = planner(Situation(
                Motion(0.02 * number, -1.2 - RADIUS, 0.0), seen(step(height))), decision)
        outlooks.append(decision.outlook)
    assert outlooks[0].attempts > 0 and repr(outlooks[0]) == repr(outlooks[1])


def test_noise_of_the_height_does_not_change_the_decision():
    plan, decision, kinds = new_planner(), None, []
    for number in range(150):
        height = 0.036 + 0.0004 * math.sin(7.0 * number)
        motion = Motion(0.02 * number, -1.4, 0.0)
        decision = plan(Situation(motion, seen(step(height, 0.001))), decision)
        kinds.append((decision.kind, decision.plan and decision.plan.strategy))
    assert sum(now != before for before, now in zip(kinds, kinds[1:])) <= 2


def test_the_outlook_says_why_other_strategies_were_not_selected():
    answer = decide(step(0.03))
    assert any(text.startswith('cruise:') for text in answer.outlook.others)


@settings(max_examples=40, deadline=None)
@given(strategies.lists(strategies.tuples(
    anything, strategies.floats(-1.0, 1.0), strategies.floats(0.0, 0.3),
    strategies.floats(-0.1, 0.5)), max_size=4), anything, strategies.floats(-3.0, 3.0),
    strategies.floats(-0.3, 0.3))
def test_no_finite_input_raises_an_error(faces, position, speed, slope):
    profile = seen(*(Face(number, place, height, 0.01, sd, run)
                     for number, (place, height, sd, run) in enumerate(faces, 1)))
    answer = kept()(Situation(Motion(0.0, position, speed, slope=slope), profile), None)
    assert isinstance(answer.kind, Kind) and answer.explanation
