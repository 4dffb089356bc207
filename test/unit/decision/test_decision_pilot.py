# SPDX-License-Identifier: Apache-2.0
"""The pilot in closed loop: set angles at 50 Hz, law (11) and the motor at 500 Hz."""
from dataclasses import replace
import math

import pytest

from ballbot_ros.control import load_tuning
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import (
    Decision, Kind, Knowledge, load_curve, load_decision_tuning, Motion, Pilot, Plan, Reason,
    Strategy)
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop

GIMBALL = load_robot('gimball')
KNOWLEDGE = Knowledge(
    GIMBALL, load_curve('gimball_down'), load_decision_tuning('decision_default'))
CRUISE = Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, 0.6, '')
STOP = Decision(Kind.STOP, Reason.STALE, 0.0, '')
NOWHERE = Motion(math.nan, math.nan, math.nan)


def stop_at(position, speed=0.8):
    """Return the decision to stop at a position."""
    return Decision(Kind.STOP, Reason.DROP, speed, '',
                    plan=Plan(Strategy.STOP, stop_position=position))


def test_the_slope_is_unknown_before_the_ball_has_moved_for_some_seconds():
    pilot, found, steady = Pilot(KNOWLEDGE), [], replace(CRUISE, set_speed=0.4)
    for index in range(250):
        motion = pilot.estimate(Motion(0.02 * index, 0.008 * index, 0.4), None)
        pilot.angle(steady, motion)
        found.append(motion.slope_sd)
    assert found[0] > 0.03 and found == sorted(found, reverse=True) and found[-1] < 0.011


def drive(slope_deg, decide, seconds=8.0):
    """Return (time, x, speed, pendulum angle) at 50 Hz; `decide` maps time to a decision."""
    return drive_on(Terrain.slope(math.radians(slope_deg)), decide, seconds)


def drive_on(terrain, decide, seconds, speed=0.0, touched=lambda x: None, pilot=None):
    """Return the log of `drive`; `touched` maps a position to that of the step touched there."""
    loop = ClosedLoop(GIMBALL, terrain, GIMBALL, load_tuning('published'), speed, 0.0)
    pilot, log = pilot or Pilot(KNOWLEDGE), []
    for _ in range(int(50 * seconds)):
        state = loop.state
        log.append((state.time, state.x, state.velocity_x, state.pendulum_angle))
        motion = pilot.estimate(Motion(*log[-1][:3]), touched(state.x))
        loop.advance(pilot.angle(decide(state.time), motion), 10)
    return log


@pytest.mark.parametrize('slope_deg', [-3.0, -0.5, 0.0, 3.0])
def test_the_ball_comes_to_rest_at_the_stop_position_and_stays_there(slope_deg):
    log = drive(slope_deg, lambda now: stop_at(1.5), seconds=9.0)
    assert max(x for _, x, *_ in log) < 1.505
    assert log[-1][1] == pytest.approx(1.5, abs=0.005)
    assert abs(log[-1][2]) < 1e-3


@pytest.mark.parametrize('slope_deg', [-3.0, 0.0, 3.0])
def test_after_an_immediate_stop_the_ball_stays_where_it_came_to_rest(slope_deg):
    log = drive(slope_deg, lambda now: CRUISE if now < 3.0 else STOP)
    rest = [x for now, x, *_ in log if now > 6.0]
    assert max(rest) - min(rest) < 0.01
    assert min(speed for now, _, speed, _ in log if now > 3.0) > -0.02


@pytest.mark.parametrize('first', [STOP, stop_at(0.9)])
def test_a_stop_for_another_reason_does_not_release_a_braking_ball(first):
    def then(now):
        return first if now < 2.5 else stop_at(3.0)

    log = drive(0.0, lambda now: CRUISE if now < 2.0 else then(now), 3.5)
    alone = drive(0.0, lambda now: CRUISE if now < 2.0 else first, 3.5)
    assert max(x for _, x, *_ in log) < max(x for _, x, *_ in alone) + 0.1


@pytest.mark.parametrize('slope_deg', [-3.0, 0.0, 3.0])
def test_the_ball_backs_off_to_the_start_of_a_plan(slope_deg):
    back = Decision(Kind.BACK_OFF, Reason.RUN_UP, 0.0, '', plan=Plan(Strategy.BACK_OFF, -0.7))
    log = drive(slope_deg, lambda now: back)
    assert min(x for _, x, *_ in log) > -0.705
    assert log[-1][1] == pytest.approx(-0.7, abs=0.005)


def test_a_stop_while_backing_off_is_shorter_uphill_than_downhill():
    back = Decision(Kind.BACK_OFF, Reason.RUN_UP, 0.0, '', plan=Plan(Strategy.BACK_OFF, -5.0))
    distances = []
    for slope_deg in -3.0, 0.0, 3.0:  # uphill, as the ball rolls back
        log = drive(slope_deg, lambda now: back if now < 3.0 else STOP, 9.0)
        start = next(x for now, x, *_ in log if now >= 3.0)
        distances.append(start - min(x for _, x, *_ in log))
        assert abs(log[-1][2]) < 1e-3
    assert distances[0] + 0.02 < distances[1] < distances[2] - 0.01


@pytest.mark.parametrize('stopped', [1.0, 1.5, 1.8, 2.0, 2.2, 2.5])
def test_a_stop_while_backing_off_ends_at_the_latest_at_the_start_of_the_plan(stopped):
    back = Decision(Kind.BACK_OFF, Reason.RUN_UP, 0.0, '', plan=Plan(Strategy.BACK_OFF, -0.5))
    log = drive(0.0, lambda now: back if now < stopped else STOP)
    assert min(x for _, x, *_ in log) > -0.51


def test_the_stopping_distance_contains_the_actuation_delay():
    rest = [Pilot(replace(KNOWLEDGE, tuning=replace(
        KNOWLEDGE.tuning, actuation_delay=delay)))._standing(STOP, Motion(0.0, 0.0, 0.4))
        for delay in (0.0, 0.3)]
    assert rest[1] - rest[0] == pytest.approx(0.3 * 0.4)


def test_between_swing_and_edge_the_pendulum_has_the_angle_of_the_plan():
    cross = Decision(Kind.CROSS, Reason.LIKELY, 0.6, '', plan=Plan(
        Strategy.SWING, speed=0.6, swing_position=0.8, swing_angle=1.8, edge=1.3))
    log = drive(0.0, lambda now: cross, seconds=5.0)
    assert max(angle for _, x, _, angle in log if x < 0.8) < 0.8
    assert max(angle for _, x, _, angle in log if 1.0 < x < 1.3) > 1.5
    assert abs(log[-1][3]) < 0.2


def test_a_motion_that_is_not_finite_gives_a_hanging_pendulum():
    pilot = Pilot(KNOWLEDGE)
    assert pilot.angle(CRUISE, Motion(0.0, 0.0, 0.0)) > 0.1
    assert pilot.angle(CRUISE, NOWHERE) == 0.0


def test_the_same_stamp_gets_the_same_angle():
    pilot = Pilot(KNOWLEDGE)
    first = pilot.angle(CRUISE, Motion(0.02, 0.0, 0.0))
    assert pilot.angle(CRUISE, Motion(0.02, 0.0, 0.5)) == first


def test_slope_estimates_at_a_step_are_ignored():
    pilot = Pilot(KNOWLEDGE)

    def estimated(since, count, slope, step=None):
        return [pilot.estimate(Motion(since + 0.02 * index, 0.0, 0.4, slope=slope), step).slope
                for index in range(count)][-1]
    assert estimated(0.0, 300, 0.03) == pytest.approx(0.03, abs=0.002)
    estimated(6.0, 50, 0.3, step=0.1)
    assert estimated(7.0, 45, -0.2) == pytest.approx(0.03, abs=0.002)
    assert estimated(8.0, 200, -0.02) == pytest.approx(-0.02, abs=0.005)


@pytest.mark.parametrize('speed', [0.3, 0.5])
def test_a_ball_that_rebounds_from_a_step_does_not_touch_it_again(speed):
    """The observer of the speed law must not take the force of the step for a slope."""
    height = 0.03
    touch = 0.8 - touch_distance(GIMBALL.ball_radius, height)
    cross = Decision(Kind.CROSS, Reason.COMMITTED, speed, '', plan=Plan(
        Strategy.CRUISE, speed=speed, edge=0.82))
    bounced = []

    def decide(now):
        return stop_at(touch - 0.25, 0.0) if bounced else cross

    def touched(x):
        reached.append(x)
        if max(reached) > touch and x < max(reached) - 0.03:
            bounced.append(len(reached))
        return 0.8 if max(reached) > touch and not bounced else None
    reached = []
    terrain = Terrain([[-5.0, 0.0], [0.8, 0.0], [0.8, height], [5.0, height]])
    log = drive_on(terrain, decide, 8.0, speed, touched)
    assert bounced
    assert max(speed for _, _, speed, _ in log[bounced[0]:]) < 0.02
    assert log[-1][1] == pytest.approx(touch - 0.25, abs=0.02)


def test_a_ball_between_the_two_sides_of_a_trench_comes_to_rest():
    touch, depth = touch_distance(GIMBALL.ball_radius, 0.014), -0.014
    terrain = Terrain([[-5.0, 0.0], [-0.095, 0.0], [-0.095, depth], [0.095, depth], [0.095, 0.0],
                       [5.0, 0.0]])
    log = drive_on(terrain, lambda now: STOP, 6.0, 0.3,
                   lambda x: 0.095 if x > 0.095 - touch else None)
    assert max(abs(speed) for time, _, speed, _ in log if time > 5.0) < 0.02


@pytest.mark.parametrize('slope_deg, cord, required', [
    (0.0, 0.01, True), (0.0, 0.05, True), (3.0, None, False), (-3.0, None, False)])
def test_only_an_obstruction_before_the_stop_position_requires_emergency_lean(
        slope_deg, cord, required):
    pilot, rise = Pilot(KNOWLEDGE), math.tan(math.radians(slope_deg))
    place, points = 0.6 + touch_distance(GIMBALL.ball_radius, 0.008), []
    if cord is not None:
        points = [[place - cord, 0.0], [place - cord, 0.008], [place - cord + 0.008, 0.008],
                  [place - cord + 0.008, 0.0]]
    drive_on(Terrain([[-5.0, -5.0 * rise], *points, [5.0, 5.0 * rise]]),
             lambda now: stop_at(0.6, 0.2), 15.0, pilot=pilot)
    assert pilot.at_emergency_lean is required
