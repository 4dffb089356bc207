# SPDX-License-Identifier: Apache-2.0
"""The loop gets the scheduling that it requests, or an error names the cause and the remedy."""
import os
from pathlib import Path
import re
import resource
import subprocess
import sys
import threading

import pytest
from refusals import refused

from ballbot_ros.bridge import realtime
from ballbot_ros.bridge.realtime import Scheduling
from ballbot_ros.errors import ConfigurationError

# In a separate process, because the preparation affects all threads.
PREPARED = """
import os, threading, time
from ballbot_ros.bridge.realtime import NAME, Scheduling

ending, others = threading.Event(), []
before = threading.Thread(target=ending.wait)
before.start()
cpu = max(os.sched_getaffinity(0))
scheduling = Scheduling(20, cpu, True).prepared()
after = threading.Thread(target=ending.wait)
after.start()


def policy(thread):
    return os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority


def loop():
    scheduling.enter()
    assert policy(0) == (os.SCHED_FIFO, 20), policy(0)
    assert os.sched_getaffinity(0) == {cpu}
    with open(f'/proc/self/task/{threading.get_native_id()}/comm') as name:
        assert name.read().strip() == NAME


thread = threading.Thread(target=loop)
failed = []
threading.excepthook = failed.append
thread.start()
thread.join()
for other in (before, after, threading.main_thread()):
    assert policy(other.native_id) == (os.SCHED_FIFO, 19), policy(other.native_id)
    assert len(os.sched_getaffinity(other.native_id)) == len(os.sched_getaffinity(0))
with open('/proc/self/status') as status:
    locked = next(int(line.split()[1]) for line in status if line.startswith('VmLck:'))
assert locked > 1000, locked
ending.set()
assert not failed
"""

# The same system, with a user who has none of the permissions.
REFUSED = """
import os, resource, sys
from ballbot_ros.bridge.realtime import Scheduling
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
os.setuid(65534)
try:
    Scheduling({}).prepared()
except Exception as error:
    print(type(error).__name__, error)
assert os.sched_getscheduler(0) == os.SCHED_OTHER
"""


@pytest.mark.parametrize('permitted', [True, False])
def test_the_default_is_a_priority_if_the_system_permits_it(permitted, monkeypatch, caplog):
    given = []
    monkeypatch.setattr(realtime, 'permits', lambda priority: permitted)
    monkeypatch.setattr(realtime, '_set_priority', lambda thread, priority: given.append(priority))
    priority = realtime.DEFAULT_PRIORITY if permitted else 0
    assert Scheduling(-1).prepared() == Scheduling(priority)
    assert (priority in given) is permitted
    assert ('limits.d' in caplog.text) is not permitted


def may_use_realtime():
    """Return whether this process may have a real-time priority."""
    return subprocess.run(['chrt', '-f', '20', 'true'], capture_output=True).returncode == 0


def run(program):
    """Run a program and return what it prints."""
    done = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(not may_use_realtime(), reason='this user may not have real-time priority')
def test_the_loop_has_the_highest_priority_and_memory_is_locked():
    run(PREPARED)


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can become another user')
@pytest.mark.parametrize('asked, words', [
    ('priority=20', ('realtime_priority 20', 'RLIMIT_RTPRIO is 0', 'limits.d', 'LimitRTPRIO',
                     'docs/realtime.md')),
    ('lock_memory=True', ('lock_memory', '65536 bytes', 'limits.d', 'LimitMEMLOCK=infinity',
                          'docs/realtime.md'))])
def test_unavailable_scheduling_is_refused_with_the_remedy(asked, words):
    text = run(REFUSED.format(asked))
    assert text.startswith('ConfigurationError') and all(word in text for word in words), text


def test_an_unavailable_processor_is_refused_and_the_available_ones_are_named():
    with refused('unavailable', 'cpu', ConfigurationError) as raised:
        Scheduling(cpu=1023).prepared()
    assert re.search(rf'process, only .*\b{min(os.sched_getaffinity(0))}\b', str(raised.value))


def test_a_limit_on_locked_memory_counts_only_without_permission(monkeypatch):
    calls = []

    class Kernel:
        """A kernel that locks all memory."""

        @staticmethod
        def mlockall(flags):
            calls.append(flags)
            return 0

    def locked(limit, permitted):
        monkeypatch.setattr(resource, 'getrlimit', lambda _: (limit, limit))
        monkeypatch.setattr(realtime, '_may_lock', lambda: permitted)
        monkeypatch.setattr(realtime, '_libc', Kernel)
        calls.clear()
        try:
            Scheduling(lock_memory=True).prepared()
        except ConfigurationError:
            assert not calls
        return bool(calls)
    assert locked(resource.RLIM_INFINITY, permitted=False) and locked(65536, permitted=True)
    assert not locked(65536, permitted=False)


def test_nothing_is_requested_by_default(monkeypatch, caplog):
    caplog.set_level('INFO')
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, lambda *_: pytest.fail('requested'))
    names = []

    def loop():
        Scheduling().prepared().enter()
        names.append(Path('/proc/thread-self/comm').read_text().strip())
    thread = threading.Thread(target=loop)
    thread.start()
    thread.join()
    assert names == [realtime.NAME] and not caplog.records


def test_the_scheduling_is_described_in_words():
    assert Scheduling(20, 1, True).in_words == (
        'with real-time priority 20, on processor 1, its memory locked')
    assert Scheduling(cpu=0).in_words == (
        'without real-time priority, on processor 0, its memory not locked')
