# SPDX-License-Identifier: Apache-2.0
"""Measure the data loss on a link with random bytes, in simulated time."""
import random

from ballbot_ros.drives import device_class, driver_class, DRIVES, open_driver
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.emulator.ball import settings_for
from ballbot_ros.emulator.line import Direction, LineFaults
from ballbot_ros.physics.simulation.scene import load_scene

GARBAGE = 2000.0  # random bytes per second, in each direction
RATE, SECONDS = 500.0, 20.0
TICK = 1e-4  # polling period of the drive [s]
# Number of the latest periods whose positions count as correct.
RECENT = 50


class FloodedLine(MemoryLine):
    """A link in simulated time, with a drive at its other end and random bytes."""

    def __init__(self, device, baud):
        super().__init__(device)
        rng = random.Random(7)
        device.baud = baud
        self.directions = (Direction(baud, rng), Direction(baud, rng))

    def flood(self, rate):
        """Insert random bytes at a rate [1/s], in each direction."""
        for direction in self.directions:
            direction.faults = LineFaults(garbage=rate)

    def write(self, data):
        """Send to the drive."""
        self.directions[0].put(data, self.now)

    def read(self):
        """Return the bytes that have arrived."""
        return self.directions[1].take(self.now)

    def pass_time(self, seconds):
        """Advance drive and link."""
        end = self.now + seconds - 0.5 * TICK
        while self.now < end:
            self.now += TICK
            self.device.tick(self.now)
            reply = self.device.receive(self.directions[0].take(self.now), self.now)
            self.directions[1].put(reply, self.now + self.device.turnaround)


def flood(protocol, firmware):
    """Return the fractions of periods with a new and with a wrong position [%]."""
    settings = settings_for(load_scene('flat').model.robot, firmware=firmware)
    baud = max(driver_class(protocol).baud_rates)
    line = FloodedLine(device_class(protocol)(settings), baud)
    driver = open_driver(protocol, line, driver_class(protocol).Options(
        torque_limit=settings.torque_limit), line.clock)
    driver.identify()
    driver.arm()
    line.flood(GARBAGE)
    true, fresh, wrong, last = [], 0, 0, driver.poll().time
    periods = int(SECONDS * RATE)
    for number in range(periods):
        # More than half a turn between periods: positions are distinct and far from each other.
        true = [*true[-RECENT:], 3.5 * (number % 997)]
        line.device.sensed = line.device.sensed._replace(position=true[-1])
        line.pass_time(1.0 / RATE)
        telemetry = driver.poll()
        if telemetry.time != last:
            last, fresh = telemetry.time, fresh + 1
            wrong += min(abs(telemetry.position - value) for value in true) > 0.01
        driver.send_torque(0.0)
    return 100.0 * fresh / periods, wrong


def measure():
    for protocol, firmware in ((protocol, firmware) for protocol in sorted(DRIVES)
                               for firmware in device_class(protocol).firmwares or ('',)):
        name = f'{protocol} {firmware}'.strip()
        part, wrong = flood(protocol, firmware)
        yield f'{name}: periods with a reading under garbage', '%', [part], None
        yield f'{name}: wrong readings among them', '', [wrong], 0.5
