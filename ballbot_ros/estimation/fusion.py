# SPDX-License-Identifier: Apache-2.0
"""The filter with sensor supervision: IMU timeout, encoder jumps."""
from collections import deque
import math
from typing import Callable, Deque, Optional

from ballbot_ros.control.rolling_model import RollingModel
from ballbot_ros.control.signals import refuse_not_finite
from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation.encoder import (
    Continuity, EncoderCheck, EncoderReading, VELOCITY_MIN)
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import (
    Estimate, FilterTuning, JOINT, PENDULUM_RATE, PendulumFilter)
from ballbot_ros.physics.model.robot import Robot

# While the encoder is implausible the angle is a prediction: it permits torque for `RELIED_ON`,
# and the estimate is lost after `GIVEN_UP` [s].
RELIED_ON, GIVEN_UP = 0.02, 0.1
# The estimate is lost after this number of jumps within this time [s].
MOST_JUMPS, JUMPS_WITHIN = 3, 5.0
# Highest plausible rate of ball and pendulum [rad/s].
HIGHEST_RATE = 300.0
# An IMU is not used after this time without a reading [s].
IMU_TIMEOUT = 0.05
# Largest number of IMU readings kept until the next encoder reading: some seconds.
QUEUE_SIZE = 2000
# Time constant that smooths the derivative of the turn rate [s].
SMOOTHING = 0.01


class Fusion:
    """
    Estimates the state from encoder and IMU readings in order of their arrival.

    Parameters
    ----------
    robot : Robot
    mounting : ImuMounting, optional
    tuning : FilterTuning, optional
    encoder_zero : float, optional
        Encoder angle at joint angle 0 [rad], of an absolute encoder.

    Attributes
    ----------
    estimate : Estimate or None
        None before the first encoder reading.
    jumps : int
        Number of encoder readings rejected because no motion explains them.
    rezeroed : int
        Number of new encoder zeros.
    last_jump : float
        Last change of the encoder zero [rad].
    follower : callable
        Called with each IMU reading, at the ball centre, and the estimate after it.

    """

    def __init__(self, robot: Robot, mounting: ImuMounting = ImuMounting(),
                 tuning: FilterTuning = FilterTuning(),
                 encoder_zero: Optional[float] = None):
        self._robot, self._filter = robot, PendulumFilter(robot, tuning)
        self._inertia = RollingModel(robot).own.pendulum_inertia
        motor = robot.motor
        # Without data, the motor may be at its highest rate in each motion [rad/s].
        self._highest_rate = motor.no_load_rate if motor is not None and motor.back_voltage \
            else VELOCITY_MIN
        self._mounting, self._encoder_zero = mounting, encoder_zero
        self.jumps = self.rezeroed = 0
        self.last_jump = 0.0
        self.follower: Callable[[Estimate, ImuReading], None] = lambda *_: None
        self.reset()

    def reset(self) -> None:
        """Drop the estimate; at the next encoder reading, the robot is assumed to be at rest."""
        self.estimate: Optional[Estimate] = None
        self._waiting: Deque[ImuReading] = deque(maxlen=QUEUE_SIZE)
        self._newest = -math.inf
        self._imu: Optional[ImuReading] = None
        self._upright = False  # whether ball angle 0 is where the IMU is upright
        self._continuity, self._check = Continuity(), EncoderCheck()
        self._jumped: Deque[float] = deque(maxlen=MOST_JUMPS)  # times [s]

    def reconnected(self) -> None:
        """Reset the count of jumps: a reconnected drive may count from another zero."""
        self._jumped.clear()

    def is_relied_on(self) -> bool:
        """Return whether the encoder is plausible, or was within `RELIED_ON`."""
        estimate, doubt = self.estimate, self._continuity.doubt
        return estimate is not None and (
            doubt is None or estimate.stamp - doubt.since <= RELIED_ON)

    def imu(self, reading: ImuReading) -> None:
        """
        Queue an IMU reading; the first encoder reading that is not older uses it.

        Raises `MessageError` with reason ``out_of_order``, and ``outlier`` for a turn rate that no
        motion explains.
        """
        if reading.stamp < self._newest:
            raise MessageError(
                f'IMU reading stamped {reading.stamp:.6f} s refused: one stamped '
                f'{self._newest:.6f} s arrived before', 'out_of_order', 'stamp')
        self._newest = reading.stamp
        followed = self._imu is not None and reading.stamp - self._imu.stamp <= IMU_TIMEOUT
        if self.estimate is not None and followed \
                and not self._filter.explains(self.estimate, reading):
            raise MessageError(
                f'IMU reading refused: no motion explains a turn rate of {reading.turn_rate:.3g} '
                'rad/s after the previous readings; check cable, supply and range of the gyro',
                'outlier', 'turn_rate')
        self._waiting.append(reading)

    def _use(self, reading: ImuReading, torque: float) -> None:
        """Predict the estimate under a torque and correct it with an IMU reading."""
        before, period, turning = self._imu, math.inf, 0.0
        if before is not None:
            period, turning = reading.stamp - before.stamp, before.turn_acceleration
            if 0.0 < period <= IMU_TIMEOUT:
                slope = (reading.turn_rate - before.turn_rate) / period
                turning += (slope - turning) * min(1.0, period / SMOOTHING)
        imu = self._imu = self._mounting.at_centre(reading, turning)
        if self.estimate is None:
            return
        if not self._upright:
            self._upright = True
            self.estimate = _with_upright(self.estimate, imu)
        estimate = self._filter.predict(self.estimate, imu.stamp, torque, imu)
        self.estimate = self._filter.with_imu(estimate, imu, min(period, IMU_TIMEOUT))
        self.follower(self.estimate, imu)

    def encoder(self, reading: EncoderReading) -> Estimate:
        """
        Process an encoder reading, and return the estimate at its time.

        Raises `MessageError` with reason ``not_finite``, and `EstimateLostError` with reason
        ``diverged`` if the estimate diverges, ``encoder_jumps`` if the encoder jumps repeatedly,
        and as `EncoderCheck` does; then the next reading starts an estimate of a robot at rest.
        """
        refuse_not_finite('encoder reading', stamp=reading.stamp, angle=reading.angle,
                          torque=reading.torque, rate=reading.rate or 0.0)
        try:
            self.estimate = self._after(reading)
        except EstimateLostError:
            self.reset()
            raise
        return self.estimate

    def _after(self, reading: EncoderReading) -> Estimate:
        """Return the estimate after an encoder reading."""
        stamp, angle, torque = reading[:3]
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._use(self._waiting.popleft(), torque)
        imu = self._imu
        if imu is not None and stamp - imu.stamp > IMU_TIMEOUT:
            imu = None
        self._check = self._check.after(reading)
        if self.estimate is None:
            self._upright = imu is not None
            self._continuity = Continuity(reading)
            return self._filter.start(stamp, angle, imu, self._encoder_zero)
        predicted = self._filter.predict(self.estimate, stamp, torque, imu)
        self._continuity = self._continuity.after(
            reading, self._filter.innovation(predicted, angle), predicted.joint_rate)
        if self._continuity.doubt is not None:
            self._check = EncoderCheck(reading)
            estimate = self._without_reading(predicted)
        else:
            estimate = self._filter.with_encoder(predicted, angle, reading.latency)
            if self._check.pause:
                change = float(estimate.mean[PENDULUM_RATE] - predicted.mean[PENDULUM_RATE])
                self._check = self._check.moved(
                    torque + self._inertia * change / self._check.pause,
                    self._robot.largest_gravity_torque, self._highest_rate)
        if not _plausible(estimate):
            raise EstimateLostError(
                'the estimate of the pendulum angle has diverged: readings contradict each other '
                'or the model for too long; let the robot come to rest',
                'diverged', 'pendulum_angle')
        return estimate

    def _without_reading(self, estimate: Estimate) -> Estimate:
        """Return the estimate without a rejected reading, with a new zero if enough agree."""
        doubt = self._continuity.doubt
        assert doubt is not None
        self.jumps += 1
        if doubt.jump is None:
            if estimate.stamp - doubt.since > GIVEN_UP:
                raise EstimateLostError(
                    f'for {GIVEN_UP:g} s the encoder has jumped, and its readings contradict each '
                    'other: check its cable and its supply; let the robot come to rest',
                    'encoder_jumps', 'encoder')
            return estimate
        self.rezeroed += 1
        self.last_jump = doubt.jump
        self._continuity = self._continuity._replace(doubt=None)
        self._jumped.append(estimate.stamp)
        if len(self._jumped) == MOST_JUMPS and estimate.stamp - self._jumped[0] < JUMPS_WITHIN:
            raise EstimateLostError(
                f'the encoder has jumped {MOST_JUMPS} times within {JUMPS_WITHIN:g} s, the last '
                f'time by {doubt.jump:.3f} rad at the joint: check its cable and its magnet; '
                'let the robot come to rest', 'encoder_jumps', 'encoder')
        return estimate._replace(encoder_zero=estimate.encoder_zero + doubt.jump)


def _with_upright(estimate: Estimate, imu: ImuReading) -> Estimate:
    """
    Return the estimate with ball angle 0 where an IMU that starts late is upright.

    Without an IMU the ball angle starts at 0.  The pendulum angle does not change, so ball and
    joint angle change by opposite amounts.
    """
    shift = math.remainder(
        math.atan2(imu.forward, imu.upward) - estimate.readings.ball_angle, 2.0 * math.pi)
    mean = estimate.mean.copy()
    mean[JOINT] -= shift
    return estimate._replace(mean=mean, encoder_zero=estimate.encoder_zero + shift)


def _plausible(estimate: Estimate) -> bool:
    """Return whether an estimate is finite and within the plausible rates."""
    _, _, rate, ball_rate, _ = estimate.mean.tolist()
    return abs(rate) < HIGHEST_RATE and abs(ball_rate) < HIGHEST_RATE \
        and estimate.angle_sd < math.pi
