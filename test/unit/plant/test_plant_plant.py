# SPDX-License-Identifier: Apache-2.0
"""The plant: integer periods, exact time, and torque limits."""
from dataclasses import replace
import math

import pytest
from refusals import refused

from ballbot_ros.errors import ConfigurationError, SimulationError
from ballbot_ros.physics import load_robot, load_scene
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Plant


def flat(rate=500.0, **arguments):
    return Plant(load_scene('flat'), rate, **arguments)


def test_time_does_not_accumulate_rounding_errors():
    plant = flat(1000.0)
    for _ in range(3000):
        plant.advance(0.0)
    assert plant.time == plant.state.time == 3.0
    assert sum([0.001] * 3000) != 3.0  # a running sum does


def test_a_period_is_a_whole_number_of_steps():
    assert flat(10000.0).period == 1e-4
    for rate in (300.0, 20000.0, 7.0):
        with refused('inconsistent') as caught:
            flat(rate)
        assert f'control_rate {rate:g} Hz' in str(caught.value)


@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, math.inf])
def test_invalid_rates_are_refused(rate):
    with pytest.raises(ConfigurationError):
        flat(rate)


def test_two_short_periods_equal_one_long_period():
    long, short = flat(250.0), flat(500.0)
    for _ in range(50):
        after = long.advance(0.5)
        short.advance(0.5)
        assert short.advance(0.5) == pytest.approx(after, abs=1e-12)


def test_torque_is_limited_by_the_motor_or_by_the_given_limit():
    motor, own, exact = flat(), flat(torque_limit=1.0), flat(torque_limit=1.0)
    motor.advance(1e9)
    assert motor.torque == 4.0
    own.advance(-1e9)
    exact.advance(-1.0)
    assert own.torque == exact.torque == -1.0
    assert own.state == exact.state


def spinning(joint_rate, **arguments):
    """Return a plant of GimBall in flight with the given joint rate."""
    scene = read_scene({'robot': 'gimball', 'duration': 1.0, 'initial': {
        'y': 50.0, 'ball_rate': -joint_rate}}, 'test', 'test')
    return Plant(scene, 500.0, **arguments)


MOTOR = load_robot('gimball').motor
STALL = MOTOR.stall_torque_per_volt * MOTOR.maximum_voltage
IDLE = MOTOR.maximum_voltage / MOTOR.back_voltage


@pytest.mark.parametrize(('share', 'asked', 'given'), [
    (0.0, 9.0, 4.0),  # limited by the gear: the stall torque is 4.32
    (0.5, 9.0, 0.5 * STALL), (0.5, -9.0, -4.0), (0.5, -1.0, -1.0),
    (1.0, 9.0, 0.0), (1.0, -9.0, -4.0),
    # Above its idle speed the motor brakes even at full voltage.
    (1.5, 9.0, -0.5 * STALL), (1.5, 0.0, -0.5 * STALL), (1.5, -9.0, -4.0),
    (-0.5, 9.0, 4.0), (-0.5, -9.0, -0.5 * STALL), (-1.0, -9.0, 0.0), (-1.5, -9.0, 0.5 * STALL)])
def test_the_torque_stays_within_the_motor_line(share, asked, given):
    plant = spinning(share * IDLE)
    plant.advance(asked)
    assert plant.torque == pytest.approx(given, abs=1e-12)


def test_the_torque_limit_only_reduces_the_motor_torque():
    for limit, given in ((1.0, 1.0), (100.0, 0.5 * STALL), (math.inf, 0.5 * STALL)):
        plant = spinning(0.5 * IDLE, torque_limit=limit)
        plant.advance(9.0)
        assert plant.torque == pytest.approx(given)


def test_a_robot_without_a_motor_has_no_motor_line():
    scene = read_scene({'robot': 'gimball', 'duration': 1.0, 'initial': {
        'y': 50.0, 'ball_rate': -2.0 * IDLE}}, 'test', 'test')
    bare = replace(scene.model.robot, motor=None)
    plant = Plant(replace(scene, model=replace(scene.model, robot=bare)), 500.0)
    plant.advance(30.0)
    assert plant.torque == 30.0


def test_the_motor_work_is_the_integral_of_the_reported_torque():
    plant, work = flat(), 0.0
    for _ in range(200):
        before = plant.state
        after = plant.advance(9.0)
        work += plant.torque * (after.joint_angle - before.joint_angle)
        # The power of the motor is at most its maximum, which is at half the idle speed.
        assert plant.torque * before.joint_rate <= STALL * IDLE / 4.0 + 1e-9
    assert plant.state.motor_work == pytest.approx(work, rel=1e-6) and work > 1.0


def test_under_full_torque_the_joint_approaches_its_idle_speed():
    scene = read_scene({'robot': 'gimball', 'robot_changes': {'joint_friction': 0.0},
                        'duration': 1.0, 'initial': {'y': 50.0}}, 'test', 'test')
    plant = Plant(scene, 500.0)
    rates = [plant.advance(9.0).joint_rate for _ in range(400)]
    assert max(rates) <= IDLE + 1e-9 and rates[-1] == pytest.approx(IDLE, rel=1e-3)


def test_a_ball_without_pendulum_has_no_torque():
    plant = Plant(load_scene('flat', robot='shellball'), 500.0)
    start = plant.state
    assert plant.advance(3.0).ball_rate == pytest.approx(start.ball_rate, abs=1e-9)
    assert plant.torque == 0.0


def test_reset_restores_the_state_and_time_continues():
    plant = flat()
    start = plant.state
    first = [plant.advance(0.5) for _ in range(20)]
    assert plant.reset() == start._replace(time=plant.time)
    assert plant.time == 0.04 and plant.torque == 0.0
    second = [plant.advance(0.5) for _ in range(20)]
    # The second run equals the first one at a later time.
    assert [state[1:] for state in second] == [state[1:] for state in first]
    assert second[0].time == pytest.approx(0.042)


def test_a_failed_run_stays_at_the_last_valid_state():
    scene = read_scene({
        'robot': 'gimball', 'robot_changes': {'contact_stiffness': 500.0}, 'duration': 1.0,
        'initial': {'y': 1.0, 'velocity_y': -10.0}}, 'test', 'test')
    plant = Plant(scene, 500.0)
    with refused('penetrated', 'y', SimulationError):
        while True:
            before = plant.state
            plant.advance(0.0)
    assert plant.state == before and plant.time == before.time > 0.0
    with pytest.raises(SimulationError):
        plant.advance(0.0)
    assert plant.state == before and plant.time == before.time
