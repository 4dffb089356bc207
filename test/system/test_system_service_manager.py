# SPDX-License-Identifier: Apache-2.0
"""A bridge that systemd runs: notifications from its start to its end."""
import signal
import socket
import time

from driving import Driving
import pytest
from waiting import TIMEOUT


@pytest.fixture
def systemd(tmp_path, monkeypatch):
    """Return the socket of a service manager with a watchdog of 1 s."""
    address = tmp_path / 'notify'
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as found:
        found.bind(str(address))
        found.settimeout(TIMEOUT)
        monkeypatch.setenv('NOTIFY_SOCKET', str(address))
        monkeypatch.setenv('WATCHDOG_USEC', '1000000')
        yield found


# Before the graph, whose processes get the environment at its creation.
def test_systemd_is_notified_of_start_watchdog_and_end_of_a_bridge(
        systemd, graph, motor, hardware):
    states = []
    deadline = time.monotonic() + TIMEOUT

    def receive():
        assert time.monotonic() < deadline, states
        states.append(systemd.recv(4096).decode())
    graph.start('bridge', hardware=hardware(), port=motor.path, control='direct')
    # Notifications come at 10 Hz: an e-stop that is released earlier is not reported.
    while 'STATUS=e-stop: engaged at start' not in states:
        receive()
    run = Driving(graph, motor)
    run.release()
    run.pull()
    # No commands are published while this test receives, so the commands may have timed out.
    released = {'STATUS=running', 'STATUS=commands timed out'}
    while not ('READY=1' in states and released & set(states) and states.count('WATCHDOG=1') > 3):
        receive()
    graph.end('bridge', signal.SIGTERM)
    while states[-1] != 'STOPPING=1':
        receive()
