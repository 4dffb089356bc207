# SPDX-License-Identifier: Apache-2.0
"""
State estimate of a session, and the validity of its measurements and IMU readings.

The age of an IMU reading counts from its arrival, or from its stamp if that is earlier.  A reading
stamped in the future or too far in the past is refused: it would hide a dead IMU, or put all later
readings out of order.  So after a clock step, forward or back, readings are refused until `Clocks`
follows it; this does not affect safety.
"""
from abc import ABC, abstractmethod
import logging
import math
from typing import Any, Generic, List, Optional, Protocol, Tuple, TypeVar

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.motor_state import MEASUREMENT_AGE_MAX
from ballbot_ros.bridge.supervisor import PendulumMotion
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation import (
    EncoderReading, Estimate, Fusion, ImuReading, OdometryFilter, OdometryState)
from ballbot_ros.estimation.fusion import IMU_TIMEOUT
from ballbot_ros.estimation.kalman import JOINT
from ballbot_ros.imus.plausibility import EXPLANATIONS, ImuPlausibility
from ballbot_ros.physics.model.robot import Robot

# Allowed difference between the clocks of the IMU and of the bridge [s].
AHEAD = 0.01
# Grace period after the timeout of the IMU, without torque [s]: after a preemption of this
# process, queued readings are read within it; they may be as late as replies of the drive.
MISSING_TIMEOUT = MEASUREMENT_AGE_MAX - IMU_TIMEOUT
# Time with uninterrupted readings before an IMU is usable [s].
IMU_RECOVERY_TIME = 0.5


class ImuWatch:
    """
    Monitors the readings of an IMU.  All times are of one steady clock and passed in [s].

    `silent` is set at the start and by a timeout, and cleared by uninterrupted readings for
    `IMU_RECOVERY_TIME`; `silences` counts the timeouts.
    """

    def __init__(self) -> None:
        self.silent = True
        self.silences = 0
        self._fresh_until = self._steady_since = -math.inf
        self._missing_since = math.inf
        self._pulling = False  # whether the motor had torque when readings stopped

    def check(self, stamp: float, now: float) -> None:
        """
        Refuse a stamp in the future or too far in the past.

        Raises `MessageError` with reason ``from_the_future`` or ``stale``.
        """
        if stamp > now + AHEAD:
            raise MessageError(
                f'IMU reading stamped {stamp:.3f} s refused: the local time is {now:.3f} s; '
                'are the clocks of both machines synchronised, and was one of them set?',
                'from_the_future', 'stamp')
        if not stamp >= now - IMU_TIMEOUT:
            raise MessageError(
                f'IMU reading stamped {stamp:.3f} s refused: the local time is {now:.3f} s, '
                f'more than {IMU_TIMEOUT:g} s later; is it delayed, or do the clocks differ?',
                'stale', 'stamp')

    def reading_received(self, stamp: float, now: float) -> None:
        """Record the arrival of an accepted reading."""
        if now > self._fresh_until:
            self._steady_since = now
        self._fresh_until = max(self._fresh_until, min(stamp, now) + IMU_TIMEOUT)

    def has(self, now: float) -> bool:
        """Return whether the latest reading is within the timeout."""
        return now <= self._fresh_until

    def usable(self, now: float) -> bool:
        """Return whether the IMU is present and steady."""
        return self.has(now) and not self.silent

    def update(self, now: float, pulling: bool) -> bool:
        """
        Check for a timeout or a recovery; call this in each period.

        Returns True when it detects a timeout, if the motor had torque (`pulling`) when the
        readings stopped.
        """
        if self.has(now):
            self._missing_since = math.inf
            self.silent = self.silent and now - self._steady_since < IMU_RECOVERY_TIME
            return False
        if now < self._missing_since:
            self._missing_since, self._pulling = now, pulling
        if self.silent or now - self._missing_since < MISSING_TIMEOUT:
            return False
        self.silent = True
        self.silences += 1
        return self._pulling


LOG = logging.getLogger(__name__)

# Sum of the overshoots of the pendulum beyond its angle limits [rad].
SWING_OVERSHOOT = 0.8
# Age above which a newer estimate replaces the odometry of the last IMU reading [s].
ODOMETRY_AGE_MAX = 0.03


class AxisEstimate(Protocol):
    """State estimate of an axis."""

    @property
    def stamp(self) -> float:
        """Return the time of the measurement [s]."""

    @property
    def readings(self) -> Any:
        """Return the input of the control law of the axis."""


Estimated = TypeVar('Estimated', bound=AxisEstimate, covariant=True)


class AxisSensing(ABC, Generic[Estimated]):
    """
    Measurements of one axis, and the state estimated from them.  All times are of one clock [s].

    `expecting` is True until a requested measurement arrives; `stamp` is that of the last one.
    """

    def __init__(self, hardware: Hardware):
        self._joint = hardware.joint
        self.imu_watch = ImuWatch()
        # Time and torque of each command that may act after the last measurement [s], [N m].
        self._commands: List[Tuple[float, float]] = [(-math.inf, 0.0)]
        self._answered = self._waiting_since = 0.0
        self.expecting = False
        self.stamp = -math.inf

    def begin(self, now: float) -> None:
        """Restart with a drive after its handshake."""
        self._answered, self.expecting = now, False

    def ask(self, now: float) -> None:
        """Record a request for a measurement."""
        if not self.expecting:
            self._waiting_since = now
        self.expecting = True

    def commanded(self, torque: float, now: float) -> None:
        """Record a torque of the axis before it is sent [N m]."""
        self._commands.append((now, torque))

    def restart(self, now: float) -> None:
        """Restart the reply timeout after a blocking operation."""
        self._waiting_since = now

    def silence(self, now: float) -> float:
        """Return the time since the first unanswered request [s]; 0 without one."""
        return now - self._waiting_since if self.expecting else 0.0

    def is_stale(self, now: float) -> bool:
        """Return whether the last reply, or its measurement, is too old for torque."""
        # Replies may continue without new estimates, when the time of the measurement is unknown.
        return now - self._answered > MEASUREMENT_AGE_MAX or now - self.stamp > MEASUREMENT_AGE_MAX

    def new_measurement(self, telemetry: Telemetry) -> Optional[EncoderReading]:
        """
        Return the reading of a new measurement, or None.

        A measurement of unknown time yields None but counts as a reply.
        """
        if telemetry.position is None or telemetry.time is None \
                or telemetry.time <= self._answered:
            return None
        self._answered, self.expecting = telemetry.time, False
        if telemetry.measured is None:
            return None
        before, self.stamp = self.stamp, max(telemetry.measured, self.stamp)
        stamp, commands, rate = self.stamp, self._commands, telemetry.velocity
        # The drive executes commands and requests in the order of their transmission, but any
        # command may have been delayed.
        momentum, end = 0.0, stamp
        for when, torque in reversed(commands):
            start = max(when, before)
            if start < end:
                momentum, end = momentum + torque * (end - start), start
        torques = [torque for _, torque in commands]
        while len(commands) > 1 and commands[1][0] <= stamp:
            del commands[0]
        return EncoderReading(
            stamp, self._joint.joint_angle(telemetry.position),
            momentum / (stamp - before) if -math.inf < before < stamp else torques[-1],
            None if rate is None else self._joint.joint_angle(rate), self._answered - stamp,
            (min(torques), max(torques)))

    @abstractmethod
    def take(self, telemetry: Telemetry) -> Optional[Estimated]:
        """Return an estimate from a new measurement, None if there is none in the telemetry."""

    @abstractmethod
    def motion(self, now: float) -> Optional[PendulumMotion]:
        """Return the motion that the supervisor limits, None if it is too old for torque."""


class Sensing(AxisSensing[Estimate]):
    """
    Converts telemetry of the drive to estimates.  All times are of one clock [s].

    `odometry` is that of the last estimate; it continues after a reconnection.
    """

    def __init__(self, hardware: Hardware, robot: Robot):
        super().__init__(hardware)
        self._imu_required = hardware.connection.imu_required
        self.fusion = Fusion(robot, hardware.imu, hardware.estimate, hardware.joint.encoder_zero)
        self._plausibility = ImuPlausibility()
        self._gravity, self._mounting = robot.gravity, hardware.imu
        self._largest_swing = 2.0 * hardware.limits.angle_limit + SWING_OVERSHOOT
        self._rolling = OdometryFilter(robot, hardware.odometry)
        self.odometry: Optional[OdometryState] = None
        self._after_imu: Optional[OdometryState] = None  # after the last IMU reading
        self.fusion.follower = self._follow

    def begin(self, now: float) -> None:
        super().begin(now)
        self.fusion.reconnected()

    def take(self, telemetry: Telemetry) -> Optional[Estimate]:
        """See `AxisSensing`; raises as `Fusion.encoder` does."""
        reading, zeros = self.new_measurement(telemetry), self.fusion.rezeroed
        if reading is None:
            return None
        try:
            estimate = self.fusion.encoder(reading)
        except EstimateLostError:
            if self.odometry is not None:
                self.odometry = self._rolling.lost(self.odometry)
            raise
        if self.fusion.rezeroed > zeros:
            LOG.warning('the encoder jumped by %.3f rad at the joint; its zero was shifted by '
                        'the same angle', self.fusion.last_jump)
        self.odometry = self._rolling.start(estimate) if self.odometry is None else \
            self._rolling.advance(self.odometry, estimate)
        return estimate

    def _follow(self, estimate: Estimate, imu: ImuReading) -> None:
        if self.odometry is not None:
            self.odometry = self._after_imu = self._rolling.advance(self.odometry, estimate, imu)

    def steady_odometry(self) -> Optional[OdometryState]:
        """
        Return the odometry to publish: that of the last IMU update, unless it is old.

        Between IMU readings the predicted rate of the ball has the uncertainty of possible
        impacts.
        """
        newest, after_imu = self.odometry, self._after_imu
        if newest is not None and after_imu is not None \
                and newest.stamp - after_imu.stamp < ODOMETRY_AGE_MAX:
            return after_imu
        return newest

    def motion(self, now: float) -> Optional[PendulumMotion]:
        estimate = self.fusion.estimate
        if estimate is None or self.is_stale(now) or now - estimate.stamp > MEASUREMENT_AGE_MAX \
                or self.needs_imu(now) or not self.fusion.is_relied_on():
            return None
        angle, _, rate, ball_rate, _ = estimate.mean.tolist()
        return PendulumMotion(angle, rate, rate - ball_rate)

    @property
    def imu_fault(self) -> str:
        """Return why the IMU is implausible, a key of `EXPLANATIONS`; empty while plausible."""
        return self._plausibility.fault

    def imu(self, reading: ImuReading, now: float) -> None:
        """
        Accept an IMU reading.

        Raises `MessageError` as `ImuWatch.check` and `Fusion.imu` do, and with the reason codes of
        `imus.plausibility.EXPLANATIONS`.
        """
        self.imu_watch.check(reading.stamp, now)
        estimate, centred = self.fusion.estimate, self._mounting.at_centre(reading, 0.0)
        self._plausibility = self._plausibility.after(
            reading.stamp, reading.turn_rate, centred.forward, centred.upward, self._gravity,
            None if estimate is None else float(estimate.mean[JOINT]), self._largest_swing)
        fault = self.imu_fault
        if fault:
            raise MessageError(EXPLANATIONS[fault], fault, 'imu')
        self.fusion.imu(reading)
        self.imu_watch.reading_received(reading.stamp, now)

    def needs_imu(self, now: float) -> bool:
        """Return whether a required IMU is not usable."""
        return self._imu_required and not self.imu_watch.usable(now)
