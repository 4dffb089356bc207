# SPDX-License-Identifier: Apache-2.0
"""Closed loop with the full model, with impact and slip, and odometry from the ball angle."""
from dataclasses import replace
import math

from hypothesis import given, settings, strategies
import pytest
from tiers import slow

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import (
    Decider, Kind, Knowledge, load_curve, load_decision_tuning, Motion, Reason, StepObservation)
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop

GIMBALL = load_robot('gimball')
TUNING = replace(load_decision_tuning('decision_default'), unseen_room=1.0)
KNOWN = Knowledge(GIMBALL, load_curve('gimball_down'), TUNING)


def sloped(height, at, slope):
    """Return a slope with a step."""
    far, rise = 20.0, math.tan(slope)
    return Terrain([[-far, -(far + at) * rise], [at, 0.0], [at, height],
                    [far, height + (far - at) * rise]])


def drive(height, face, *, seconds=8.0, speed=0.0, slope=0.0, latency=0.0, noise=0.0):
    """Return the final state, and the positions and decisions at 50 Hz."""
    loop = ClosedLoop(GIMBALL, sloped(height, face, slope), GIMBALL, load_tuning('published'),
                      speed, 0.0)
    decider, places, decisions, underway = Decider(KNOWN), [], [], []
    for _ in range(int(50 * seconds)):
        state = loop.state
        now, ahead, wrong = state.time, face - state.x, noise * math.sin(13.0 * state.time)
        underway.append(
            StepObservation(now, True, max(0.0, ahead + wrong), height + wrong, 0.005,
                            max(noise, 5e-4))
            if ahead > 0.0 else StepObservation(now, False))
        while underway and underway[0].stamp <= now - latency:
            decider.observe(underway.pop(0))
        decider.move(Motion(now, -GIMBALL.ball_radius * state.ball_angle,
                            -GIMBALL.ball_radius * state.ball_rate))
        _, decision, angle = decider.decide()
        decisions.append(decision)
        places.append(state.x)
        loop.advance(angle, 10)
    return loop.state, places, decisions


def changes(decisions):
    """Return the number of decision changes before the face is passed."""
    kinds = [decision.kind for decision in decisions if decision.kind is not Kind.CLEAR]
    return sum(one is not other for one, other in zip(kinds, kinds[1:]))


@pytest.mark.parametrize('height, face, latency', [
    *slow((0.031, 1.2, 0.0), (0.010, 0.6, 0.0), (0.025, 1.426, 0.28)), (0.020, 1.5, 0.5)])
def test_a_step_is_crossed_as_decided(height, face, latency):
    state, _, decisions = drive(height, face, latency=latency)
    kinds = [item.kind for item in decisions if item.reason is not Reason.STALE]
    assert Kind.CROSS in kinds and kinds[-1] is Kind.CLEAR
    assert changes(decisions) == (1 if latency else 0)   # STALE before the first observation
    assert state.x > face + 0.3
    assert state.y == pytest.approx(GIMBALL.ball_radius + height, abs=0.005)


@pytest.mark.parametrize('height, face, speed, slope', [
    *slow((0.080, 1.2, 0.0, 0.0), (0.080, 2.0, 0.4, -2.0), (-0.100, 1.5, 0.4, -0.5),
          (-0.100, 2.0, 0.4, -3.0), (-0.100, 1.5, 0.4, 3.0)), (0.300, 1.5, 0.4, -1.0)])
def test_the_ball_stops_with_the_gap_before_a_refused_step(height, face, speed, slope):
    state, places, decisions = drive(height, face, speed=speed, slope=math.radians(slope),
                                     seconds=12.0)
    assert {item.kind for item in decisions} <= {Kind.GO_ROUND, Kind.STOP}
    assert abs(state.velocity_x) < 0.05
    gap = face - state.x - GIMBALL.ball_radius
    assert gap == pytest.approx(TUNING.stop_gap, abs=0.06)
    assert face - max(places) - GIMBALL.ball_radius > TUNING.stop_gap - 0.08


@pytest.mark.slow
@given(height=strategies.sampled_from([-0.1, 0.12, 0.4]), face=strategies.floats(1.3, 2.2),
       slope=strategies.floats(-3.0, 3.0), speed=strategies.floats(0.0, 0.4),
       noise=strategies.floats(0.0, 0.004), latency=strategies.sampled_from([0.0, 0.2, 0.5]))
@settings(max_examples=4, deadline=None)
def test_a_stop_ends_at_rest_where_physically_possible(height, face, slope, speed, noise, latency):
    state, places, decisions = drive(height, face, speed=speed, slope=math.radians(slope),
                                     noise=noise, latency=latency, seconds=12.0)
    assert {item.kind for item in decisions} <= {Kind.GO_ROUND, Kind.STOP}
    assert face - max(places) > GIMBALL.ball_radius
    assert abs(state.velocity_x) < 0.05


def test_a_negative_braking_room_predicts_a_fall():
    # The ball cruises at 0.9 m/s when the sensor first reports the drop.
    for more, falls in ((0.15, False), (-0.6, True)):
        room = 1.0 + more
        state, _, decisions = drive(-0.1, room, speed=0.9, seconds=4.0)
        assert decisions[0].kind is Kind.STOP
        assert (decisions[0].outlook.braking_room > 0.0) is not falls
        assert (state.y < GIMBALL.ball_radius - 0.02) is falls
