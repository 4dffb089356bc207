# SPDX-License-Identifier: Apache-2.0
"""The measured rate of the joint states."""
import pytest

from ballbot_ros.control.supervised import LEAST_PERIODS, RATE_PERIODS, RateMonitor


def monitored(*stamps):
    """Return a monitor that has received the stamps."""
    monitor = RateMonitor()
    for stamp in stamps:
        monitor.add(stamp)
    return monitor


@pytest.mark.parametrize('number', [11, 12, 20, 40])
def test_the_rate_is_the_inverse_of_the_median_period(number):
    late = [0.01 * index + (0.5 if index > number - 4 else 0.0) for index in range(number)]
    assert monitored(*late).rate == pytest.approx(100.0)


def test_repeated_stamps_count_once_and_a_backward_jump_resets_the_monitor():
    stamps = [0.1 * (index // 2) for index in range(2 * LEAST_PERIODS + 2)]
    assert monitored(*stamps).rate == pytest.approx(10.0)
    assert monitored(*stamps[:-2]).rate is None
    assert monitored(*stamps, 0.05).rate is None
    again = [0.05 + 0.2 * index for index in range(LEAST_PERIODS + 1)]
    assert monitored(*stamps, *again).rate == pytest.approx(5.0)


@pytest.mark.parametrize('fast, period', [(9, 1.0), (10, 0.55), (11, 0.1)])
def test_only_the_last_periods_count(fast, period):
    stamps = [float(index) for index in range(RATE_PERIODS + 10)]
    stamps += [stamps[-1] + 0.1 * index for index in range(1, fast + 1)]
    assert monitored(*stamps).rate == pytest.approx(1.0 / period)
