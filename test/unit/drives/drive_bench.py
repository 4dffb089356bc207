# SPDX-License-Identifier: Apache-2.0
"""A driver, and a drive at the other end of a line in memory."""
from dataclasses import replace
import json
from pathlib import Path
import tempfile

from ballbot_ros.drives import device_class, open_driver, read_options
from ballbot_ros.drives.emulated_device import DriveSettings
from ballbot_ros.drives.memory_line import MemoryLine

# Protocol, and firmware if several are supported.
KINDS = ('odrive 0.5', 'odrive 0.6', 'odrive_can 0.5', 'odrive_can 0.6', 'roboclaw', 'vesc',
         'vesc_can')
# Transit time of a reply [s]; the longest one of an ODrive takes less at 921600 baud.
LINE_TIME = 0.0009


FOLDER = tempfile.TemporaryDirectory(prefix='ballbot_endpoints')


def confirmed_options(device):
    """Return the options for values that a drive does not report over its line."""
    if device.protocol != 'odrive_can':
        return {}
    if device.settings.firmware == '0.6':
        path = Path(FOLDER.name) / 'flat_endpoints.json'
        path.write_text(json.dumps(device.endpoints()))
        return {'endpoints': str(path)}
    return {'firmware': '0.5.6', 'confirmed': dict(device.properties)}


class Bench(MemoryLine):
    """A line with a drive and a driver; the kind is one of `KINDS`."""

    def __init__(self, kind, settings=None, **options):
        protocol, _, firmware = kind.partition(' ')
        super().__init__(device_class(protocol)(
            replace(settings or DriveSettings(), firmware=firmware)), LINE_TIME)
        self.driver = open_driver(
            protocol, self, read_options(protocol, {
                'torque_limit': 0.1, **confirmed_options(self.device), **options}, 'test'),
            self.clock)

    def sense(self, **changes):
        """Change measurements of the drive."""
        self.device.sensed = self.device.sensed._replace(**changes)

    def settings(self):
        """Return the settings that the driver reads back, by name."""
        return {item.name: item for item in self.driver.read_settings()}

    def refused(self):
        """Return the settings that are not acceptable, by name."""
        return {name: item for name, item in self.settings().items() if not item.acceptable}

    def sent(self):
        """Return a list that records the further writes of the driver."""
        kept = []
        self.to_drive = lambda data: kept.append(data) or data
        return kept

    def cycles(self, number, torque=0.0, period=0.002):
        """Run control periods, with requests only if `torque` is None; return the telemetry."""
        for _ in range(number):
            self.pass_time(period)
            self.driver.poll()
            if torque is None:
                self.driver.ask()
            else:
                self.driver.send_torque(torque)
        return self.driver.poll()
