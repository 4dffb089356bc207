# SPDX-License-Identifier: Apache-2.0
"""The controller with supervision: stale set-points, slow joint states, time jumps, e-stop."""
from collections import deque
from dataclasses import dataclass
import logging
import math
from statistics import median
from typing import Deque, Optional

from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.errors import MessageError

LOG = logging.getLogger(__name__)

# Largest time by which the stamp of a set-point may be ahead of the joint states [s].
STAMP_AHEAD_MAX = 1.0
# Tolerance factor of measured rates.
RATE_SLACK = 0.98
# Number of periods whose median gives the rate, and smallest number that does: one joint state
# lost at the start must not stop the robot.
RATE_PERIODS, LEAST_PERIODS = 20, 10
# Shortest time between two warnings of a low rate, which may change with each joint state [s].
WARNING_PERIOD = 1.0
# Excessive resistance in the speed law is logged after this time [s]: pushes are shorter.
RESISTANCE_TIME = 1.0
# After an e-stop, set-points other than rest are accepted after a gap of this time [s].
SET_POINT_GAP = 0.5
# Tolerance for stamps rounded to the nanosecond; far below any period [s].
STAMP_ROUNDING = 1e-6


class RateMonitor:
    """Measures a rate by the median period, which ignores a single late message."""

    def __init__(self) -> None:
        self._last = math.inf
        self._periods: Deque[float] = deque(maxlen=RATE_PERIODS)

    def add(self, stamp: float) -> None:
        """Add the stamp of an arrival [s]; ignore a repeated one, restart after a jump back."""
        if stamp > self._last:
            self._periods.append(stamp - self._last)
        elif stamp < self._last:
            self._periods.clear()
        self._last = stamp

    @property
    def rate(self) -> Optional[float]:
        """Return the rate [Hz], None with fewer than `LEAST_PERIODS`."""
        if len(self._periods) < LEAST_PERIODS:
            return None
        return 1.0 / median(self._periods)


@dataclass(frozen=True)
class Supervision:
    """
    Requirements on the publishers of joint states and set-points.

    Attributes
    ----------
    lowest_rate : float
        Lowest rate of joint states; below it the loop diverges [Hz].
    set_point_timeout : float
        Age at which a set-point expires [s]; 0 for never.
    set_point_period : float
        In lockstep, a state gives a torque only with the set-point of its own period [s];
        0 outside lockstep.
    let_down_time : float
        Time for which the lowered pendulum is held [s]; then the torque is zero.

    """

    lowest_rate: float = 0.0
    set_point_timeout: float = 0.0
    set_point_period: float = 0.0
    let_down_time: float = math.inf


class SupervisedController:
    """
    Computes a torque from each joint state, zero where a torque would not be safe.

    All times are stamps.

    While the e-stop is engaged it is idle.  A release alone starts no motion: set-points other
    than rest are refused until one is rest, or there is none for `SET_POINT_GAP`.

    Attributes
    ----------
    expected : Supervision
    too_slow : bool
        The rate of joint states is too low: the torque is 0.
    overcome : bool
        The resistance exceeds the largest that the lean can hold: the ball rolls away.
    let_down : bool
        The set-point has expired; the pendulum is lowered.
    e_stop : bool

    """

    def __init__(self, controller: PendulumController, supervision: Supervision):
        self._controller = controller
        self.expected = supervision
        self._rate = RateMonitor()
        self._newest: Optional[JointReadings] = None
        self._waiting: Optional[JointReadings] = None
        self._held_at = self._warned_at = -math.inf
        # The last set-point other than rest, and its time.
        self._requested: Optional[SetPoint] = None
        self._requested_at = -math.inf
        self._rest_first = False
        self.too_slow = self.overcome = self.let_down = self.e_stop = False

    def retune(self, tuning: ControlTuning) -> None:
        """Change the gains without a jump of the torque; the caller updates `expected`."""
        self._controller.retune(tuning)

    @property
    def set_point(self) -> SetPoint:
        """Return the active set-point."""
        return self._controller.set_point

    @property
    def rate(self) -> Optional[float]:
        """Return the median rate of the joint states [Hz], None with too few of them."""
        return self._rate.rate

    @property
    def time(self) -> float:
        """Return the stamp of the latest joint state, 0 before the first [s]."""
        return self._newest.stamp if self._newest else 0.0

    def give(self, set_point: SetPoint, now: Optional[float] = None) -> None:
        """
        Accept a set-point at a time [s]; without a clock, that of the latest joint state.

        Raises `MessageError` with reason ``stale``, ``from_the_future`` or ``e_stop``.
        """
        ahead = set_point.stamp - (self.time if now is None else now)
        # With the e-stop engaged joint states may have stopped, and the age is unknown.
        dated = self._newest is not None and not self.e_stop
        if dated and ahead > STAMP_AHEAD_MAX:
            raise MessageError(
                f'set-point stamped {set_point.stamp:.3f} s refused: the joint '
                f'states are stamped {self.time:.3f} s; is one of them stamped with wall time?',
                'from_the_future', 'stamp')
        timeout = self.expected.set_point_timeout
        if dated and timeout and -ahead > timeout:
            raise MessageError(
                f'set-point stamped {set_point.stamp:.3f} s refused: the joint states are '
                f'stamped {self.time:.3f} s, more than {timeout:g} s later', 'stale', 'stamp')
        self._check_e_stop(set_point)
        if not self.e_stop:
            self._controller.give(set_point)
            self.let_down = False

    def on_e_stop(self, engaged: bool) -> None:
        """Store the state of the e-stop; if engaged, drop the set-point."""
        if engaged and not self.e_stop:
            self.forget()
        self._rest_first = self._rest_first or engaged
        self.e_stop = engaged

    def forget(self) -> None:
        """Drop the set-point."""
        self._controller.reset()
        self.let_down = False

    def record_request(self, set_point: SetPoint) -> None:
        """Record a requested set-point, also one from a sender without authority."""
        if not set_point.is_rest:
            self._requested, self._requested_at = set_point, self.time

    @property
    def requested(self) -> Optional[SetPoint]:
        """Return the last set-point other than rest within `SET_POINT_GAP`, None without one."""
        return self._requested if self.time - self._requested_at < SET_POINT_GAP else None

    def _check_e_stop(self, set_point: SetPoint) -> None:
        """Refuse set-points other than rest while the e-stop is engaged, or just after."""
        if set_point.is_rest:
            self._rest_first = self._rest_first and self.e_stop
            return
        waiting = self._rest_first and (self.e_stop or self.requested is not None)
        self.record_request(set_point)
        if waiting:
            raise MessageError(f'set-point of {set_point.in_words} refused: ' + (
                'the e-stop is engaged' if self.e_stop else
                'it was requested while the e-stop was engaged; request rest first, or '
                f'nothing for {SET_POINT_GAP:g} s'), 'e_stop', 'e_stop')
        self._rest_first = False

    def take(self, readings: JointReadings) -> None:
        """Store a joint state; `answer` then returns its torque."""
        if self._newest is not None and readings.stamp < self._newest.stamp:
            LOG.warning(
                f'time went back from {self._newest.stamp:.3f} s to {readings.stamp:.3f} s: '
                'set-point and integral are reset')
            self._controller.reset()
            self._requested_at = -math.inf
        self._rate.add(readings.stamp)
        self._newest = self._waiting = readings

    def torque(self, readings: JointReadings, in_force: float, e_stop: bool) -> float:
        """Return the torque for a new joint state, 0 for none [N m]; see `answer`."""
        self.on_e_stop(e_stop)
        self.take(readings)
        return self.answer(in_force) or 0.0

    def answer(self, in_force: Optional[float] = None) -> Optional[float]:
        """
        Return the torque for the latest joint state [N m].

        None if its torque was returned already, or its set-point is missing; `in_force` as in
        `PendulumController.torque`.
        """
        readings = self._waiting
        if readings is None or self._too_early(readings.stamp):
            return None
        self._waiting = None
        self._check_age(readings.stamp)
        rate = self._rate.rate
        slow = rate is not None and rate < RATE_SLACK * self.expected.lowest_rate
        if slow and not self.too_slow \
                and not 0.0 <= readings.stamp - self._warned_at < WARNING_PERIOD:
            self._warned_at = readings.stamp
            LOG.warning(
                f'joint states arrive at {rate:.0f} Hz and these gains need '
                f'{self.expected.lowest_rate:.0f} Hz: torque is 0; raise the rate, choose '
                'another tuning, or find what delays them')
        if slow or self.too_slow:
            # The law stores the readings, and restarts from zero torque.
            self._controller.take_over()
        self.too_slow = slow
        torque = self._controller.torque(readings, 0.0 if slow else in_force)
        self._check_hold(readings.stamp)
        return 0.0 if slow else torque

    def _check_hold(self, stamp: float) -> None:
        """Log a resistance that exceeds the largest that the pendulum can hold."""
        if not self._controller.overcome or stamp < self._held_at:
            self._held_at, self.overcome = stamp, False
        elif stamp - self._held_at > RESISTANCE_TIME and not self.overcome:
            self.overcome = True
            LOG.warning(
                f'the set speed of {self.set_point.value:g} m/s is not reached: estimated '
                f'resistance of a slope of {math.degrees(self._controller.slope):.1f} degrees, '
                f'but the largest lean holds {math.degrees(self._controller.steepest_slope):.1f}; '
                'the ball may roll away')

    def _too_early(self, stamp: float) -> bool:
        """In lockstep, return whether the set-point of this state's period is missing."""
        period = self.expected.set_point_period
        if not period or self.e_stop:
            return False
        given = self.set_point.stamp
        return not given - STAMP_ROUNDING <= stamp < given + period - STAMP_ROUNDING

    def _check_age(self, stamp: float) -> None:
        """Lower the pendulum when the set-point has expired."""
        timeout = self.expected.set_point_timeout
        current = self.set_point
        if not timeout or current.mode is Mode.IDLE:
            return
        age = stamp - current.stamp
        if self.let_down:
            if age > timeout + self.expected.let_down_time:
                self._controller.give(SetPoint(Mode.IDLE, 0.0, current.stamp))
        elif age > timeout + STAMP_ROUNDING:
            self.let_down = True
            self._controller.give(SetPoint(Mode.HOLD, 0.0, current.stamp))
            LOG.warning(
                f'no new set-point for {timeout:g} s at t = {stamp:.3f} s: the pendulum is '
                f'lowered; publish set-points at {2.0 / timeout:.0f} Hz or more')
