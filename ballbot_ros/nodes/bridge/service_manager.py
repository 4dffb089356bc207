# SPDX-License-Identifier: Apache-2.0
"""
Notifications to systemd: ready, watchdog, stopping, and why the motor has no power.

The protocol is that of sd_notify(3): datagrams to the socket in the environment.  A process that
systemd did not start has no such socket and sends nothing.
"""
from contextlib import suppress
import os
import socket
from typing import Optional

from ballbot_ros.bridge.loop import Loop
from ballbot_ros.bridge.session import Report, Session
from ballbot_ros.clock import steady_time
from ballbot_ros.nodes.bridge.health import summary

# Watchdog messages per watchdog timeout of systemd.
MESSAGES_PER_TIMEOUT = 4.0


class ServiceManager:
    """
    Sends the state of the bridge to the service manager.

    Watchdog messages require that both the executor, which calls `notify`, and the loop, which
    calls `beat`, are running, so a stall of either one is detected.
    """

    def __init__(self) -> None:
        address = os.environ.get('NOTIFY_SOCKET', '')
        # An abstract address begins with a zero byte, which the environment cannot hold.
        self._address = '\0' + address[1:] if address.startswith('@') else address
        self._socket: Optional[socket.socket] = None
        if address:
            self._socket = socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._every, self._next = _watchdog() / MESSAGES_PER_TIMEOUT, 0.0
        self._beats = self._seen = 0
        self._status = ''

    def ready(self) -> None:
        self._notify('READY=1')

    def stopping(self) -> None:
        self._notify('STOPPING=1')

    def beat(self, _: Report) -> None:
        """Record a completed period of the loop; called in its thread."""
        self._beats += 1

    def notify(self, session: Session, loop: Optional[Loop], failure: object = None) -> None:
        """Send the state and, while the loop runs, a watchdog message; to be called at 10 Hz."""
        if self._socket is None:
            return
        _, status = summary(session, loop)
        # Retry a message that a full queue has rejected.
        if status != self._status and self._notify(f'STATUS={status}'):
            self._status = status
        now = steady_time()
        # Before configure there is no loop: a timer searches for a missing drive.
        if self._every > 0.0 and now >= self._next and failure is None \
                and (loop is None or self._beats != self._seen):
            self._next, self._seen = now + self._every, self._beats
            self._notify('WATCHDOG=1')

    def _notify(self, line: str) -> bool:
        """Send a line and return whether it was accepted, without blocking."""
        if self._socket is not None:
            with suppress(OSError):
                self._socket.sendto(line.encode(), self._address)
                return True
        return False


def _watchdog() -> float:
    """Return the watchdog timeout of systemd [s], 0 for none."""
    if os.environ.get('WATCHDOG_PID', str(os.getpid())) != str(os.getpid()):
        return 0.0  # meant for another process
    try:
        return max(0.0, 1e-6 * int(os.environ.get('WATCHDOG_USEC', '0')))
    except ValueError:
        return 0.0
