# SPDX-License-Identifier: Apache-2.0
"""Watchdog and rate monitor."""
import math

import pytest
from refusals import refused

from ballbot_ros.control import RateMonitor, Watchdog
from ballbot_ros.errors import MessageError


def test_never_fed_is_expired_but_distinguishable_from_gone():
    watchdog = Watchdog(0.25)
    assert watchdog.expired(0.0) and not watchdog.fed
    watchdog.feed(1.0)
    assert not watchdog.expired(1.25) and watchdog.fed
    assert watchdog.expired(1.26) and watchdog.fed
    watchdog.reset()
    assert watchdog.expired(1.0) and not watchdog.fed


def test_silence_is_the_time_since_the_last_sign_of_life():
    watchdog = Watchdog(0.25)
    assert watchdog.silence(3.0) == math.inf and watchdog.timeout == 0.25
    watchdog.feed(1.0)
    assert watchdog.silence(1.2) == pytest.approx(0.2)
    assert not watchdog.expired(1.0)
    with pytest.raises(MessageError) as caught:
        watchdog.silence(math.inf)
    assert caught.value.reason == 'not_finite'


@pytest.mark.parametrize('fed, now', [(0.0, 1.0), (100.0, 0.0)])
def test_silence_and_a_clock_that_jumps_back_expire_until_fed_again(fed, now):
    watchdog = Watchdog(0.25)
    watchdog.feed(fed)
    assert watchdog.expired(now)
    watchdog.feed(now)
    assert not watchdog.expired(now + 0.1)


@pytest.mark.parametrize('timeout', [0.0, -1.0, math.nan, math.inf])
def test_a_watchdog_that_never_or_always_expires_is_refused(timeout):
    with refused('out_of_range', 'timeout'):
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


def test_repeated_stamps_count_once_and_a_jump_back_starts_again():
    monitor = RateMonitor()
    for stamp in (0.0, 0.0, 0.1, 0.1):
        monitor.add(stamp)
    assert monitor.period == pytest.approx(0.1)
    monitor.add(0.05)
    assert monitor.period is None


@pytest.mark.parametrize('fast, period', [(9, 1.0), (10, 0.55), (11, 0.1)])
def test_the_last_twenty_periods_count_unless_another_number_is_given(fast, period):
    monitor = RateMonitor()
    for index in range(30):
        monitor.add(float(index))
    for index in range(1, fast + 1):
        monitor.add(29.0 + 0.1 * index)
    assert monitor.period == pytest.approx(period)


def test_there_is_no_rate_before_there_are_stamps_enough():
    quick, patient = RateMonitor(), RateMonitor(5, least=4)
    for monitor, needed in ((quick, 2), (patient, 4)):
        for index in range(needed):
            assert monitor.rate is None
            monitor.add(0.5 * index)
        assert monitor.rate == pytest.approx(2.0)


@pytest.mark.parametrize('size, least', [(1, 1), (1, 2), (5, 1), (5, 6)])
def test_a_rate_of_one_stamp_or_of_more_than_are_kept_is_refused(size, least):
    with refused('out_of_range', 'least'):
        RateMonitor(size, least)


def test_two_stamps_make_a_rate():
    monitor = RateMonitor(2, least=2)
    for stamp in (0.0, 1.0, 1.5):
        monitor.add(stamp)
    assert monitor.rate == 2.0
