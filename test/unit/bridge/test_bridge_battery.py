# SPDX-License-Identifier: Apache-2.0
"""Voltage sag under load does not count as empty; an empty battery stops the drive gently."""
import math

from hypothesis import given, strategies as some
import pytest
from refusals import refused

from ballbot_ros.bridge.condition import Battery, BatteryWatch, SEEN
from ballbot_ros.errors import ConfigurationError

SIX_CELLS = Battery(full_voltage=25.2, low_voltage=21.6, empty_voltage=20.4, high_voltage=27.0,
                    resistance=0.2, smoothing=2.0, empty_time=5.0, fade_time=2.0)
EVERY = 0.05


def watch(voltage, seconds, current=0.0, before=BatteryWatch(), start=0.0, battery=SIX_CELLS):
    """Update the watch for some seconds with a voltage [V], constant or a function of time."""
    for number in range(1, round(seconds / EVERY) + 1):
        now = start + number * EVERY
        at = voltage(now) if callable(voltage) else voltage
        drawn = current(now) if callable(current) else current
        before = before.update(battery, at, drawn, now)
    return before


def test_the_first_reading_counts_immediately_and_later_ones_are_smoothed():
    first = watch(24.0, EVERY)
    assert first.voltage == 24.0
    later = watch(22.0, 2.0, before=first, start=EVERY)
    assert later.voltage == pytest.approx(22.0 + 2.0 * math.exp(-1.0), rel=1e-6)


def test_the_resistive_voltage_drop_is_added():
    assert watch(22.0, 1.0, current=10.0).voltage == pytest.approx(24.0)
    assert watch(26.0, 1.0, current=-10.0).voltage == pytest.approx(24.0)  # braking


def test_sag_under_load_is_neither_low_nor_empty():
    # 24 V at rest; 20 A for 4 s of every 8 s lowers the terminal voltage to 20 V.
    def load(now):
        return 20.0 if now % 8.0 < 4.0 else 0.0
    found = watch(lambda now: 24.0 - 0.2 * load(now), 60.0, load)
    assert not found.warnings(60.0) and found.part(SIX_CELLS, 60.0) == 1.0


def test_a_short_sag_is_smoothed_out_if_the_current_is_unknown():
    found = watch(lambda now: 20.0 if now % 8.0 < 1.0 else 24.0, 60.0, None)
    assert not found.warnings(60.0)


@pytest.mark.parametrize('nothing', (None, math.nan, math.inf, -math.inf, 0.0, -3.0))
def test_a_malformed_reading_changes_nothing(nothing):
    before = watch(24.0, 1.0)
    assert watch(nothing, 20.0, before=before, start=1.0) == before


@pytest.mark.parametrize('nothing', (None, math.nan, math.inf, -math.inf))
def test_an_invalid_current_counts_as_zero(nothing):
    assert watch(24.0, 1.0, nothing) == watch(24.0, 1.0)


def test_nothing_is_reported_before_the_first_voltage_reading():
    unread = BatteryWatch()
    assert not unread.warnings(1e6) and unread.part(SIX_CELLS, 1e6) == 1.0
    assert not unread.stop(SIX_CELLS, 1e6) and math.isnan(unread.percentage(SIX_CELLS))


def test_a_low_battery_is_reported_and_does_not_flicker():
    low = watch(21.5, 1.0)
    assert low.warnings(1.0) == ('battery_low',)
    assert watch(21.7, 30.0, before=low, start=1.0).low
    assert not watch(22.0, 30.0, before=low, start=1.0).low
    assert not watch(21.7, 30.0).low
    assert low.part(SIX_CELLS, 100.0) == 1.0


def test_an_empty_battery_fades_the_torque_after_empty_time_and_then_stops():
    found = watch(20.0, 4.9)
    assert found.part(SIX_CELLS, 4.9) == 1.0 and 'battery_empty' not in found.warnings(4.9)
    found = watch(20.0, 1.0, before=found, start=4.9)
    assert found.fading_since == pytest.approx(5.05, abs=0.06)
    assert found.part(SIX_CELLS, found.fading_since + 0.5) == pytest.approx(0.75)
    assert not found.stop(SIX_CELLS, found.fading_since + 1.9)
    stop = found.stop(SIX_CELLS, found.fading_since + 2.0)
    assert '20.0 V' in stop and 'empty_voltage is 20.4 V' in stop and 'charge it' in stop
    assert found.warnings(6.0) == ('battery_empty', 'battery_low')


def test_a_recovery_restarts_the_empty_time():
    found = watch(lambda now: 24.0 if 4.0 < now < 8.0 else 20.0, 12.0)
    assert found.fading_since == math.inf


def test_an_empty_battery_that_recovers_at_rest_stays_empty_until_it_is_charged():
    empty = watch(20.0, 10.0)
    rested = watch(21.0, 60.0, before=empty, start=10.0)
    assert rested.stop(SIX_CELLS, 70.0)
    charged = watch(24.0, 60.0, before=rested, start=70.0)
    assert not charged.stop(SIX_CELLS, 130.0) and not charged.warnings(130.0)
    assert charged.part(SIX_CELLS, 130.0) == 1.0


def test_without_a_fade_time_the_torque_ends_immediately():
    battery = Battery(empty_voltage=20.4, fade_time=0.0)
    found = watch(20.0, 6.0, battery=battery)
    assert found.part(battery, found.fading_since) == 0.0
    assert found.stop(battery, found.fading_since)


def test_a_short_spike_above_high_voltage_is_reported_for_long_enough_to_be_seen():
    found = watch(24.0, 1.0).update(SIX_CELLS, 27.5, -15.0, 1.05)
    after = watch(24.0, 1.0, before=found, start=1.05)
    assert after.warnings(1.05 + 0.9 * SEEN) == ('over_voltage',)
    assert not after.warnings(1.05 + 1.1 * SEEN)


def test_a_limit_that_is_not_given_is_not_monitored():
    found = watch(1.0, 100.0, battery=Battery())
    assert not found.warnings(100.0) and not found.stop(Battery(), 100.0)
    assert math.isnan(found.percentage(Battery()))


def test_the_percentage_is_clamped_between_empty_and_full():
    for voltage, part in ((25.2, 1.0), (22.8, 0.5), (20.4, 0.0), (30.0, 1.0), (10.0, 0.0)):
        assert watch(voltage, EVERY).percentage(SIX_CELLS) == pytest.approx(part)


@given(some.lists(some.tuples(
    some.floats(0.0, 3.0), some.none() | some.floats(), some.none() | some.floats())))
def test_the_torque_fraction_stays_between_zero_and_one_for_any_report(reports):
    found, now = BatteryWatch(), 0.0
    for pause, voltage, current in reports:
        now += pause
        found = found.update(SIX_CELLS, voltage, current, now)
        assert 0.0 <= found.part(SIX_CELLS, now) <= 1.0
        assert not math.isnan(found.time)


@pytest.mark.parametrize('changes', [
    {'empty_voltage': 21.0, 'low_voltage': 21.0}, {'low_voltage': 25.0, 'full_voltage': 24.0},
    {'empty_voltage': 26.0, 'full_voltage': 25.0}, {'full_voltage': 25.0, 'high_voltage': 24.0},
    {'empty_voltage': 26.0, 'high_voltage': 25.0}])  # the error names the first key
def test_voltages_in_the_wrong_order_are_refused(changes):
    with refused('inconsistent', next(iter(changes)), ConfigurationError):
        Battery(**changes)
