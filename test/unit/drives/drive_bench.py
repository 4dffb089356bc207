# SPDX-License-Identifier: Apache-2.0
"""A drive at the other end of a line that is nothing but memory, with a clock of its own."""
from dataclasses import replace

from ballbot_ros.drives import device_class, open_driver, read_options
from ballbot_ros.drives.emulated_device import DriveSettings

# Protocol, and the firmware where that makes a difference.
KINDS = ('odrive 0.5', 'odrive 0.6', 'roboclaw', 'vesc')
# How long a reply is under way [s]; the longest of an ODrive takes less at its 921600 baud.
LINE_TIME = 0.0009


class Bench:
    """
    A device, a line to it and a driver on the line; time passes while the driver waits.

    `to_drive` and `from_drive` may be replaced by functions that change the bytes on the way.
    The kind is one of `KINDS`.
    """

    port = 'bench'

    def __init__(self, kind, settings=None, **options):
        protocol, _, firmware = kind.partition(' ')
        self.now = 0.0
        self.device = device_class(protocol)(
            replace(settings or DriveSettings(), firmware=firmware))
        self.to_drive = self.from_drive = lambda data: data
        self.waiting = []  # when it has arrived, what
        self.driver = open_driver(
            protocol, self, read_options(protocol, {'torque_limit': 0.1, **options}, 'test'),
            clock=lambda: self.now)

    def write(self, data):
        """Give bytes to the device and keep its reply, which takes its time on the line."""
        reply = self.from_drive(self.device.receive(self.to_drive(data), self.now))
        self.waiting.append((self.now + LINE_TIME, reply))

    def read(self):
        """Return what has arrived."""
        data = b''.join(reply for when, reply in self.waiting if when <= self.now)
        self.waiting = [item for item in self.waiting if item[0] > self.now]
        return data

    def wait(self, seconds):
        """Let a millisecond pass."""
        self.pass_time(min(seconds, 0.001))
        return any(when <= self.now for when, _ in self.waiting)

    def pass_time(self, seconds):
        """Let time pass for drive and driver."""
        self.now += seconds
        self.device.tick(self.now)

    def cycles(self, number, torque=0.0, period=0.002):
        """Run control periods, of requests only if no torque is given; return the telemetry."""
        for _ in range(number):
            self.pass_time(period)
            self.driver.poll()
            if torque is None:
                self.driver.ask()
            else:
                self.driver.send_torque(torque)
        return self.driver.poll()
