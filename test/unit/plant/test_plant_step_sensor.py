# SPDX-License-Identifier: Apache-2.0
"""Step detection ahead of the ball, and the noise of its measurements."""
import numpy as np
import pytest

from ballbot_ros.physics import Terrain
from ballbot_ros.physics.model.terrain import read_terrain
from ballbot_ros.plant import Latency, Sensor, SensorFaults
from ballbot_ros.plant.step_sensor import faces


def ground(*pieces):
    return read_terrain([{'flat': {'length': 1.0}}, *pieces], 'test')


@pytest.mark.parametrize('piece, expected', [
    ({'step': {'height': 0.03}}, [(1.0, 0.03)]),
    ({'step': {'height': -0.2}}, [(1.0, -0.2)]),
    ({'threshold': {'height': 0.02, 'width': 0.1, 'bevel': 0.005}},
     [(1.0, 0.02), (1.095, -0.02)]),
    ({'threshold': {'height': 0.02, 'width': 0.2, 'bevel': 0.08}}, []),
    ({'slope': {'length': 1.0, 'angle_deg': 30}}, []),
    ({'step': {'height': 0.001}}, []),
    ({'carpet': {'thickness': 0.006, 'length': 1.0}}, [(1.0, 0.006), (1.994, -0.006)]),
    ({'cord': {'diameter': 0.008}}, [(1.0, 0.008), (1.004, -0.008)]),
])
def test_steep_rises_and_drops_are_faces_and_slopes_are_not(piece, expected):
    found = faces(ground(piece, {'flat': {'length': 1.0}}))
    assert np.array(found).reshape(-1, 2) == pytest.approx(np.array(expected).reshape(-1, 2))


@pytest.mark.parametrize('slope_deg', [-10.0, -3.0, -0.2, 0.0, 0.2, 3.0, 10.0])
@pytest.mark.parametrize('piece', [
    {'carpet': {'thickness': 0.006, 'length': 1.0}}, {'cord': {'diameter': 0.008}},
    {'threshold': {'height': 0.02, 'width': 0.1, 'bevel': 0.005}}])
def test_a_rounded_edge_is_detected_on_any_slope(piece, slope_deg):
    level, slope = ground(piece, {'flat': {'length': 1.0}}), np.tan(np.radians(slope_deg))
    sheared = level.vertices + slope * level.vertices[:, :1] * [0.0, 1.0]
    for found, flat in zip(faces(Terrain(sheared)), faces(level), strict=True):
        assert found[0] == pytest.approx(flat[0], abs=0.002)  # the crest moves with the slope
        assert found[1] == pytest.approx(flat[1], abs=abs(slope) * 0.007)


def test_the_next_face_ahead_of_the_centre_is_detected_within_reach():
    sensor = Sensor(ground({'step': {'height': 0.03}}, {'flat': {'length': 2.0}},
                           {'step': {'height': 0.08}}), reach=1.5)
    assert sensor.measure(0.2, 0) == sensor.measure(0.2, 7)
    found = sensor.measure(0.2, 0)
    assert (found.detected, found.distance, found.height) == (True, pytest.approx(0.8), 0.03)
    beyond = sensor.measure(1.01, 0)
    assert (beyond.detected, beyond.distance, beyond.height) == (False, 1.5, 0.0)
    assert sensor.measure(1.6, 0).height == pytest.approx(0.08)


def test_the_noise_depends_only_on_seed_and_number():
    step = Terrain.step(0.03, at=1.0)
    one, two = (Sensor(step, 3.0, 0.01, 0.002, seed=5) for _ in range(2))
    one.measure(0.5, 1)
    assert one.measure(0.5, 2) == two.measure(0.5, 2) != two.measure(0.5, 3)
    assert Sensor(step, 3.0, 0.01, 0.002, seed=6).measure(0.5, 2) != two.measure(0.5, 2)


def test_the_noise_has_the_stated_deviations_and_no_bias():
    sensor = Sensor(Terrain.step(0.03, at=1.0), 3.0, 0.01, 0.002)
    samples = np.array([(found.distance, found.height) for found in (
        sensor.measure(0.0, number) for number in range(4000))])
    assert samples.mean(axis=0) == pytest.approx([1.0, 0.03], abs=6e-4)
    assert samples.std(axis=0) == pytest.approx([0.01, 0.002], rel=0.05)


def faulty(height=0.03, height_sd=0.0, **faults):
    return Sensor(Terrain.step(height, at=1.0), 3.0, 0.01, height_sd,
                  faults=SensorFaults(**faults))


@pytest.mark.parametrize('share', [0.0, 0.5, 1.0])
def test_the_reported_noise_may_be_a_fraction_of_the_actual_noise(share):
    sensor = faulty(height_sd=0.002, reported_sd=share)
    assert (sensor.distance_sd, sensor.height_sd) == (share * 0.01, share * 0.002)
    assert sensor.measure(0.0, 3) == faulty(height_sd=0.002).measure(0.0, 3)


def test_bias_is_added_to_rise_and_drop_and_scale_is_relative_to_the_height():
    assert faulty(bias=0.004).measure(0.0, 0).height == pytest.approx(0.034)
    assert faulty(-0.03, bias=0.004).measure(0.0, 0).height == pytest.approx(-0.026)
    assert faulty(-0.03, scale=0.1).measure(0.0, 0).height == pytest.approx(-0.033)


def test_the_measured_height_grows_during_the_approach():
    heights = [faulty(growth=0.5).measure(x, 0).height for x in (-2.0, 0.0, 0.5, 0.99)]
    assert heights == pytest.approx([0.0, 0.015, 0.0225, 0.02985])


def test_dropouts_are_random_but_reproducible():
    dropped = [[faulty(dropout=0.3).measure(0.0, number) is None for number in range(500)]
               for _ in range(2)]
    assert dropped[0] == dropped[1] and sum(dropped[0]) == pytest.approx(150, abs=40)


def test_delayed_samples_are_returned_in_order_after_the_latency():
    late = Latency(0.3)
    for index in range(3):
        late.put(0.1 * index, index)
    assert [late.due(now) for now in (0.0, 0.2, 0.1 + 0.2, 0.45)] == [[], [], [0], [1]]
    late.clear()
    assert late.due(9.0) == []


def test_a_noise_free_sensor_reports_its_resolution_because_0_means_unknown():
    exact = Sensor(Terrain.step(0.03), 3.0)
    assert exact.distance_sd > 0.0 and exact.height_sd == 0.0005
    silent = Sensor(Terrain.step(0.03), 3.0, faults=SensorFaults(reported_sd=0.0))
    assert (silent.distance_sd, silent.height_sd) == (0.0, 0.0)
