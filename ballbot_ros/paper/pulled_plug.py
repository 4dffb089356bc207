# SPDX-License-Identifier: Apache-2.0
"""
The black box of a simulated session whose cable is unplugged: the example in the documentation.

The session of the bridge drives the full model of GimBall through an emulated ODrive, with a
clock that this module advances.
"""
import math
from pathlib import Path
from tempfile import TemporaryDirectory

from matplotlib.figure import Figure

from ballbot_ros.black_box.dump import write_file
from ballbot_ros.black_box.read import BlackBoxRecording, read_black_box
from ballbot_ros.black_box.ring import BlackBox
from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.sensing import IMU_RECOVERY_TIME
from ballbot_ros.bridge.session import Session
from ballbot_ros.drives import device_class, open_driver
from ballbot_ros.drives.driver import Driver
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.emulator.ball import Ball, settings_for
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.figures.black_box import around_fault
from ballbot_ros.physics.simulation.scene import load_scene
from ballbot_ros.studies.progress import ignore, Progress

PERIOD = 0.002  # of the loop [s]
UNPLUG_TIME, END_TIME = 3.2, 4.2  # after the start [s]
TORQUE_AMPLITUDE, FREQUENCY = 0.5, 0.7  # of the commands [N m, Hz]


class RecordedLine(MemoryLine):
    """A line in memory to an emulated drive with a ball, recorded by a black box."""

    def __init__(self) -> None:
        self.hardware = load_hardware('gimball_odrive')
        scene = load_scene('flat')
        settings = settings_for(scene.model.robot,
                                torque_limit=self.hardware.options().torque_limit)
        device = device_class(self.hardware.connection.protocol)(settings)
        super().__init__(device, 0.5 * PERIOD)
        self.ball = Ball(scene, settings, PERIOD)
        self.box = BlackBox(self.clock)
        self.session = Session(
            self.hardware, scene.model.robot, self.connect, self.clock, self.box)

    def connect(self) -> Driver:
        return open_driver(self.hardware.connection.protocol, self, self.hardware.options(),
                           self.clock)

    def to_drive(self, data: bytes) -> bytes:
        self.box.record('>', data)
        return data

    def read(self) -> bytes:
        data = super().read()
        if data:
            self.box.record('<', data)
        return data

    def pass_time(self, seconds: float) -> None:
        """Advance ball, drive and IMU by a time [s], at least by one period."""
        end = self.now + max(seconds, PERIOD) - 1e-9
        while self.now < end:
            self.now += PERIOD
            self.ball.advance(self.device.torque())
            self.device.sensed = self.ball.sensed(self.device.sensed)
            self.device.tick(self.now)
            sample = self.ball.imu()
            self.session.imu(ImuReading(
                self.now, sample.turn_rate, sample.forward, sample.upward))

    def run(self, until: float) -> None:
        """Run the session until a time [s]; command a swing once the e-stop is released."""
        while self.now < until:
            self.pass_time(PERIOD)
            self.session.report(self.session.tick())
            if not self.session.supervisor.e_stop:
                try:
                    self.session.command(
                        TORQUE_AMPLITUDE * math.sin(math.tau * FREQUENCY * self.now), self.now)
                except MessageError:
                    pass  # recorded in the black box


def pulled_plug(progress: Progress = ignore) -> BlackBoxRecording:
    """Return the recording of a session whose cable is unplugged while the pendulum swings."""
    line = RecordedLine()
    line.session.configure()
    begin = line.now
    line.run(begin + 1.1 * IMU_RECOVERY_TIME)
    line.session.activate()
    line.session.release()
    for tenth in range(1, 11):
        line.run(begin + UNPLUG_TIME * tenth / 10.0)
        progress(tenth / 12.0)
    line.plugged = False
    line.run(begin + END_TIME)
    line.session.close()
    fault = line.box.take_fault()
    if fault is None:
        raise AssertionError('expected a fault event after the plug was pulled')
    about = {'hardware': line.hardware.name, 'made': 'simulated with the full model'}
    with TemporaryDirectory() as folder:
        return read_black_box(write_file(
            Path(folder), line.box, *fault, about))


def black_box(progress: Progress = ignore) -> Figure:
    """Draw the black box of a session whose cable is unplugged while the pendulum swings."""
    figure = around_fault(pulled_plug(progress), 1.5)
    progress(1.0)
    return figure
