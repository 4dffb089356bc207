# SPDX-License-Identifier: Apache-2.0
"""The step tracker: convergence, passed steps, contradictions and arbitrary input."""
from dataclasses import replace
import math
import re

from hypothesis import given, strategies
import numpy as np
import pytest

from ballbot_ros.decision import (
    Decider, DecisionTuning, Knowledge, load_curve, Motion, ProfileTracker, Reason,
    StepObservation)
from ballbot_ros.decision.perception import GroundFusion
from ballbot_ros.decision.planning.ahead import faces_ahead
from ballbot_ros.physics.model.robot import load_robot

GIMBALL = load_robot('gimball')
anything = strategies.floats(allow_nan=True, allow_infinity=True)


def tracker():
    return ProfileTracker(GIMBALL, DecisionTuning())


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
    step = track.face
    assert step.number == 1
    assert step.position == pytest.approx(1.5, abs=0.02)
    assert step.height == pytest.approx(0.03, abs=0.001)
    assert step.height_sd < 0.0006


def test_unreported_noise_of_heights_averages_out_as_well():
    random, tracking = np.random.default_rng(5), tracker()
    heights = [tracking.update(
        seen(0.02 * index, 1.5, 0.006 + random.normal(0.0, 0.0015), 0.0, 0.0), 0.0).face.height
        for index in range(150)]
    # The constant error limits the accuracy of the height, not the weight of the average.
    assert np.std(heights[30:]) < 0.0005
    assert np.mean(heights[30:]) == pytest.approx(0.006, abs=0.0005)


def test_a_standard_deviation_of_zero_is_replaced():
    step = tracker().update(seen(0.0, distance_sd=0.0, height_sd=0.0), 0.0).face
    assert step.position_sd > 0.0 and step.height_sd > 0.0


def test_the_next_step_has_another_number():
    tracking = tracker()
    assert tracking.update(seen(0.0, 0.5), 0.0).face.number == 1
    assert tracking.update(seen(0.1, 0.5), 0.0).face.number == 1
    assert tracking.update(seen(0.2, 0.8, height=0.05), 0.51).face is None
    step = tracking.update(seen(0.3, 0.8, height=0.05), 0.51).face
    assert step.number == 2 and step.height == 0.05
    assert step.position == pytest.approx(1.31)


def test_a_passed_step_is_removed():
    tracking = tracker()
    tracking.update(seen(0.0, 0.5), 0.0)
    assert tracking.update(nothing(0.1), 0.49).face is None


def test_a_step_beyond_the_range_of_its_sensor_is_kept():
    """The sensor has a range of 1 m, which it does not report if it detects nothing."""
    tracking = tracker()
    for index, position in enumerate([*np.arange(0.0, 0.8, 0.01), *np.arange(0.8, -0.5, -0.01)]):
        distance, stamp = 1.5 - float(position), 0.02 * index
        profile = tracking.update(
            seen(stamp, distance) if distance < 1.0 else nothing(stamp), float(position))
    assert profile.face.number == 1
    for index in range(40):  # the step has been removed
        profile = tracking.update(nothing(6.0 + 0.02 * index), 0.7)
    assert profile.face is None


@pytest.mark.parametrize('second', [
    seen(0.1, distance=0.8), seen(0.1, height=0.06),
    StepObservation(0.1, False, height=0.03)])
def test_contradictions_are_reported_and_not_averaged_in(second):
    tracking = tracker()
    before = tracking.update(seen(0.0), 0.0).face
    track = tracking.update(second, 0.0)
    assert track.rejection is Reason.CONTRADICTORY and track.explanation
    assert track.face == before


def test_a_persistent_change_is_accepted_after_several_observations():
    tracking = tracker()
    tracking.update(seen(0.0, height=0.03), 0.0)
    answers = [tracking.update(seen(0.1 * index, height=0.06), 0.0) for index in range(1, 6)]
    assert [answer.rejection is None for answer in answers] == [False] * 4 + [True]
    assert answers[-1].face.height == 0.06 and answers[-1].face.number == 2


def test_a_step_that_slip_displaces_keeps_its_number():
    tracking = tracker()
    tracking.update(seen(0.0, 0.3), 0.0)
    for index in range(1, 6):
        track = tracking.update(seen(0.1 * index, 0.2), 0.0)
    assert track.rejection is None and track.face.number == 1
    assert track.face.position == pytest.approx(0.2)


def test_a_missed_step_is_kept_near_the_ball_and_removed_far_ahead():
    near, far = tracker(), tracker()
    near.update(seen(0.0, 0.3), 0.0)
    far.update(seen(0.0, 1.0), 0.0)
    for index in range(1, 20):
        assert near.update(nothing(0.1 * index), 0.0).face is not None
        assert (far.update(nothing(0.1 * index), 0.0).face is None) == (index >= 8)


@pytest.mark.parametrize('change', [
    {'distance': -0.1}, {'distance_sd': -0.1}, {'height_sd': -0.1}, {'distance': math.nan},
    {'height': math.inf}, {'stamp': math.nan}, {'distance_sd': 1e200}, {'height': 1e30}])
def test_impossible_observations_are_reported(change):
    tracking = tracker()
    before = tracking.update(seen(0.0), 0.0).face
    track = tracking.update(replace(seen(0.1), **change), 0.0)
    assert track.rejection is Reason.BAD_OBSERVATION and track.face == before


def test_odometry_that_is_not_finite_is_reported():
    assert tracker().update(seen(0.0), math.nan).rejection is Reason.BAD_OBSERVATION


def test_a_reset_removes_steps_and_does_not_reuse_numbers():
    tracking = tracker()
    tracking.update(seen(100.0), 0.0)
    tracking.reset()
    track = tracking.update(seen(0.0), 0.0)
    assert track.rejection is None and track.face.number == 2


@given(strategies.lists(strategies.tuples(
    anything, strategies.booleans(), anything, anything, anything, anything, anything),
    max_size=8))
def test_no_observation_raises_an_error_or_gives_an_invalid_step(rows):
    tracking = tracker()
    for *observation, position in rows:
        step = tracking.update(StepObservation(*observation), position).face
        if step is not None:
            assert math.isfinite(step.position) and math.isfinite(step.height)
            assert step.position_sd > 0.0 and step.height_sd > 0.0


def fused(first, second):
    """Return mean and deviation of two values, each with its deviation."""
    (one, one_sd), (other, other_sd) = first, second
    weights = one_sd**-2, other_sd**-2
    return ((one * weights[0] + other * weights[1]) / sum(weights), sum(weights)**-0.5)


def test_a_more_accurate_observation_has_more_weight():
    tracking = tracker()
    tracking.update(seen(0.0, 1.0, 0.030, 0.02, 0.002), 0.0)
    step = tracking.update(seen(0.1, 0.92, 0.033, 0.04, 0.001), 0.1).face
    assert (step.position, step.position_sd) == pytest.approx(fused((1.0, 0.02), (1.02, 0.04)))
    assert (step.height, step.height_sd) == pytest.approx(fused((0.03, 0.002), (0.033, 0.001)))
    assert step.number == 1


def test_a_missing_standard_deviation_is_treated_as_zero():
    assert tracker().update(StepObservation(0.0, True, 1.0, 0.03), 0.0).face \
        == tracker().update(seen(0.0, distance_sd=0.0, height_sd=0.0), 0.0).face


def test_no_number_of_observations_makes_a_step_exact():
    tracking = tracker()
    for index in range(5):
        reported = tracking.update(seen(0.1 * index, distance_sd=0.01, height_sd=1e-5), 0.0).face
        assert (reported.position_sd, reported.height_sd) == (0.01, 0.0005)


def test_unreported_noise_is_assumed_large_until_the_scatter_is_known():
    tracking = tracker()
    steps = [tracking.update(seen(0.1 * index, distance_sd=0.0, height_sd=0.0), 0.0).face
             for index in range(20)]
    assert (steps[0].position_sd, steps[0].height_sd) == (0.02, 0.005)
    assert steps[4].height_sd == pytest.approx(0.005 / math.sqrt(5))
    assert (steps[-1].position_sd, steps[-1].height_sd) == (0.01, 0.002)


@pytest.mark.parametrize('reported', [0.0, 0.0005])
def test_observations_with_more_scatter_than_reported_are_weighted_by_their_scatter(reported):
    random, errors = np.random.default_rng(1), []
    for _ in range(40):
        tracking = tracker()
        for index in range(30):
            step = tracking.update(seen(0.1 * index, height_sd=reported, height=float(
                random.normal(0.03, 0.004))), 0.0).face
        errors.append((step.height - 0.03) / step.height_sd)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.35


def test_the_uncertainty_of_a_step_that_grows_on_approach_covers_its_further_growth():
    tracking = tracker()
    for index in range(60):
        distance = 2.0 - 0.03 * index
        track = tracking.update(seen(
            0.1 * index, distance, 0.03 * (1.0 - 0.2 * distance), 0.01, 0.0005), 0.03 * index)
        assert track.rejection is None
        if index > 20:
            assert track.face.height + 2.0 * track.face.height_sd > 0.03
    assert track.face.height < 0.029


def test_clear_floor_is_observed_up_to_the_reported_range():
    assert tracker().update(StepObservation(0.0, False, 1.5), 0.2).seen_to == 1.7
    assert tracker().update(nothing(0.0), 0.2).seen_to == math.inf


def test_behind_a_detected_edge_only_the_granted_room_counts_as_observed():
    for room in (0.0, 1.5):
        granted = ProfileTracker(GIMBALL, DecisionTuning(unseen_room=room))
        assert granted.update(seen(0.0, 1.0), 0.2).seen_to == pytest.approx(1.2 + room)
        assert granted.update(nothing(0.1), 1.3).seen_to == math.inf
        assert granted.update(seen(0.2, 0.4), 1.3).seen_to == math.inf  # one outlier


def test_the_granted_room_is_that_of_the_present_tuning():
    knowledge = Knowledge(GIMBALL, load_curve('gimball_down'), DecisionTuning(unseen_room=1.5))
    decider = Decider(knowledge)
    decider.prepare(replace(knowledge, tuning=DecisionTuning()))()
    decider.observe(seen(0.0, 1.0))
    decider.move(Motion(0.0, 0.2, 0.0))
    decider.decide()
    assert decider.profile.seen_to == pytest.approx(1.2)


@pytest.mark.parametrize('name, deviation', [
    # Five combined standard deviations of both observations are allowed.
    ('distance', 5.0 * math.hypot(0.01, 0.02)), ('height', 5.0 * math.hypot(0.002, 0.004))])
def test_a_contradiction_exceeds_the_combined_deviation_of_both_observations(name, deviation):
    for sign in (1.0, -1.0):
        for more in (0.99, 1.01):
            tracking = tracker()
            first = seen(0.0, 1.0, 0.03)
            tracking.update(first, 0.0)
            second = replace(first, stamp=0.1, distance_sd=0.02, height_sd=0.004, **{
                name: getattr(first, name) + sign * more * deviation})
            assert (tracking.update(second, 0.0).rejection is not None) == (more > 1.0)


@pytest.mark.parametrize('second, numbers', [
    (seen(0.1, height=0.06), ['30', '60', '5']), (seen(0.1, height=2.0), ['30', '2000', '5']),
    (StepObservation(0.1, False, height=2.0), ['2000']),
    (seen(0.1, distance=0.8), ['200', '5']),
    (StepObservation(0.1, False, height=0.03), ['30']),
    (seen(0.1, distance=-0.1), ['0.1']), (seen(0.1, distance=2e6), ['2e+06'])])
def test_a_rejection_contains_the_numbers(second, numbers):
    tracking = tracker()
    tracking.update(seen(0.0), 0.0)
    explanation = tracking.update(second, 0.0).explanation
    assert re.findall(r'\d[\d.e+]*', explanation) == numbers


@pytest.mark.parametrize('name', ['distance', 'distance_sd', 'height_sd'])
def test_values_from_zero_to_a_million_metres_are_accepted(name):
    # Heights may be negative: a drop.
    for value in (0.0, 1e6):
        assert tracker().update(replace(seen(0.0), **{name: value}), 0.0).rejection is None
    for value in (-1e-9, 1e6 + 0.5):
        answer = tracker().update(replace(seen(0.0), **{name: value}), 0.0)
        assert answer.rejection is Reason.BAD_OBSERVATION and name in answer.explanation
    assert tracker().update(seen(0.0, height=-1e6), 0.0).rejection is None


def test_a_rejected_observation_does_not_make_an_earlier_one_late():
    tracking = tracker()
    tracking.update(seen(0.0), 0.0)
    assert tracking.update(seen(0.1, height=0.06), 0.0).rejection is Reason.CONTRADICTORY
    assert tracking.update(seen(0.0), 0.0).rejection is None, 'that of 0.1 s was rejected'


def test_a_consistent_observation_resets_the_count_of_contradictions():
    tracking = tracker()
    tracking.update(seen(0.0), 0.0)
    for index in range(1, 15):
        fine = index % 5 == 0
        answer = tracking.update(seen(0.1 * index, height=0.03 if fine else 0.06), 0.0)
        assert (answer.rejection is None) == fine


def test_a_detection_resets_the_count_of_misses():
    tracking = tracker()
    tracking.update(seen(0.0), 0.0)
    for index in range(1, 15):
        observe = seen if index % 5 == 0 else nothing
        assert tracking.update(observe(0.1 * index), 0.0).face is not None


def test_after_the_removal_of_a_step_the_count_of_misses_starts_at_zero():
    tracking = tracker()
    tracking.update(seen(0.0), 0.0)
    for index in range(1, 9):
        answer = tracking.update(nothing(0.1 * index), 0.0)
    assert answer.face is None
    assert tracking.update(nothing(0.9), 0.0).face is None
    assert tracking.update(seen(1.0), 0.0).face is None
    assert tracking.update(seen(1.1), 0.0).face.number == 2
    assert tracking.update(nothing(1.2), 0.0).face.number == 2


def test_a_step_in_a_single_observation_never_enters_the_profile():
    """The sensor reports a phantom in every fifth observation, each at another position."""
    tracking = tracker()
    tracking.update(nothing(0.0), 0.0)
    for index in range(1, 50):
        observation = nothing(0.1 * index) if index % 5 else seen(
            0.1 * index, 0.5 + 0.2 * index % 2.0, 0.01 + 0.03 * index % 0.1)
        assert tracking.update(observation, 0.0).face is None


@pytest.mark.parametrize('nearer, count', [(0.3, 3), (1.5, 2)])
def test_a_step_before_a_confirmed_one_requires_three_detections(nearer, count):
    """The sensor detects the next step: a nearer one contradicts its earlier detections."""
    tracking = tracker()
    for index in range(10):
        tracking.update(seen(0.02 * index, distance=1.0), 0.0)
    heights = [[face.height for face in tracking.update(
        seen(0.2 + 0.02 * index, distance=nearer, height=-0.1), 0.0).faces] for index in range(3)]
    assert [-0.1 in found for found in heights] == [index + 1 >= count for index in range(3)]


@pytest.mark.parametrize('height, moved, numbers', [
    (0.03, 1.9, [1]), (0.03, 2.0, [1, 2]),  # a radius away is another step
    (0.032, 1.9, [1]), (0.06, 1.9, [2])])   # and so is one of another height
def test_a_displaced_step_keeps_its_number_if_slip_explains_it(
        height, moved, numbers):
    tracking, radius = tracker(), GIMBALL.ball_radius
    tracking.update(seen(0.0, radius), 0.0)
    for index in range(1, 6):
        answer = tracking.update(seen(0.1 * index, moved * radius, height), 0.0)
    assert answer.rejection is None and [face.number for face in answer.faces] == numbers
    assert answer.faces[-1].position == moved * radius and answer.faces[-1].height == height


def test_a_drop_close_behind_an_edge_is_another_edge():
    tracking = tracker()
    for index in range(5):
        tracking.update(seen(0.1 * index, 0.3, 0.015), 0.0)
    for index in range(5, 15):  # the sensor looks over the nearer one
        answer = tracking.update(seen(0.1 * index, 0.33, -0.03), 0.0)
        assert answer.rejection is None and answer.face.number == 1
    assert [face.height for face in answer.faces] == pytest.approx([0.015, -0.03])


def test_an_observation_out_of_order_does_not_change_the_profile():
    fusion = GroundFusion(GIMBALL, DecisionTuning())
    for number in range(11):
        fusion.move(Motion(9.0 + 0.1 * number, 0.0, 0.0))
    fusion.observe(seen(10.0))
    fusion.fuse()
    before = fusion.profile
    for index in range(9):
        fusion.observe(nothing(9.0 + 0.1 * index))
        fusion.fuse()
        assert fusion.profile == before


@pytest.mark.parametrize('position, distance, number', [
    (0.47, 0.13, 1),     # not passed: it is observed once more
    (0.49, 0.10, 1),     # passed, and displaced by slip
    (0.49, 0.12, 2)])    # passed, and farther ahead than slip explains
def test_a_step_is_a_new_one_if_the_last_is_passed_and_slip_does_not_explain_it(
        position, distance, number):
    tracking = tracker()
    tracking.update(seen(0.0, 0.5, distance_sd=0.03), 0.0)
    for stamp in (0.1, 0.2):
        answer = tracking.update(seen(stamp, distance, distance_sd=0.03), position)
    assert answer.rejection is None and answer.face.number == number


@pytest.mark.parametrize('distance, kept', [(1.49, True), (1.51, False)])
def test_within_one_and_a_half_radii_a_step_is_kept_although_it_is_not_detected(distance, kept):
    tracking, radius = tracker(), GIMBALL.ball_radius
    tracking.update(seen(0.0, distance * radius), 0.0)
    for index in range(1, 12):
        answer = tracking.update(nothing(0.1 * index), 0.0)
    assert (answer.face is not None) == kept


@pytest.mark.parametrize('observation', [
    seen(0.5, 2.2, 0.14), StepObservation(0.5, False, 3.0), nothing(0.5), seen(0.5, 2.5, 0.1)])
def test_no_single_observation_makes_the_floor_behind_an_edge_known(observation):
    """The first observation is an outlier, which remains an edge behind the next one."""
    tracking = tracker()
    tracking.update(seen(0.0, 2.2, 0.14), 0.0)
    for index in range(1, 5):
        tracking.update(seen(0.1 * index, 0.5, -0.025), 0.0)
    track = tracking.update(observation, 0.0)
    assert track.seen_to == pytest.approx(0.5)
    assert [face.height for face in faces_ahead(track, 0.0)] == pytest.approx([-0.025])
