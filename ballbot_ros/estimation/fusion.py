# SPDX-License-Identifier: Apache-2.0
"""The filter among unreliable sensors: an IMU that times out, an encoder that jumps."""
from collections import deque
from dataclasses import replace
import math
from typing import Deque, Optional

from ballbot_ros.control.signals import refuse_not_finite
from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import Estimate, JOINT, PendulumFilter
from ballbot_ros.estimation.tuning import FilterTuning
from ballbot_ros.physics.model.robot import Robot

# An encoder angle further than this from the predicted one is an outlier [rad]: at 25 rad/s,
# more than any joint here turns, it takes 20 ms, and the rate is known before.
OUTLIER = 0.5
# So many outliers in a row, and the encoder counts from another zero.
REZERO_AFTER = 5
# No ball or pendulum turns faster [rad/s].
HIGHEST_RATE = 300.0
# An IMU is not relied on after this silence [s].
IMU_TIMEOUT = 0.05
# So many IMU readings wait while there is no encoder reading: some seconds.
QUEUE_SIZE = 2000
# Over which the differences of the turn rate are smoothed [s]: one of two readings is noisy.
SMOOTHING = 0.01


class Fusion:
    """
    Takes readings as they come and always has an estimate.

    Parameters
    ----------
    robot : Robot
    mounting : ImuMounting, optional
    tuning : FilterTuning, optional
    encoder_zero : float, optional
        Encoder angle at joint angle 0 [rad], of an encoder that remembers it.

    Attributes
    ----------
    estimate : Estimate or None
        None before the first encoder reading.
    jumps : int
        Encoder readings that were left out as outliers.
    rezeroed : int
        How often a new zero of the encoder was learned.

    """

    def __init__(self, robot: Robot, mounting: ImuMounting = ImuMounting(),
                 tuning: FilterTuning = FilterTuning(),
                 encoder_zero: Optional[float] = None):
        """Start with nothing known."""
        self._filter = PendulumFilter(robot, tuning)
        self._mounting, self._encoder_zero = mounting, encoder_zero
        self.jumps = self.rezeroed = 0
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next encoder reading is of a robot at rest."""
        self.estimate: Optional[Estimate] = None
        self._waiting: Deque[ImuReading] = deque(maxlen=QUEUE_SIZE)
        self._newest = -math.inf
        self._imu: Optional[ImuReading] = None
        self._upright = False  # ball angle 0 is where the IMU is upright
        self._in_a_row = 0

    def has_imu(self, now: float) -> bool:
        """Return whether there is an IMU reading not older than its timeout."""
        return now - self._newest <= IMU_TIMEOUT

    def imu(self, reading: ImuReading) -> None:
        """
        Take an IMU reading; it counts from the first encoder reading that is not older.

        Raises
        ------
        MessageError
            With reason ``out_of_order``.

        """
        if reading.stamp < self._newest:
            raise MessageError(
                'out_of_order', f'IMU reading of {reading.stamp:.6f} s refused: one of '
                f'{self._newest:.6f} s came before')
        self._newest = reading.stamp
        self._waiting.append(reading)

    def _use(self, reading: ImuReading, torque: float) -> None:
        """Update the estimate with an IMU reading, reached under a torque."""
        before, period, turning = self._imu, math.inf, 0.0
        if before is not None:
            period, turning = reading.stamp - before.stamp, before.turn_acceleration
            if 0.0 < period <= IMU_TIMEOUT:
                slope = (reading.turn_rate - before.turn_rate) / period
                turning += (slope - turning) * min(1.0, period / SMOOTHING)
        imu = self._mounting.at_centre(replace(reading, turn_acceleration=turning))
        self._imu = imu
        if self.estimate is None:
            return
        if not self._upright:
            self._upright = True
            self.estimate = _with_upright(self.estimate, imu)
        estimate = self._filter.predict(self.estimate, imu.stamp, torque, imu)
        self.estimate = self._filter.with_imu(estimate, imu, min(period, IMU_TIMEOUT))

    def encoder(self, stamp: float, angle: float, torque: float) -> Estimate:
        """
        Take an encoder reading and return the estimate of its time.

        Parameters
        ----------
        stamp : float
            [s]
        angle : float
            Of the joint, from an arbitrary zero [rad].
        torque : float
            At the pendulum since the reading before [N m].

        Raises
        ------
        MessageError
            With reason ``not_finite``.
        EstimateLostError
            If the estimate has run away; the next reading is again of a robot at rest.

        """
        refuse_not_finite('encoder reading', stamp=stamp, angle=angle, torque=torque)
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._use(self._waiting.popleft(), torque)
        imu = self._imu
        if imu is not None and stamp - imu.stamp > IMU_TIMEOUT:
            imu = None
        if self.estimate is None:
            self._upright = imu is not None
            self.estimate = self._filter.start(stamp, angle, imu, self._encoder_zero)
            return self.estimate
        estimate = self._filter.predict(self.estimate, stamp, torque, imu)
        innovation = self._filter.innovation(estimate, angle)
        if abs(innovation) <= OUTLIER:
            self._in_a_row = 0
            estimate = self._filter.with_encoder(estimate, angle)
        else:
            self.jumps += 1
            self._in_a_row += 1
            if self._in_a_row >= REZERO_AFTER:
                self._in_a_row = 0
                self.rezeroed += 1
                estimate = estimate._replace(encoder_zero=estimate.encoder_zero + innovation)
        if not _plausible(estimate):
            self.reset()
            raise EstimateLostError(
                'the estimate of the pendulum angle has run away: readings contradict each other '
                'or the model for too long; let the robot come to rest')
        self.estimate = estimate
        return estimate


def _with_upright(estimate: Estimate, imu: ImuReading) -> Estimate:
    """
    Return the estimate with ball angle 0 where the IMU is upright, when it comes after the start.

    Without one the ball angle was counted from wherever it was.  The pendulum stays where it is,
    so ball and joint angle move by opposite amounts.
    """
    shift = math.remainder(
        math.atan2(imu.forward, imu.upward) - estimate.readings.ball_angle, 2.0 * math.pi)
    mean = estimate.mean.copy()
    mean[JOINT] -= shift
    return estimate._replace(mean=mean, encoder_zero=estimate.encoder_zero + shift)


def _plausible(estimate: Estimate) -> bool:
    """Return whether an estimate can be one of a robot; infinity and NaN cannot."""
    _, _, rate, ball_rate, _ = estimate.mean.tolist()
    return abs(rate) < HIGHEST_RATE and abs(ball_rate) < HIGHEST_RATE \
        and estimate.angle_sd < math.pi
