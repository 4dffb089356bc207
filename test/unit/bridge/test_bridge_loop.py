# SPDX-License-Identifier: Apache-2.0
"""The loop keeps its rate, publishes its reports, and closes the session in every case."""
import threading
import time
from typing import NamedTuple, Optional

import pytest
from waiting import wait_until

from ballbot_ros.bridge import loop as loop_module
from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.observer import SessionObserver

RATE = 100.0
TIMEOUT = 20.0  # on a busy machine [s]


class Tick(NamedTuple):
    """A report that is identified by the number of its period."""

    number: int
    estimate: Optional[str] = None


class SimulatedTime:
    """Time that advances only when a loop or a test sleeps."""

    now = 0.0

    def clock(self):
        """Return the time [s]."""
        return self.now

    def sleep(self, seconds):
        """Advance the time, and yield to other threads."""
        time.sleep(0.0001)
        self.now += seconds


TIME = SimulatedTime()


@pytest.fixture(autouse=True)
def simulated_time(monkeypatch):
    """Let the loop sleep in simulated time."""
    monkeypatch.setattr(loop_module, 'sleep', TIME.sleep)


class FakeSession:
    """A session that records its calls."""

    clock, observer = TIME.clock, SessionObserver()

    def __init__(self):
        self.ticks, self.waits, self.closed = [], [], 0
        self.expecting, self.on_tick, self.answer, self.estimate = False, None, None, None
        self.ticked = threading.Event()

    def tick(self):
        """Return the estimate of a late reply."""
        self.ticks.append(self.clock())
        if self.on_tick is not None:
            self.on_tick()
        if len(self.ticks) >= 20:
            self.ticked.set()
        return self.estimate

    def await_answer(self, timeout):
        """Return the answer once per period."""
        self.waits.append(timeout)
        self.expecting = False
        return self.answer

    def report(self, estimate):
        """Return a report with the number of its period; None in the first."""
        return None if len(self.ticks) == 1 else Tick(len(self.ticks), estimate)

    def close(self):
        """Count the call."""
        self.closed += 1


def run(session, publish=lambda report: None, rate=RATE):
    """Run a loop for twenty ticks, and end it."""
    loop = Loop(session, rate, publish)
    assert session.ticked.wait(TIMEOUT)
    was_running = loop.running
    loop.end()
    assert was_running and not loop.running
    return loop


def test_it_ticks_at_its_rate_and_not_faster():
    session = FakeSession()
    run(session)
    assert session.ticks[19] - session.ticks[0] == pytest.approx(19.0 / RATE)


def test_each_report_is_published_and_nothing_else():
    session, seen = FakeSession(), []
    run(session, seen.append)
    assert seen[:19] == [Tick(number) for number in range(2, 21)]


def test_an_expected_answer_is_awaited_until_the_next_period_and_published():
    session, seen = FakeSession(), []
    session.answer = 'answer'
    session.on_tick = lambda: setattr(session, 'expecting', True)
    run(session, seen.append)
    assert [report.estimate for report in seen] == ['answer'] * len(seen)
    assert all(0.0 < timeout < 1.01 / RATE for timeout in session.waits)


def test_a_period_has_one_report_unless_a_measurement_arrives_late():
    for late in (None, 'late'):
        session, seen = FakeSession(), []
        session.answer, session.estimate = 'answer', late
        session.on_tick = lambda: setattr(session, 'expecting', True)
        run(session, seen.append)
        reports = [Tick(number, estimate) for number in range(2, 21)
                   for estimate in filter(None, (late, 'answer'))]
        assert seen[:len(reports)] == reports or seen == reports[:-1]


def test_without_an_expected_answer_there_is_no_wait():
    session = FakeSession()
    run(session)
    assert not session.waits


def test_missed_periods_are_counted_and_not_made_up_for():
    session = FakeSession()
    slow = iter([0.105])
    session.on_tick = lambda: TIME.sleep(next(slow, 0.0))
    loop = run(session)
    assert loop.late == 10  # those that were due during the delay
    assert session.ticks[19] - session.ticks[0] == pytest.approx(0.105 + 18.0 / RATE)


def test_end_closes_the_session_and_may_be_called_twice():
    session = FakeSession()
    loop = run(session)
    assert session.closed >= 1 and loop.failure is None
    loop.end()
    ticks = len(session.ticks)
    time.sleep(3.0 / RATE)
    assert len(session.ticks) == ticks


def test_a_tick_that_hangs_does_not_keep_the_session_open(monkeypatch):
    monkeypatch.setattr(loop_module, 'JOIN_TIMEOUT', 0.1)
    session, released = FakeSession(), threading.Event()
    session.on_tick = lambda: released.wait(TIMEOUT)
    loop = Loop(session, RATE, lambda report: None)
    loop.end()
    assert loop.running and session.closed == 1
    released.set()


@pytest.mark.parametrize('where', ['tick', 'publish'])
def test_any_error_closes_the_session_and_is_kept(where):
    session, error = FakeSession(), ZeroDivisionError('planted')

    def fail(*_):
        raise error
    if where == 'tick':
        session.on_tick = fail
    loop = Loop(session, RATE, fail)
    wait_until(lambda: not loop.running)
    assert loop.failure is error and session.closed == 1


def test_the_loop_does_not_keep_the_process_alive():
    session = FakeSession()
    loop = Loop(session, RATE, lambda report: None)
    thread, = (each for each in threading.enumerate() if each.name == 'motor loop')
    assert thread.daemon
    loop.end()


def test_a_loop_that_misses_periods_reports_the_scheduling():
    session = FakeSession()
    loop = Loop(session, RATE, lambda report: TIME.sleep(0.05))
    assert session.ticked.wait(TIMEOUT)
    delayed = loop.delayed()
    loop.end()
    assert 'the machine delays the loop' in delayed and 'without real-time priority' in delayed
