# SPDX-License-Identifier: Apache-2.0
"""Fusion applies the filter in the order of the stamps and tolerates sensor failures."""
from dataclasses import replace
import math

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.control import RollingModel
from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation import (
    EncoderReading, FilterTuning, Fusion, ImuMounting, ImuReading, PendulumFilter)
from ballbot_ros.physics import load_robot

GIMBALL = load_robot('gimball')
G = GIMBALL.gravity
FILTER = PendulumFilter(GIMBALL)


def upright(stamp, turn_rate=0.0):
    return ImuReading(stamp, turn_rate, 0.0, G)


def tilted(stamp, angle):
    """Return the reading of an IMU at rest at a ball angle [rad]."""
    return ImuReading(stamp, 0.0, G * math.sin(angle), G * math.cos(angle))


def started(encoder=0.0, **options):
    """Return a fusion that has received one encoder reading at time 0."""
    fusion = Fusion(GIMBALL, **options)
    fusion.encoder(EncoderReading(0.0, encoder))
    return fusion


def same(one, other):
    """Return whether two estimates are equal."""
    return one.stamp == other.stamp and one.encoder_zero == other.encoder_zero and np.array_equal(
        one.mean, other.mean) and np.array_equal(one.covariance, other.covariance)


# Order of the readings

def test_without_an_imu_fusion_alternates_prediction_and_encoder_update():
    fusion, estimate = Fusion(GIMBALL), FILTER.start(0.0, 4.0)
    assert fusion.estimate is None
    fusion.encoder(EncoderReading(0.0, 4.0))
    for number in range(1, 20):
        stamp, angle, torque = 0.004 * number, 4.0 + 0.01 * number, 0.1 * number
        found = fusion.encoder(EncoderReading(stamp, angle, torque))
        estimate = FILTER.with_encoder(FILTER.predict(estimate, stamp, torque), angle)
        assert same(found, estimate) and fusion.estimate is found


def test_imu_readings_apply_at_their_stamps_with_the_torque_of_the_period():
    mounting = ImuMounting(0.1, -0.05, 0.2)
    fusion = Fusion(GIMBALL, mounting)
    first = ImuReading(0.0, 0.3, 0.5, G)
    fusion.imu(first)
    before = mounting.at_centre(first, 0.0)
    estimate = FILTER.start(0.0, 2.0, before)
    assert same(fusion.encoder(EncoderReading(0.0, 2.0)), estimate)
    turning = 0.0
    for number in range(1, 20):
        stamp, torque = 0.021 * number, math.sin(number)
        readings = [ImuReading(stamp - late, math.sin(3.0 * (stamp - late)), 0.1 * number, G)
                    for late in (0.019, 0.015, 0.0)]
        for reading in readings:
            fusion.imu(reading)
        for reading in readings:
            elapsed = reading.stamp - before.stamp
            slope = (reading.turn_rate - before.turn_rate) / elapsed
            turning += (slope - turning) * min(1.0, elapsed / 0.01)
            before = mounting.at_centre(reading, turning)
            estimate = FILTER.with_imu(
                FILTER.predict(estimate, reading.stamp, torque, before), before, elapsed)
        estimate = FILTER.with_encoder(
            FILTER.predict(estimate, stamp, torque, before), 2.0 + 0.001 * number)
        found = fusion.encoder(EncoderReading(stamp, 2.0 + 0.001 * number, torque))
        np.testing.assert_allclose(found.mean, estimate.mean, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found.covariance, estimate.covariance, rtol=1e-9, atol=1e-15)
    assert abs(turning) > 0.1


def test_an_imu_reading_waits_for_an_encoder_reading_of_its_time_or_later():
    fusion, plain = started(), started()
    for both in (fusion, plain):
        both.imu(upright(0.001))
        both.encoder(EncoderReading(0.002, 0.0))
    fusion.imu(upright(0.006, turn_rate=3.0))
    second, third = EncoderReading(0.004, 0.0), EncoderReading(0.006, 0.0)
    assert same(fusion.encoder(second), plain.encoder(second))
    assert fusion.encoder(third).mean[3] > plain.encoder(third).mean[3] + 0.1


def test_imu_readings_out_of_order_are_refused_but_repeated_stamps_are_accepted():
    fusion = Fusion(GIMBALL)
    fusion.imu(upright(1.0))
    with refused('out_of_order', error=MessageError):
        fusion.imu(upright(0.9))
    fusion.imu(upright(1.0, turn_rate=0.5))
    assert np.isfinite(fusion.encoder(EncoderReading(1.001, 0.0)).mean).all()


def test_the_last_two_thousand_imu_readings_are_buffered():
    def after(readings):
        fusion = started()
        for reading in readings:
            fusion.imu(reading)
        return fusion.encoder(EncoderReading(2.1, 0.0))

    readings = [tilted(0.001 * number, 0.2 if number < 3 else 0.0) for number in range(2002)]
    assert same(after(readings), after(readings[-2000:]))
    assert not same(after(readings), after(readings[-1999:]))


# The start

@pytest.mark.parametrize('age, used', [(0.0, True), (0.04, True), (0.06, False)])
def test_a_recent_imu_reading_and_a_stored_zero_allow_a_start_in_motion(age, used):
    fusion = Fusion(GIMBALL, encoder_zero=11.5)
    fusion.imu(tilted(0.0, -0.2))
    estimate = fusion.encoder(EncoderReading(age, 12.0))
    assert estimate.readings.pendulum_angle == pytest.approx(0.3 if used else 0.0, abs=1e-12)
    assert estimate.readings.ball_angle == pytest.approx(-0.2 if used else 0.0, abs=1e-12)


def test_an_imu_present_at_the_start_does_not_shift_the_encoder_zero_later():
    fusion = Fusion(GIMBALL)
    fusion.imu(upright(0.0))
    fusion.encoder(EncoderReading(0.0, 0.0))
    fusion.imu(tilted(0.002, 0.3))
    assert fusion.encoder(EncoderReading(0.002, 0.0)).encoder_zero == 0.0


@pytest.mark.parametrize('turns', [0, 1, -2])
def test_a_late_imu_sets_the_ball_angle_to_the_nearest_turn(turns):
    fusion = started()
    for number in range(1, 201):  # joint and ball turn slowly
        fusion.encoder(EncoderReading(0.002 * number, -2.0 * math.pi * turns * number / 200))
    before = fusion.estimate.readings
    fusion.imu(tilted(0.402, 0.3))
    after = fusion.encoder(EncoderReading(0.402, -2.0 * math.pi * turns))
    assert after.readings.pendulum_angle == pytest.approx(before.pendulum_angle, abs=0.15)
    whole = (after.readings.ball_angle - 0.3) / (2.0 * math.pi)
    assert abs(whole - round(whole)) < 0.05
    assert abs(after.readings.ball_angle - before.ball_angle) < math.pi + 0.3
    zero = after.encoder_zero
    fusion.imu(tilted(0.404, 0.5))
    assert fusion.encoder(EncoderReading(0.404, -2.0 * math.pi * turns)).encoder_zero == zero


# IMU timeout

@pytest.mark.parametrize('start, stamp, carried', [
    (0.0, 0.05, True), (0.0, 0.051, False), (8.0, 8.04, True), (8.0, 8.06, False)])
def test_after_the_imu_timeout_the_floor_is_assumed_level(start, stamp, carried):
    fusion, imu = Fusion(GIMBALL), tilted(start, 0.2)
    fusion.imu(imu)
    estimate = fusion.encoder(EncoderReading(start, 0.0))
    predicted = FILTER.predict(estimate, stamp, 0.5, imu if carried else None)
    assert same(fusion.encoder(EncoderReading(stamp, 0.001, 0.5)),
                FILTER.with_encoder(predicted, 0.001))


@pytest.mark.parametrize('gap, turning', [(0.05, 100.0), (0.2, 0.0)])
def test_beyond_the_timeout_the_turn_acceleration_is_zero(gap, turning):
    # The period of the reading after the gap is limited to one timeout.
    fusion, rate = started(), 100.0 * gap
    for reading in (upright(0.0), upright(gap, rate)):
        fusion.imu(reading)
    first, later = upright(0.0), replace(upright(gap, rate), turn_acceleration=turning)
    estimate = FILTER.with_imu(FILTER.start(0.0, 0.0), first, 0.05)
    estimate = FILTER.with_imu(FILTER.predict(estimate, gap, 0.0, later), later, 0.05)
    found = fusion.encoder(EncoderReading(gap, float(estimate.mean[1])))
    np.testing.assert_allclose(found.mean, estimate.mean, rtol=1e-9, atol=1e-12)


# Encoder jumps

def test_an_angle_far_from_the_prediction_is_rejected_and_counted():
    fusion = started()
    before = fusion.encoder(EncoderReading(0.002, 0.0))
    assert same(fusion.encoder(EncoderReading(0.004, 0.51)), FILTER.predict(before, 0.004, 0.0))
    assert (fusion.jumps, fusion.rezeroed) == (1, 0)
    # After a pause, the rejection threshold is half a radian.
    for angle, rejected in ((0.5, 0), (0.51, 1)):
        fusion = started()
        fusion.encoder(EncoderReading(0.06, angle))
        assert fusion.jumps == rejected


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_consistent_readings_for_18_ms_after_a_jump_change_the_encoder_zero(sign):
    fusion = started()
    for number in range(1, 10):
        fusion.encoder(EncoderReading(0.002 * number, 3.0 * sign))
    assert (fusion.jumps, fusion.rezeroed) == (9, 0)
    fusion.encoder(EncoderReading(0.020, 0.0))  # a plausible reading restarts the count
    for number in range(11, 21):
        assert fusion.rezeroed == 0
        estimate = fusion.encoder(EncoderReading(0.002 * number, 3.0 * sign))
    assert (fusion.jumps, fusion.rezeroed) == (19, 1)
    assert estimate.encoder_zero == pytest.approx(3.0 * sign, abs=1e-3)
    estimate = fusion.encoder(EncoderReading(0.042, 3.0 * sign))
    assert estimate.readings.pendulum_angle == pytest.approx(0.0, abs=1e-3)
    assert fusion.jumps == 19


@pytest.mark.parametrize('period', [0.005, 0.01])
def test_at_a_low_rate_five_readings_must_agree(period):
    fusion = started()
    for number in range(1, 7):
        assert fusion.rezeroed == (number > max(5, 1 + 0.0175 / period))
        fusion.encoder(EncoderReading(period * number, 3.0))


# Invalid and diverging inputs

@pytest.mark.parametrize('values', [
    (math.nan, 0.0), (0.1, math.inf, 0.0), (0.1, 0.0, math.nan)])
def test_an_encoder_reading_that_is_not_finite_is_refused_without_effect(values):
    fusion = started()
    before = fusion.estimate
    with refused('not_finite', error=MessageError):
        fusion.encoder(EncoderReading(*values))
    assert fusion.estimate is before


@pytest.mark.parametrize('torque', [1e4, -1e4])
def test_a_diverged_estimate_is_dropped_and_restarts_at_rest(torque):
    fusion = started(3.0)
    fusion.imu(upright(0.0))
    fusion.encoder(EncoderReading(0.002, 9.0))
    with pytest.raises(EstimateLostError) as caught:
        for number in range(2, 100):
            fusion.encoder(EncoderReading(0.002 * number, 3.0, torque))
    assert caught.value.reason == 'diverged'
    assert fusion.estimate is None and fusion.jumps > 0
    again = fusion.encoder(EncoderReading(0.5, 3.3))
    assert again.readings.pendulum_angle == 0.0 and again.encoder_zero == 3.3


@pytest.mark.parametrize('rate, lost', [
    (299.5, False), (300.5, True), (-299.5, False), (-300.5, True)])
def test_a_rate_above_three_hundred_radians_per_second_is_a_divergence(rate, lost):
    def found(fusion, torque):
        """Return whether the estimate is lost after a reading that is rejected as a jump."""
        try:
            return fusion.encoder(EncoderReading(0.001, 9.0, torque)) is None
        except EstimateLostError:
            return True

    pendulum, _ = RollingModel(GIMBALL).response(0.0, 1.0, -1.0)
    assert found(started(), rate / (0.001 * pendulum)) == lost
    fusion = started(tuning=FilterTuning(gyro_sd=1e-3, bias_sd=1e-3, ball_noise_with_imu=1e6))
    fusion.imu(upright(0.001, rate))
    assert found(fusion, 0.0) == lost


def test_an_angle_uncertain_by_half_a_turn_is_not_an_estimate():
    fusion = started(tuning=FilterTuning(start_sd=3.2, encoder_sd=10.0))
    with pytest.raises(EstimateLostError):
        fusion.encoder(EncoderReading(1e-6, 0.0))
    fusion = started(tuning=FilterTuning(start_sd=3.1, encoder_sd=10.0))
    fusion.encoder(EncoderReading(1e-6, 0.0))
