# SPDX-License-Identifier: Apache-2.0
"""
One drive from handshake to stop, used from several threads: each call holds the lock.

It sleeps only where a driver waits for an answer: in `configure`, `deactivate`, `close`, and in a
`tick` that arms the motor or looks for a drive that was lost.
"""
from enum import auto, Enum
import threading
import time
from typing import Callable, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.drive_control import DriveControl
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.motor_state import MotorState, SILENCE
from ballbot_ros.drives.contract import Identity, Setting, Telemetry
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import LinkError, RefusedError
from ballbot_ros.estimation import Estimate, Fusion, ImuReading
from ballbot_ros.physics.model.robot import Robot


class Wanted(Enum):
    """What the owner wants."""

    CLOSED = auto()
    INACTIVE = auto()  # a drive, its motor without power
    ACTIVE = auto()  # power, once the e-stop is released


class Report(NamedTuple):
    """What a tick found; times are of the clock of the session [s]."""

    time: float
    estimate: Optional[Estimate]  # None when there was no new measurement
    torque: float  # at the pendulum, in force [N m]
    telemetry: Telemetry
    state: MotorState
    e_stop: str
    timed_out: bool
    commanded: bool  # a fresh command is in force


class Session:
    """
    Keeps a drive in the state that is wanted, whatever happens to the line.

    Parameters
    ----------
    hardware : Hardware
    robot : Robot
    connect : callable
        Opens the line and returns a driver on it; called again after the line was lost.
    clock : callable
        Gives seconds and never goes back.

    Attributes
    ----------
    control : DriveControl
        With the state of the motor, and counts.
    line : DriveLine
        With the drive that there is, or why there is none.
    supervisor : Supervisor
        With the e-stop.
    fusion : Fusion
        With the newest estimate.

    """

    def __init__(self, hardware: Hardware, robot: Robot, connect: Callable[[], Driver],
                 clock: Callable[[], float] = time.monotonic):
        """Start without a line, not active, the e-stop engaged."""
        self.clock = clock
        self.control = DriveControl(hardware, robot, connect, clock)
        self.line, self.supervisor = self.control.line, self.control.supervisor
        self._sensing = self.control.sensing
        self.fusion: Fusion = self._sensing.fusion
        self._lock, self._wanted = threading.RLock(), Wanted.CLOSED

    # What the owner wants

    def configure(self) -> Tuple[Identity, Tuple[Setting, ...]]:
        """Open the line, find the drive and check it; raises as `connect.handshake` does."""
        with self._lock:
            self.close()
            found = self.line.open(patience=0.5)
            self.control.begin()
            self._wanted = Wanted.INACTIVE
            return found

    def activate(self) -> None:
        """Allow power, once the e-stop is released; raise `RefusedError` without a drive."""
        with self._lock:
            if self.line.driver is None:
                raise RefusedError(f'there is no drive: {self.line.trouble or "not configured"}')
            self._wanted = Wanted.ACTIVE

    def deactivate(self) -> None:
        """Take the power off the motor and wait until the drive confirms it."""
        with self._lock:
            if self._wanted is Wanted.ACTIVE:
                self._wanted = Wanted.INACTIVE
            self.control.stop()

    def close(self) -> None:
        """Stop the motor and close the line; whatever happens, nothing is raised."""
        with self._lock:
            self._wanted = Wanted.CLOSED
            self.control.close()

    def command(self, torque: float, stamp: float) -> None:
        """
        Take a command and send it at once, unless the line has been given its share.

        See `CommandGate.offer` for the arguments and what is raised.
        """
        with self._lock:
            now = self.clock()
            self.supervisor.offer(torque, stamp, now)
            if self._wanted is Wanted.ACTIVE and not self.supervisor.e_stop:
                self.control.follow(now)

    def imu(self, reading: ImuReading) -> None:
        """Take an IMU reading; raise `MessageError` if it is out of order."""
        with self._lock:
            self.fusion.imu(reading)

    def engage(self, reason: str) -> None:
        """Engage the e-stop; the motor loses its power at once."""
        with self._lock:
            self.supervisor.trigger(reason)
            self.control.withdraw()

    def release(self) -> None:
        """Release the e-stop, or raise `RefusedError` with the reason why not."""
        with self._lock:
            self.supervisor.reset(self.clock(), self._inhibit())

    def _inhibit(self) -> str:
        """Return what inhibits the release of the e-stop; empty for nothing."""
        driver, now = self.line.driver, self.clock()
        if driver is None:
            return f'the line to the drive is down ({self.line.trouble or "not configured"})'
        if self._wanted is not Wanted.ACTIVE:
            return 'the bridge is not active; activate it first'
        if now - (driver.telemetry.time or 0.0) > SILENCE:
            return 'the drive does not report where the motor is'
        if self.control.power.state is MotorState.STOPPING:
            return 'the drive has not confirmed the stop yet'
        if self._sensing.needs_imu(now):
            return ('no IMU reading arrives, and without one the pendulum angle is a guess; '
                    'publish imu, or set imu_required: false in the hardware file for a level '
                    'floor')
        return ''

    # What happens each period

    def tick(self) -> Optional[Report]:
        """Do what this period asks for; None before `configure` and after `close`."""
        with self._lock:
            if self._wanted is Wanted.CLOSED:
                return None
            return self._report(self.control.tick(self._wanted is Wanted.ACTIVE))

    @property
    def expecting(self) -> bool:
        """Return whether the drive is to answer a question of this period."""
        return self._sensing.expecting and self.line.driver is not None

    def await_answer(self, patience: float) -> Optional[Report]:
        """
        Wait for an answer of the drive, and report it if that is a measurement.

        For so many seconds at most; commands can be given and sent meanwhile.
        """
        driver = self.line.driver
        if driver is None:
            return None
        try:
            if driver.line.wait(patience):
                with self._lock:
                    if self.line.driver is driver:
                        estimate = self.control.measure(driver)
                        return None if estimate is None else self._report(estimate)
        except LinkError as error:
            with self._lock:
                self.control.lose(driver, error)
        return None

    def _report(self, estimate: Optional[Estimate]) -> Report:
        supervisor, driver = self.supervisor, self.line.driver
        return Report(self.clock(), estimate, supervisor.torque,
                      Telemetry() if driver is None else driver.telemetry,
                      self.control.power.state, supervisor.e_stop, supervisor.timed_out,
                      supervisor.commanded)
