# SPDX-License-Identifier: Apache-2.0
"""Ball, drive and cable in memory around a real `Session`, on a clock that the test moves."""
from dataclasses import replace
from functools import cache
import json
import math
from pathlib import Path
import random
import tempfile

from ballbot_ros.bridge.condition import Battery
from ballbot_ros.bridge.drive_line import SharedLine
from ballbot_ros.bridge.hardware_file import load_hardware, SteeringAxis
from ballbot_ros.bridge.session import Session
from ballbot_ros.control import load_tuning, PendulumController, SupervisedController, Supervision
from ballbot_ros.drives import device_class, driver_class, open_driver
from ballbot_ros.drives.emulated_device import DriveSettings, Sensed
from ballbot_ros.drives.memory_line import MemoryLine
from ballbot_ros.emulator.emulator import BusOfTwo, new_device
from ballbot_ros.errors import MessageError
from ballbot_ros.estimation import ImuReading
from ballbot_ros.physics import load_robot
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.plant import Imu, Plant
from ballbot_ros.steering import GroundTrack, LateralState, pull

STEP = 0.002
# A reply is there a step later [s].
LINE_TIME = 0.5 * STEP
GIMBALL = load_robot('gimball')
read_hardware, read_tuning = cache(load_hardware), cache(load_tuning)  # once in a test process


def scene_of(terrain):
    """Return a scene with the ball at rest."""
    return read_scene({'robot': 'gimball', 'initial': {'x': 0.0}, 'duration': 1.0,
                       'solver': {'step': 2e-4},  # exact to 1e-12 rad within 10 s
                       'terrain': terrain}, 'test', 'test')


FLAT = scene_of([{'flat': {'length': 10.0}}])


class HeldShell:
    """A pendulum in a shell that is held: the textbook's, with viscous friction."""

    def __init__(self):
        self.state = State()
        self._robot = GIMBALL

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


class SecondPort(MemoryLine):
    """The port of a second drive, on the clock of the robot."""

    def __init__(self, robot, device):
        super().__init__(device, LINE_TIME)
        self.pass_time = robot.pass_time


class TwoPorts(BusOfTwo):
    """Two drives, each with a port of its own: this device has that of the first."""

    def __init__(self, device, settings):
        super().__init__(device, settings)
        self.other = device(settings)

    def tick(self, now):
        """Update the first."""
        self.first.tick(now)

    def receive(self, data, now):
        """Give bytes to the first."""
        return self.first.receive(data, now)


class VirtualRobot(MemoryLine):
    """
    A session that drives a plant through an emulated drive, and the line between them.

    Parameters
    ----------
    protocol : str
        And behind a space the firmware where there is more than one.
    onboard : str
        Tuning of the laws on board; empty for direct control.
    steering : bool
        Whether a second motor leans the pendulum.

    Attributes
    ----------
    lateral : LateralState
        By the lateral model, in whose speed the planar model takes part.
    course : GroundTrack
        Place on the ground, of a ball that rolls.
    leans : list of float
        Torque of the second motor, at each step.
    lean_encoder : callable
        As `encoder`, of the second motor.
    temperature : float
        Of the drive [degrees Celsius].
    bus_voltage : float
        [V]
    encoder : callable
        Gives what the drive measures for what is true (`Sensed`): a fault of the encoder.
    reading : callable
        Gives what the session receives for an `ImuReading`, None for nothing: a fault of the IMU.

    """

    def __init__(self, protocol='odrive', imu=True, settings=None, held=False, terrain=None,
                 onboard='', steering=False, **limits):
        protocol, _, firmware = protocol.partition(' ')
        self.hardware = read_hardware(f'gimball_{protocol}')
        if steering:
            option = driver_class(protocol).shares_line
            where = {'drive': {option: getattr(driver_class(protocol).Options, option) + 1}} \
                if option else {'port': 'of its own'}
            self.hardware = replace(self.hardware, steering=SteeringAxis(
                50.0, 0.9, drive_torque_limit=4.0, **where))
        self.hardware = replace(
            self.hardware, limits=replace(self.hardware.limits, **limits),
            battery=Battery(),  # the supply of most of these drives is not that of GimBall
            connection=replace(self.hardware.connection, imu_required=imu,
                               loop_rate=1.0 / STEP))
        self.joint = self.hardware.joint
        torque = self.hardware.options().torque_limit
        settings = replace(settings or DriveSettings(
            torque_limit=torque, current_limit=torque / DriveSettings.torque_constant),
            firmware=firmware)
        own_port = steering and not driver_class(protocol).shares_line
        super().__init__(TwoPorts(device_class(protocol), settings) if own_port
                         else new_device(protocol, settings, steering), LINE_TIME)
        self.second_port = SecondPort(self, self.device.other) if own_port else None
        if (protocol, firmware) == ('odrive_can', '0.5'):  # a person has read it with odrivetool
            self.hardware = replace(self.hardware, drive={
                'firmware': '0.5.6', 'confirmed': dict(self.device.properties)})
        elif (protocol, firmware) == ('odrive_can', '0.6'):
            self._folder = tempfile.TemporaryDirectory()
            path = Path(self._folder.name) / 'flat_endpoints.json'
            path.write_text(json.dumps(self.device.endpoints()))
            self.hardware = replace(self.hardware, drive={'endpoints': str(path)})
        self.now = 100.0
        self.onboard = onboard
        self.plant = HeldShell() if held else Plant(
            scene_of(terrain) if terrain else FLAT, 500.0)
        self._imu = Imu(9.81) if imu else None
        self._noise = random.Random(1)  # no sensor that measures repeats a reading
        self.temperature = self.device.sensed.temperature
        self.stop_switch = 0.0  # 1 pulls that of the drive itself
        self.encoder_jump = 0.0  # of the motor shaft [rad]
        self.bus_voltage = self.device.sensed.bus_voltage
        self.encoder = self.reading = self.lean_encoder = lambda true: true
        self.lateral, self.leans, self.course = LateralState(), [], GroundTrack()
        self._shared = SharedLine(self._opened)
        self.refused = None  # of the IMU readings, the last error
        self.lines = 0  # opened and not closed
        self.torques = []  # at the motor, at each step
        self.history = {}  # of the plant, by the number of the step
        self.start()

    def start(self):
        """Begin a new session."""
        law = SupervisedController(
            PendulumController(GIMBALL, read_tuning(self.onboard)),
            Supervision(20.0, 0.5, let_down_time=self.hardware.limits.damping_time)
        ) if self.onboard else None
        if self.hardware.steering is None:
            self.session = Session(
                self.hardware, GIMBALL, self.connect, self.clock, law=law,
                publishers={'set_point': '/planner', 'cmd_vel': '/teleop'}.get)
            return
        lateral = self.hardware.lateral(GIMBALL)
        self.session = Session(
            self.hardware, GIMBALL, lambda: self.connect(self._shared.view()), self.clock, law=law,
            connect_lateral=lambda: open_driver(
                lateral.connection.protocol, self.second_port or self._shared.view(),
                lateral.options(), self.clock))

    def _opened(self):
        self.read()  # what a predecessor left
        self.lines += 1
        return self

    def connect(self, line=None):
        """Return a driver on the line."""
        return open_driver(self.hardware.connection.protocol, line or self._opened(),
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
            self.device.sensed = self.encoder(Sensed(
                scale * state.joint_angle + self.encoder_jump, scale * state.joint_rate,
                temperature=self.temperature, bus_voltage=self.bus_voltage,
                stop_switch=self.stop_switch))
            if self.hardware.steering is not None:
                self._lean(before, state)
            self.live()
            if self.second_port is not None:
                self.second_port.now = self.now
                self.second_port.live()
            self.torques.append(motor)
            self.history[round(self.now / STEP)] = state
            if self._imu is not None:
                sample = self._imu.sample(before, state, 0)[1:]
                reading = self.reading(ImuReading(
                    self.now, *(value + self._noise.gauss(0.0, 1e-6) for value in sample)))
                if reading is not None:
                    try:
                        self.session.imu(reading)
                    except MessageError as error:
                        self.refused = error

    def _lean(self, before, after):
        """Let the second motor and the lateral model live on for a step."""
        motor = self.device.second_torque() if self.device.booted_at <= self.now else 0.0
        joint, robot = self.hardware.steering, self.session.robot
        speeds = [-robot.ball_radius * state.ball_rate for state in (before, after)]
        self.lateral = pull(
            robot, self.lateral, sum(speeds) / 2, motor * joint.gear_ratio * joint.gear_efficiency
            * joint.direction, STEP, (speeds[1] - speeds[0]) / STEP)
        self.course = self.course.after(
            -robot.ball_radius * after.ball_angle, self.lateral, robot.ball_radius)
        scale = joint.gear_ratio * joint.direction
        self.device.second = self.lean_encoder(Sensed(
            scale * self.lateral.lean, scale * self.lateral.lean_rate))
        self.leans.append(motor)

    def run(self, seconds, torque=None):
        """Let the bridge tick, and command a torque if there is one; return the last report."""
        report = None
        for _ in range(round(seconds / STEP)):
            self.pass_time(STEP)
            report = self.tick() or report
            if torque is not None:
                self.session.command(torque, self.now)
        return report

    def tick(self):
        """Execute a period of the bridge; return its report."""
        return self.session.report(self.session.tick())

    def loop(self, seconds, set_point=None):
        """Let the bridge tick and wait for answers as its loop does; set-points come at 50 Hz."""
        report = None
        for number in range(round(seconds / STEP)):
            if set_point is not None and number % 10 == 0:
                self.session.give(set_point)
            start = self.now
            late = self.session.tick()
            report = self.session.report(self.session.await_answer(STEP) or late) or report
            if self.now == start:  # nothing was waited for
                self.pass_time(STEP)
        return report

    def ready(self):
        """Configure, activate and release the e-stop; return the robot."""
        self.session.configure()
        self.session.activate()
        self.run(0.02)
        self.session.release()
        self.run(0.02)
        return self

    @property
    def motor(self):
        """Return the torque at the motor shaft now [N m]."""
        return self.torques[-1]
