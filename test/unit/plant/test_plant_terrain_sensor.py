# SPDX-License-Identifier: Apache-2.0
"""The terrain polyline measured by a camera at the height of the ball, and sensor faults."""
import numpy as np
import pytest

from ballbot_ros.physics import Terrain
from ballbot_ros.plant import SensorFaults, TerrainSensor

RADIUS = 0.226


def measured(terrain, x=0.0, number=0, height_sd=0.0, seed=0, reach=3.0, **faults):
    """Return x and z of one measurement, and the measurement."""
    sensor = TerrainSensor(terrain, reach, height_sd, seed, SensorFaults(**faults))
    profile = sensor.measure(x, float(terrain.height(x)) + RADIUS, number)
    return np.array(profile.x), np.array(profile.z), profile


@pytest.mark.parametrize('terrain', [
    Terrain.flat(), Terrain.slope(0.1), Terrain.slope(-0.1), Terrain.step(0.05, at=1.0),
    Terrain([[0.0, 0.0], [0.6, 0.0], [1.0, 0.05], [2.0, 0.05]])])
def test_points_lie_on_the_ground_from_behind_the_ball_to_the_reach(terrain):
    x, z, profile = measured(terrain, 0.1)
    face = np.isclose(x, 0.9)
    ground = terrain.height(x + 0.1) - terrain.height(0.1) - RADIUS
    assert z[~face] == pytest.approx(ground[~face], abs=1e-12)
    assert (np.diff(x) >= 0.0).all() and len(profile.z_sd) == len(x)
    assert (profile.x_min, profile.x_max) == (x[0], x[-1])
    assert profile.x_min == pytest.approx(-0.3, abs=0.015)
    assert profile.x_max == pytest.approx(3.0, abs=0.015)


def test_points_have_the_pixel_spacing_and_shift_between_measurements():
    (one, *_), (two, *_) = (measured(Terrain.flat(), number=number) for number in (1, 2))
    assert np.diff(one) == pytest.approx(0.015)
    assert not np.isclose(np.mod(one[0] - two[0], 0.015), 0.0)


def test_points_on_a_vertical_face_have_the_same_x():
    x, z, _ = measured(Terrain.step(0.06, at=1.0))
    on_face = z[x == 1.0] + RADIUS
    assert len(on_face) == 4 and (on_face > 0.0).all() and (on_face < 0.06).all()


@pytest.mark.parametrize('x, hidden', [(0.0, 0.1 / RADIUS), (0.5, 0.05 / RADIUS)])
def test_the_floor_behind_a_drop_is_hidden_up_to_the_line_of_sight(x, hidden):
    found, z, _ = measured(Terrain.step(-0.1, at=1.0), x)
    low = found[z < -RADIUS - 0.05]
    assert found[z > -RADIUS - 0.05].max() <= 1.0 - x
    assert low.min() == pytest.approx(1.0 - x + hidden, abs=0.016)


def test_no_points_lie_behind_a_wall_and_the_range_ends_there():
    x, z, profile = measured(Terrain.step(0.5, at=1.0))
    assert profile.x_max == x.max() == pytest.approx(1.0)
    assert z.max() == pytest.approx(0.5 - RADIUS, abs=0.016)


@pytest.mark.parametrize('x', [-1e9, -1e6, 1e6, 1e9])
def test_beyond_the_ends_of_the_terrain_nothing_is_observed(x):
    assert TerrainSensor(Terrain.flat(), 2.0).measure(x, 0.2, 1) is None


def test_the_noise_depends_on_seed_and_number_and_equals_the_reported_noise():
    assert measured(Terrain.flat(), height_sd=0.003, number=5)[2] \
        == measured(Terrain.flat(), height_sd=0.003, number=5)[2]
    assert measured(Terrain.flat(), height_sd=0.003, number=5, seed=1)[2] \
        != measured(Terrain.flat(), height_sd=0.003, number=5)[2]
    noise = np.concatenate([measured(Terrain.flat(), number=number, height_sd=0.003)[1] + RADIUS
                            for number in range(40)])
    assert noise.std() == pytest.approx(0.003, rel=0.05)
    assert noise.mean() == pytest.approx(0.0, abs=1e-4)
    assert set(measured(Terrain.flat(), height_sd=0.003)[2].z_sd) == {0.003}
    assert set(measured(Terrain.flat(), height_sd=0.003, reported_sd=0.0)[2].z_sd) == {0.0}


def measured_height(**faults):
    """Return the measured height of a 40 mm step 1 m ahead of a sensor with faults."""
    x, z, _ = measured(Terrain.step(0.04, at=1.0), **faults)
    return z[(x > 1.0) & (x < 1.05)].mean() - z[(x > 0.95) & (x < 1.0)].mean()


def test_faults_change_the_height_of_a_step():
    assert measured_height() == pytest.approx(0.04)
    assert measured_height(bias=-0.004) == pytest.approx(0.036)
    assert measured_height(scale=0.1) == pytest.approx(0.044)
    assert measured_height(growth=0.2) == pytest.approx(0.8 * 0.04, abs=0.001)
    assert measured_height(offset=0.02) == pytest.approx(0.04)


def test_offset_and_tilt_transform_all_points():
    x, z, _ = measured(Terrain.flat(), offset=0.02, tilt=0.05)
    assert z == pytest.approx(-RADIUS + 0.02 + np.tan(0.05) * x)


def test_measurements_and_points_are_dropped_at_their_rates():
    whole, some = len(measured(Terrain.flat())[0]), len(measured(Terrain.flat(), holes=0.3)[0])
    assert some == pytest.approx(0.7 * whole, rel=0.15)
    faulty = TerrainSensor(Terrain.flat(), 3.0, faults=SensorFaults(dropout=0.3))
    number = sum(faulty.measure(0.0, RADIUS, index) is None for index in range(300))
    assert number == pytest.approx(90, abs=30)
    assert TerrainSensor(Terrain.flat(), 3.0, faults=SensorFaults(holes=1.0)).measure(
        0.0, RADIUS, 0) is None
