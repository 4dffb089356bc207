# SPDX-License-Identifier: Apache-2.0
"""Times of measurement from randomly delayed arrivals."""
from hypothesis import given, strategies as some
import numpy as np
import pytest

from ballbot_ros.imus.source import ArrivalClock, LOST_PERIODS

PERIOD = 0.005
lateness = some.lists(some.floats(0.0, 3.0 * PERIOD), min_size=1, max_size=200)


def stamps(late, period=PERIOD, clock=1.0):
    """Return true times of sending, arrival times, and estimated times of sending [s]."""
    sent = period * clock * np.arange(len(late)) + 100.0
    arrivals = np.maximum.accumulate(sent + np.array(late))
    found = ArrivalClock(period)
    return sent, arrivals, np.array([found.sent(arrival) for arrival in arrivals.tolist()])


@given(lateness)
def test_a_stamp_is_never_later_than_its_arrival_nor_earlier_than_the_previous_stamp(late):
    _, arrivals, found = stamps(late)
    assert np.all(found <= arrivals + 1e-9) and np.all(np.diff(found) >= 0.0)


def test_punctual_readings_are_stamped_with_their_arrival():
    sent, _, found = stamps([0.0] * 50)
    assert found == pytest.approx(sent)


def test_stamps_of_a_burst_are_evenly_spaced():
    # A USB adapter delivers the received bytes every 16 ms.
    sent = PERIOD * np.arange(2000)
    arrivals = np.ceil(sent / 0.016) * 0.016
    clock = ArrivalClock(PERIOD)
    found = np.array([clock.sent(arrival) for arrival in arrivals.tolist()])
    assert np.abs(found - sent)[200:].max() < 0.002 < np.abs(arrivals - sent).max()
    assert np.abs(np.diff(found))[200:].max() < 1.1 * PERIOD


def test_a_late_reading_does_not_shift_other_stamps():
    late = [0.0] * 100
    late[50] = 2.0 * PERIOD
    sent, _, found = stamps(late)
    assert np.abs(found - sent).max() < 0.05 * PERIOD


@pytest.mark.parametrize('clock', (0.995, 0.999, 1.0, 1.001, 1.005))
def test_the_drift_of_a_clock_is_followed(clock):
    generator = np.random.default_rng(1)
    sent, _, found = stamps(generator.exponential(0.0005, 4000), clock=clock)
    assert np.abs(found - sent)[500:].max() < 0.002


def test_the_estimate_restarts_after_a_gap():
    clock = ArrivalClock(PERIOD)
    clock.sent(1.0)
    assert clock.sent(1.0 + (LOST_PERIODS + 2.0) * PERIOD) == 1.0 + (LOST_PERIODS + 2.0) * PERIOD
