# SPDX-License-Identifier: Apache-2.0
"""Recognition of attempts and their outcomes, also with odometry slip or without observations."""
from dataclasses import replace
from functools import lru_cache
import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from tiers import slow

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import (
    Decision, Face, Kind, load_decision_tuning, Motion, Profile, ProfileTracker, Reason,
    StepObservation, TerrainObservation)
from ballbot_ros.decision.execution.attempts import AttemptWatch
from ballbot_ros.decision.values import Outlook, Plan, Strategy, UNSEEN
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import TerrainSensor
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop

GIMBALL = load_robot('gimball')
TUNING = load_decision_tuning('decision_default')
SLIPPERY = replace(GIMBALL, surface_friction=0.03, edge_friction=0.02)
NARROW = [[-1, 0], [1, 0], [1, .02], [1.3, .02]]
GROUNDS = {
    'step': [[-1, 0], [1, 0], [1, .02], [2, .02]],
    'high': [[-1, 0], [1, 0], [1, .05], [2, .05]],
    'two edges': [[-1, 0], [1, 0], [1, .02], [1.2, .02], [1.2, .04], [2, .04]],
    'threshold': [*NARROW, [1.3, 0], [2, 0]],
    'drop behind': [*NARROW, [1.3, -.1], [2, -.1]],
    'drop': [[-1, 0], [1, 0], [1, -.1], [2, -.1]],
}
NEVER = 99.0, 99.0


@lru_cache(maxsize=None)
def drive(ground, speed, lean, robot=GIMBALL, unseen=NEVER, seconds=4.5, polyline=False):
    """Drive a ball over a terrain with slipping odometry; return outcomes and final state."""
    terrain = Terrain(GROUNDS[ground])
    faces = [(face[0, 0], face[-1, 1] - face[0, 1]) for face in terrain.faces(1.0, 0.002)]
    loop = ClosedLoop(robot, terrain, robot, load_tuning('published'), 0.0, 0.0)
    tracker, watch = ProfileTracker(GIMBALL, TUNING), AttemptWatch(GIMBALL)
    random, sensor = np.random.default_rng(1), TerrainSensor(terrain, 3.0, 0.0005)
    outcomes, profile = [], UNSEEN
    for index in range(int(50 * seconds)):
        state = loop.state
        now = state.time
        x, v = (-robot.ball_radius * number for number in (state.ball_angle, state.ball_rate))
        ahead = next((face for face in faces if face[0] > state.x), None)
        sight = sensor.measure(state.x, state.y, index) if polyline else None
        if sight is not None:
            profile = tracker.update(TerrainObservation(
                now, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max), x)
        elif not unseen[0] <= now < unseen[1]:
            profile = tracker.update(StepObservation(now, False) if ahead is None else (
                StepObservation(
                    now, True, max(0.0, ahead[0] - state.x + 0.005 * random.normal()),
                    ahead[1] + 0.0005 * random.normal(), 0.005, 0.0005)), x)
        decision = Decision(
            Kind.CROSS, Reason.LIKELY, speed, '', step=profile.face.number if profile.face else 0,
            plan=Plan(Strategy.CRUISE, speed=speed), outlook=Outlook(probability=0.9))
        outcome = watch.update(Motion(now, x, v, state.pendulum_angle), profile, decision)
        if outcome is not None:
            outcomes.append(outcome)
        loop.advance(min(max(1.8 * (speed - v), -lean), lean), 10)
    return outcomes, loop.state


@pytest.mark.parametrize('ground, speed, lean, results', [
    ('step', 0.9, 0.7, ['over']),
    ('step', 0.5, 0.5, ['stuck']),
    ('two edges', 0.9, 0.7, ['over']),
    ('threshold', 0.9, 0.7, ['over']),
    ('drop behind', 0.9, 0.7, ['fell']),
    ('drop', 0.4, 0.7, ['fell']),
])
def test_the_outcome_is_reported(ground, speed, lean, results):
    outcomes, _ = drive(ground, speed, lean)
    assert [item.result for item in outcomes] == results


def test_an_outcome_contains_the_conditions_at_touch():
    (first, *_), _ = drive('step', 0.9, 0.7)
    assert first.touch_speed == pytest.approx(0.85, abs=0.03)
    assert first.height == pytest.approx(0.02, abs=0.0006)
    assert 0.0 < first.height_sd < 0.002
    assert first.distance == pytest.approx(1.0 - 0.093, abs=0.03)
    assert first.probability == 0.9 and first.robot == GIMBALL.digest
    assert first.plan.strategy is Strategy.CRUISE and first.plan.speed == 0.9
    assert -0.7 <= first.held_angle <= 0.7


@pytest.mark.parametrize('polyline', [False, *slow(True)])
def test_a_ball_that_spins_at_the_foot_of_a_step_has_not_crossed(polyline):
    outcomes, state = drive('high', 0.5, 1.4, SLIPPERY, seconds=7.0, polyline=polyline)
    assert -GIMBALL.ball_radius * state.ball_angle > 1.5  # odometry is far beyond the step
    assert state.x < 1.0
    assert outcomes
    assert {item.result for item in outcomes} == {'stuck'}


def test_an_attempt_that_was_not_observed_has_no_outcome():
    outcomes, state = drive('step', 0.9, 0.7, unseen=(2.0, 99.0))
    assert state.x > 1.3 and not outcomes


def test_a_late_observation_gives_a_late_outcome():
    outcomes, _ = drive('step', 0.9, 0.7, unseen=(2.0, 3.2))
    assert [item.result for item in outcomes] == ['over']
    assert 3.2 <= outcomes[0].stamp < 3.3


def rolled(stamps, positions, faces=(Face(1, 1.0, 0.05, 0.005, 0.001),)):
    """Return the outcomes and the watch for positions, with the same faces in each profile."""
    watch, outcomes = AttemptWatch(GIMBALL), []
    decision = Decision(Kind.CROSS, Reason.LIKELY, 0.5, '', step=1)
    speeds = np.gradient(positions, stamps)
    for stamp, position, speed in zip(stamps, positions, speeds):
        outcome = watch.update(Motion(stamp, position, float(speed)),
                               Profile(stamp, faces), decision)
        if outcome is not None:
            outcomes.append(outcome)
    return outcomes, watch


def test_the_run_up_of_a_failure_starts_where_the_ball_was_last_at_rest():
    stamps = np.arange(0.0, 6.0, 0.02)
    outcomes, _ = rolled(stamps, np.minimum(np.abs(0.5 * stamps - 0.5), 0.86))
    assert [item.failure.run_up for item in outcomes] == pytest.approx([0.86], abs=0.02)


def test_a_ball_held_by_a_step_is_stuck_after_a_timeout():
    stamps = np.arange(0.0, 6.0, 0.02)
    outcomes, _ = rolled(stamps, np.minimum(0.5 * stamps, 0.86))
    assert [item.result for item in outcomes] == ['stuck']
    assert 1.5 <= outcomes[0].stamp - 0.86 / 0.5 < 1.7


def test_rocking_at_the_foot_is_one_failure_not_many():
    stamps = np.arange(0.0, 10.0, 0.02)
    rocking = np.where(stamps < 1.72, 0.5 * stamps, 0.85 + 0.02 * np.sin(4.0 * stamps))
    outcomes, _ = rolled(stamps, rocking)
    assert [item.result for item in outcomes] == ['stuck']


@pytest.mark.parametrize('jump', [0.5, -0.5])
def test_a_jump_of_odometry_is_not_an_attempt(jump):
    stamps = np.arange(0.0, 3.0, 0.02)
    positions = np.minimum(0.5 * stamps, 0.7) + jump * (stamps > 2.0)
    assert rolled(stamps, positions)[0] == []


def test_a_step_that_appears_under_the_ball_is_not_an_attempt():
    watch = AttemptWatch(GIMBALL)
    decision = Decision(Kind.CROSS, Reason.LIKELY, 0.5, '', step=1)
    for index in range(20):
        now = 0.02 * index
        watch.update(Motion(now, 0.8 + 0.5 * now, 0.5), Profile(now), decision)
    watch.update(Motion(0.4, 1.0, 0.5), Profile(0.4, (Face(1, 1.05, 0.05, 0.005, 0.001),)),
                 decision)
    assert watch.attempt is None


numbers = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-2.0, 2.0))
faces = st.builds(Face, st.integers(0, 3), numbers, numbers, numbers, numbers)
profiles = st.one_of(st.just(UNSEEN), st.builds(
    Profile, numbers, st.lists(faces, max_size=3).map(tuple), slope=numbers))


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 0.3), numbers, numbers, profiles,
                          st.sampled_from(list(Kind))), max_size=30))
def test_no_input_raises_an_error_and_outcomes_are_finite(stream):
    watch, now = AttemptWatch(GIMBALL), 0.0
    for passed, position, speed, profile, kind in stream:
        now += passed
        outcome = watch.update(Motion(now, position, speed), profile,
                               Decision(kind, Reason.LIKELY, 0.5, ''))
        assert outcome is None or math.isfinite(outcome.touch_speed)
