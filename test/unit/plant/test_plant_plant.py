# SPDX-License-Identifier: Apache-2.0
"""The plant: whole periods, time without rounding, torque within its limit."""
import math

import pytest

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics import load_scene
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant


def flat(rate=500.0, **arguments):
    return Plant(load_scene('flat'), rate, **arguments)


def test_time_carries_no_rounding():
    plant = flat(1000.0)
    for _ in range(3000):
        plant.advance(0.0)
    assert plant.time == plant.state.time == 3.0
    assert sum([0.001] * 3000) != 3.0  # as adding up would


def test_a_period_is_a_whole_number_of_steps():
    assert flat(10000.0).period == 1e-4
    for rate in (300.0, 20000.0, 7.0):
        with pytest.raises(ConfigurationError, match='whole number of steps') as caught:
            flat(rate)
        assert f'control_rate {rate:g} Hz' in str(caught.value)


@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, math.inf])
def test_rates_that_are_none_are_refused(rate):
    with pytest.raises(ConfigurationError):
        flat(rate)


def test_two_short_periods_are_one_long_one():
    long, short = flat(250.0), flat(500.0)
    for _ in range(50):
        after = long.advance(0.5)
        short.advance(0.5)
        assert short.advance(0.5) == pytest.approx(after, abs=1e-12)


def test_torque_is_cut_to_the_limit_of_the_motor_or_to_ones_own():
    motor, own, exact = flat(), flat(torque_limit=1.0), flat(torque_limit=1.0)
    motor.advance(1e9)
    assert motor.torque == 4.0
    own.advance(-1e9)
    exact.advance(-1.0)
    assert own.torque == exact.torque == -1.0
    assert own.state == exact.state


def test_a_ball_without_pendulum_has_no_torque():
    plant = Plant(load_scene('flat', robot='shellball'), 500.0)
    start = plant.state
    assert plant.advance(3.0).ball_rate == pytest.approx(start.ball_rate, abs=1e-9)
    assert plant.torque == 0.0


def test_reset_brings_the_state_back_and_lets_time_go_on():
    plant = flat()
    start = plant.state
    first = [plant.advance(0.5) for _ in range(20)]
    assert plant.reset() == start._replace(time=plant.time)
    assert plant.time == 0.04 and plant.torque == 0.0
    second = [plant.advance(0.5) for _ in range(20)]
    # The same run again, later: nothing of the first is left.
    assert [state[1:] for state in second] == [state[1:] for state in first]
    assert second[0].time == pytest.approx(0.042)


def test_a_run_that_fails_stays_at_the_last_good_state():
    scene = read_scene({
        'robot': 'gimball', 'robot_changes': {'contact_stiffness': 500.0}, 'duration': 1.0,
        'initial': {'y': 1.0, 'velocity_y': -10.0}}, 'test', 'test')
    plant = Plant(scene, 500.0)
    with pytest.raises(SimulationError, match='under the ground'):
        while True:
            before = plant.state
            plant.advance(0.0)
    assert plant.state == before and plant.time == before.time > 0.0
    with pytest.raises(SimulationError):
        plant.advance(0.0)
    assert plant.state == before and plant.time == before.time
