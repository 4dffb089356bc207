# SPDX-License-Identifier: Apache-2.0
"""Assumed braking of the ball: less downhill, and none beyond the steepest slope."""
from dataclasses import replace
from functools import cache, partial
import math

from hypothesis import given, strategies
import pytest

from ballbot_ros.control import load_tuning
from ballbot_ros.decision import load_decision_tuning
from ballbot_ros.decision.planning.braking import Braking
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import load_robot

GIMBALL, TUNING = load_robot('gimball'), load_decision_tuning('decision_default')
CONTROL = load_tuning('published')
braking = cache(partial(Braking, GIMBALL, TUNING, CONTROL))  # compiles kernels
slopes = strategies.floats(-0.15, 0.15)


def test_on_level_floor_the_accelerations_are_those_of_the_tuning():
    uneven = Braking(GIMBALL, replace(TUNING, acceleration=0.3), CONTROL)
    assert uneven.acceleration(0.0) == pytest.approx(0.3)
    assert uneven.deceleration(0.0) == pytest.approx(TUNING.deceleration)


def test_the_stopping_distance_contains_reaction_and_braking():
    slow = Braking(GIMBALL, replace(TUNING, reaction_time=0.5, actuation_delay=0.1,
                                    deceleration=0.25), CONTROL)
    # The law adds its swing time, and brakes less below 0.25 / 2 m/s.
    assert slow.distance(1.0, 0.0) == pytest.approx(
        0.6 + 0.15 + (1.0 - 0.125**2) / 0.5 + 0.125 / 2.0)
    assert slow.distance(-1.0, 0.0) == 0.0
    assert slow.distance(1.0, 0.0, emergency=True) < slow.distance(1.0, 0.0)
    assert slow.expected_distance(1.0, 0.0) < slow.distance(1.0, 0.0, emergency=True)


def test_the_law_has_the_gains_of_the_controller():
    slow = Braking(GIMBALL, TUNING, replace(CONTROL, swing_time=0.4))
    assert slow.distance(1.0, 0.0) == pytest.approx(braking().distance(1.0, 0.0) + 0.25)
    with pytest.raises(ConfigurationError) as refusal:
        Braking(GIMBALL, TUNING, replace(CONTROL, position_kp=0.0))
    assert refusal.value.field == 'position_kp'


@given(strategies.floats(0.0, 1.5), slopes, slopes)
def test_the_braking_distance_grows_downhill_and_has_an_inverse(speed, one, other):
    down, up = min(one, other), max(one, other)
    distance = braking().distance(speed, down, emergency=True)
    assert distance >= braking().distance(speed, up, emergency=True)
    if math.isfinite(distance):
        assert braking().speed_within(distance, down) == pytest.approx(speed, abs=1e-6)
    assert braking().acceleration(down) >= braking().acceleration(up)


def test_beyond_the_steepest_slope_the_ball_cannot_brake():
    # The usable fraction of the torque is 0.4 / 0.537 = 0.745; the emergency lean is 1.4 rad.
    limit = math.asin(0.745 * 1.6 * 0.0787 * math.sin(1.4) / (5.4 * 0.226))
    assert braking().steepest == pytest.approx(limit, rel=0.01)
    assert math.isfinite(braking().distance(0.1, -braking().steepest + 1e-6, emergency=True))
    assert braking().distance(0.1, -braking().steepest - 1e-6, emergency=True) == math.inf
    assert braking().speed_within(10.0, -braking().steepest - 1e-6) == 0.0


def rolled(speed, set_speed, room, acceleration):
    """Return the speed after a distance, if the law commands 2 / s times the speed error."""
    position, step = 0.0, 1e-4
    while position < room:
        wanted = 2.0 * (set_speed - speed)
        position += step * speed
        speed += step * min(max(wanted, -0.4), acceleration)
    return speed


@pytest.mark.parametrize('speed, set_speed, room', [
    (0.001, 1.1, 0.3), (0.001, 1.1, 2.5), (0.4, 0.45, 0.2), (0.4, 0.9, 0.6), (1.0, 0.5, 0.3),
    (1.0, 0.5, 3.0), (0.5, 0.5, 1.0)])
def test_the_speed_at_touch_is_that_of_the_law(speed, set_speed, room):
    assert braking().touch_speed(speed, set_speed, room, 0.0) == pytest.approx(
        rolled(speed, set_speed, room, TUNING.acceleration), abs=2e-3)


def test_an_uphill_slope_reduces_the_speed_at_touch():
    level = braking().touch_speed(0.0, 1.1, 1.0, 0.0)
    assert braking().touch_speed(0.0, 1.1, 1.0, 0.03) < level - 0.1
    assert braking().touch_speed(0.0, 1.1, 1.0, -0.03) > level
    assert braking().touch_speed(0.3, 1.1, 1.0, 0.2) == 0.3, 'too steep to accelerate'
