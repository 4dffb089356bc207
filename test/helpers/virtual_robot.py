# SPDX-License-Identifier: Apache-2.0
"""Ball, drive and cable in memory around a real `Session`, on a clock that the test advances."""
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
from ballbot_ros.bridge.observer import SessionObserver
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

# Protocols, each with the firmware if there are several, and those of a serial port.
ALL = ('odrive 0.5', 'odrive 0.6', 'odrive_can 0.5', 'odrive_can 0.6', 'vesc', 'vesc_can',
       'roboclaw')
SERIAL = tuple(name for name in ALL if '_can' not in name)
STEP = 0.002
# A reply arrives one step later [s].
LINE_TIME = 0.5 * STEP
GIMBALL = load_robot('gimball')
read_hardware, read_tuning = cache(load_hardware), cache(load_tuning)  # once per test process


def scene_of(terrain):
    """Return a scene with the ball at rest."""
    return read_scene({'robot': 'gimball', 'initial': {'x': 0.0}, 'duration': 1.0,
                       'solver': {'step': 2e-4},  # exact to 1e-12 rad within 10 s
                       'terrain': terrain}, 'test', 'test')


FLAT = scene_of([{'flat': {'length': 10.0}}])


class HeldShell:
    """A pendulum in a fixed shell: the textbook pendulum with viscous friction."""

    def __init__(self):
        self.state = State()
        self._robot = GIMBALL

    def advance(self, torque):
        """Advance by a step under a constant torque."""
        robot, state = self._robot, self.state
        rate = state.pendulum_rate + STEP / robot.joint_inertia * (
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
    """Two drives, each with a separate port; this device has the port of the first."""

    def __init__(self, device, settings):
        super().__init__(device, settings)
        self.other = device(settings)

    def tick(self, now):
        """Update the first drive."""
        self.first.tick(now)

    def receive(self, data, now):
        """Pass bytes to the first drive."""
        return self.first.receive(data, now)


class VirtualRobot(MemoryLine):
    """
    A session that drives a plant through an emulated drive, and the line between them.

    Parameters
    ----------
    protocol : str
        Name of the protocol; the firmware follows after a space if there is more than one.
    onboard : str
        Tuning of the onboard control laws; empty for direct control.
    steering : bool
        Whether a second motor leans the pendulum.
    quirks : sequence of str
        Quirks of the drive.

    Attributes
    ----------
    lateral : LateralState
        State of the lateral model, to which the planar model gives the speed.
    course : GroundTrack
        Position of the rolling ball on the ground.
    leans : list of float
        Torque of the second motor at each step [N m].
    lean_encoder : callable
        As `encoder`, for the second motor.
    temperature : float
        Temperature of the drive [degrees Celsius].
    bus_voltage : float
        Supply voltage of the drive [V].
    encoder : callable
        Maps the true values (`Sensed`) to those that the drive measures: a fault of the encoder.
    transmitted : callable
        Maps the torque of the motor at the pendulum [N m] and the state of the plant to the torque
        on the pendulum: a fault of motor or gear.
    reading : callable
        Maps an `ImuReading` to the received one, or to None if none arrives: a fault of the IMU.

    """

    def __init__(self, protocol='odrive', imu=True, settings=None, held=False, terrain=None,
                 onboard='', steering=False, quirks=(), **limits):
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
            firmware=firmware, quirks=quirks)
        own_port = steering and not driver_class(protocol).shares_line
        super().__init__(TwoPorts(device_class(protocol), settings) if own_port
                         else new_device(protocol, settings, steering), LINE_TIME)
        self.second_port = SecondPort(self, self.device.other) if own_port else None
        if (protocol, firmware) == ('odrive_can', '0.5'):  # as read with odrivetool
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
        self._noise = random.Random(1)  # a real sensor never repeats a reading
        self.temperature = self.device.sensed.temperature
        self.stop_switch = 0.0  # 1 actuates the stop switch of the drive itself
        self.encoder_jump = 0.0  # of the motor shaft [rad]
        self.bus_voltage = self.device.sensed.bus_voltage
        self.encoder = self.reading = self.lean_encoder = lambda true: true
        self.transmitted = lambda torque, state: torque
        self.lateral, self.leans, self.course = LateralState(), [], GroundTrack()
        self._shared = SharedLine(self._opened)
        self.observer = SessionObserver()
        self.refused = None  # the last error of an IMU reading
        self.lines = 0  # number of open lines
        self.torques = []  # at the motor shaft, at each step [N m]
        self.history = {}  # states of the plant by step number
        self.start()

    def start(self):
        """Start a new session."""
        law = SupervisedController(
            PendulumController(GIMBALL, read_tuning(self.onboard)),
            Supervision(20.0, 0.5, let_down_time=self.hardware.limits.damping_time)
        ) if self.onboard else None
        self.session = Session(
            self.hardware, GIMBALL, self.connect, self.clock, self.observer, law,
            self.connect_lateral, {'set_point': '/planner', 'cmd_vel': '/teleop'}.get)
        self.session.sensing.imu_watch.silent = False  # has been steady for IMU_RECOVERY_TIME

    def _opened(self):
        self.read()  # discard the data of the previous connection
        self.lines += 1
        return self

    def connect(self):
        """Return a driver on the line."""
        return self._driver(
            self.hardware, self._shared.view() if self.hardware.steering else self._opened())

    def connect_lateral(self):
        """Return the driver of the second motor."""
        return self._driver(
            self.hardware.lateral(GIMBALL), self.second_port or self._shared.view())

    def _driver(self, hardware, line):
        return open_driver(
            hardware.connection.protocol, line, hardware.options(), self.clock)

    def close(self):
        """Decrement the number of open lines."""
        self.lines -= 1

    def pass_time(self, seconds):
        """Advance ball and drive, without the bridge, by at least one step."""
        end = self.now + max(seconds, STEP) - 1e-9
        while self.now < end:
            self.now += STEP
            motor = self.device.torque() if self.device.booted_at <= self.now else 0.0
            gear = self.joint.gear_ratio * self.joint.gear_efficiency * self.joint.direction
            before = self.plant.state
            state = self.plant.advance(self.transmitted(motor * gear, before))
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
        """Advance the second motor and the lateral model by one step."""
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
        """Tick the bridge and command a torque, if given, each period; return the last report."""
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
        """Run the bridge loop, with a set-point (if given) at 50 Hz; return the last report."""
        report = None
        for number in range(round(seconds / STEP)):
            if set_point is not None and number % 10 == 0:
                self.session.give(set_point)
            start = self.now
            late = self.session.tick()
            report = self.session.report(self.session.await_answer(STEP) or late) or report
            if self.now == start:  # the session did not wait
                self.pass_time(STEP)
        return report

    def change(self, **sections):
        """Replace sections of the hardware file, and start a new session; return the robot."""
        self.hardware = replace(self.hardware, **sections)
        self.start()
        return self

    def active(self):
        """Configure and activate; return the robot, its e-stop engaged."""
        self.session.configure()
        self.session.activate()
        self.run(0.02)
        return self

    def ready(self):
        """Configure, activate and release the e-stop; return the robot."""
        self.active().session.release()
        self.run(0.02)
        return self

    @property
    def motor(self):
        """Return the torque at the motor shaft now [N m]."""
        return self.torques[-1]
