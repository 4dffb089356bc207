# SPDX-License-Identifier: Apache-2.0
"""The tracker: converges, moves on, reports contradictions, survives anything."""
from dataclasses import replace
import math

from hypothesis import given, strategies
import numpy as np
import pytest

from ballbot_ros.decision import DecisionTuning, Reason, StepObservation, StepTracker
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
anything = strategies.floats(allow_nan=True, allow_infinity=True)


def tracker():
    return StepTracker(GIMBALL, DecisionTuning())


def seen(stamp, distance=1.0, height=0.03, distance_sd=0.01, height_sd=0.002):
    return StepObservation(stamp, True, distance, height, distance_sd, height_sd)


def nothing(stamp):
    return StepObservation(stamp, False)


def test_noise_averages_out_while_the_ball_rolls():
    random, tracking = np.random.default_rng(3), tracker()
    for index in range(200):
        position = 0.005 * index
        track = tracking.update(
            seen(0.02 * index, 1.5 - position + random.normal(0.0, 0.03),
                 0.03 + random.normal(0.0, 0.004), 0.03, 0.004), position)
        assert track.rejection is None
    step = track.step
    assert step.number == 1
    assert step.position == pytest.approx(1.5, abs=0.02)
    assert step.height == pytest.approx(0.03, abs=0.001)
    assert step.height_sd < 0.0006


def test_deviation_of_zero_is_not_believed():
    step = tracker().update(seen(0.0, distance_sd=0.0, height_sd=0.0), 0.0).step
    assert step.position_sd > 0.0 and step.height_sd > 0.0


def test_same_stamp_gives_the_same_answer():
    tracking = tracker()
    first = tracking.update(seen(1.0), 0.0)
    assert tracking.update(seen(1.0, distance=0.5), 0.0) is first


def test_next_step_is_another_step():
    tracking = tracker()
    assert tracking.update(seen(0.0, 0.5), 0.0).step.number == 1
    assert tracking.update(seen(0.1, 0.5), 0.0).step.number == 1
    step = tracking.update(seen(0.2, 0.8, height=0.05), 0.51).step
    assert step.number == 2 and step.height == 0.05
    assert step.position == pytest.approx(1.31)


def test_passed_step_is_forgotten():
    tracking = tracker()
    tracking.update(seen(0.0, 0.5), 0.0)
    assert tracking.update(nothing(0.1), 0.49).step is None


@pytest.mark.parametrize('second', [
    seen(0.1, distance=0.8), seen(0.1, height=0.06), seen(-0.1),
    StepObservation(0.1, False, height=0.03)])
def test_contradictions_are_reported_and_not_averaged_in(second):
    tracking = tracker()
    before = tracking.update(seen(0.0), 0.0).step
    track = tracking.update(second, 0.0)
    assert track.rejection is Reason.CONTRADICTORY and track.explanation
    assert track.step == before


def test_a_world_that_really_changed_is_believed_after_some_looks():
    tracking = tracker()
    tracking.update(seen(0.0, height=0.03), 0.0)
    answers = [tracking.update(seen(0.1 * index, height=0.06), 0.0) for index in range(1, 6)]
    assert [answer.rejection is None for answer in answers] == [False] * 4 + [True]
    assert answers[-1].step.height == 0.06 and answers[-1].step.number == 2


def test_slip_that_displaces_the_step_does_not_make_another_of_it():
    tracking = tracker()
    tracking.update(seen(0.0, 0.3), 0.0)
    for index in range(1, 6):
        track = tracking.update(seen(0.1 * index, 0.2), 0.0)
    assert track.rejection is None and track.step.number == 1
    assert track.step.position == pytest.approx(0.2)


def test_step_is_kept_where_a_sensor_may_look_over_it_and_forgotten_far_off():
    near, far = tracker(), tracker()
    near.update(seen(0.0, 0.3), 0.0)
    far.update(seen(0.0, 1.0), 0.0)
    for index in range(1, 20):
        assert near.update(nothing(0.1 * index), 0.0).step is not None
        assert (far.update(nothing(0.1 * index), 0.0).step is None) == (index >= 5)


@pytest.mark.parametrize('change', [
    {'distance': -0.1}, {'distance_sd': -0.1}, {'height_sd': -0.1}, {'distance': math.nan},
    {'height': math.inf}, {'stamp': math.nan}, {'distance_sd': 1e200}, {'height': 1e30}])
def test_impossible_observations_are_reported(change):
    tracking = tracker()
    before = tracking.update(seen(0.0), 0.0).step
    track = tracking.update(replace(seen(0.1), **change), 0.0)
    assert track.rejection is Reason.BAD_OBSERVATION and track.step == before


def test_odometry_that_is_not_finite_is_reported():
    assert tracker().update(seen(0.0), math.nan).rejection is Reason.BAD_OBSERVATION


def test_reset_forgets_but_does_not_reuse_numbers():
    tracking = tracker()
    tracking.update(seen(100.0), 0.0)
    tracking.reset()
    track = tracking.update(seen(0.0), 0.0)
    assert track.rejection is None and track.step.number == 2


@given(strategies.lists(strategies.tuples(
    anything, strategies.booleans(), anything, anything, anything, anything, anything),
    max_size=8))
def test_no_observation_makes_it_raise_or_invent_a_step(rows):
    tracking = tracker()
    for *observation, position in rows:
        step = tracking.update(StepObservation(*observation), position).step
        if step is not None:
            assert math.isfinite(step.position) and math.isfinite(step.height)
            assert step.position_sd > 0.0 and step.height_sd > 0.0
