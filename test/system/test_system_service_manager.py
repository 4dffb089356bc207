# SPDX-License-Identifier: Apache-2.0
"""A bridge that systemd has started, from its start to its end."""
import signal
import socket
import time

from driving import Driving
import pytest
from waiting import TIMEOUT


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    """Return the socket of a service manager that waits a second for a sign of life."""
    address = tmp_path / 'notify'
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as found:
        found.bind(str(address))
        found.settimeout(TIMEOUT)
        monkeypatch.setenv('NOTIFY_SOCKET', str(address))
        monkeypatch.setenv('WATCHDOG_USEC', '1000000')
        yield found


# Before the graph, whose processes have the environment of its beginning.
def test_systemd_is_notified_of_the_start_the_life_and_the_end_of_a_bridge(
        systemd, graph, motor, hardware):
    states = []
    deadline = time.monotonic() + TIMEOUT

    def receive():
        assert time.monotonic() < deadline, states
        states.append(systemd.recv(4096).decode())
    graph.start('bridge', hardware=hardware(), port=motor.path, control='direct')
    # It is notified ten times a second: an e-stop that is released sooner is not reported.
    while 'STATUS=e-stop: engaged at start' not in states:
        receive()
    run = Driving(graph, motor)
    run.release()
    run.pull()
    # There are no commands while this test listens, so that it may have timed out by then.
    released = {'STATUS=running', 'STATUS=commands timed out'}
    while not ('READY=1' in states and released & set(states) and states.count('WATCHDOG=1') > 3):
        receive()
    graph.end('bridge', signal.SIGTERM)
    while states[-1] != 'STOPPING=1':
        receive()
