# SPDX-License-Identifier: Apache-2.0
"""A line to an emulated drive without a serial port, on a simulated clock."""
from ballbot_ros.drives.emulated_device import Device
from ballbot_ros.errors import LinkError


class MemoryLine:
    """
    Both ends of a line in memory; its clock advances while a driver waits.

    Replies of the device arrive after a delay [s].  `now` is the time [s], `plugged` whether the
    cable is connected; `waiting` has the replies in transit with their arrival times [s].
    """

    port = 'memory'

    def __init__(self, device: Device, delay: float = 0.0):
        self.device = device
        self.now = 0.0
        self.plugged = True
        self.waiting: list[tuple[float, bytes]] = []
        self._delay = delay

    def clock(self) -> float:
        """Return the time [s]."""
        return self.now

    def write(self, data: bytes) -> None:
        """Pass bytes to the drive and queue its reply; raise `LinkError` if unplugged."""
        self._check()
        self._reply(self.to_drive(data), always=True)

    def read(self) -> bytes:
        self._check()
        data = b''.join(reply for when, reply in self.waiting if when <= self.now)
        self.waiting = [item for item in self.waiting if item[0] > self.now]
        return data

    def wait(self, seconds: float, least: int = 1) -> bool:
        """Advance by at most a millisecond, and return whether a reply has arrived."""
        self._check()
        self.pass_time(min(seconds, 0.001))
        return any(when <= self.now for when, reply in self.waiting if reply)

    def pass_time(self, seconds: float) -> None:
        """Advance the clock of both ends."""
        self.now += seconds
        self.live()

    def live(self) -> None:
        """Run the drive up to now, and queue its unrequested data."""
        self.device.tick(self.now)
        self._reply(b'')

    def close(self) -> None:
        """Do nothing."""

    def to_drive(self, data: bytes) -> bytes:
        """Return the received part of written bytes; override it for a faulty line."""
        return data

    def from_drive(self, data: bytes) -> bytes:
        """Return the received part of a reply; see `to_drive`."""
        return data

    def _reply(self, data: bytes, always: bool = False) -> None:
        reply = self.device.receive(data, self.now)
        if reply or always:
            self.waiting.append((self.now + self._delay, self.from_drive(reply)))

    def _check(self) -> None:
        if not self.plugged:
            raise LinkError('the cable is out', 'gone', 'port')
