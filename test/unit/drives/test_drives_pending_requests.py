# SPDX-License-Identifier: Apache-2.0
"""Matching of replies to requests: no delay of replies makes a measurement stamp too new."""
from drive_bench import Bench, KINDS
import pytest
from tiers import pairs

from ballbot_ros.drives.driver import LARGEST_NUMBER, Match, PendingRequests

PERIOD, TIMEOUT = 0.002, 0.05


def pending(*kinds):
    """Return requests that were written once per period, starting at 0."""
    requests = PendingRequests(TIMEOUT)
    for number, kind in enumerate(kinds):
        requests.add(kind)
        requests.written(number * PERIOD, number * PERIOD)
    return requests


def test_a_reply_answers_the_oldest_request_of_its_kind_however_late_it_is_read():
    requests = pending(*'aaa')
    assert [requests.match('a', 0.01).measured for _ in range(3)] == [
        0.0, PERIOD, 2 * PERIOD]
    assert not requests


def test_a_lost_reply_makes_stamps_too_old_until_a_reply_of_another_kind():
    requests = pending(*'aabaa')
    assert requests.match('a', 0.01).measured == 0.0  # the reply to the second request
    assert requests.match('b', 0.01).measured == 2 * PERIOD
    assert requests.match('a', 0.01).measured == 3 * PERIOD
    assert requests.take_lost(0.01) == 1


def test_a_reply_that_names_its_request_is_never_taken_for_another():
    requests = pending(1, 2, 3)
    assert requests.match(2, 0.01).measured == PERIOD
    assert requests.match(1, 0.01) == Match()
    assert requests.match(3, 0.01).measured == 2 * PERIOD


def test_a_reply_to_no_request_has_no_time():
    assert pending().match('a', 1.0) == (-float('inf'), None)
    assert pending('b').match('a', 1.0).measured is None


def test_a_write_that_was_delayed_leaves_the_time_unknown():
    requests = PendingRequests(TIMEOUT)
    requests.add('a')
    assert requests and requests.kinds == {'a'}
    requests.written(0.0, 0.02)
    assert requests.match('a', 0.01) == (0.0, None)


def test_a_reply_after_the_timeout_is_not_a_measurement():
    assert pending('a').match('a', TIMEOUT).measured == 0.0
    assert pending('a').match('a', TIMEOUT + 1e-6) == (0.0, None)


def test_a_lost_reply_is_counted_once():
    requests = pending(*'aaa')
    assert requests.take_lost(0.0505) == 1
    assert requests.take_lost(0.06) == 2 and requests
    requests.clear()
    assert requests.take_lost(0.07) == 0 and not requests
    requests = pending(*'aab')
    requests.match('b', 0.01)
    assert requests.take_lost(0.01) == 2


def test_without_power_nothing_is_asked_while_replies_are_overdue():
    requests = pending(*'aa')
    assert requests.may_send(0.04, False) and not requests.may_send(0.06, False)
    requests.match('a', 0.06)
    assert not requests.may_send(0.15, False)  # the second reply may still arrive
    requests.match('a', 0.15)
    assert requests.may_send(0.15, False)


def test_without_power_requests_are_given_up_when_no_reply_arrives_any_more():
    requests = pending(*'aa')
    assert not requests.may_send(0.1, False)
    assert requests.may_send(0.12, False) and not requests
    assert requests.take_lost(0.12) == 2


def test_under_power_few_requests_may_be_pending_that_are_not_overdue():
    requests = pending(*'a' * LARGEST_NUMBER)
    assert requests.is_full and not requests.may_send(0.01, True)
    requests.match('a', 0.01)
    assert not requests.is_full and requests.may_send(0.01, True)
    requests = pending(*'a' * LARGEST_NUMBER)
    requests.take_lost(0.0505)
    assert requests.is_full and requests.may_send(0.0505, True)


def test_a_line_is_stalled_when_a_reply_is_overdue_and_nothing_was_sent_meanwhile():
    requests = pending(*'aa')
    assert not requests.is_stalled(0.0505)
    requests.take_lost(0.0505)
    assert requests.is_stalled(0.0505)
    requests.add('a')
    requests.written(0.0505, 0.0505)
    assert not requests.is_stalled(0.0525)


def test_named_requests_are_given_up_one_by_one():
    requests = PendingRequests(TIMEOUT, named=True)
    requests.add(1)
    requests.written(0.0, 0.0)
    assert requests.may_send(0.1, False) and requests.take_lost(0.1) == 1 and requests
    assert requests.take_lost(0.12) == 0 and not requests


class DelayedBench(Bench):
    """A bench whose drive turns at a constant speed, and whose replies are delayed."""

    speed = 5.0

    def pass_time(self, seconds):
        """Advance the rotation of the drive."""
        self.sense(position=self.speed * (self.now + seconds), velocity=self.speed)
        super().pass_time(seconds)

    def errors(self, latency, seconds, drop=lambda: False):
        """Return time, error of the stamp (positive: too new) and age of each measurement [s]."""
        found, last = [], self.driver.telemetry.time
        for _ in range(round(seconds / PERIOD)):
            self._delay = latency(self.now)
            if drop():
                self.waiting = self.waiting[:-1]
            self.pass_time(PERIOD)
            telemetry = self.driver.poll()
            if telemetry.time != last and telemetry.measured is not None:
                found.append((self.now, telemetry.measured - telemetry.position / self.speed,
                              self.now - telemetry.measured))
                last = telemetry.time
            self.driver.send_torque(0.0)
        return found


# The drive answers within its period; quantization makes a position slightly older.
ALLOWED = 0.0025


def bench_of(kind):
    """Return a bench with an armed drive, and the error of its stamps without latency [s]."""
    bench = DelayedBench(kind)
    bench.driver.identify()
    bench.driver.arm()
    offset = bench.errors(lambda now: 0.0009, 0.1)[-1][1]
    return bench, offset


@pytest.mark.parametrize('kind, latency', pairs(KINDS, [0.01, 0.03, 0.045]))
def test_a_constant_latency_is_in_the_stamps(kind, latency):
    bench, offset = bench_of(kind)
    errors = bench.errors(lambda now: latency, 1.0)
    assert len(errors) > 20
    assert all(abs(error - offset) < ALLOWED for _, error, _ in errors), max(
        abs(error - offset) for _, error, _ in errors)


def test_with_a_growing_latency_no_measurement_is_dated_too_new(kind):
    bench, offset = bench_of(kind)
    begin = bench.now
    found = bench.errors(lambda now: 0.0009 + 0.2 * (now - begin), 3.0)
    assert begin + 0.2 < found[-1][0] < begin + 0.4
    assert all(error - offset < ALLOWED for _, error, _ in found)


def test_lost_replies_do_not_shift_stamps_for_long(kind):
    bench, offset = bench_of(kind)
    dropped = iter([index % 40 == 7 for index in range(10**6)])
    errors = [abs(error - offset) for _, error, _ in bench.errors(
        lambda now: 0.0009, 2.0, lambda: next(dropped))]
    assert len(errors) > 500
    assert max(errors) < 0.02 and sorted(errors)[int(0.7 * len(errors))] < ALLOWED
