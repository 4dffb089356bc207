# SPDX-License-Identifier: Apache-2.0
"""The steering law reaches feasible yaw rates, damps nutation, and keeps its reserve."""
import math

import pytest
from tiers import pairs

from ballbot_ros.physics import load_robot
from ballbot_ros.steering import (
    curvature_limit, LateralState, law, steady_turn, step, yaw_rate_limit)
from ballbot_ros.steering.law import RESERVE

GIMBALL = load_robot('gimball')


def drive(state, speed, yaw_rate, duration, dt=2e-3):
    """Return the states under the steering law."""
    states = []
    for _ in range(round(duration / dt)):
        state = step(GIMBALL, state, speed, law(GIMBALL, state, speed, yaw_rate), dt)
        states.append(state)
    return states


@pytest.mark.parametrize('speed, share', pairs([0.1, 0.2, 0.4, 0.8, 1.2, -0.4], [1.0, -0.5]))
def test_a_yaw_rate_within_the_limit_is_reached(speed, share):
    target = share * yaw_rate_limit(GIMBALL, speed)
    end = drive(LateralState(), speed, target, 6.0)[-1]
    assert end.yaw_rate == pytest.approx(target, rel=1e-2)
    assert end.tilt_rate == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize('speed', [0.2, 0.8])
def test_a_yaw_rate_beyond_the_limit_is_limited(speed):
    end = drive(LateralState(), speed, math.inf, 6.0)[-1]
    assert end.yaw_rate == pytest.approx(yaw_rate_limit(GIMBALL, speed), rel=1e-2)


@pytest.mark.parametrize('speed', [0.0, 0.2, 0.4, 0.8, 1.2])
def test_nutation_is_damped(speed):
    start = LateralState(tilt=0.1)
    held = start
    tilts = []
    for _ in range(2000):
        held = step(GIMBALL, held, speed, 0.0, 2e-3)
        tilts.append(abs(held.tilt))
    assert max(tilts[1000:]) > 0.05
    assert max(abs(state.tilt_rate) for state in drive(start, speed, 0.0, 4.0)[1000:]) < 0.02


@pytest.mark.slow
def test_vertical_angular_momentum_left_by_an_edge_is_compensated():
    turned = LateralState(yaw_rate=0.1)
    end = drive(turned, 0.4, 0.0, 6.0)[-1]
    assert abs(end.yaw_rate) < 2e-3
    assert end.tilt < -0.02


def test_the_curvature_limit_falls_with_speed_and_does_not_depend_on_the_direction():
    limits = [curvature_limit(GIMBALL, speed) for speed in (0.0, 0.1, 0.2, 0.4, 0.8, 1.6)]
    assert limits == sorted(limits, reverse=True)
    assert limits[-1] > 0.05
    assert curvature_limit(GIMBALL, -0.4) == curvature_limit(GIMBALL, 0.4)
    assert yaw_rate_limit(GIMBALL, 0.4) == pytest.approx(0.4 * limits[3])


def test_the_curvature_limit_at_rest_is_that_of_a_tilted_wheel():
    # tan(tilt) = curvature R (J1 + J2) / J1, and the pendulum hangs vertically.
    lean = (1.0 - RESERVE) * GIMBALL.steering.largest_lean
    ball, pendulum = GIMBALL.ball_inertia, GIMBALL.pendulum_inertia
    expected = math.tan(lean) * ball / ((ball + pendulum) * GIMBALL.ball_radius)
    assert curvature_limit(GIMBALL, 0.0) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize('field, low', [
    ('steering.largest_lean', 0.2), ('steering.largest_torque', 0.15), ('surface_friction', 0.01)])
def test_each_robot_limit_reduces_the_curvature_limit(field, low):
    from ballbot_ros.physics.model.robot import with_parameters
    less = with_parameters(GIMBALL, {field: low})
    assert curvature_limit(less, 0.6) < 0.8 * curvature_limit(GIMBALL, 0.6)


def test_a_robot_without_steering_has_no_curvature():
    assert yaw_rate_limit(load_robot('shellball'), 0.4) == 0.0
    assert curvature_limit(GIMBALL.replace(steering=None), 0.4) == 0.0


def test_the_limit_keeps_a_reserve_of_lean():
    turn = steady_turn(GIMBALL, 0.4, curvature_limit(GIMBALL, 0.4))
    assert turn.lean == pytest.approx((1.0 - RESERVE) * GIMBALL.steering.largest_lean, rel=1e-3)


def test_the_lean_is_zero_at_standstill():
    assert law(GIMBALL, LateralState(), 0.0, 0.3) == 0.0
