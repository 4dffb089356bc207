# SPDX-License-Identifier: Apache-2.0
"""
One drive from handshake to stop, thread-safe: each call holds the lock.

Only calls that wait for a reply block: `configure`, `deactivate`, `close`, and a `tick` that arms
the motor or reconnects.
"""
from collections import Counter
from enum import auto, Enum
import math
import threading
import time
from typing import Callable, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.condition import Condition
from ballbot_ros.bridge.drive_control import DriveControl
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.imu_watch import STEADY
from ballbot_ros.bridge.motor_state import MotorState, SILENCE
from ballbot_ros.bridge.observer import SessionObserver
from ballbot_ros.bridge.onboard import OnBoard
from ballbot_ros.bridge.warm_up import warm_up
from ballbot_ros.control import Mode, SetPoint
from ballbot_ros.drives.contract import Identity, Setting, Telemetry
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import LinkError, MessageError, RefusedError
from ballbot_ros.estimation import Estimate, Fusion, ImuReading, OdometryState
from ballbot_ros.physics.model.robot import Robot


class Wanted(Enum):
    """Requested state."""

    CLOSED = auto()
    INACTIVE = auto()  # connected, motor power disabled
    ACTIVE = auto()  # motor power enabled once the e-stop is released


class Report(NamedTuple):
    """Result of a tick; times are of the session clock [s]."""

    time: float
    estimate: Optional[Estimate]  # None when there was no new measurement
    torque: float  # at the pendulum, in force [N m]
    telemetry: Telemetry
    state: MotorState
    e_stop: str
    timed_out: bool  # commands or set-points have timed out
    commanded: bool  # a fresh command or set-point is active
    set_point: Optional[SetPoint] = None  # of onboard control; None in direct control
    condition: Condition = Condition()  # of battery and motor
    needs_imu: bool = False  # a required IMU is not usable


class Session:
    """
    Keeps a drive in the requested state, and reconnects after a lost link.

    Parameters
    ----------
    hardware : Hardware
    robot : Robot
    connect : callable
        Opens the link and returns its driver; called again to reconnect.
    clock : callable
        Monotonic clock [s].
    observer : SessionObserver
        Receives what happens.
    law : OnBoard, optional
        Computes the torque from set-points; None for direct control by torque commands.

    Attributes
    ----------
    control : DriveControl
        State of the motor, and counters.
    line : DriveLine
        The connected drive, or why none is connected.
    supervisor : Supervisor
        With the e-stop.
    fusion : Fusion
        With the latest estimate.
    set_points_refused : Counter
        By reason; the callbacks of the topics count them.
    lock : RLock
        Held in each call, and during changes of data that the loop reads.

    """

    def __init__(self, hardware: Hardware, robot: Robot, connect: Callable[[], Driver],
                 clock: Callable[[], float] = time.monotonic,
                 observer: SessionObserver = SessionObserver(), law: Optional[OnBoard] = None):
        """Start disconnected and inactive, the e-stop engaged; see `warm_up`."""
        warm_up(robot)
        self.hardware, self.robot, self.clock, self.law = hardware, robot, clock, law
        self.observer = observer
        self.set_points_refused: Counter[str] = Counter()
        limits = hardware.limits
        self._largest = {Mode.HOLD: limits.angle_limit, Mode.DRIVE: limits.speed_limit,
                         Mode.SPEED: limits.speed_limit * robot.ball_radius}
        self.control = DriveControl(hardware, robot, connect, clock, observer, law)
        self.line, self.supervisor = self.control.line, self.control.supervisor
        self._sensing = self.control.sensing
        self.fusion: Fusion = self._sensing.fusion
        self.lock, self._wanted = threading.RLock(), Wanted.CLOSED

    # Requests

    def configure(self) -> Tuple[Identity, Tuple[Setting, ...]]:
        """Open the link and check the drive; raises as `drive_line.handshake` does."""
        with self.lock:
            self.close()
            found = self.line.open(timeout=0.5)
            self.control.begin()
            self._wanted = Wanted.INACTIVE
            return found

    def activate(self) -> None:
        """Enable power once the e-stop is released; raise `RefusedError` without a drive."""
        with self.lock:
            if self.line.driver is None:
                raise RefusedError(f'there is no drive: {self.line.trouble or "not configured"}',
                                   'missing', 'drive')
            self._wanted = Wanted.ACTIVE

    def deactivate(self) -> None:
        """Disable power, wait for the confirmation of the drive, and engage the e-stop."""
        with self.lock:
            if self._wanted is Wanted.ACTIVE:
                self._wanted = Wanted.INACTIVE
            self.control.stop()
            self.engage('deactivated')

    def close(self) -> None:
        """Stop the motor, close the link, engage the e-stop; raises nothing."""
        with self.lock:
            self._wanted = Wanted.CLOSED
            self.control.close()
            self.engage('the bridge was shut down')

    def command(self, torque: float, stamp: float) -> None:
        """
        Accept a command and send it immediately if the rate limit of the link allows.

        See `CommandGate.offer` for arguments and errors; with reason ``onboard`` during onboard
        control.
        """
        if self.law is not None:
            self.supervisor.gate.refuse('onboard')
            raise MessageError(
                'onboard', 'joint_commands are not followed while the laws run on board: send '
                'set_point or cmd_vel, or start the bridge with control:=direct')
        with self.lock:
            now = self.clock()
            self.observer.command(torque, stamp)
            self.supervisor.offer(torque, stamp, now)
            if self._wanted is Wanted.ACTIVE and not self.supervisor.e_stop:
                self.control.follow(now)

    def give(self, set_point: SetPoint) -> None:
        """
        Accept a set-point, stamped with the session clock, or 0 for now.

        Raises
        ------
        MessageError
            As `OnBoard.give`, with reason ``out_of_range`` beyond the limits of the hardware
            file, and with ``direct`` in direct control.

        """
        if self.law is None:
            raise MessageError(
                'direct', 'set-points are not followed in direct control: send joint_commands, '
                'from a node controller for instance, or start the bridge with control:=onboard')
        with self.lock:
            self.observer.set_point(set_point)
            largest = self._largest.get(set_point.mode, math.inf)
            if abs(set_point.value) > largest:
                raise MessageError(
                    'out_of_range', f'set-point of {set_point.in_words} refused: it must be '
                    f'within +-{largest:.3g} by angle_limit and speed_limit of the hardware file',
                    set_point.mode.value)
            self.law.give(set_point, self.clock(), bool(self.supervisor.e_stop))

    def imu(self, reading: ImuReading) -> None:
        """Accept an IMU reading; raises as `Sensing.imu` does.  An implausible one stops."""
        with self.lock:
            self.observer.imu(reading)
            try:
                self._sensing.imu(reading, self.clock())
            finally:
                if self._sensing.imu_fault and not self.supervisor.e_stop:
                    self.supervisor.trigger(self._sensing.imu_fault)
                    self.control.withdraw()

    def engage(self, reason: str) -> None:
        """Engage the e-stop, which disables motor power immediately."""
        with self.lock:
            self.observer.requested_stop(reason)
            self.supervisor.trigger(reason)
            self.control.withdraw()

    def release(self, too_early: str = '') -> None:
        """
        Release the e-stop if it is engaged; raise `RefusedError` with the reason why not.

        `too_early` is a reason of the caller, empty for none; those of the session come first.
        """
        with self.lock:
            if self._wanted is Wanted.ACTIVE and not self.supervisor.e_stop:
                return
            try:
                reason, field = self._inhibit()
                self.supervisor.reset(
                    self.clock(), reason or too_early, field if reason else 'e_stop')
            except RefusedError as error:
                self.observer.event(str(error))
                raise
            self.observer.event('e-stop released')

    def _inhibit(self) -> Tuple[str, str]:
        """Return what inhibits the release of the e-stop, and its field; empty for nothing."""
        driver, now = self.line.driver, self.clock()
        if driver is None:
            return (f'the line to the drive is down ({self.line.trouble or "not configured"})',
                    'drive')
        if self._wanted is not Wanted.ACTIVE:
            return 'the bridge is not active; activate it first', 'state'
        if now - (driver.telemetry.time or 0.0) > SILENCE:
            return 'the drive does not report where the motor is', 'encoder'
        if self.control.monitor.condition.stop:
            return self.control.monitor.condition.stop, 'battery'
        if self.control.power.state is MotorState.STOPPING:
            return 'the drive has not confirmed the stop yet', 'motor'
        if self._sensing.imu_fault:
            return self._sensing.imu_fault, 'imu'
        if self._sensing.needs_imu(now):
            return (f'no IMU reading arrives, or none did in the last {STEADY:g} s without a gap, '
                    'and without one the pendulum angle is a guess; publish imu, or set '
                    'imu_required: false in the hardware file for a level floor', 'imu')
        estimate, limit = self.fusion.estimate, self.hardware.limits.angle_limit
        if estimate is not None and abs(estimate.readings.pendulum_angle) > limit:
            return (f'the pendulum angle is {estimate.readings.pendulum_angle:.2f} rad, beyond '
                    f'angle_limit of {limit:g} rad: let the robot come to rest, and look at '
                    'encoder_zero of the hardware file and at how the IMU is mounted',
                    'pendulum_angle')
        return (self.law.inhibit(), 'set_point') if self.law is not None else ('', '')

    def clear_faults(self) -> str:
        """
        Clear the faults of the drive while its motor has no power; return the result as text.

        Raises
        ------
        RefusedError
            Without a drive, with the motor armed or about to be, for a drive without this
            function, or if faults remain.

        """
        with self.lock:
            driver = self.line.driver
            if driver is None:
                raise RefusedError(f'there is no drive: {self.line.trouble or "not configured"}',
                                   'missing', 'drive')
            if not self.supervisor.e_stop:
                raise RefusedError(
                    'the e-stop is released: a motor whose faults are cleared could turn '
                    'immediately; engage it first', 'refused', 'e_stop')
            if self.control.power.state is not MotorState.DISARMED:
                raise RefusedError('the motor is under power, or its stop is not confirmed yet',
                                   'busy', 'motor')
            left = self.control.clear_faults(driver)
            self.observer.event(f'faults cleared, left: {", ".join(left) or "none"}')
        if left:
            raise RefusedError(f'the drive still names {", ".join(left)}; remove the cause',
                               'standing', 'drive')
        return 'the drive names no fault any more'

    # Each period

    @property
    def odometry(self) -> Optional[OdometryState]:
        """Return the odometry; None before the first measurement."""
        return self._sensing.steady_odometry()

    def tick(self) -> Optional[Report]:
        """Execute one period; None before `configure` and after `close`."""
        with self.lock:
            if self._wanted is Wanted.CLOSED:
                return None
            return self._report(self.control.tick(self._wanted is Wanted.ACTIVE))

    @property
    def expecting(self) -> bool:
        """Return whether a reply of this period is outstanding."""
        return self._sensing.expecting and self.line.driver is not None

    def await_answer(self, timeout: float) -> Optional[Report]:
        """
        Wait for a reply of the drive, and return its report if it is a measurement.

        The timeout is in seconds; commands are accepted and sent meanwhile.
        """
        driver = self.line.driver
        if driver is None:
            return None
        try:
            if driver.line.wait(timeout, driver.shortest_answer):
                with self.lock:
                    if self.line.driver is driver:
                        estimate = self.control.measure(driver)
                        if estimate is None:
                            return None
                        if self.control.answer(estimate) and self._wanted is Wanted.ACTIVE:
                            self.control.follow(self.clock())
                        return self._report(estimate)
        except LinkError as error:
            with self.lock:
                self.control.lose(driver, error)
        return None

    def _report(self, estimate: Optional[Estimate]) -> Report:
        supervisor, driver, law = self.supervisor, self.line.driver, self.law
        timed_out, commanded, set_point = supervisor.timed_out, supervisor.commanded, None
        if law is not None:
            set_point = law.set_point
            timed_out = timed_out or law.let_down
            commanded = commanded and set_point.mode is not Mode.IDLE
        now, state = self.clock(), self.control.power.state
        telemetry = Telemetry() if driver is None else driver.telemetry
        self.observer.period(now, estimate, supervisor, telemetry, state)
        return Report(now, estimate, supervisor.torque, telemetry, state, supervisor.e_stop,
                      timed_out, commanded, set_point, self.control.monitor.condition,
                      self._sensing.needs_imu(now))
