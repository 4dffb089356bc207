# SPDX-License-Identifier: Apache-2.0
"""Observations are checked against odometry; single wrong observations are ignored."""
import numpy as np
import pytest

from ballbot_ros.decision import (
    DecisionTuning, Face, Motion, Profile, Reason, StepObservation, TerrainObservation)
from ballbot_ros.decision.perception import GroundFusion
from ballbot_ros.decision.perception.edge_map import EdgeEstimate, EdgeMap
from ballbot_ros.decision.perception.ground_profile import GroundProfile, steep_stretches
from ballbot_ros.physics.model.robot import load_robot

GIMBALL, TUNING = load_robot('gimball'), DecisionTuning()
RADIUS = GIMBALL.ball_radius
SPEED, PERIOD = 0.4, 0.02


def terrain(stamp, position, x, face=1.5, height=0.03, slope=0.0, noise=0.0, seed=0):
    """Return a camera observation of a step on a slope, at positions x relative to the ball."""
    place = np.asarray(x) + position
    z = slope * np.asarray(x) + np.where(place > face, height, 0.0) - RADIUS
    z += noise * np.random.default_rng(seed).standard_normal(len(z))
    return TerrainObservation(stamp, tuple(x), tuple(z.tolist()), (), x[0], x[-1])


def step(stamp, position, face=1.5, height=0.03):
    """Return an observation of a step sensor."""
    return StepObservation(stamp, True, face - position, height, 0.005, 0.001)


def drive(fusion, make, count, start=0, speed=SPEED):
    """Fuse the motion and observations of each period, and return the last profile."""
    for number in range(start, start + count):
        stamp = PERIOD * number
        fusion.move(Motion(stamp, speed * stamp, speed))
        for observation in make(stamp, speed * stamp):
            fusion.observe(observation)
        fusion.fuse()
    return fusion.profile


EVEN = tuple(np.linspace(-0.3, 2.5, 190).tolist())
# Rays at equal angles from 0.3 m above the floor: the spacing grows from 4 to 250 mm.
ANGLES = tuple(np.tan(np.linspace(-0.7, 1.45, 160)) * 0.3)


@pytest.mark.parametrize('make', [
    lambda stamp, position: [step(stamp, position)],
    lambda stamp, position: [terrain(stamp, position, EVEN)]])
def test_a_frozen_sensor_is_rejected_though_its_stamps_advance(make):
    fusion = GroundFusion(GIMBALL, TUNING)
    before = drive(fusion, make, 50)
    assert before.rejection is None

    def frozen(stamp, position):
        return [type(item)(stamp, *list(vars(item).values())[1:]) for item in make(0.98, 0.392)]
    profile = drive(fusion, frozen, 20, 50)
    assert profile.rejection is Reason.BAD_OBSERVATION and 'frozen' in profile.explanation
    # The face does not move along with the repeated data.
    assert profile.faces[0].position == pytest.approx(before.faces[0].position, abs=1e-3)
    assert drive(fusion, make, 10, 70).rejection is None


def test_a_frozen_sensor_with_noise_is_rejected_before_its_step_has_moved_far():
    fusion = GroundFusion(GIMBALL, TUNING)
    drive(fusion, lambda stamp, position: [terrain(stamp, position, EVEN, noise=0.001)], 50)
    profile = drive(fusion, lambda stamp, position: [terrain(
        stamp, 0.4, EVEN, noise=0.001, seed=round(1e3 * stamp))], 150, 50)
    assert profile.rejection is Reason.CONTRADICTORY
    assert profile.faces[0].position < 1.9


@pytest.mark.parametrize('kind', ['step', 'terrain'])
def test_a_sensor_at_rest_may_repeat_its_observation(kind):
    def make(stamp, position):
        return [step(stamp, position) if kind == 'step' else terrain(stamp, position, EVEN)]
    assert drive(GroundFusion(GIMBALL, TUNING), make, 100, speed=0.0).rejection is None


def test_single_wrong_observations_are_ignored_and_consecutive_ones_are_reported():
    fusion = GroundFusion(GIMBALL, TUNING)
    drive(fusion, lambda stamp, position: [step(stamp, position)], 20)
    wrong = StepObservation(0.4, True, -1.0, 0.03)
    for number, rejected in enumerate((False, False, True, True)):
        profile = drive(fusion, lambda stamp, position: [
            StepObservation(stamp, True, wrong.distance, 0.03)], 1, 20 + number)
        assert (profile.rejection is not None) == rejected
        assert profile.stamp == pytest.approx(0.38)  # of the last valid one
    assert drive(fusion, lambda stamp, position: [step(stamp, position)], 1, 24).rejection is None


def test_an_observation_out_of_order_is_ignored():
    fusion = GroundFusion(GIMBALL, TUNING)
    drive(fusion, lambda stamp, position: [step(stamp, position)], 20)
    late = step(0.30, 0.12)
    profile = drive(fusion, lambda stamp, position: [step(stamp, position), late], 20, 20)
    assert profile.rejection is None and profile.faces[0].number == 1


@pytest.mark.parametrize('slope', [-0.05, 0.0, 0.05])
@pytest.mark.parametrize('noise', [0.0, 0.001])
def test_a_camera_with_rays_at_equal_angles_shows_steps_far_ahead(slope, noise):
    """The normal spacing at a distance is not a gap, and a descent occludes nothing."""
    fusion = GroundFusion(GIMBALL, TUNING)
    profile = drive(fusion, lambda stamp, position: [terrain(
        stamp, position, ANGLES, 2.2, 0.03, slope, noise, round(1e3 * stamp))], 100)
    assert profile.rejection is None and profile.seen_to > 0.8 + 1.4
    face, = profile.faces
    assert face.position == pytest.approx(2.2, abs=0.1)
    assert face.height == pytest.approx(0.03, abs=max(0.004, 3.0 * face.height_sd))


def test_single_outliers_make_no_faces_and_a_persistent_face_is_found():
    random = np.random.default_rng(0)

    def make(stamp, position):
        one = terrain(stamp, position, EVEN, 1.5, 0.03, noise=0.001, seed=round(1e3 * stamp))
        z = np.array(one.z)
        wrong = random.random(len(z)) < 0.1
        z[wrong] += random.uniform(-0.2, 0.2, wrong.sum())
        return [TerrainObservation(stamp, one.x, tuple(z.tolist()), (), one.x_min, one.x_max)]
    fusion = GroundFusion(GIMBALL, TUNING)
    phantoms = 0
    for number in range(150):
        profile = drive(fusion, make, 1, number)
        assert profile.rejection is None
        assert number < 10 or 1 in [face.number for face in profile.faces]
        phantoms += len(profile.faces) > 1
    assert phantoms == 0 and len(profile.faces) == 1
    assert profile.faces[0].height == pytest.approx(0.03, abs=0.002)


@pytest.mark.parametrize('high', [-0.15, -0.08, 0.045, 0.1])
def test_an_outlier_in_occluded_ground_makes_no_face(high):
    """The edge occludes the ground in later scans, so that none corrects the outlier."""
    def make(stamp, position):
        x = np.array(EVEN)
        place = x + position
        z = np.where(place > 1.5, -0.04, 0.0) - RADIUS
        z += 0.001 * np.random.default_rng(round(1e3 * stamp)).standard_normal(len(z))
        kept = (place < 1.5) | (place > 1.6)
        if stamp == 30 * PERIOD:
            wrong = int(np.argmin(np.abs(place - 1.55)))
            z[wrong], kept[wrong] = high - RADIUS, True
        x, z = tuple(x[kept].tolist()), tuple(z[kept].tolist())
        return [TerrainObservation(stamp, x, z, (), x[0], x[-1])]
    fusion = GroundFusion(GIMBALL, TUNING)
    drive(fusion, make, 10)
    for number in range(10, 100):
        profile = drive(fusion, make, 1, number)
        drop, = profile.faces
        assert profile.rejection is None and drop.position == pytest.approx(1.5, abs=0.02)
        assert drop.height == pytest.approx(-0.04, abs=0.005)


@pytest.mark.parametrize('wall', [0, 2000])
@pytest.mark.parametrize('largest', [0.03, 0.3])
def test_outliers_of_one_point_in_thirty_make_no_face(largest, wall):
    """This also holds with most of the rays on a wall, where they give no slope."""
    floor = np.linspace(-0.3, 2.5, 1400)

    def make(stamp, position):
        random = np.random.default_rng(round(1e3 * stamp))
        x = np.concatenate((floor, np.full(wall, 2.5))) - position
        z = np.concatenate((np.zeros(len(floor)), np.linspace(0.0, 0.6, wall))) - RADIUS
        wrong = (random.random(len(x)) < 0.03) & (x < 2.4 - position)
        z += random.uniform(-largest, largest, len(x)) * wrong
        return [TerrainObservation(
            stamp, tuple(x.tolist()), tuple(z.tolist()), (), float(x[0]), float(x[-1]))]
    fusion = GroundFusion(GIMBALL, TUNING)
    for number in range(100):
        faces = drive(fusion, make, 1, number, speed=0.2).faces
        assert all(face.position > 2.4 for face in faces)


def test_a_thin_wall_in_each_observation_is_not_an_outlier():
    x = tuple(np.linspace(-0.3, 2.5, 190).tolist())

    def make(stamp, position):
        one = terrain(stamp, position, x, 9.0)
        z = np.array(one.z)
        z[np.abs(np.array(x) + position - 1.5) < 0.0074] += 0.1
        return [TerrainObservation(stamp, one.x, tuple(z.tolist()), (), one.x_min, one.x_max)]
    profile = drive(GroundFusion(GIMBALL, TUNING), make, 40)
    assert any(face.height > 0.05 for face in profile.faces)


def test_a_face_that_some_observations_miss_keeps_its_number():
    fusion = GroundFusion(GIMBALL, TUNING)

    def make(stamp, position):
        shown = round(stamp / PERIOD) % 3 > 0
        return [terrain(stamp, position, EVEN, height=0.009 if shown else 0.0, noise=0.001,
                        seed=round(1e3 * stamp))]
    drive(fusion, make, 20)
    found = [tuple(face.number for face in drive(fusion, make, 1, 20 + index).faces)
             for index in range(80)]
    assert sum(one != other for one, other in zip(found, found[1:])) <= 1 and found[-1]


def test_the_height_threshold_of_the_edge_map_has_hysteresis():
    edges = EdgeMap(5.0)
    edge = edges.start(certain=True)

    def entered(height):
        edge.ground = EdgeEstimate(Face(0, 1.0, height, 0.01, 0.0005), 0.0)
        edges.update()
        return bool(edges.faces)
    assert list(map(entered, (0.004, -0.004, -0.005, -0.004, 0.0035, 0.002))) == [
        False, False, True, True, True, False]


@pytest.mark.parametrize('camera', [False, True])
def test_a_stretch_that_is_too_steep_is_found_before_the_drop_at_its_end(camera):
    """A stretch that ends at a face is not a part of it."""
    points = ((-0.2, 0.0), (1.0, 0.0), (1.3, -0.06), (1.3, -0.2), (3.0, -0.2))
    profile = Profile(0.0, (Face(1, 1.3, -0.14, 0.01, 0.001),), points,
                      points_sd=(0.001,) * 5 if camera else ())
    (start, slope), = steep_stretches(profile, 0.15)
    assert start == 1.0 and slope == pytest.approx(-0.197, abs=0.002)
    assert steep_stretches(profile, 0.21) == []


def test_the_ground_is_extrapolated_with_its_slope_beyond_the_last_point():
    floor = GroundProfile(((0.0, 0.0), (2.0, -0.1)), 0.0)
    assert floor.rise(1.0, 3.0) == pytest.approx(-0.1, abs=1e-4)
    assert GroundProfile((), 0.05).rise(0.0, 1.0) == pytest.approx(0.05, abs=1e-3)


def test_a_detection_close_to_a_drop_does_not_replace_it():
    edges = EdgeMap(5.0)
    drop = Face(0, 1.356, -0.13, 0.01, 0.001)
    known = edges.start(True)
    known.ground = EdgeEstimate(drop, 0.0)
    lip = Face(0, 1.335, -0.003, 0.01, 0.003)
    assert edges.associate([lip, drop], edges.edges) == {1: known}
    assert edges.associate([drop, lip], edges.edges) == {0: known}
    assert edges.associate([lip], edges.edges) == {0: known}
