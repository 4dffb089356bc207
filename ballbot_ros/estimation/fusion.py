# SPDX-License-Identifier: Apache-2.0
"""The filter among unreliable sensors: an IMU that stays away, an encoder that jumps."""
from collections import deque
from dataclasses import replace
import math
from typing import Deque, Optional

from ballbot_ros.errors import EstimateLostError, MessageError
from ballbot_ros.estimation.imu import ImuMounting, ImuReading
from ballbot_ros.estimation.kalman import Estimate, FilterTuning, PendulumFilter
from ballbot_ros.physics.model.robot import Robot

# An encoder angle further than this from the expected one is not believed [rad]: at 25 rad/s,
# more than any joint here turns, it takes 20 ms, and the rate is known before.
JUMP = 0.5
# So many in a row, and the encoder counts from another zero.
INSISTS = 5
# No ball or pendulum turns faster [rad/s].
FASTEST = 300.0
# An IMU is not asked any more after this silence [s].
IMU_TIMEOUT = 0.05
# So many IMU readings wait while there is no encoder reading: some seconds.
MOST_WAITING = 2000
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
        Encoder readings that were not believed.
    rezeroed : int
        Times that the encoder went on from another zero.

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
        self._waiting: Deque[ImuReading] = deque(maxlen=MOST_WAITING)
        self._newest = -math.inf
        self._imu: Optional[ImuReading] = None
        self._upright = False  # ball angle 0 is where the IMU is upright
        self._in_a_row = 0
        self._torque = 0.0

    def has_imu(self, now: float) -> bool:
        """Tell whether the IMU has been heard of lately."""
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

    def _use(self, reading: ImuReading) -> None:
        """Improve the estimate by an IMU reading."""
        before, period, turning = self._imu, math.inf, 0.0
        if before is not None:
            period, turning = reading.stamp - before.stamp, before.turn_acceleration
            if 0.0 < period <= IMU_TIMEOUT:
                slope = (reading.turn_rate - before.turn_rate) / period
                turning += (slope - turning) * min(1.0, period / SMOOTHING)
        self._imu = self._mounting.at_centre(replace(reading, turn_acceleration=turning))
        if self.estimate is None:
            return
        if not self._upright:
            self._learn_upright(self._imu)
        estimate = self._filter.predict(
            self.estimate, reading.stamp, self._torque, self._imu)
        self.estimate = self._filter.with_imu(estimate, self._imu, min(period, IMU_TIMEOUT))

    def _learn_upright(self, imu: ImuReading) -> None:
        """
        Let ball angle 0 be where the IMU is upright, when it comes after the start.

        Without one the ball angle was counted from wherever it was.  The pendulum stays where it
        is, so ball and joint angle move by opposite amounts.
        """
        estimate = self.estimate
        assert estimate is not None
        self._upright = True
        shift = math.atan2(imu.forward, imu.upward) - estimate.readings.ball_angle
        shift = math.remainder(shift, 2.0 * math.pi)
        mean = estimate.mean.copy()
        mean[1] -= shift
        self.estimate = estimate._replace(
            mean=mean, encoder_zero=estimate.encoder_zero + shift)

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
        if not (math.isfinite(angle) and math.isfinite(stamp) and math.isfinite(torque)):
            raise MessageError(
                'not_finite', f'encoder reading refused: angle {angle!r}, stamp {stamp!r} and '
                f'torque {torque!r} must be finite')
        self._torque = torque
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._use(self._waiting.popleft())
        imu = self._imu
        if imu is not None and stamp - imu.stamp > IMU_TIMEOUT:
            imu = None
        if self.estimate is None:
            self._upright = imu is not None
            self.estimate = self._filter.start(stamp, angle, imu, self._encoder_zero)
            return self.estimate
        estimate = self._filter.predict(self.estimate, stamp, torque, imu)
        surprise = self._filter.surprise(estimate, angle)
        if abs(surprise) <= JUMP:
            self._in_a_row = 0
            estimate = self._filter.with_encoder(estimate, angle)
        else:
            self.jumps += 1
            self._in_a_row += 1
            if self._in_a_row >= INSISTS:
                self._in_a_row = 0
                self.rezeroed += 1
                estimate = estimate._replace(encoder_zero=estimate.encoder_zero + surprise)
        if not _sane(estimate):
            self.reset()
            raise EstimateLostError(
                'the estimate of the pendulum angle has run away: readings contradict each other '
                'or the model for too long; let the robot come to rest')
        self.estimate = estimate
        return estimate


def _sane(estimate: Estimate) -> bool:
    """Tell whether an estimate is one of a robot; infinity and NaN are not."""
    rates = estimate.mean[2:4]
    return bool(abs(rates[0]) < FASTEST and abs(rates[1]) < FASTEST
                and estimate.angle_sd < math.pi)
