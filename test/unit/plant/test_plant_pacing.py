# SPDX-License-Identifier: Apache-2.0
"""Pacing: never ahead of the clock, dropped periods are counted; rates must divide evenly."""
import math

from hypothesis import given, strategies
import pytest
from refusals import refused

from ballbot_ros.plant import Pace, periods_per, Speedometer


def test_nothing_is_due_at_the_start_and_then_one_per_period():
    pace = Pace(0.002, 1.0)
    assert pace.due(100.0) == 0
    assert [pace.due(100.0 + 0.002 * number + 1e-9) for number in range(1, 6)] == [1] * 5
    assert pace.due(100.010) == 0


@pytest.mark.parametrize('factor, due', [(0.5, 2), (1.0, 5), (2.0, 10)])
def test_the_factor_scales_simulated_time_per_wall_clock_time(factor, due):
    pace = Pace(0.002, factor)
    pace.due(0.0)
    assert pace.due(0.0101) == due


def test_periods_beyond_the_maximum_lag_are_dropped_and_counted():
    pace = Pace(0.002, 1.0, most=10)
    pace.due(0.0)
    assert pace.due(1.0001) == 10
    assert pace.dropped == 490
    assert pace.due(1.0021) == 1  # dropped periods are not caught up


def test_a_pause_is_not_caught_up():
    pace = Pace(0.002, 1.0)
    pace.due(0.0)
    pace.restart(50.0)
    assert pace.due(50.001) == 0 and pace.due(50.0041) == 2
    assert pace.dropped == 0


@pytest.mark.slow
@given(strategies.lists(strategies.floats(0.0, 0.5), min_size=1, max_size=60),
       strategies.floats(1e-4, 0.1), strategies.floats(0.1, 50.0))
def test_pace_never_runs_ahead_of_the_clock_and_counts_all_dropped_periods(gaps, period, factor):
    pace, now, done = Pace(period, factor), 10.0, 0
    pace.due(now)
    for gap in gaps:
        now += gap
        due = pace.due(now)
        assert 0 <= due <= 10
        done += due
        elapsed = (now - 10.0) * factor / period
        assert done + pace.dropped <= elapsed * (1 + 1e-9) + 1e-6
        assert done + pace.dropped > elapsed * (1 - 1e-9) - 1.0 - 1e-6


@pytest.mark.parametrize('slow, base, periods', [
    (100.0, 500.0, 5), (500.0, 500.0, 1), (0.1, 500.0, 5000), (250.0, 1000.0, 4),
    (30.0, 30.0, 1), (1.0 / 3.0, 1.0, 3)])
def test_a_rate_that_divides_the_base_rate_gives_its_number_of_periods(slow, base, periods):
    assert periods_per(slow, base, 'odom_rate') == periods


@pytest.mark.parametrize('slow, base, near', [
    (300.0, 500.0, ('250 Hz', '500 Hz')), (499.0, 500.0, ('250 Hz', '500 Hz')),
    (600.0, 500.0, ('250 Hz', '500 Hz')), (99.0, 500.0, ('83.3333 Hz', '100 Hz')),
    (0.3, 1.0, ('0.25 Hz', '0.333333 Hz'))])
def test_other_rates_are_refused_with_the_nearest_valid_rates(slow, base, near):
    with refused('inconsistent', 'odom_rate') as caught:
        periods_per(slow, base, 'odom_rate')
    for rate in near:
        assert rate in str(caught.value)
        periods_per(base / round(base / float(rate.split()[0])), base, 'odom_rate')


def test_speedometer_measures_over_its_window():
    meter = Speedometer(window=1.0)
    for tick in range(11):
        assert math.isnan(meter.factor)
        meter.note(0.05 * tick, 7.0 + 0.1 * tick + 1e-9 * tick)
    assert meter.factor == pytest.approx(0.5)
    for tick in range(1, 11):
        meter.note(0.5 + 0.2 * tick, 8.0 + 0.1 * tick + 1e-6)
    assert meter.factor == pytest.approx(2.0, rel=1e-3)


def test_speedometer_starts_again_when_time_goes_back():
    meter = Speedometer(window=1.0)
    for simulated, wall in ((5.0, 0.0), (5.5, 0.5), (0.0, 0.6), (0.4, 1.0), (0.9, 1.5)):
        meter.note(simulated, wall)
        assert math.isnan(meter.factor)
    meter.note(1.0, 1.6)
    assert meter.factor == pytest.approx(1.0)
