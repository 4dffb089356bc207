# SPDX-License-Identifier: Apache-2.0
"""Watchdog and rate monitor."""
import math

import pytest

from ballbot_ros.control import RateMonitor, Watchdog
from ballbot_ros.errors import ConfigurationError, MessageError


def test_never_fed_is_expired_but_distinguishable_from_gone():
    watchdog = Watchdog(0.25)
    assert watchdog.expired(0.0) and not watchdog.fed
    watchdog.feed(1.0)
    assert not watchdog.expired(1.25) and watchdog.fed
    assert watchdog.expired(1.26) and watchdog.fed
    watchdog.reset()
    assert watchdog.expired(1.0) and not watchdog.fed


def test_feeding_revives():
    watchdog = Watchdog(0.25)
    watchdog.feed(0.0)
    assert watchdog.expired(1.0)
    watchdog.feed(1.0)
    assert not watchdog.expired(1.1)


def test_clock_that_jumps_back_expires_until_fed_again():
    watchdog = Watchdog(0.25)
    watchdog.feed(100.0)
    assert watchdog.expired(0.0)
    watchdog.feed(0.0)
    assert not watchdog.expired(0.1)


@pytest.mark.parametrize('timeout', [0.0, -1.0, math.nan, math.inf])
def test_watchdog_that_never_or_always_barks_is_refused(timeout):
    with pytest.raises(ConfigurationError, match='more than 0 s'):
        Watchdog(timeout)


def test_time_must_be_finite():
    with pytest.raises(MessageError):
        Watchdog(1.0).feed(math.nan)
    with pytest.raises(MessageError):
        RateMonitor().add(math.inf)


def test_rate_is_the_median():
    monitor = RateMonitor(11)
    assert monitor.period is None and monitor.rate is None
    for index in range(20):
        monitor.add(0.01 * index + (0.5 if index > 14 else 0.0))
    assert monitor.period == pytest.approx(0.01)
    assert monitor.rate == pytest.approx(100.0)


def test_repeated_stamps_count_once_and_a_jump_back_starts_anew():
    monitor = RateMonitor()
    for stamp in (0.0, 0.0, 0.1, 0.1):
        monitor.add(stamp)
    assert monitor.period == pytest.approx(0.1)
    monitor.add(0.05)
    assert monitor.period is None


def test_rate_of_one_stamp_is_refused():
    with pytest.raises(ConfigurationError, match='at least 2'):
        RateMonitor(1)
