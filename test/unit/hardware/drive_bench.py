# SPDX-License-Identifier: Apache-2.0
"""A drive at the other end of a line that is nothing but memory, with a clock of its own."""
from ballbot_ros.emulator.device import DriveSettings
from ballbot_ros.emulator.odrive import ODriveDevice
from ballbot_ros.emulator.roboclaw import RoboClawDevice
from ballbot_ros.emulator.vesc import VescDevice
from ballbot_ros.hardware.drivers import open_driver, read_options

DEVICES = {'odrive': ODriveDevice, 'roboclaw': RoboClawDevice, 'vesc': VescDevice}


class Bench:
    """
    A device, a line to it and a driver on the line; time passes while the driver waits.

    `to_drive` and `from_drive` may be replaced by functions that change the bytes on the way.
    """

    port = 'bench'

    def __init__(self, protocol, settings=None, **options):
        self.now = 0.0
        self.device = DEVICES[protocol](settings or DriveSettings())
        self.to_drive = self.from_drive = lambda data: data
        self.waiting = b''
        self.driver = open_driver(
            protocol, self, read_options(protocol, {'torque_limit': 0.1, **options}, 'test'),
            clock=lambda: self.now)

    def write(self, data):
        """Give bytes to the device and keep its reply."""
        reply = self.device.receive(self.to_drive(data), self.now)
        self.waiting += self.from_drive(reply)

    def read(self):
        """Return what waits."""
        data, self.waiting = self.waiting, b''
        return data

    def wait(self, seconds):
        """Let a millisecond pass."""
        self.pass_time(min(seconds, 0.001))
        return bool(self.waiting)

    def pass_time(self, seconds):
        """Let time pass for drive and driver."""
        self.now += seconds
        self.device.tick(self.now)

    def cycles(self, number, torque=0.0, period=0.002):
        """Run control periods and return the last telemetry."""
        for _ in range(number):
            self.pass_time(period)
            self.driver.poll()
            self.driver.send_torque(torque)
        return self.driver.poll()
