# SPDX-License-Identifier: Apache-2.0
"""A robot of bits: ball, drive and cable in memory, with a clock that only the test moves."""
from dataclasses import replace
import math

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.bridge.session import Session
from ballbot_ros.drives import device_class, open_driver
from ballbot_ros.drives.emulated_device import DriveSettings, Sensed
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant

STEP = 0.002
# A reply is there a step later [s].
LINE_TIME = 0.5 * STEP


class HeldShell:
    """A pendulum in a shell that is held: the textbook's, with viscous friction."""

    def __init__(self):
        self.state = State()
        self._robot = load_robot('gimball')

    def advance(self, torque):
        """Advance by a step under a constant torque."""
        robot, state = self._robot, self.state
        inertia = robot.pendulum_inertia + robot.pendulum_mass * robot.pendulum_length**2
        rate = state.pendulum_rate + STEP / inertia * (
            torque - robot.joint_friction * state.pendulum_rate
            - robot.largest_gravity_torque * math.sin(state.pendulum_angle))
        self.state = state._replace(time=state.time + STEP, pendulum_rate=rate,
                                    pendulum_angle=state.pendulum_angle + STEP * rate)
        return self.state


class VirtualRobot(MemoryLine):
    """
    A session that drives a plant through an emulated drive, and the line between them.

    Parameters
    ----------
    protocol : str
        And behind a space the firmware where there is more than one.

    Attributes
    ----------
    temperature : float
        Of the drive [degrees Celsius].

    """

    def __init__(self, protocol='odrive', imu=True, settings=None, held=False, terrain=None,
                 **limits):
        protocol, _, firmware = protocol.partition(' ')
        self.hardware = load_hardware(f'gimball_{protocol}')
        self.hardware = replace(
            self.hardware, limits=replace(self.hardware.limits, **limits),
            connection=replace(self.hardware.connection, imu_required=imu))
        self.joint = self.hardware.joint
        torque = self.hardware.options().torque_limit
        super().__init__(device_class(protocol)(replace(settings or DriveSettings(
            torque_limit=torque, current_limit=torque / DriveSettings.torque_constant),
            firmware=firmware)), LINE_TIME)
        self.now = 100.0
        self.plant = HeldShell() if held else Plant(read_scene(
            {'robot': 'gimball', 'initial': {'x': 0.0}, 'duration': 1.0,
             'terrain': terrain or [{'flat': {'length': 10.0}}]}, 'test', 'test'), 500.0)
        self._imu = Imu(9.81) if imu else None
        self.temperature = self.device.sensed.temperature
        self.lines = 0  # opened and not closed
        self.torques = []  # at the motor, at each step
        self.start()

    def start(self):
        """Begin a new session."""
        self.session = Session(self.hardware, load_robot('gimball'), self.connect, self.clock)

    def connect(self):
        """Return a driver on the line."""
        self.read()  # what a predecessor left
        self.lines += 1
        return open_driver(self.hardware.connection.protocol, self,
                           self.hardware.options(), self.clock)

    def close(self):
        """Count it."""
        self.lines -= 1

    def pass_time(self, seconds):
        """Let ball and drive live on, without the bridge, for a step at least."""
        end = self.now + max(seconds, STEP) - 1e-9
        while self.now < end:
            self.now += STEP
            motor = self.device.torque() if self.device.booted_at <= self.now else 0.0
            gear = self.joint.gear_ratio * self.joint.gear_efficiency * self.joint.direction
            before = self.plant.state
            state = self.plant.advance(motor * gear)
            scale = self.joint.gear_ratio * self.joint.direction
            self.device.sensed = Sensed(scale * state.joint_angle, scale * state.joint_rate,
                                        temperature=self.temperature)
            self.device.tick(self.now)
            self.torques.append(motor)
            if self._imu is not None:
                sample = self._imu.sample(before, state, 0)
                self.session.imu(ImuReading(self.now, *sample[1:]))

    def run(self, seconds, torque=None):
        """Let the bridge tick, and command a torque if there is one; return the last report."""
        report = None
        for _ in range(round(seconds / STEP)):
            self.pass_time(STEP)
            report = self.session.tick() or report
            if torque is not None:
                self.session.command(torque, self.now)
        return report

    def ready(self):
        """Configure, activate and release the e-stop; return the robot."""
        self.session.configure()
        self.run(0.1)
        self.session.activate()
        self.session.release()
        self.run(0.1)
        return self

    @property
    def motor(self):
        """Return the torque at the motor shaft now [N m]."""
        return self.torques[-1]
