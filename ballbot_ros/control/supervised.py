# SPDX-License-Identifier: Apache-2.0
"""The controller among unreliable publishers: old set-points, slow joint states, new time."""
from dataclasses import dataclass
import logging
import math
from typing import Optional

from ballbot_ros.control.controller import PendulumController
from ballbot_ros.control.freshness import RateMonitor
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.errors import MessageError

LOG = logging.getLogger(__name__)

# A set-point stamped further ahead of the joint states than this is of another clock [s].
SKEW = 1.0
# Measured rates are this uncertain.
RATE_SLACK = 0.98
# So many joint states are seen before their rate is judged: one lost at the start is no reason
# to stop.
JUDGED = 11
# More than the speed law can hold is said when it has lasted for so long [s]: pushes pass.
PUSH = 1.0
# After an e-stop, set-points other than rest must have been away for so long [s].
QUIET = 0.5
# Stamps are rounded to the nanosecond; this is well above and well below any period [s].
ROUNDING = 1e-6


@dataclass(frozen=True)
class Supervision:
    """
    What is expected of those that publish joint states and set-points.

    Attributes
    ----------
    lowest_rate : float
        Joint states must come at least this often, or the loop diverges [Hz].
    set_point_timeout : float
        Age at which a set-point is not followed any more [s]; 0 for never.
    set_point_period : float
        In lockstep, a state is answered only with the set-point of its own period [s];
        0 outside lockstep.
    let_down_time : float
        How long a pendulum that is let down is held there [s]; no torque after.

    """

    lowest_rate: float = 0.0
    set_point_timeout: float = 0.0
    set_point_period: float = 0.0
    let_down_time: float = math.inf


class SupervisedController:
    """
    Answers joint states with torque, or with none where that would not be safe.

    All time is that of the stamps.  What a person should know is logged.

    While the e-stop is engaged it is idle.  A release alone starts nothing: set-points other than
    rest are refused until they have been at rest, or away for `QUIET`.

    Attributes
    ----------
    expected : Supervision
    too_slow : bool
        The joint states come too rarely: torque is held at 0.
    overcome : bool
        More resists the set speed than the largest lean holds: the ball rolls away.
    let_down : bool
        Nobody has renewed the set-point.
    e_stop : bool

    """

    def __init__(self, controller: PendulumController, supervision: Supervision):
        """Start idle."""
        self._controller = controller
        self.expected = supervision
        self._rate = RateMonitor(least=JUDGED)
        self._newest: Optional[JointReadings] = None
        self._waiting: Optional[JointReadings] = None
        self._held_at = -math.inf
        # The set-point other than rest that came last, and when.
        self._asked: Optional[SetPoint] = None
        self._asked_at = -math.inf
        self._rest_first = False
        self.too_slow = self.overcome = self.let_down = self.e_stop = False

    def retune(self, tuning: ControlTuning) -> None:
        """Go on with other gains, without a jump; `expected` is to be changed with them."""
        self._controller.retune(tuning)

    @property
    def set_point(self) -> SetPoint:
        """Return the set-point in force."""
        return self._controller.set_point

    @property
    def excess(self) -> float:
        """Return what the torque limit has cut off the last answer [N m]."""
        return self._controller.excess

    @property
    def rate(self) -> Optional[float]:
        """Return the median rate of the joint states [Hz], None before it can be judged."""
        return self._rate.rate

    @property
    def time(self) -> float:
        """Return the stamp of the newest joint state, 0 before there is one [s]."""
        return self._newest.stamp if self._newest else 0.0

    def give(self, set_point: SetPoint) -> None:
        """
        Take a set-point.

        Raises
        ------
        MessageError
            With reason ``stale``, ``from_the_future`` or ``e_stop``.

        """
        ahead = set_point.stamp - self.time
        if self._newest is not None and ahead > SKEW:
            raise MessageError(
                'from_the_future', f'set-point of {set_point.stamp:.3f} s refused: the joint '
                f'states are of {self.time:.3f} s; is one of them stamped with wall time?')
        timeout = self.expected.set_point_timeout
        if self._newest is not None and timeout and -ahead > timeout:
            raise MessageError(
                'stale', f'set-point of {set_point.stamp:.3f} s refused: the joint states are '
                f'of {self.time:.3f} s, more than {timeout:g} s later')
        self._check_e_stop(set_point)
        if not self.e_stop:
            self._controller.give(set_point)
            self.let_down = False

    def hear_e_stop(self, engaged: bool) -> None:
        """Take note whether the e-stop is engaged; a set-point in force is then forgotten."""
        if engaged and not self.e_stop:
            self.forget()
        self._rest_first = self._rest_first or engaged
        self.e_stop = engaged

    def forget(self) -> None:
        """Be idle, until another set-point is given."""
        self._controller.reset()
        self.let_down = False

    def overhear(self, set_point: SetPoint) -> None:
        """Take note of what was asked for, be it by a sender that is not followed."""
        if not set_point.is_rest:
            self._asked, self._asked_at = set_point, self.time

    @property
    def asked(self) -> Optional[SetPoint]:
        """Return the set-point other than rest that came within `QUIET`, None without one."""
        return self._asked if self.time - self._asked_at < QUIET else None

    def _check_e_stop(self, set_point: SetPoint) -> None:
        """Refuse what asks for motion while the e-stop is engaged, or right after."""
        if set_point.is_rest:
            self._rest_first = self._rest_first and self.e_stop
            return
        waiting = self._rest_first and (self.e_stop or self.asked is not None)
        self.overhear(set_point)
        if waiting:
            raise MessageError('e_stop', f'set-point of {set_point.in_words} refused: ' + (
                'the e-stop is engaged' if self.e_stop else
                'it was asked for while the e-stop was engaged; ask for rest first, or for '
                f'nothing for {QUIET:g} s'))
        self._rest_first = False

    def take(self, readings: JointReadings) -> None:
        """Note a joint state; `answer` then gives the torque for it."""
        if self._newest is not None and readings.stamp < self._newest.stamp:
            LOG.warning(
                f'time went back from {self._newest.stamp:.3f} s to {readings.stamp:.3f} s: '
                'set-point and integral are forgotten')
            self._controller.reset()
            self._asked_at = -math.inf
        self._rate.add(readings.stamp)
        self._newest = self._waiting = readings

    def answer(self, in_force: Optional[float] = None) -> Optional[float]:
        """
        Return the torque for the newest joint state [N m].

        Parameters
        ----------
        in_force : float, optional
            See `PendulumController.torque` [N m].

        Returns
        -------
        float or None
            None if it was answered already, or its set-point is still to come.

        """
        readings = self._waiting
        if readings is None or self._too_early(readings.stamp):
            return None
        self._waiting = None
        self._check_age(readings.stamp)
        rate = self._rate.rate
        slow = rate is not None and rate < RATE_SLACK * self.expected.lowest_rate
        if slow and not self.too_slow:
            LOG.warning(
                f'joint states come at {rate:.0f} Hz and these gains need '
                f'{self.expected.lowest_rate:.0f} Hz: torque is 0; raise the rate or choose '
                'another tuning')
        if slow or self.too_slow:
            # The law takes note of the readings, and begins at the zero that is in force.
            self._controller.take_over()
        self.too_slow = slow
        torque = self._controller.torque(readings, 0.0 if slow else in_force)
        self._check_hold(readings.stamp)
        return 0.0 if slow else torque

    def _check_hold(self, stamp: float) -> None:
        """Say when what resists is more than the pendulum holds."""
        if not self._controller.overcome or stamp < self._held_at:
            self._held_at, self.overcome = stamp, False
        elif stamp - self._held_at > PUSH and not self.overcome:
            self.overcome = True
            LOG.warning(
                f'the set speed of {self.set_point.value:g} m/s is not kept: what resists is like '
                f'a slope of {math.degrees(self._controller.slope):.1f} degrees, and the largest '
                f'lean holds {math.degrees(self._controller.steepest_slope):.1f}; the ball may '
                'roll away')

    def _too_early(self, stamp: float) -> bool:
        """In lockstep, return whether the set-point of this state's period is missing."""
        period = self.expected.set_point_period
        if not period or self.e_stop:
            return False
        given = self.set_point.stamp
        return not given - ROUNDING <= stamp < given + period - ROUNDING

    def _check_age(self, stamp: float) -> None:
        """Let the pendulum down when nobody renews the set-point."""
        timeout = self.expected.set_point_timeout
        current = self.set_point
        if not timeout or current.mode is Mode.IDLE:
            return
        age = stamp - current.stamp
        if self.let_down:
            if age > timeout + self.expected.let_down_time:
                self._controller.give(SetPoint(Mode.IDLE, 0.0, current.stamp))
        elif age > timeout + ROUNDING:
            self.let_down = True
            self._controller.give(SetPoint(Mode.HOLD, 0.0, current.stamp))
            LOG.warning(
                f'no new set-point for {timeout:g} s at t = {stamp:.3f} s: the pendulum is let '
                f'down; publish set-points at {2.0 / timeout:.0f} Hz or more')
