# SPDX-License-Identifier: Apache-2.0
"""Thermal derating of the torque, compared with closed forms."""
import math

from hypothesis import given, strategies as some
import pytest
from refusals import refused

from ballbot_ros.bridge.condition import (
    derating, DERATING_START, left_by, Thermal, warmed)
from ballbot_ros.errors import ConfigurationError

THERMAL = Thermal(drive_warn_at=80.0, drive_zero_at=100.0, motor_warn_at=90.0,
                  motor_zero_at=120.0, continuous_torque=2.0, time_constant=30.0)
loads, warmths = some.floats(0.0, 4.0), some.floats(0.0, 16.0)


def test_under_a_constant_torque_the_winding_warms_along_an_exponential():
    for load, seconds in ((1.0, 30.0), (2.0, 7.0), (0.5, 300.0)):
        expected = load**2 * (1.0 - math.exp(-seconds / 30.0))
        assert warmed(0.0, load, seconds, 30.0) == pytest.approx(expected, rel=1e-12)


def test_twice_the_continuous_torque_is_allowed_for_ln_four_thirds_time_constants():
    assert warmed(0.0, 2.0, 30.0 * math.log(4.0 / 3.0), 30.0) == pytest.approx(1.0)


@given(warmths, loads, some.floats(0.0, 100.0), some.floats(0.0, 100.0))
def test_two_steps_equal_one_step_of_their_sum(warmth, load, first, second):
    assert warmed(warmed(warmth, load, first, 30.0), load, second, 30.0) == pytest.approx(
        warmed(warmth, load, first + second, 30.0), rel=1e-9, abs=1e-12)


def test_time_that_stands_still_or_goes_backwards_does_not_warm_the_winding():
    assert warmed(0.5, 3.0, 0.0, 30.0) == 0.5
    assert warmed(0.5, 3.0, -5.0, 30.0) == 0.5


@pytest.mark.parametrize('temperature, part', [
    (-20.0, 1.0), (80.0, 1.0), (85.0, 0.75), (90.0, 0.5), (100.0, 0.0), (150.0, 0.0),
    (None, 1.0), (math.nan, 1.0), (math.inf, 1.0)])
def test_the_torque_fades_between_two_temperatures(temperature, part):
    assert derating(THERMAL, temperature, None, 0.0, 4.0)[0] == pytest.approx(part)


@given(some.floats(0.0, 1.0), some.floats(0.1, 3.0))
def test_permanent_requests_of_full_torque_settle_at_the_continuous_torque(warmth, continuous):
    """With a torque limit of 1, the warmth settles at 1, or lower if full torque causes less."""
    step = 0.01
    for _ in range(800):
        load = left_by(warmth, continuous) / continuous
        warmth = warmed(warmth, load, step, 1.0)
        assert warmth <= 1.0 + step / continuous**2  # the most that one step adds
    assert warmth == pytest.approx(min(1.0, 1.0 / continuous**2), abs=0.2) and warmth < 1.0 + 1e-3


def test_a_cool_winding_allows_full_torque_and_a_hot_one_the_continuous_torque():
    assert left_by(DERATING_START, 0.5) == 1.0
    assert left_by(1.0, 0.5) == left_by(7.0, 0.5) == 0.5
    assert left_by(0.5 + 0.5 * DERATING_START, 0.5) == pytest.approx(0.75)
    assert left_by(5.0, 1.5) == 1.0


def test_the_lowest_limit_applies_and_each_hot_part_is_named():
    assert derating(THERMAL, 85.0, 105.0, 0.0, 4.0) == (
        pytest.approx(0.5), ('drive_hot', 'motor_hot'))
    assert derating(THERMAL, 20.0, None, 0.9, 4.0) == (pytest.approx(0.75), ('motor_i2t',))
    assert derating(THERMAL, 20.0, 30.0, 0.5, 4.0) == (1.0, ())


def test_a_limit_that_is_not_given_is_not_monitored():
    assert derating(Thermal(), 500.0, 500.0, 9.0, 4.0) == (1.0, ())


@pytest.mark.parametrize('changes, reason, field', [
    ({'drive_warn_at': 80.0}, 'missing', 'drive_warn_at'),
    ({'motor_zero_at': 80.0}, 'missing', 'motor_warn_at'),
    ({'drive_warn_at': 90.0, 'drive_zero_at': 90.0}, 'inconsistent', 'drive_warn_at'),
    ({'motor_warn_at': 90.0, 'motor_zero_at': 60.0}, 'inconsistent', 'motor_warn_at'),
    ({'continuous_torque': 0.0}, 'out_of_range', 'continuous_torque'),
    ({'time_constant': -1.0}, 'out_of_range', 'time_constant')])
def test_inconsistent_limits_are_refused(changes, reason, field):
    with refused(reason, field, ConfigurationError):
        Thermal(**changes)
