# SPDX-License-Identifier: Apache-2.0
"""Properties of the perception for any stream of observations in any order."""
from dataclasses import astuple, replace
import math

from hypothesis import given, settings, strategies as some
import numpy as np
import pytest

from ballbot_ros.decision import (
    DecisionTuning, Motion, ProfileTracker, Reason, StepObservation, TerrainObservation)
from ballbot_ros.decision.perception import GroundFusion
from ballbot_ros.physics import Terrain
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.plant import SensorFaults, TerrainSensor

GIMBALL, TUNING = load_robot('gimball'), DecisionTuning()
RADIUS = GIMBALL.ball_radius

anything = some.floats(allow_nan=True, allow_infinity=True)
lengths = some.floats(-4.0, 4.0) | some.sampled_from([-RADIUS, 0.0, math.nan, 1e300])
rows = some.lists(some.tuples(lengths, lengths, lengths), max_size=12)
polylines = some.builds(
    lambda stamp, rows, order, ends, frame: TerrainObservation(
        stamp, tuple(sorted(x for x, _, _ in rows) if order else (x for x, _, _ in rows)),
        tuple(z for _, z, _ in rows), tuple(abs(sd) for _, _, sd in rows) if order else (),
        *ends, frame),
    anything | some.floats(0.0, 9.0), rows, some.booleans(),
    some.just((-4.0, 4.0)) | some.tuples(anything, anything),
    some.sampled_from(['base_link', 'base_link', 'odom']))
steps = some.builds(StepObservation, anything | some.floats(0.0, 9.0), some.booleans(), anything,
                    anything, anything, anything)


def scan(terrain, x, stamp, number=0, height_sd=0.0, **faults):
    sight = TerrainSensor(terrain, 3.0, height_sd, 0, SensorFaults(**faults)).measure(
        x, float(terrain.height(x)) + RADIUS, number)
    return TerrainObservation(stamp, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max)


def check(profile):
    """Check the invariants of a profile."""
    assert (profile.rejection is None) == (not profile.explanation)
    for face in profile.faces:
        assert all(map(math.isfinite, astuple(face)))
        assert face.height_sd >= TUNING.height_bias_sd and face.position_sd >= 0.01
        assert face.run >= 0.0
    places = [face.position for face in profile.faces]
    assert places == sorted(places)
    x = [point[0] for point in profile.points]
    assert x == sorted(x) and all(math.isfinite(z) for _, z in profile.points)
    assert len(profile.points_sd) == len(profile.points)
    assert all(sd > 0.0 for sd in profile.points_sd)


@pytest.mark.slow
@settings(max_examples=150)
@given(some.lists(some.tuples(polylines | steps, anything | some.floats(-1.0, 1.0)), max_size=8))
def test_no_stream_raises_an_error_or_gives_a_number_that_is_not_finite(stream):
    tracking = ProfileTracker(GIMBALL, TUNING)
    for observation, position in stream:
        check(tracking.update(observation, position))


@settings(max_examples=40)
@given(some.lists(some.tuples(some.floats(-0.1, 0.4), some.floats(0.2, 2.5), some.booleans()),
                  min_size=1, max_size=8),
       some.floats(-0.1, 0.1), some.integers(0, 99))
def test_a_rejected_observation_does_not_change_the_profile(scenes, grade, seed):
    tracking, stamp, before = ProfileTracker(GIMBALL, TUNING), 0.0, None
    for height, place, reported in scenes:
        terrain = Terrain([(-9.0, -9.0 * grade), (place, place * grade),
                           (place, place * grade + height), (9.0, 9.0 * grade + height)]
                          if abs(height) > 0.001 else [(0.0, 0.0), (1.0, grade)])
        stamp += 0.1
        observation = scan(terrain, 0.0, stamp, seed, 0.001, reported_sd=float(reported))
        profile = tracking.update(observation, 0.0)
        check(profile)
        if profile.rejection is not None and before is not None:
            assert profile.faces == before.faces and profile.points == before.points
        before = profile


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(some.floats(0.015, 0.08), some.floats(0.9, 1.6), some.floats(0.0, 0.003),
       some.sampled_from([0.0, 1.0]), some.floats(0.0, 0.5), some.floats(-0.06, 0.06),
       some.integers(0, 99))
def test_noise_dropouts_and_slopes_leave_the_height_within_its_deviation(
        height, place, height_sd, reported, dropout, grade, seed):
    terrain = Terrain([(-9.0, -9.0 * grade), (place, place * grade),
                       (place, place * grade + height), (9.0, 9.0 * grade + height)])
    sensor = TerrainSensor(terrain, 3.0, height_sd, seed,
                           SensorFaults(reported_sd=reported, dropout=dropout,
                                        holes=0.5 * dropout))
    tracking, profile = ProfileTracker(GIMBALL, TUNING), None
    for number in range(40):
        x = 0.01 * number
        sight = sensor.measure(x, float(terrain.height(x)) + RADIUS / math.cos(math.atan(grade)),
                               number)
        if sight is not None:
            profile = tracking.update(TerrainObservation(
                0.02 * number, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max), x)
            assert profile.rejection is None
    face = profile.face
    assert abs(face.position - place) < 3.0 * face.position_sd
    assert abs(face.height - height) < 4.5 * face.height_sd


def fused(observations, motions, order):
    """Return the profile after observations and motions in a given order."""
    fusion = GroundFusion(GIMBALL, TUNING)
    for index in order:
        if index < len(observations):
            fusion.observe(observations[index])
        else:
            fusion.move(motions[index - len(observations)])
        fusion.fuse()
    return fusion.profile


def test_an_observation_is_fused_at_the_position_of_the_ball_at_its_stamp():
    terrain = Terrain.step(0.03, at=1.2)
    motions = [Motion(0.02 * index, 0.01 * index, 0.5) for index in range(40)]
    late = [scan(terrain, 0.005 * index, 0.01 * index) for index in (0, 5, 11, 20)]
    count = len(late)
    same = fused(late, motions, [*range(count), *range(count, count + 40)])
    afterwards = fused(late, motions, [*range(count, count + 40), *range(count)])
    assert same == afterwards
    assert same.face.position == pytest.approx(1.2, abs=0.01)


def test_latency_of_half_a_second_moves_no_face():
    terrain, fusion, places = Terrain.step(0.03, at=1.5), GroundFusion(GIMBALL, TUNING), []
    for index in range(120):
        stamp = 0.01 * index
        fusion.move(Motion(stamp, 0.8 * stamp, 0.8))
        if index >= 50:
            fusion.observe(scan(terrain, 0.8 * (stamp - 0.5), stamp - 0.5, index))
        fusion.fuse()
        if fusion.profile is not None:
            assert fusion.profile.rejection is None
            places.append(fusion.profile.face.position)
    assert np.ptp(places) < 0.01 and places[-1] == pytest.approx(1.5, abs=0.01)


@pytest.mark.parametrize('stamp, reason', [
    (99.0, Reason.BAD_OBSERVATION), (math.nan, Reason.BAD_OBSERVATION),
    (math.inf, Reason.BAD_OBSERVATION), (-99.0, Reason.STALE)])
def test_an_observation_of_another_clock_is_refused_and_blocks_no_other(stamp, reason):
    fusion = GroundFusion(GIMBALL, TUNING)
    good = StepObservation(0.0, True, 1.0, 0.03, 0.01, 0.001)
    fusion.observe(replace(good, stamp=stamp))
    fusion.move(Motion(0.0, 0.0, 0.0))
    fusion.fuse()
    assert fusion.profile.rejection is reason and fusion.profile.explanation
    fusion.observe(good)
    fusion.fuse()
    assert fusion.profile.rejection is None and fusion.profile.face.height == 0.03


@pytest.mark.parametrize('off', [5.0, -5.0])
def test_observations_of_another_clock_do_not_change_the_profile(off):
    fusion = GroundFusion(GIMBALL, TUNING)
    good = StepObservation(0.0, True, 1.0, 0.03, 0.01, 0.001)
    fusion.move(Motion(0.0, 0.0, 0.0))
    fusion.observe(good)
    fusion.fuse()
    profile = fusion.profile
    for number in range(10):
        fusion.observe(replace(good, stamp=off + 0.01 * number, height=0.1))
        fusion.fuse()
    assert fusion.profile == profile and profile.rejection is None


def test_a_second_observation_with_the_same_stamp_is_ignored():
    fusion = GroundFusion(GIMBALL, TUNING)
    fusion.move(Motion(0.0, 0.0, 0.0))
    for height in (0.03, 0.1):
        fusion.observe(StepObservation(0.0, True, 1.0, height, 0.01, 0.001))
        fusion.fuse()
    assert fusion.profile.rejection is None and fusion.profile.face.height == 0.03


def test_an_observation_waits_for_its_odometry():
    fusion = GroundFusion(GIMBALL, TUNING)
    fusion.observe(StepObservation(0.1, True, 1.0, 0.03, 0.01, 0.001))
    fusion.move(Motion(0.05, 0.0, 0.0))
    fusion.fuse()
    assert fusion.profile is None
    fusion.move(Motion(0.1, 0.2, 0.0))
    fusion.fuse()
    assert fusion.profile.face.position == 1.2


def test_the_uncertainty_of_the_map_grows_with_distance_and_time():
    fusion = GroundFusion(GIMBALL, TUNING)
    fusion.move(Motion(0.0, 0.0, 0.0))
    fusion.observe(StepObservation(0.0, True, 1.0, 0.03, 0.01, 0.001))
    fusion.fuse()
    now, then, rolled = (fusion.at(Motion(stamp, place, 0.0)).face for stamp, place in (
        (0.0, 0.0), (0.5, 0.0), (0.5, 0.4)))
    assert now == fusion.profile.face
    assert now.position_sd < then.position_sd < rolled.position_sd
    assert now.height_sd < then.height_sd == rolled.height_sd < 0.002
    assert (rolled.position, rolled.height) == (now.position, now.height)


def test_faces_that_the_ball_has_passed_since_the_observation_are_not_ahead():
    fusion = GroundFusion(GIMBALL, TUNING)
    fusion.move(Motion(0.0, 0.0, 0.0))
    fusion.observe(scan(Terrain([(-9, 0), (0.5, 0), (0.5, 0.03), (0.9, 0.03), (0.9, 0.06),
                                 (9, 0.06)]), 0.0, 0.0))
    fusion.fuse()
    fusion.move(Motion(0.3, 0.6, 0.0))
    assert len(fusion.profile.faces) == 2
    assert [face.number for face in fusion.at(Motion(0.3, 0.6, 0.0)).faces] == [2]


def both(step_height, step_sd, terrain_height=0.03):
    """Return the profile of a terrain sensor and a step sensor that observe one step."""
    tracking, terrain = ProfileTracker(GIMBALL, TUNING), Terrain.step(terrain_height, at=1.0)
    for index in range(10):
        tracking.update(scan(terrain, 0.0, 0.1 * index, index, 0.001), 0.0)
        profile = tracking.update(StepObservation(
            0.1 * index, True, 1.0, step_height, 0.01, step_sd), 0.0)
    return profile


def test_two_consistent_sensors_reduce_the_uncertainty_and_keep_the_polyline():
    profile = both(0.031, 0.001)
    assert profile.rejection is None and len(profile.faces) == 1 and len(profile.points) > 3
    assert 0.03 < profile.face.height < 0.031
    assert profile.face.height_sd < 0.0006


def test_of_two_contradictory_faces_the_higher_one_is_used():
    for step, terrain in ((0.06, 0.03), (0.03, 0.06)):
        face = both(step, 0.001, terrain).face
        assert face.height == pytest.approx(0.06, abs=0.001) and face.height_sd > 0.01


def test_a_step_that_only_the_step_sensor_detects_is_in_the_profile():
    tracking = ProfileTracker(GIMBALL, TUNING)
    tracking.update(scan(Terrain.flat(), 0.0, 0.0), 0.0)
    profile = tracking.update(StepObservation(0.0, True, 1.0, 0.04, 0.01, 0.001), 0.0)
    assert profile.face.height == 0.04 and profile.points


def test_the_rejection_of_a_sensor_without_messages_expires():
    tracking = ProfileTracker(GIMBALL, TUNING)
    tracking.update(StepObservation(0.0, True, math.nan, 0.04), 0.0)
    assert tracking.update(scan(Terrain.flat(), 0.0, 0.5), 0.0).rejection is not None
    assert tracking.update(scan(Terrain.flat(), 0.0, 1.5), 0.0).rejection is None


def test_the_map_follows_odometry_that_slips():
    terrain = Terrain([(-9, 0), (1.2, 0), (1.2, 0.03), (1.7, 0.03), (1.7, 0.05), (9, 0.05)])
    tracking, slip = ProfileTracker(GIMBALL, TUNING), 0.0
    for number in range(62):
        x, slip = 0.01 * min(number, 40), 0.01 * max(0, number - 40)
        profile = tracking.update(scan(terrain, x, 0.02 * number, number, 0.001), x + slip)
        assert profile.rejection is None
        if number > 5:
            assert [face.number for face in profile.faces] == [1, 2]
    assert profile.face.position - slip == pytest.approx(1.2, abs=0.05)
