# SPDX-License-Identifier: Apache-2.0
"""Memory of failures, of free ground behind the ball, and of positions without progress."""
from dataclasses import replace
import math

import pytest

from ballbot_ros.decision import (
    Decision, DecisionTuning, Face, Kind, Knowledge, load_curve, load_decision_tuning, Motion,
    Plan, PLANNERS, Profile, Reason, Situation, Strategy)
from ballbot_ros.decision.execution.memory import Memory
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.planning.safety_filter import with_safety_filter
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.values import Failure, Obstruction
from ballbot_ros.physics.model.robot import load_robot

TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWN = Knowledge(load_robot('gimball'), load_curve('gimball_down'), TUNING)
STEP = Face(4, 1.0, 0.02, 0.01, 0.001)
RADIUS = KNOWN.robot.ball_radius
DRIVING = Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, 0.4, '')
PLAN = Plan(Strategy.ACCELERATE, 0.0, 0.75, edge=1.0)


def outcome(result='stuck', **changes):
    return replace(Outcome(
        stamp=3.0, result=result, face=4, position=1.0, height=0.02, height_sd=0.001,
        touch_speed=0.7, touch_angle=0.0, held_angle=0.0, plan=PLAN), **changes)


def moved(memory, *positions, faces=(), since=0.0):
    for index, position in enumerate(positions):
        now = since + 0.02 * index
        memory.move(Motion(now, position, 0.4), Profile(now, faces))


def failures(memory, face):
    return Situation(Motion(0.0, 0.0, 0.0), failures=tuple(memory.failures)).failures_at(face)


def test_only_ground_that_the_ball_has_rolled_over_is_free():
    """The last 5 cm of the room behind the ball are clearance: it may end in a drop."""
    memory = Memory(TUNING, RADIUS)
    assert memory.free_from == math.inf
    moved(memory, 0.3, 0.5, 0.2, 0.4)
    assert memory.free_from == 0.2
    roomy = Memory(DecisionTuning(room_behind=0.5), RADIUS)
    moved(roomy, 0.3, 0.5)
    assert roomy.free_from == pytest.approx(-0.15)
    memory.reset()
    assert memory.free_from == math.inf


def test_after_climbing_a_step_the_ball_does_not_back_off_over_its_edge():
    memory = Memory(TUNING, RADIUS)
    moved(memory, 0.0, 0.9, faces=(STEP,))
    moved(memory, 1.1, 1.5, since=0.04)
    assert memory.free_from == pytest.approx(1.05)
    # Below the step again, the floor that the ball has rolled over is free.
    moved(memory, 0.6, since=0.08)
    assert memory.free_from == 0.0


def test_an_edge_whose_estimate_moves_behind_the_ball_has_been_passed():
    """One profile has the edge ahead of the ball, and the next one does not contain it."""
    memory = Memory(TUNING, RADIUS)
    moved(memory, 0.0, 0.96, faces=(STEP,))
    moved(memory, 0.98, 1.5, since=0.04)
    assert memory.free_from == pytest.approx(1.05)
    far = Memory(TUNING, RADIUS)
    moved(far, 0.0, 0.5, faces=(STEP,))
    moved(far, 0.9, since=0.04)
    assert far.free_from == 0.0


def test_below_a_step_down_the_ball_does_not_back_off_into_the_step():
    memory = Memory(TUNING, RADIUS)
    down = replace(STEP, height=-0.02)
    moved(memory, *(0.9 + 0.01 * index for index in range(80)), faces=(down,))
    touch = math.sqrt(2.0 * RADIUS * 0.02 - 0.02**2)
    assert 1.0 + touch < memory.free_from < 1.0 + touch + 0.1


def test_a_failure_is_found_by_its_position_despite_another_number_and_height():
    memory = Memory(TUNING, RADIUS)
    moved(memory, 0.0)
    memory.take(outcome())
    assert failures(memory, STEP) == [Failure(1.0, PLAN, 0.7)]
    for height in (0.022, -0.015):
        later = replace(STEP, number=9, position=1.1, height=height)
        assert len(failures(memory, later)) == 1
    assert failures(memory, replace(later, position=1.2)) == []
    # The ball may have spun at the foot: less ground is free than by odometry.
    assert memory.free_from == pytest.approx(0.1)
    memory.take(outcome('over'))
    assert failures(memory, STEP) == []


@pytest.mark.parametrize('speed, seconds, at_emergency_lean, reason', [
    (0.0, 2.6, True, Reason.STUCK), (-0.2, 1.1, True, Reason.STEEP), (0.0, 2.3, True, None),
    (-0.2, 0.9, True, None), (-0.07, 1.5, True, None), (-0.2, 1.1, False, Reason.STEEP),
    (0.0, 20.0, False, None)])
def test_a_lack_of_progress_is_detected(speed, seconds, at_emergency_lean, reason):
    memory = Memory(TUNING, RADIUS)
    for index in range(int(seconds * 50)):
        now = 0.02 * index
        # The ball rocks by a few centimetres.
        memory.watch(Motion(now, 0.5 + speed * now + 0.02 * math.sin(5.0 * now), speed), DRIVING,
                     at_emergency_lean)
    assert (None if memory.obstruction is None else memory.obstruction.reason) is reason


def test_a_ball_without_progress_in_a_swing_is_stuck():
    """The slope is not estimated during a swing."""
    memory, swing = Memory(TUNING, RADIUS), replace(DRIVING, kind=Kind.CROSS)
    for index in range(130):
        memory.watch(Motion(0.02 * index, 0.5, 0.0), swing, False)
    assert memory.obstruction.reason is Reason.STUCK


@pytest.mark.parametrize('kind', [Kind.STOP, Kind.GO_ROUND])
@pytest.mark.parametrize('speed', [0.15, 0.003])
def test_an_obstruction_before_the_stop_position_ends_the_approach_to_it(kind, speed):
    memory, decision = Memory(TUNING, RADIUS), replace(DRIVING, kind=kind, set_speed=speed)
    for index in range(130):
        memory.watch(Motion(0.02 * index, 0.5, 0.0), decision, True)
    assert memory.obstruction.reason is Reason.STUCK
    answer = StopLines(KNOWN).filtered(decision, Situation(
        Motion(2.6, 0.5, 0.0), Profile(2.6), free_from=0.48, obstruction=memory.obstruction))
    assert (answer.kind, answer.reason, answer.set_speed) == (
        Kind.GO_ROUND, Reason.STUCK, 0.0)


@pytest.mark.parametrize('decision', [
    replace(DRIVING, kind=Kind.STOP, set_speed=0.0), replace(DRIVING, kind=Kind.BACK_OFF),
    replace(DRIVING, kind=Kind.CROSS, contact_since=0.0)])
def test_a_ball_without_a_forward_command_or_in_contact_is_not_stuck(decision):
    memory = Memory(TUNING, RADIUS)
    for index in range(400):
        memory.watch(Motion(0.02 * index, 0.5, 0.0), decision, True)
    assert memory.obstruction is None


def test_a_ball_with_progress_is_not_stuck_and_clears_an_obstruction_that_it_passes():
    memory = Memory(TUNING, RADIUS)
    for index in range(500):
        memory.watch(Motion(0.02 * index, 0.0005 * index, 0.025), DRIVING, True)
    assert memory.obstruction is None
    for index in range(200):
        memory.watch(Motion(20.0 + 0.02 * index, 0.3, 0.0), DRIVING, True)
    assert memory.obstruction.position == pytest.approx(0.3)
    moved(memory, 0.39)
    assert memory.obstruction is not None
    moved(memory, 0.41, since=1.0)
    assert memory.obstruction is None


def test_the_ball_stops_before_an_obstruction_and_requests_another_way():
    filtered = StopLines(KNOWN).filtered
    blocked = Obstruction(0.5, Reason.STUCK)
    here = Situation(Motion(0.0, 0.49, 0.0), Profile(0.0), free_from=0.0, obstruction=blocked)
    for position in (0.49, 0.26, 0.24, 0.1):
        answer = filtered(DRIVING, replace(here, motion=Motion(0.0, position, 0.0)))
        assert (answer.kind, answer.reason) == (Kind.GO_ROUND, Reason.STUCK)
        assert answer.plan.stop_position == pytest.approx(0.25)
        assert answer.plan.strategy is Strategy.GO_ROUND
    # Without free ground behind it, the ball stays where it is.
    stands = filtered(DRIVING, replace(here, free_from=0.48))
    assert (stands.kind, stands.set_speed) == (Kind.GO_ROUND, 0.0)
    assert (stands.plan.strategy, stands.plan.stop_position) == (Strategy.GO_ROUND, math.inf)
    for decision in (replace(DRIVING, kind=Kind.STOP, set_speed=0.0),
                     replace(DRIVING, kind=Kind.BACK_OFF)):
        assert filtered(decision, here) is decision
    assert filtered(DRIVING, replace(here, obstruction=None)) is DRIVING


def answer(failures, position=0.0, free_from=-3.0, speed=0.0):
    planner = with_safety_filter(PLANNERS['cubic'](KNOWN), KNOWN)
    return planner(Situation(Motion(0.0, position, speed), Profile(0.0, (STEP,)), failures,
                             free_from), None)


def test_a_failed_plan_is_never_repeated():
    first = answer(())
    assert first.kind is Kind.CROSS
    failed = [Failure(1.0, first.plan, first.outlook.touch_speed)]
    back = answer(failed, 0.8)
    assert (back.kind, back.reason) == (Kind.BACK_OFF, Reason.RUN_UP)
    second = answer(failed, back.plan.start)
    assert second.kind is Kind.CROSS
    assert second.plan.speed > 1.05 * first.plan.speed
    assert second.outlook.touch_speed > 1.1 * first.outlook.touch_speed
    failed.append(Failure(1.0, second.plan, second.outlook.touch_speed))
    third = answer(failed, -3.0)
    assert third.kind is Kind.GO_ROUND or third.plan.speed > second.plan.speed
    # Without room for a longer run-up the ball goes round.
    assert answer(failed, 0.8, free_from=0.7).reason is Reason.FAILED_BEFORE
    fast = Failure(1.0, replace(first.plan, speed=1.09), 1.05)
    assert answer([fast], -3.0).kind is Kind.GO_ROUND


def test_backing_off_ends_where_the_run_up_is_long_enough():
    planner = with_safety_filter(PLANNERS['cubic'](KNOWN), KNOWN)
    position, previous = 0.6, None
    for index in range(200):
        given = Situation(Motion(0.02 * index, position, 0.0), Profile(0.02 * index, (STEP,)),
                          free_from=-3.0)
        previous = planner(given, previous)
        if previous.kind is not Kind.BACK_OFF:
            break
        start = previous.plan.start
        position -= 0.02
    assert previous.kind is Kind.CROSS and start - 0.02 <= position <= start + 0.05
    assert previous.outlook.touch_speed >= previous.required_speed
