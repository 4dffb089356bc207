# SPDX-License-Identifier: Apache-2.0
"""
Operation of the axes of a robot from handshake to stop; thread-safe: each call holds the lock.

Each axis has its own `DriveControl`.  Either all axes have torque or none: an e-stop of one
applies to all, and one that is not armed disables the others.

Only calls that wait for a reply block: `configure`, `deactivate`, `close`, and a `tick` that arms
the motor or reconnects.
"""
from collections import Counter
from dataclasses import replace
from enum import auto, Enum
import math
import threading
from typing import Any, Callable, List, NamedTuple, Optional, Tuple

from ballbot_ros.bridge.condition import Condition
from ballbot_ros.bridge.drive_control import DriveControl
from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.lean import LateralAxis
from ballbot_ros.bridge.motor_state import MEASUREMENT_AGE_MAX, MotorState
from ballbot_ros.bridge.observer import SessionObserver
from ballbot_ros.bridge.sensing import Estimated, IMU_RECOVERY_TIME, Sensing
from ballbot_ros.bridge.supervisor import EStop, StopReason
from ballbot_ros.clock import steady_time
from ballbot_ros.control import Mode, SetPoint, SupervisedController
from ballbot_ros.control.checked import warm_up as warm_up_laws
from ballbot_ros.control.command_gate import CLOCK_SKEW_MAX
from ballbot_ros.drives.contract import Identity, Setting, Telemetry
from ballbot_ros.drives.driver import Driver
from ballbot_ros.errors import (
    BallbotError, ConfigurationError, LinkError, MessageError, RefusedError)
from ballbot_ros.estimation import (
    EncoderReading, Estimate, Fusion, ImuReading, OdometryFilter, OdometryState)
from ballbot_ros.imus.plausibility import EXPLANATIONS
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import GroundTrack, required_steering


# States of an axis in which the others may have power.
READY = (MotorState.DISARMED, MotorState.ARMED)


def warm_up(robot: Robot) -> None:
    """
    Run filter and controllers once on synthetic readings.

    The first run after an installation compiles them; within the loop that would exceed the
    watchdog timeout of the drive.
    """
    warm_up_laws(robot)
    fusion, odometry = Fusion(robot), OdometryFilter(robot)
    state: Optional[OdometryState] = None
    for number in range(1, 5):
        stamp = 0.002 * number
        imu = ImuReading(stamp, 0.0, 0.0, robot.gravity)
        fusion.imu(imu)
        estimate = fusion.encoder(EncoderReading(stamp, 0.0))
        state = odometry.start(estimate) if state is None else odometry.advance(
            state, estimate, imu)


class Wanted(Enum):
    """Requested state."""

    CLOSED = auto()
    INACTIVE = auto()  # connected, motor power disabled
    ACTIVE = auto()  # motor power enabled once the e-stop is released


class Report(NamedTuple):
    """Result of a period; times are of the session clock [s]."""

    time: float
    estimate: Optional[Estimate]  # None when there was no new measurement
    torque: float  # applied at the pendulum [N m]
    telemetry: Telemetry
    state: MotorState
    e_stop: Optional[EStop]
    timed_out: bool  # commands or set-points have timed out
    commanded: bool  # a fresh command or set-point is active
    set_point: Optional[SetPoint] = None  # of onboard control; None in direct control
    condition: Condition = Condition()  # of battery and motor
    needs_imu: bool = False  # a required IMU is not usable


class Session:
    """
    Keeps the drives in the requested state, and reconnects after a lost link.

    Parameters
    ----------
    connect : callable
        Opens the link and returns its driver; called again to reconnect.
    clock : callable
        Monotonic clock [s].
    observer : SessionObserver
        Receives the events.
    law : SupervisedController, optional
        Computes the torque from set-points, without a topic in between; the torque has the stamp
        of its measurement, so it expires if the measurements stop.  None for direct control by
        torque commands.
    connect_lateral : callable, optional
        As `connect`, for the lateral axis, if the hardware has one.
    publishers : callable
        Returns the names of the nodes that publish on a topic, for messages.

    Attributes
    ----------
    axes : tuple of DriveControl
        The joint of the pendulum first.
    control : DriveControl
        The first axis: state of the motor, and counters.
    sensing : Sensing
        Measurements of the first axis.
    lateral : LateralAxis or None
        Measurements and law of the lateral axis.
    course : GroundTrack or None
        Position and heading of a robot with a lateral axis, by its model.
    line : DriveLine
        The connected drive, or the reason for a missing connection.
    supervisor : Supervisor
        Torque limits and e-stop of the first axis.
    fusion : Fusion
        State estimation of the first axis, with the latest estimate.
    set_points_refused : Counter
        Number of refusals by reason; the callbacks of the topics count them.
    lock : RLock
        Held in each call, and during changes of data that the loop reads.

    """

    def __init__(self, hardware: Hardware, robot: Robot, connect: Callable[[], Driver],
                 clock: Callable[[], float] = steady_time,
                 observer: SessionObserver = SessionObserver(),
                 law: Optional[SupervisedController] = None,
                 connect_lateral: Optional[Callable[[], Driver]] = None,
                 publishers: Callable[[str], str] = lambda topic: ''):
        """Start disconnected and inactive, the e-stop engaged; see `warm_up`."""
        warm_up(robot)
        self.hardware, self.robot, self.clock, self.law = hardware, robot, clock, law
        self.observer, self._publishers = observer, publishers
        self.set_points_refused: Counter[str] = Counter()
        limits = hardware.limits
        self._largest = {Mode.HOLD: limits.angle_limit, Mode.DRIVE: limits.speed_limit,
                         Mode.SPEED: limits.speed_limit * robot.ball_radius}
        self.sensing = Sensing(hardware, robot)
        self.fusion: Fusion = self.sensing.fusion
        self.control = DriveControl(hardware, self.sensing, connect, clock, observer, law)
        self.axes: Tuple[DriveControl[Any], ...] = (self.control,)
        self.lateral: Optional[LateralAxis] = None
        self.course: Optional[GroundTrack] = None
        if hardware.steering is not None:
            if law is None or connect_lateral is None:
                raise ConfigurationError(
                    f'{hardware.name}: the lateral axis requires onboard control: use '
                    'control:=onboard, or remove the section steering', 'inconsistent', 'control')
            lateral = hardware.lateral(robot)
            self.lateral = LateralAxis(lateral, robot, self._speed, self._yaw_rate)
            self.course = GroundTrack()
            self.axes += (DriveControl(
                lateral, self.lateral, connect_lateral, clock, observer, self.lateral),)
        for axis in self.axes:
            axis.others = tuple(other for other in self.axes if other is not axis)
        self.line, self.supervisor = self.control.line, self.control.supervisor
        self.lock, self._wanted = threading.RLock(), Wanted.CLOSED

    # Requests

    def configure(self) -> Tuple[Identity, Tuple[Setting, ...]]:
        """
        Open the link and check the drive; the estimate restarts with a robot at rest.

        Raises as `drive_line.handshake` does.
        """
        with self.lock:
            self.close()
            self.fusion.reset()
            found = []
            try:
                for axis in self.axes:
                    found.append(axis.line.open(timeout=0.5))
                    axis.begin()
            except BallbotError:
                self.close()
                raise
            self._wanted = Wanted.INACTIVE
            return found[0][0], tuple(item for _, settings in found for item in settings)

    def activate(self) -> None:
        """Enable power once the e-stop is released; raise `RefusedError` without a drive."""
        with self.lock:
            self._drivers()
            self._wanted = Wanted.ACTIVE

    def deactivate(self) -> None:
        """Engage the e-stop, and wait until the drive confirms that it has disabled power."""
        with self.lock:
            if self._wanted is Wanted.ACTIVE:
                self._wanted = Wanted.INACTIVE
            self.engage('deactivated', StopReason.DEACTIVATED)
            for axis in self.axes:
                axis.stop()

    def close(self) -> None:
        """Engage the e-stop, stop the motor and close the link; raises nothing."""
        with self.lock:
            self._wanted = Wanted.CLOSED
            self.engage('the bridge was shut down', StopReason.CLOSED)
            for axis in self.axes:
                axis.close()

    def command(self, torque: float, stamp: float) -> None:
        """
        Accept a command and send it immediately if the rate limit of the link allows.

        See `CommandGate.offer` for arguments and errors; the reason is ``onboard`` in onboard
        control.
        """
        if self.law is not None:
            self.supervisor.gate.refuse('onboard')
            raise MessageError(
                'joint_commands are not accepted in onboard control: send '
                'set_point or cmd_vel, or start the bridge with control:=direct',
                'onboard', 'control')
        with self.lock:
            now = self.clock()
            self.observer.command(torque, stamp)
            self.supervisor.offer(torque, stamp, now)
            if self._wanted is Wanted.ACTIVE and not self.supervisor.e_stop:
                self.control.follow(now)

    def give(self, set_point: SetPoint) -> None:
        """
        Accept a set-point, stamped with the session clock; a stamp of 0 means now.

        Raises `MessageError` as `SupervisedController.give` does, with reason ``out_of_range``
        beyond the limits of the hardware file, and with ``direct`` in direct control; the current
        set-point remains.
        """
        if self.law is None:
            raise MessageError(
                'set-points are not accepted in direct control: send joint_commands, '
                'for instance from a node controller, or start the bridge with control:=onboard',
                'direct', 'control')
        with self.lock:
            self.observer.set_point(set_point)
            largest = self._largest.get(set_point.mode, math.inf)
            if abs(set_point.value) > largest:
                raise MessageError(
                    f'set-point of {set_point.in_words} refused: it must be '
                    f'within +-{largest:.3g} by angle_limit and speed_limit of the hardware file',
                    'out_of_range', set_point.mode.value)
            now = self.clock()
            self.law.on_e_stop(bool(self.supervisor.e_stop))
            if set_point.stamp > now + CLOCK_SKEW_MAX:
                raise MessageError(
                    f'the set-point is stamped {set_point.stamp:.3f} s, but the local '
                    f'time is {now:.3f} s: does the sender use another clock?',
                    'from_the_future', 'stamp')
            # Its age counts from now at the latest, so the timeout limits every set-point.
            self.law.give(replace(set_point, stamp=min(set_point.stamp or now, now)), now)

    def imu(self, reading: ImuReading) -> None:
        """Accept an IMU reading as `Sensing.imu` does; engage the e-stop if it is implausible."""
        with self.lock:
            self.observer.imu(reading)
            try:
                self.sensing.imu(reading, self.clock())
            finally:
                fault = self.sensing.imu_fault
                if fault:
                    self.engage(EXPLANATIONS[fault], StopReason(fault))

    def engage(self, text: str, reason: StopReason = StopReason.REQUESTED) -> None:
        """Engage the e-stop of all axes, which disables their power immediately."""
        with self.lock:
            self._engage(EStop(reason, text))

    def _engage(self, cause: EStop) -> None:
        for axis in self.axes:
            axis.supervisor.trigger(cause)
            axis.withdraw()

    def release(self, too_early: str = '') -> None:
        """
        Release the e-stop if it is engaged; raise `RefusedError` with the reason of a refusal.

        `too_early` is a reason of the caller, empty for none; those of the session precede it.
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
            for axis in self.axes[1:]:
                axis.supervisor.release()
            if self.lateral is not None:
                self.lateral.rezero()
            self.observer.event('e-stop released')

    def _inhibit(self) -> Tuple[str, str]:
        """Return the reason against a release of the e-stop, and its field; empty for none."""
        now = self.clock()
        for axis in self.axes:
            driver = axis.line.driver
            if driver is None:
                return (f'the line to the drive is down ({axis.line.trouble or "not configured"})',
                        'drive')
            if self._wanted is not Wanted.ACTIVE:
                return 'the bridge is not active; activate it first', 'state'
            if now - (driver.telemetry.time or 0.0) > MEASUREMENT_AGE_MAX:
                return 'the drive does not report the motor position', 'encoder'
            if axis.monitor.condition.stop:
                return axis.monitor.condition.stop, 'battery'
            if axis.power.state is MotorState.STOPPING:
                return 'the drive has not confirmed the stop yet', 'motor'
        if self.sensing.imu_fault:
            return EXPLANATIONS[self.sensing.imu_fault], 'imu'
        if self.sensing.needs_imu(now):
            return (f'no IMU readings, or less than {IMU_RECOVERY_TIME:g} s without a gap, '
                    'and without them the pendulum angle is unreliable; publish imu, or set '
                    'imu_required: false in the hardware file for a level floor', 'imu')
        estimate, limit = self.fusion.estimate, self.hardware.limits.angle_limit
        if estimate is not None and abs(estimate.readings.pendulum_angle) > limit:
            return (f'the pendulum angle is {estimate.readings.pendulum_angle:.2f} rad, beyond '
                    f'angle_limit of {limit:g} rad: let the robot come to rest, and check '
                    'encoder_zero of the hardware file and the mounting of the IMU; if the '
                    'estimate is wrong, clean up the bridge and configure it again at rest',
                    'pendulum_angle')
        if self.lateral is not None and self.hardware.steering is not None \
                and self.hardware.steering.encoder_zero is not None:
            lean, most = self.lateral.state.lean, required_steering(self.robot).largest_lean
            if abs(lean) > most:
                return (f'the lean is {lean:.2f} rad, beyond the largest lean of {most:g} rad: '
                        'check encoder_zero in the section steering of the hardware file',
                        'lean')
        requested = None if self.law is None else self.law.requested
        if requested is None:
            return '', ''
        topic = 'cmd_vel' if requested.mode is Mode.SPEED else 'set_point'
        names = self._publishers(topic)
        return (f'{topic} requests {requested.in_words}{f" (from {names})" if names else ""}, '
                'and the robot would jump; request rest (a set-point of 0), or nothing for half '
                'a second, then release again', 'set_point')

    def clear_faults(self) -> str:
        """
        Clear the faults of the drive while its motor has no power; return the result as text.

        Raises `RefusedError` without a drive, with the motor armed or about to be, for a drive
        without this function, or if faults remain.
        """
        with self.lock:
            drivers = self._drivers()
            if not self.supervisor.e_stop:
                raise RefusedError(
                    'the e-stop is released, so the motor could turn as soon as its faults are '
                    'cleared; engage the e-stop first', 'refused', 'e_stop')
            if any(axis.power.state is not MotorState.DISARMED for axis in self.axes):
                raise RefusedError('motor power is enabled, or the stop is not confirmed yet',
                                   'busy', 'motor')
            left = [name for axis, driver in zip(self.axes, drivers)
                    for name in axis.clear_faults(driver)]
            self.observer.event(f'faults cleared; remaining: {", ".join(left) or "none"}')
        if left:
            raise RefusedError(f'the drive still reports {", ".join(left)}; remove the cause',
                               'standing', 'drive')
        return 'the drive reports no faults'

    def _drivers(self) -> List[Driver]:
        """Return the drivers of all axes; raise `RefusedError` if one is missing."""
        drivers = []
        for axis in self.axes:
            if axis.line.driver is None:
                raise RefusedError(f'there is no drive: {axis.line.trouble or "not configured"}',
                                   'missing', 'drive')
            drivers.append(axis.line.driver)
        return drivers

    # Each period

    def _speed(self) -> Optional[float]:
        """Return the speed of the ball [m/s], None before the first estimate."""
        estimate = self.fusion.estimate
        return None if estimate is None else \
            -self.robot.ball_radius * estimate.readings.ball_rate

    def _yaw_rate(self) -> Optional[float]:
        """Return the commanded yaw rate [rad/s], None while no set-point is followed."""
        law = self.law
        if law is None or law.set_point.mode is Mode.IDLE:
            return None
        return 0.0 if law.let_down else law.set_point.yaw_rate

    def _couple(self) -> None:
        """Apply the e-stop of one axis to all, and disconnect all if one is lost."""
        if any(axis.line.driver is None for axis in self.axes):
            # Requests to one axis could feed the watchdog of another that cannot be stopped.
            trouble = next(axis.line.trouble for axis in self.axes if axis.line.driver is None)
            for axis in self.axes:
                if axis.line.driver is not None:
                    axis.disconnect(axis.line.driver, LinkError(
                        f'the drive of another axis was lost ({trouble})', 'closed', 'port'))
        stops = [axis.supervisor.e_stop for axis in self.axes if axis.supervisor.e_stop]
        if 0 < len(stops) < len(self.axes):
            self._engage(stops[0])

    @property
    def odometry(self) -> Optional[OdometryState]:
        """Return the odometry; None before the first measurement."""
        return self.sensing.steady_odometry()

    def tick(self) -> Optional[Estimate]:
        """Execute one period; return the estimate of a late reply, if there is one."""
        with self.lock:
            estimate = None
            if self._wanted is Wanted.CLOSED:
                return estimate
            for axis in self.axes:
                ready = all(other.power.state in READY for other in axis.others)
                found = axis.tick(self._wanted is Wanted.ACTIVE and ready)
                estimate = found if axis is self.control else estimate
                if axis.line.driver is None:  # the other axes wait until it is connected
                    break
            self._couple()
            return estimate

    @property
    def expecting(self) -> bool:
        """Return whether a reply of this period is outstanding."""
        return self.line.driver is not None and any(axis.sensing.expecting for axis in self.axes)

    def await_answer(self, timeout: float) -> Optional[Estimate]:
        """
        Wait for a reply from the drive, and return the estimate of a new measurement.

        The timeout is in seconds; commands are accepted and sent meanwhile.
        """
        expecting = next((axis for axis in self.axes if axis.sensing.expecting), self.control)
        waited = expecting.line.driver
        if waited is None:
            return None
        try:
            if not waited.line.wait(timeout, waited.shortest_answer):
                return None
        except LinkError as error:
            with self.lock:
                expecting.disconnect(waited, error)
                self._couple()
            return None
        estimate = None
        with self.lock:
            if expecting.line.driver is waited:
                for axis in self.axes:
                    found = self._answered(axis)
                    estimate = found if axis is self.control else estimate
                self._couple()
        return estimate

    def _answered(self, axis: DriveControl[Estimated]) -> Optional[Estimated]:
        """Read the replies of an axis, send its torque, and return a new estimate."""
        driver = axis.line.driver
        if driver is None:
            return None
        try:
            estimate = axis.measure(driver)
        except LinkError as error:
            axis.disconnect(driver, error)
            return None
        if estimate is not None and axis.answer(estimate) and self._wanted is Wanted.ACTIVE:
            axis.follow(self.clock())
        return estimate

    def report(self, estimate: Optional[Estimate]) -> Optional[Report]:
        """Return the result of a period, None before `configure` and after `close`."""
        supervisor, law = self.supervisor, self.law
        with self.lock:
            if self._wanted is Wanted.CLOSED:
                return None
            if self.lateral is not None and self.course is not None and self.odometry is not None:
                self.course = self.course.after(
                    self.odometry.position, self.lateral.state, self.robot.ball_radius)
            timed_out, commanded, set_point = supervisor.timed_out, supervisor.commanded, None
            if law is not None:
                set_point = law.set_point
                timed_out = timed_out or law.let_down
                commanded = commanded and set_point.mode is not Mode.IDLE
            now, state, driver = self.clock(), self.control.power.state, self.line.driver
            telemetry = Telemetry() if driver is None else driver.telemetry
            self.observer.period(now, estimate, supervisor, telemetry, state)
            return Report(now, estimate, supervisor.torque, telemetry, state, supervisor.e_stop,
                          timed_out, commanded, set_point, self.control.monitor.condition,
                          self.sensing.needs_imu(now))
