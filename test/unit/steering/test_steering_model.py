# SPDX-License-Identifier: Apache-2.0
"""The lateral model obeys the conservation laws, and its steady turns are equilibria."""
from dataclasses import replace
import math
import random

import pytest
from refusals import refused

from ballbot_ros.physics import load_robot
from ballbot_ros.steering import LateralState, law, pull, steady_turn, step
from ballbot_ros.steering.model import accelerations, lateral_acceleration

GIMBALL = load_robot('gimball')
LOSSLESS = GIMBALL.replace(rolling_friction=0.0)


def energy(robot, state, speed):
    """Return the energy of (S1) and (S2) without that of the forward motion."""
    m, e, radius = robot.pendulum_mass, robot.pendulum_length, robot.ball_radius
    swing, rate = state.lean - state.tilt, state.lean_rate - state.tilt_rate
    sideways, yaw = radius * state.tilt_rate, state.yaw_rate
    spin = yaw - speed / radius * math.tan(state.tilt)
    ball = (robot.ball_mass * sideways**2 + robot.ball_inertia * (state.tilt_rate**2 + spin**2))
    bob = m * ((sideways + e * rate * math.cos(swing))**2 + (e * rate * math.sin(swing))**2
               + (speed - yaw * e * math.sin(swing))**2)
    own = robot.pendulum_inertia * (rate**2 + yaw**2)
    return 0.5 * (ball + bob + own) - m * robot.gravity * e * math.cos(swing)


def test_a_ball_at_rest_conserves_energy_while_the_lean_is_held():
    state = LateralState(lean=0.3, tilt=-0.2)
    before = energy(LOSSLESS, state, 0.0)
    swings = []
    for _ in range(2000):
        state = step(LOSSLESS, state, 0.0, 0.3, 1e-3)
        swings.append(state.tilt)
    # The lean deviates slightly under load, so the actuator does some work.
    assert energy(LOSSLESS, state, 0.0) == pytest.approx(before, abs=2e-3)
    assert max(swings) - min(swings) > 0.5


@pytest.mark.slow
def test_rolling_friction_dissipates_energy():
    state = LateralState(lean=0.0, tilt=0.3)
    for _ in range(4000):
        state = step(GIMBALL.replace(rolling_friction=0.05), state, 0.0, 0.0, 2e-3)
    damped = math.hypot(state.tilt, state.tilt_rate)
    state = LateralState(lean=0.0, tilt=0.3)
    for _ in range(4000):
        state = step(LOSSLESS, state, 0.0, 0.0, 2e-3)
    assert damped < 0.9 * math.hypot(state.tilt, state.tilt_rate)


@pytest.mark.parametrize('speed', [0.1, 0.4, -0.4, 1.2])
@pytest.mark.parametrize('curvature', [0.1, -0.3])
def test_a_steady_turn_is_an_equilibrium(speed, curvature):
    turn = steady_turn(GIMBALL, speed, curvature)
    state = LateralState(lean=turn.lean, tilt=turn.tilt, yaw_rate=turn.yaw_rate)
    found = accelerations(GIMBALL, state, speed, 0.0)
    assert found.tilt == pytest.approx(0.0, abs=1e-9)
    assert found.yaw == pytest.approx(0.0, abs=1e-9)
    assert turn.yaw_rate == curvature * speed


@pytest.mark.parametrize('speed', [0.2, 0.4, 0.8])
def test_small_oscillations_have_the_frequency_of_nutation(speed):
    ball, pendulum = LOSSLESS.ball_inertia, LOSSLESS.pendulum_inertia
    m, radius = LOSSLESS.pendulum_mass * LOSSLESS.pendulum_length, LOSSLESS.ball_radius
    a = ball + LOSSLESS.total_mass * radius**2 - m * radius
    b = pendulum + m * LOSSLESS.pendulum_length - m * radius
    rolling = speed / radius
    rate = math.sqrt((a * ball / (ball + pendulum) * rolling**2 + m * LOSSLESS.gravity) / (a + b))
    stiff = LOSSLESS.replace(steering=replace(LOSSLESS.steering, largest_torque=100.0))
    tilt = 1e-3
    state = LateralState(tilt=tilt, yaw_rate=ball / (ball + pendulum) * rolling * tilt)
    count, period = 400, 2.0 * math.pi / rate
    for _ in range(count):
        state = step(stiff, state, speed, 0.0, period / count)
    assert state.tilt == pytest.approx(tilt, rel=2e-3)
    assert state.tilt_rate == pytest.approx(0.0, abs=0.02 * rate * tilt)


def test_right_turns_mirror_left_turns():
    left, right = LateralState(), LateralState()
    for _ in range(1000):
        left = step(GIMBALL, left, 0.4, law(GIMBALL, left, 0.4, 0.2), 2e-3)
        right = step(GIMBALL, right, 0.4, law(GIMBALL, right, 0.4, -0.2), 2e-3)
    assert left.heading > 0.2
    assert left == pytest.approx([-number for number in right])


@pytest.mark.parametrize('torque', [0.6, 1.0])
def test_lean_rate_and_torque_stay_within_their_limits(torque):
    robot = GIMBALL.replace(steering=replace(GIMBALL.steering, largest_torque=torque))
    limits, state = robot.steering, LateralState()
    for command in (1.0, -1.0, 0.2):
        for _ in range(500):
            later = step(robot, state, 0.4, command, 2e-3)
            force = accelerations(robot, state, 0.4, (later.lean_rate - state.lean_rate) / 2e-3)
            assert abs(force.torque) <= torque * (1.0 + 1e-6)
            # If the torque is too low to decelerate the lean, it may exceed its limits.
            if torque >= GIMBALL.steering.largest_torque:
                assert abs(later.lean_rate) <= limits.largest_lean_rate * (1.0 + 1e-9)
                assert abs(later.lean) <= limits.largest_lean + 1e-3
            state = later


@pytest.mark.parametrize('function', [step, law])
def test_step_and_law_refuse_a_robot_without_steering(function):
    arguments = (LateralState(), 0.4, 0.1) + ((0.01,) if function is step else ())
    with refused('missing', 'steering'):
        function(load_robot('shellball'), *arguments)
    with refused('missing', 'steering'):
        function(GIMBALL.replace(steering=None), *arguments)


def test_the_lateral_acceleration_is_finite_at_any_yaw_rate():
    turning = LateralState(yaw_rate=1e17)
    assert math.isfinite(lateral_acceleration(GIMBALL, turning, 0.5, 0.1))


@pytest.mark.parametrize('seed', range(3))
def test_the_state_stays_within_the_range_of_the_model_under_any_torque(seed):
    choose, state, torque = random.Random(seed), LateralState(), 0.0
    for number in range(10_000):
        if number % 50 == 0:
            torque = choose.uniform(-1.0, 1.0)
        state = pull(GIMBALL, state, choose.uniform(-1.5, 1.5), torque, 0.002)
        assert abs(state.tilt) < 0.5 * math.pi
        assert max(abs(state.tilt_rate), abs(state.yaw_rate)) < 60.0
