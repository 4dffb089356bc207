# SPDX-License-Identifier: Apache-2.0
"""The IMU: its axes, and the conversion of readings to the centre of the ball."""
import math

from hypothesis import given, strategies
import pytest
from refusals import refused

from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import ImuMounting, ImuReading
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

numbers = strategies.floats(-20.0, 20.0)
places = strategies.floats(-0.3, 0.3)


@given(places, places, strategies.floats(-3.0, 3.0), numbers, numbers, numbers, numbers)
def test_at_centre_removes_rotation(forward, upward, angle, ahead, above, turn_rate, turning):
    # The specific force at r in the shell is a + w' x r - w^2 r; the IMU axes are at an angle.
    position, at_centre = complex(forward, upward), complex(ahead, above)
    force = at_centre + (1j * turning - turn_rate**2) * position
    measured = force * complex(math.cos(angle), -math.sin(angle))
    moved = ImuMounting(forward, upward, angle).at_centre(
        ImuReading(3.0, turn_rate, measured.real, measured.imag), turning)
    assert (moved.stamp, moved.turn_rate, moved.turn_acceleration) == (3.0, turn_rate, turning)
    assert (moved.forward, moved.upward) == pytest.approx((ahead, above), abs=1e-9)


def test_converted_readings_of_an_off_centre_imu_equal_those_at_the_centre():
    scene = read_scene({'robot': 'gimball', 'terrain': [{'flat': {'length': 30.0}}],
                        'initial': {'x': 0.5}, 'duration': 1.0}, '', '')
    plant, place = Plant(scene, 500.0), (0.12, -0.08)
    central, far, mounting = Imu(9.81), Imu(9.81, place), ImuMounting(*place)
    for number in range(200):
        before = plant.state
        after = plant.advance(1.1 * math.sin(1.2 * plant.time))
        turning = (after.ball_rate - before.ball_rate) * 500.0
        moved = mounting.at_centre(ImuReading(*far.sample(before, after, number)), turning)
        true = central.sample(before, after, number)
        assert (moved.forward, moved.upward) == pytest.approx(
            (true.forward, true.upward), abs=1e-9)


@pytest.mark.parametrize('index', range(5))
@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_a_reading_that_is_not_finite_is_refused(index, bad):
    values = [0.0] * 5
    values[index] = bad
    with refused('not_finite', error=MessageError):
        ImuReading(*values)


def test_by_default_the_imu_is_at_the_centre_and_aligned():
    reading = ImuReading(1.0, 2.0, 3.0, 4.0)
    assert reading.turn_acceleration == 0.0
    assert ImuMounting().at_centre(reading, 0.0) == reading


@pytest.mark.parametrize('name, largest', [
    ('imu_forward', 10.0), ('imu_upward', 10.0), ('imu_angle', math.pi)])
def test_mounting_parameters_have_a_range(name, largest):
    for value in (-largest, largest):
        assert getattr(ImuMounting(**{name: value}), name) == value
        with refused('out_of_range', name):
            ImuMounting(**{name: 1.001 * value})
