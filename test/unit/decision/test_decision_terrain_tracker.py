# SPDX-License-Identifier: Apache-2.0
"""Profiles from polylines: faces, slopes, uncertainty, and refused observations."""
from dataclasses import replace
import math

import numpy as np
import pytest
from tiers import slow

from ballbot_ros.decision import (
    DecisionTuning, Face, Motion, ProfileTracker, Reason, TerrainObservation)
from ballbot_ros.decision.perception import GroundFusion
from ballbot_ros.decision.perception.elevation import CELL, ElevationMap, medians, resample, Scan
from ballbot_ros.decision.perception.ground import ground_of
from ballbot_ros.physics import Terrain
from ballbot_ros.physics.model.robot import load_robot
from ballbot_ros.plant import SensorFaults, TerrainSensor
from ballbot_ros.studies.evaluation.sensors import Camera, SensorModel

GIMBALL = load_robot('gimball')
RADIUS = GIMBALL.ball_radius


def tracker():
    return ProfileTracker(GIMBALL, DecisionTuning())


def ground(*pieces):
    """Return level floor to x = 1.2 m, pieces of run and rise, and level floor again."""
    vertices = [(-2.0, 0.0), (1.2, 0.0)]
    for run, rise in (*pieces, (4.0, 0.0)):
        vertices.append((vertices[-1][0] + run, vertices[-1][1] + rise))
    return Terrain(vertices)


def approach(terrain, count=40, to=0.8, height_sd=0.0, seed=0, tracking=None, **faults):
    """Return the profiles of an approach from x = 0 with 20 observations per second."""
    sensor = TerrainSensor(terrain, 3.0, height_sd, seed, SensorFaults(**faults))
    tracking, profiles = tracking or tracker(), []
    for number, x in enumerate(np.linspace(0.0, to, count)):
        sight = sensor.measure(x, float(terrain.height(x)) + RADIUS, number)
        if sight is not None:
            profiles.append(tracking.update(TerrainObservation(
                0.05 * number, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max), x))
    return profiles


def exact(terrain, at=0.0, stamp=0.0, **change):
    """Return the observation of all vertices of a terrain between -0.3 and 3 m."""
    places = np.unique(np.concatenate([[-0.3, 3.0], terrain.vertices[:, 0] - at]))
    places = np.repeat(places[(places >= -0.3) & (places <= 3.0)], 2)
    left = np.interp(places + at - 1e-9, *terrain.vertices.T)
    right = np.interp(places + at + 1e-9, *terrain.vertices.T)
    heights = np.where(np.arange(len(places)) % 2, right, left) - terrain.height(at) - RADIUS
    return replace(TerrainObservation(
        stamp, tuple(places.tolist()), tuple(heights.tolist()), (), -0.3, 3.0), **change)


NEAR_WALL = Terrain([(-2.0, 0.0), (0.5, 0.0), (0.5, 0.6), (4.0, 0.6)])

SCENES = {
    'rise': (ground((0.0, 0.03)), [(1.2, 0.03)]),
    'drop': (ground((0.0, -0.1)), [(1.2, -0.1)]),
    'threshold': (ground((0.0, 0.02), (0.08, 0.0), (0.0, -0.02)), [(1.2, 0.02), (1.28, -0.02)]),
    'cord': (ground((0.0, 0.02), (0.02, 0.0), (0.0, -0.02)), [(1.2, 0.02), (1.22, -0.02)]),
    'carpet': (ground((0.005, 0.006)), [(1.2, 0.006)]),
    'bevel': (ground((0.04, 0.03)), [(1.2, 0.03)]),
    'two': (ground((0.0, 0.03), (0.3, 0.0), (0.0, -0.1)), [(1.2, 0.03), (1.5, -0.1)]),
    'wall behind': (ground((0.0, 0.03), (0.4, 0.0), (0.0, 0.5)), [(1.2, 0.03), (1.6, 0.5)]),
    'ramp': (ground((0.5, 0.07)), []),
    'flat': (Terrain.flat(), []),
    'slope': (Terrain.slope(-0.06), []),
}


@pytest.mark.parametrize('name', SCENES)
@pytest.mark.parametrize('height_sd', [0.0, 0.001])
def test_the_faces_of_a_terrain_and_no_others_are_found(name, height_sd):
    terrain, expected = SCENES[name]
    profile = approach(terrain, height_sd=height_sd)[-1]
    assert profile.rejection is None
    found = [(face.position, face.height) for face in profile.faces]
    assert len(found) == len(expected)
    for (place, height), (true_place, true_height) in zip(found, expected):
        assert place == pytest.approx(true_place, abs=0.015)
        assert height == pytest.approx(true_height, abs=0.003 if abs(true_height) < 0.2 else 0.01)


@pytest.mark.parametrize('seed', [0, *slow(1, 2, 3)])
def test_a_face_slightly_above_the_noise_stays_once_it_is_detected(seed):
    profiles = approach(ground((0.0, 0.008)), count=120, height_sd=0.003, seed=seed)
    faces = [[face.number for face in profile.faces if abs(face.position - 1.2) < 0.05]
             for profile in profiles]
    first = next(index for index, numbers in enumerate(faces) if numbers)
    assert first < 30
    assert all(numbers == faces[first] for numbers in faces[first:])


DESCENT = Terrain([(-2.0, 0.1), (4.0, -0.2)])


@pytest.mark.parametrize('terrain, position, run', [
    (DESCENT, 2.7, 0.25),  # the ground behind it is too short for a slope
    (DESCENT, 2.0, 0.25),
    (ground((0.3, -0.012)), 1.2, 0.3)])
def test_a_known_face_remains_only_if_it_is_steeper_than_the_ground_beside_it(
        terrain, position, run):
    """An outlier at the end of the observed ground has started it."""
    found, seen = ElevationMap(DecisionTuning()), exact(terrain)
    x, z = np.array(seen.x), np.array(seen.z)
    found.add(resample(x, z, np.zeros(len(x)), np.ones(len(x), bool), 0.0), 0.0)
    known = Face(1, position, -0.012, 0.01, 0.001, run)
    assert ground_of(found, 0.0, 0.0, RADIUS, [known]).faces == ()


@pytest.mark.parametrize('seed', [0, *slow(1, 2, 3)])
def test_unreported_noise_is_averaged(seed):
    terrain = ground((0.0, 0.011), (0.15, 0.0), (0.0, 0.009))
    last = approach(terrain, 80, 0.8, 0.0034, seed, reported_sd=0.0)[-1]
    assert [face.position for face in last.faces] == pytest.approx([1.2, 1.35], abs=0.03)
    assert [face.height for face in last.faces] == pytest.approx([0.011, 0.009], abs=0.003)


def watch(terrain, to, seed=0, **camera):
    """Return the profiles of 50 camera observations on an approach from x = 0."""
    model, tracking, profiles = SensorModel('camera', **camera), tracker(), []
    for number, x in enumerate(np.linspace(0.0, to, 50)):
        ahead, up, deviation = (tuple(values.tolist()) for values in Camera(
            terrain, model, seed).sample(x, RADIUS, number))
        profiles.append(tracking.update(TerrainObservation(
            0.02 * number, ahead, up, deviation, ahead[0], ahead[-1]), x))
    return profiles


def test_a_cord_of_few_points_is_not_rejected_as_outliers():
    terrain = Terrain([(-2.0, 0.0), (0.598, 0.0), (0.598, 0.01), (0.606, 0.01), (0.606, 0.0),
                       (6.0, 0.0)])
    for profile in watch(terrain, to=0.1, eye_height=0.34, lowest_ray=math.radians(65.0),
                         rays=170)[11:]:
        assert [face.height for face in profile.faces] == pytest.approx([0.01, -0.01], abs=0.003)


@pytest.mark.parametrize('seed', [0, 1, *slow(9, 11)])
def test_noise_that_is_largest_near_the_ball_makes_no_faces(seed):
    profiles = watch(Terrain.flat(), 0.4, seed, eye_height=0.17, lowest_ray=math.radians(64.0),
                     rays=273, height_sd=0.0032, faults=SensorFaults(reported_sd=0.0))
    assert not any(profile.faces for profile in profiles)


@pytest.mark.parametrize('seed', [2, 5, 8, *slow(3, 11)])
def test_the_short_ground_before_a_wall_is_averaged_and_has_no_faces(seed):
    """A scan has 20 nodes, and most of its points are on the wall."""
    profiles = watch(NEAR_WALL, 0.15, seed, eye_height=0.15, lowest_ray=math.radians(63.0),
                     rays=324, height_sd=0.0027, faults=SensorFaults(reported_sd=0.5))
    assert all(abs(face.position - 0.5) < 0.06 for profile in profiles for face in profile.faces)


@pytest.mark.parametrize('seed', [5, 6])
def test_a_single_node_before_a_gap_raises_no_error(seed):
    profiles = watch(NEAR_WALL, 0.15, seed, eye_height=0.38, lowest_ray=math.radians(60.0),
                     rays=489, height_sd=0.0028)
    assert all(profile.rejection is None for profile in profiles)


def test_a_vertical_face_with_many_points_is_not_a_slope():
    terrain = Terrain([(-2.0, 0.0), (1.931, 0.0), (1.931, 0.117), (8.0, 0.117)])
    profiles = watch(terrain, to=0.3, eye_height=0.057663845, lowest_ray=1.461123959, rays=223,
                     faults=SensorFaults(holes=0.24830778, tilt=-0.00061338841))
    assert all(profile.rejection is None for profile in profiles)
    assert max(face.height_sd for profile in profiles for face in profile.faces) < 0.06


@pytest.mark.parametrize('gap, seen_to', [(0.07, 3.0), (0.12, 1.2)])
def test_ground_between_points_is_observed_if_the_ball_rolls_over_the_gap(gap, seen_to):
    x = np.concatenate([np.arange(-0.3, 1.2001, 0.01), np.append(
        np.arange(1.2 + gap, 2.99, gap), 3.0)])
    profile = tracker().update(TerrainObservation(
        0.0, tuple(x.tolist()), (-RADIUS,) * len(x), (), -0.3, 3.0), 0.0)
    assert profile.seen_to == pytest.approx(seen_to, abs=0.011)


def test_a_face_that_has_disappeared_is_removed():
    tracking = tracker()
    approach(ground((0.0, 0.01)), count=40, to=0.1, tracking=tracking)
    gone = approach(ground((1.0, 0.0)), count=160, to=0.1, tracking=tracking)
    assert not gone[-1].faces


@pytest.mark.parametrize('growth', [*slow(0.05), 0.15])
def test_far_heights_that_are_too_small_do_not_level_a_slope(growth):
    slopes = [profile.slope for profile in approach(
        Terrain.slope(-0.04), count=300, to=2.5, growth=growth)]
    # Without an absolute reference the error would grow with the distance.
    assert -0.041 < min(slopes) and max(slopes) < -0.04 * (1.0 - growth)


@pytest.mark.parametrize('seed', [0, *slow(1, 2)])
def test_a_stretch_that_is_too_steep_stays_once_it_is_detected(seed):
    fusion = GroundFusion(GIMBALL, DecisionTuning())
    fusion.follow(DecisionTuning(), 0.075)
    sensor = TerrainSensor(ground((0.5, -0.0393)), 3.0, 0.003, seed)  # 0.0785 rad
    known = []
    for number, x in enumerate(np.linspace(0.0, 0.9, 150)):
        sight = sensor.measure(x, RADIUS, number)
        fusion.move(Motion(0.02 * number, x, 0.3))
        fusion.observe(TerrainObservation(
            0.02 * number, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max))
        fusion.fuse()
        known.append(len(fusion.profile.steep))
    first = known.index(1)
    assert first < 75 and set(known[first:]) == {1}


@pytest.mark.parametrize('name', ['rise', 'threshold', 'carpet', 'bevel', 'ramp', 'slope'])
def test_observations_without_noise_reproduce_the_ground_to_a_millimetre(name):
    terrain, _ = SCENES[name]
    profile = approach(terrain)[-1]
    x, z = np.array(profile.points).T
    places = np.linspace(0.6, 3.0, 500)
    # Positions of faces are less accurate than a millimetre.
    near = [np.abs(places - corner) < 0.04 for corner, _ in terrain.vertices]
    places = places[~np.any(near, axis=0)]
    assert np.interp(places, x, z) == pytest.approx(
        terrain.height(places) - terrain.height(0.8), abs=0.001)
    assert len(x) < 12


def test_ramps_and_slopes_change_the_polyline_and_are_not_faces():
    profile = approach(SCENES['ramp'][0], height_sd=0.001)[-1]
    x, z = np.array(profile.points).T
    grade = (np.interp(1.6, x, z) - np.interp(1.3, x, z)) / 0.3
    assert not profile.faces and grade == pytest.approx(0.14, abs=0.01)
    slope = approach(Terrain.slope(-0.06), height_sd=0.001)[-1]
    assert slope.slope == pytest.approx(-0.06, abs=3.0 * slope.slope_sd)
    assert slope.slope_sd < 0.006


@pytest.mark.parametrize('place', [-0.08, -0.02, 0.02, 0.08])
@pytest.mark.parametrize('height', [0.03, -0.02])
def test_a_face_near_the_ball_is_not_a_slope_below_it(height, place):
    at = 1.2 + place
    profile = tracker().update(exact(ground((0.0, height)), at=at), at)
    assert abs(profile.slope) < 0.01


def test_a_bevel_has_a_run_and_a_vertical_face_none():
    bevel, rise = (approach(SCENES[name][0])[-1].face for name in ('bevel', 'rise'))
    assert bevel.run == pytest.approx(0.04, abs=0.01) and rise.run == 0.0


def test_occluded_ground_is_as_low_as_the_next_observed_ground():
    profile = approach(SCENES['drop'][0])[-1]
    hidden = np.linspace(1.22, 1.2 + 0.1 / RADIUS * 0.4, 5)
    assert np.interp(hidden, *zip(*profile.points)) == pytest.approx(-0.1, abs=0.01)
    # The observation before the last one, 0.02 m earlier, contains all of it.
    assert profile.seen_to == pytest.approx(3.78, abs=0.03)


def test_the_observed_terrain_ends_at_a_trench_with_a_hidden_floor():
    for width, depth, ends in ((0.35, 0.3, True), (0.03, 0.3, False)):
        terrain = ground((0.0, -depth), (width, 0.0), (0.0, depth))
        profile = approach(terrain, to=0.0, count=10)[-1]
        assert not profile.faces
        assert (profile.seen_to < 1.25) == ends
    # A trench observed deeper than a ball can sink into it is a pair of faces.
    profiles = approach(ground((0.0, -0.05), (0.15, 0.0), (0.0, 0.05)), to=0.9)
    assert [face.height for face in profiles[-1].faces] == pytest.approx([-0.05, 0.05], abs=0.005)
    assert profiles[-1].seen_to > 2.0
    assert all(profile.faces for profile in profiles if profile.seen_to > 1.3)


@pytest.mark.parametrize('width', [0.02, 0.04, 0.06])
@pytest.mark.parametrize('depth', [0.02, 0.15])
def test_a_groove_that_the_ball_spans_is_neither_faces_nor_a_slope(width, depth):
    sensor = TerrainSensor(ground((0.0, -depth), (width, 0.0), (0.0, depth)), 3.0, 0.0005)
    tracking = tracker()
    tracking.follow(DecisionTuning(), 0.075)
    for number, x in enumerate(np.linspace(0.6, 1.4, 60)):
        sight = sensor.measure(x, RADIUS, number)
        profile = tracking.update(TerrainObservation(
            0.05 * number, sight.x, sight.z, sight.z_sd, sight.x_min, sight.x_max), x)
        assert profile.rejection is None and profile.seen_to > 3.0
        assert not profile.faces and not profile.steep
        assert profile.slope == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize('seed', [0, *slow(1, 2, 3)])
def test_the_height_of_a_step_down_on_a_descent_does_not_depend_on_the_distance(seed):
    slope = -0.0664
    terrain = Terrain([(-2.0, -2.0 * slope), (1.8, 1.8 * slope), (1.8, 1.8 * slope - 0.043),
                       (6.0, 6.0 * slope - 0.043)])
    profiles = approach(terrain, to=1.5, count=75, height_sd=0.001, seed=seed)
    for profile in profiles[5:]:
        assert len(profile.faces) == 1
        assert profile.face.height == pytest.approx(-0.043, abs=0.006)


def test_the_observed_terrain_ends_at_a_wall():
    assert approach(SCENES['wall behind'][0])[-1].seen_to == pytest.approx(1.6, abs=0.02)


def test_faces_keep_their_numbers_and_a_passed_one_is_no_longer_ahead():
    tracking = tracker()
    numbers = [[face.number for face in profile.faces] for profile in approach(
        SCENES['two'][0], 80, 1.3, 0.001, tracking=tracking)]
    assert numbers[10] == [1, 2] and numbers[-1] == [2]
    assert {tuple(row) for row in numbers[10:]} == {(1, 2), (2,)}


@pytest.mark.slow
@pytest.mark.parametrize('count', [2, 8, 30])
@pytest.mark.parametrize('height_sd', [0.001, 0.003])
def test_errors_of_height_are_as_large_as_reported(count, height_sd):
    errors = []
    for seed in range(30):
        face = approach(SCENES['rise'][0], count, 0.01 * count, height_sd, seed)[-1].face
        if face is not None:
            errors.append((face.height - 0.03) / face.height_sd)
    squares = float(np.sum(np.square(errors)))
    # The chi-square bound of 99.9 % for 30; the minimum deviation reduces the sum.
    assert len(errors) >= 28 and squares < 59.7
    assert squares > 0.02 * len(errors)


@pytest.mark.parametrize('reported, floor', [(1.0, 0.0005), (0.0, 0.002)])
def test_no_number_of_observations_makes_a_height_exact(reported, floor):
    face = approach(SCENES['rise'][0], 60, 0.3, 0.0005, reported_sd=reported)[-1].face
    assert face.height_sd == floor


def test_unreported_noise_is_assumed_large_until_it_is_estimated():
    profiles = approach(SCENES['rise'][0], 40, 0.4, 0.003, reported_sd=0.0)
    assert all(profile.face is None or profile.face.height_sd > 0.0025 for profile in profiles[:4])
    assert abs(profiles[-1].face.height - 0.03) < 3.0 * profiles[-1].face.height_sd


def test_the_uncertainty_of_a_step_that_grows_on_approach_covers_its_further_growth():
    steady, growing = (approach(SCENES['rise'][0], 40, 0.6, 0.0005, growth=growth)[-1].face
                       for growth in (0.0, 0.2))
    assert growing.height < 0.027
    assert growing.height + 2.0 * growing.height_sd > 0.03
    assert steady.height_sd == 0.0005


@pytest.mark.parametrize('change, words', [
    ({'frame': 'camera'}, "frame 'camera'"),
    ({'z': (1.0,)}, '1 z'),
    ({'z_sd': (0.1,)}, '1 standard deviations'),
    ({'x': (), 'z': (), 'z_sd': ()}, '0 points'),
    ({'x': (0.0,) * 6000, 'z': (0.0,) * 6000, 'z_sd': ()}, '6000 points'),
    ({'x': (0.0, 0.0), 'z': (0.0, 0.1)}, 'the same x'),
    ({'x': (0.0, math.nan), 'z': (0.0, 0.1)}, 'not finite'),
    ({'x': (0.0, 1.0), 'z': (0.0, math.inf)}, 'not finite'),
    ({'x': (0.0, 1.0), 'z': (0.0, -2e6)}, 'out of range'),
    ({'x': (0.0, 1.0), 'z': (-0.226, -0.226), 'z_sd': (-0.1, 0.0)}, 'negative'),
    ({'x': (0.0, 1.0, 0.5), 'z': (-0.226,) * 3}, 'x decreases from 1 to 0.5 m at point 2'),
    ({'x_min': math.nan}, 'not finite'),
    ({'x_max': -1.0}, 'x_max -1'),
    ({'x': (-3.0, 0.3), 'z': (-0.226,) * 2, 'x_min': -3.0}, 'backwards'),
    ({'x': (-0.3, 3.0), 'z': (0.226,) * 2}, 'upside down'),
    ({'x': (-0.3, 3.0), 'z': (-0.26,) * 2}, '34 mm from the ball'),
    ({'x': (-0.3, 3.0), 'z': (-0.19,) * 2}, '-36 mm from the ball'),
    ({'x': (8.0, 9.0), 'z': (-0.226,) * 2, 'x_max': 9.0}, 'not show the ground'),
    ({'stamp': math.nan}, 'not finite')])
def test_impossible_observations_are_refused_with_an_explanation(change, words):
    profile = tracker().update(exact(Terrain.flat(), **change), 0.0)
    assert profile.rejection is Reason.BAD_OBSERVATION and words in profile.explanation


def test_a_small_bias_of_the_sensor_does_not_displace_the_floor():
    for bias in (-0.029, 0.029):
        profile = tracker().update(exact(Terrain.flat(), z=(-RADIUS + bias,) * 8, x=tuple(
            np.linspace(-0.3, 3.0, 8).tolist())), 0.0)
        assert profile.rejection is None
        assert profile.points[0][1] == pytest.approx(0.0, abs=1e-9)


def test_changed_ground_is_a_contradiction_and_is_accepted_if_it_persists():
    tracking = tracker()
    for index in range(5):
        before = tracking.update(exact(Terrain.step(0.06, at=1.0), stamp=0.1 * index), 0.0)
    answers = [tracking.update(exact(Terrain.step(0.02, at=1.0), stamp=1.0 + 0.1 * index), 0.0)
               for index in range(5)]
    assert [answer.rejection for answer in answers] == [Reason.CONTRADICTORY] * 4 + [None]
    assert [answer.face for answer in answers[:4]] == [before.face] * 4
    assert answers[-1].face.height == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize('place', [1.2, 1.203, 1.207, 1.2099])
def test_a_wall_at_the_end_of_the_view_is_found_at_any_position(place):
    terrain = Terrain([(-9.0, 0.0), (place, 0.0), (place, 0.5), (9.0, 0.5)])
    face = approach(terrain, 5, 0.05)[-1].face
    assert face.height > 0.3 and face.height + 4.0 * face.height_sd > 0.5
    assert face.position == pytest.approx(place, abs=0.015)


def test_walls_on_both_sides_of_the_ball_are_not_taken_for_a_reversed_sensor():
    walls = Terrain([(-9.0, 0.5), (-0.5, 0.5), (-0.5, 0.0), (0.27, 0.0), (0.27, 0.5), (9.0, 0.5)])
    profile = approach(walls, 3, 0.01)[-1]
    assert profile.rejection is None and profile.face.height > 0.3


@pytest.mark.slow
def test_long_observation_of_a_rough_floor_does_not_add_faces():
    terrain, tracking = SCENES['rise'][0], tracker()
    sight = TerrainSensor(terrain, 3.0, 0.001).measure(0.0, RADIUS, 0)
    for index in range(400):
        profile = tracking.update(TerrainObservation(
            0.02 * index, sight.x, sight.z, (), sight.x_min, sight.x_max), 0.0)
    assert [round(face.height, 2) for face in profile.faces] == [0.03]


@pytest.mark.parametrize('count', [1, 3, 4, 5, 30])
def test_medians_are_those_of_seven_neighbours_with_the_ends_reflected(count):
    values = np.random.default_rng(count).normal(size=count)
    near = np.lib.stride_tricks.sliding_window_view(
        np.pad(values, 3, 'reflect' if count > 3 else 'edge'), 7)
    middles = np.median(near, axis=1)
    spread = np.median(np.abs(near - middles[:, None]), axis=1)
    assert np.array_equal(medians(values), [middles, spread])


def scan_of(height, steep=0.0):
    """Return a level scan with one node at a height [m], known to `steep` [m]."""
    z, steeps, none = np.zeros(100), np.zeros(100), np.zeros(100)
    z[60], steeps[60] = height, steep
    return Scan(0, z, steeps, np.ones(100), none, none, CELL)


@pytest.mark.parametrize('between', [0, 1, 5])
def test_a_node_of_the_map_becomes_known_when_two_consecutive_scans_agree(between):
    """Outliers in occluded ground agree by chance, too, but seldom in consecutive scans."""
    found, position = ElevationMap(DecisionTuning()), 0.5
    for node in (math.nan, 0.05, *[math.nan] * between, 0.05):
        assert found.add(scan_of(node), position) == ''
    assert found.known[60 - found.first] == (between == 0)
    assert found.known[59 - found.first]


@pytest.mark.parametrize('heights, known', [
    (((-0.06, 0.012), (-0.02, 0.0)), False),  # such as an outlier behind an edge
    (((-0.02, 0.0), (-0.06, 0.012)), False),
    (((-0.06, 0.012), (-0.02, 0.0), (-0.02, 0.0)), True),
    (((-0.06, 0.012), (-0.02, 0.012)), True),
    (((-0.02, 0.012), (-0.02, 0.0)), True),
])
def test_a_vague_height_does_not_confirm_a_precise_one_far_from_it(heights, known):
    found, position = ElevationMap(DecisionTuning()), 0.5
    found.add(scan_of(math.nan), position)
    for height, steep in heights:
        assert found.add(scan_of(height, steep), position) == ''
    assert found.known[60 - found.first] == known
