# SPDX-License-Identifier: Apache-2.0
"""State estimate of a session and its validity."""
import logging
import math
from typing import NamedTuple, Optional, Tuple

from ballbot_ros.bridge.hardware_file import Hardware
from ballbot_ros.bridge.imu_watch import ImuWatch
from ballbot_ros.bridge.motor_state import SILENCE
from ballbot_ros.bridge.supervisor import PendulumMotion
from ballbot_ros.drives.contract import Telemetry
from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation import (
    Estimate, Fusion, ImuReading, OdometryFilter, OdometryState)
from ballbot_ros.imus.plausibility import EXPLANATIONS, ImuPlausibility
from ballbot_ros.physics.model.robot import Robot

LOG = logging.getLogger(__name__)

# Sum of the overshoots of the pendulum beyond its angle limits [rad].
SWING_OVERSHOOT = 0.8
# Age above which a newer estimate replaces the odometry of the last IMU reading [s].
FELT_LONG_AGO = 0.03
# Comparison of the encoder with the velocity that the drive reports: time constant [s],
SMOOTHING = 0.1
# longest time between two readings [s],
LONGEST_PAUSE = 0.05
# smallest smoothed travel by velocity [rad] and part of it that the encoder contradicts,
TRAVEL_MIN, CONTRADICTED_MIN = 0.1, 0.6
# limit of the difference of one reading, as a multiple of its travel: reduces the weight of jumps,
DIFFERENCE_MAX = 2.5
# and time after which the e-stop engages [s].
CONTRADICTION_TIME = 0.04


class VelocityCheck(NamedTuple):
    """
    Comparison of encoder steps with the velocity of the drive; `after` gives the next.

    A frozen encoder differs by the whole travel, one that counts backwards by twice that.
    """

    stamp: float = -math.inf
    angle: float = 0.0
    travel: float = 0.0  # by the velocity, smoothed [rad]
    difference: float = 0.0  # of the encoder from it, smoothed [rad]
    contradicted_for: float = 0.0  # [s]

    def after(self, stamp: float, angle: float, rate: Optional[float]) -> 'VelocityCheck':
        """Return the check after a reading of the joint angle [rad] and its rate [rad/s]."""
        pause = stamp - self.stamp
        if rate is None or not 0.0 < pause <= LONGEST_PAUSE:
            return VelocityCheck(stamp, angle)
        keep, step = math.exp(-pause / SMOOTHING), rate * pause
        largest = DIFFERENCE_MAX * abs(step)
        error = min(max(angle - self.angle - step, -largest), largest)
        travel = keep * self.travel + abs(step)
        difference = keep * self.difference + error
        contradicted = travel >= TRAVEL_MIN and abs(difference) >= CONTRADICTED_MIN * travel
        return VelocityCheck(stamp, angle, travel, difference,
                             self.contradicted_for + pause if contradicted else 0.0)

    @property
    def contradicts(self) -> bool:
        """Return whether encoder and velocity contradict each other for too long."""
        return self.contradicted_for >= CONTRADICTION_TIME


class AxisSensing:
    """
    Times of the measurements of one axis.  All times are of one clock [s].

    Attributes
    ----------
    imu_watch : ImuWatch
    expecting : bool
        Whether a requested measurement has not arrived.
    stamp : float
        Of the last measurement.

    """

    def __init__(self, hardware: Hardware):
        self._joint = hardware.joint
        self.imu_watch = ImuWatch()
        self._velocity_check = VelocityCheck()
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

    def restart(self, now: float) -> None:
        """Restart the reply timeout after a blocking operation."""
        self._waiting_since = now

    def silence(self, now: float) -> float:
        """Return the time since the unanswered request [s]; 0 without one."""
        return now - self._waiting_since if self.expecting else 0.0

    def is_stale(self, now: float) -> bool:
        """Return whether the last reply, or its measurement, is too old for torque."""
        # Replies may continue without new estimates, when the time of the measurement is unknown.
        return now - self._answered > SILENCE or now - self.stamp > SILENCE

    def new_measurement(self, telemetry: Telemetry) -> Optional[Tuple[float, Optional[float]]]:
        """
        Return angle and rate of the joint [rad], [rad/s] by a new measurement, or None.

        A measurement of unknown time yields none but counts as a reply.  Raises
        `EstimateLostError` if the encoder contradicts the velocity that the drive reports.
        """
        if telemetry.position is None or telemetry.time is None \
                or telemetry.time <= self._answered:
            return None
        self._answered, self.expecting = telemetry.time, False
        if telemetry.measured is None:
            return None
        self.stamp = max(telemetry.measured, self.stamp)
        angle = self._joint.joint_angle(telemetry.position)
        rate = None if telemetry.velocity is None else self._joint.joint_angle(telemetry.velocity)
        self._velocity_check = self._velocity_check.after(self.stamp, angle, rate)
        if self._velocity_check.contradicts:
            self._velocity_check = VelocityCheck()
            raise EstimateLostError(
                'the encoder contradicts the velocity that the drive reports: it is frozen, '
                'reversed or slips; check its cable, its magnet and the settings of the '
                'drive for it; let the robot come to rest')
        return angle, rate


class Sensing(AxisSensing):
    """
    Converts telemetry of the drive to estimates.  All times are of one clock [s].

    Attributes
    ----------
    fusion : Fusion
    imu_fault : str
        Reason why the IMU is implausible; empty while it is plausible.
    odometry : OdometryState or None
        Of the last estimate; continues after a lost link.

    """

    def __init__(self, hardware: Hardware, robot: Robot):
        super().__init__(hardware)
        self._imu_required = hardware.connection.imu_required
        self.fusion = Fusion(robot, hardware.imu, hardware.estimate, hardware.joint.encoder_zero)
        self._plausibility, self.imu_fault = ImuPlausibility(), ''
        self._gravity = robot.gravity
        self._largest_swing = 2.0 * hardware.limits.angle_limit + SWING_OVERSHOOT
        self._rolling = OdometryFilter(robot, hardware.odometry)
        self.odometry: Optional[OdometryState] = None
        self._felt: Optional[OdometryState] = None  # the last one after an IMU reading
        self.fusion.follower = self._follow

    def begin(self, now: float) -> None:
        """Restart with a drive after its handshake."""
        super().begin(now)
        self.fusion.found_again()

    def take(self, telemetry: Telemetry, torque: float) -> Optional[Estimate]:
        """
        Return an estimate from a new measurement, None if there is none in the telemetry.

        Raises as `new_measurement` and `Fusion.encoder` do.
        """
        zeros = self.fusion.rezeroed
        try:
            try:
                measured = self.new_measurement(telemetry)
            except EstimateLostError:
                self.fusion.reset()
                raise
            if measured is None:
                return None
            estimate = self.fusion.encoder(self.stamp, measured[0], torque, measured[1])
        except EstimateLostError:
            if self.odometry is not None:
                self.odometry = self._rolling.lost(self.odometry)
            raise
        if self.fusion.rezeroed > zeros:
            LOG.warning('the encoder has jumped by %.3f rad at the joint, and continues from '
                        'there', self.fusion.last_jump)
        self.odometry = self._rolling.start(estimate) if self.odometry is None else \
            self._rolling.advance(self.odometry, estimate)
        return estimate

    @property
    def estimate(self) -> Optional[Estimate]:
        """Return the last estimate."""
        return self.fusion.estimate

    def _follow(self, estimate: Estimate, imu: ImuReading) -> None:
        """Store the odometry of an IMU update."""
        if self.odometry is not None:
            self.odometry = self._felt = self._rolling.advance(self.odometry, estimate, imu)

    def steady_odometry(self) -> Optional[OdometryState]:
        """
        Return the odometry to publish: that of the last IMU update, unless it is old.

        Between IMU readings the predicted rate of the ball has the uncertainty of possible
        impacts.
        """
        newest, felt = self.odometry, self._felt
        if newest is not None and felt is not None and newest.stamp - felt.stamp < FELT_LONG_AGO:
            return felt
        return newest

    def motion(self, now: float) -> Optional[PendulumMotion]:
        """Return the motion of the robot, None if the estimate is too old for torque."""
        estimate = self.fusion.estimate
        if estimate is None or self.is_stale(now) or now - estimate.stamp > SILENCE \
                or self.needs_imu(now) or not self.fusion.is_relied_on():
            return None
        angle, _, rate, ball_rate, _ = estimate.mean.tolist()
        return PendulumMotion(angle, rate, rate - ball_rate)

    def imu(self, reading: ImuReading, now: float) -> None:
        """
        Accept an IMU reading.

        Raises
        ------
        MessageError
            As `ImuWatch.check` and `Fusion.imu` do, and with the reason codes of
            `imus.plausibility.EXPLANATIONS`.

        """
        self.imu_watch.check(reading.stamp, now)
        estimate = self.fusion.estimate
        self._plausibility = self._plausibility.after(
            reading.stamp, reading.turn_rate, reading.forward, reading.upward, self._gravity,
            None if estimate is None else estimate.readings.joint_angle, self._largest_swing)
        fault = self._plausibility.fault
        self.imu_fault = EXPLANATIONS[fault] if fault else ''
        if fault:
            raise MessageError(self.imu_fault, fault, 'imu')
        self.fusion.imu(reading)
        self.imu_watch.reading_received(reading.stamp, now)

    def needs_imu(self, now: float) -> bool:
        """Return whether a required IMU is not usable."""
        return self._imu_required and not self.imu_watch.usable(now)
