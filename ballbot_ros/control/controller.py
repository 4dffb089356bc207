# SPDX-License-Identifier: Apache-2.0
"""The pendulum controller: set-points and readings in, torque out; no clock, no ROS."""
import math
from typing import Optional

from ballbot_ros.control.rolling_model import require_pendulum
from ballbot_ros.control.signals import JointReadings, Mode, SetPoint
from ballbot_ros.control.speed_law import (
    estimated_slope, Numbers, speed_law_start, speed_law_step, SpeedLaw, SpeedState,
    steepest_slope)
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.errors import MessageError
from ballbot_ros.physics.model.actuation import limited, position_torque, velocity_torque
from ballbot_ros.physics.model.robot import Robot


# Shortest blend time after a change of gains [s].
RETUNING = 0.2
# After a longer gap between readings the speed law restarts [s].
LONGEST_STEP = 0.5


class PendulumController:
    """
    Laws (11) and (12), and the speed law over (11), with a torque limit.

    All times are stamps of readings, so that a paused or replayed simulation
    gives the same torque.  Before the first set-point the torque is zero.

    The integral of (12) is the paper's ``set_rate * t - theta2`` with both counted from the
    first reading under this set-point; repeating the set-point, as a publisher does
    periodically, does not restart it.  While the torque is limited, the integral only changes
    in the direction that leaves the limit; without limiting, the law is unchanged.

    A change of the set speed keeps the resistance estimate of the speed law, a change of the mode
    resets it.

    A change of the law is bumpless: the difference between the previous torque and that of the
    new law fades linearly over `blend_time` of the tuning.

    Attributes
    ----------
    set_point : SetPoint
        Active set-point.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """

    def __init__(self, robot: Robot, tuning: ControlTuning):
        require_pendulum(robot)
        self._robot = robot
        self._use(tuning)
        self.reset()

    def retune(self, tuning: ControlTuning) -> None:
        """
        Change the gains without a jump of the torque, as for a change of the law.

        Set-point, integral and resistance estimate are kept.
        """
        self._use(tuning)
        self._fade = max(tuning.blend_time, RETUNING)
        self._taking_over = True

    def take_over(self) -> None:
        """
        Continue from zero torque without a jump, after another component held the motor at zero.

        Set-point and resistance estimate are kept; the integral restarts at the next reading.
        """
        self._restart_integral()
        self._torque = 0.0
        self._fade = max(self._tuning.blend_time, RETUNING)
        self._taking_over = True

    def _use(self, tuning: ControlTuning) -> None:
        self._tuning = tuning
        self._gravity_torque = (
            self._robot.largest_gravity_torque if tuning.gravity_compensation else 0.0)
        # Parameters of the speed law for its kernels, created at the first use.
        self._numbers: Optional[Numbers] = None

    def reset(self) -> None:
        """Drop set-point, readings and integral, and become idle, for a stop or a time jump."""
        self.set_point = SetPoint(Mode.IDLE, stamp=-1e300)
        self._last: Optional[JointReadings] = None
        self._torque = 0.0
        self._taking_over = False
        # Previous torque minus that of the new law at the change [N m], and its stamp.
        self._difference, self._since = 0.0, 0.0
        self._fade = self._tuning.blend_time
        self._restart()

    def give(self, set_point: SetPoint) -> None:
        """
        Replace the set-point.

        Raises
        ------
        MessageError
            With reason ``stale`` if it is older than the active one.

        """
        current = self.set_point
        if set_point.stamp < current.stamp:
            raise MessageError(
                f'set-point stamped {set_point.stamp:.6g} s refused: the active one is '
                f'stamped {current.stamp:.6g} s; if time was set back, reset the controller',
                'stale', 'stamp')
        if (set_point.mode, set_point.value) != (current.mode, current.value):
            if not (set_point.mode is current.mode is Mode.SPEED):
                self._restart()
            # The next reading gives a new torque, even with the stamp of the last one.
            self._answered = False
            if set_point.mode is not current.mode:
                self._taking_over, self._fade = True, self._tuning.blend_time
        self.set_point = set_point

    def torque(self, readings: JointReadings, in_force: Optional[float] = None) -> float:
        """
        Return the torque for these readings, within the torque limit [N m].

        A repeated stamp gives the same torque.

        Parameters
        ----------
        readings : JointReadings
        in_force : float, optional
            Present torque of the motor, if it may differ from the last output [N m].

        Raises
        ------
        MessageError
            With reason ``stale`` if the readings are older than the last ones.

        """
        last = self._last
        if last is not None and readings.stamp < last.stamp:
            raise MessageError(
                f'readings stamped {readings.stamp:.6g} s refused: readings stamped '
                f'{last.stamp:.6g} s arrived before; if time was set back, reset the controller',
                'stale', 'stamp')
        if not (self._answered and last is not None and readings.stamp == last.stamp):
            self._torque = self._law(
                readings, self._torque if in_force is None else in_force)
            self._last = readings
            self._answered = True
        return self._torque

    def _restart(self) -> None:
        """Restart the integral at the next reading."""
        self._restart_integral()
        self._answered = False
        # Stamp and state of the speed law, before and after the last readings.
        self._before: Optional[tuple[float, SpeedState]] = None
        self._learnt: Optional[tuple[float, SpeedState]] = None

    def _restart_integral(self) -> None:
        self._start: Optional[JointReadings] = None
        self._surplus = self._lag = 0.0

    def _law(self, readings: JointReadings, in_force: float) -> float:
        """Return the saturated torque of the active law [N m]."""
        if self.set_point.mode is Mode.IDLE:
            self._difference, self._taking_over = 0.0, False
            return 0.0
        if self.set_point.mode is Mode.DRIVE:
            unsaturated = self._drive(readings)
        else:
            set_angle = (self.set_point.value if self.set_point.mode is Mode.HOLD
                         else self._speed(readings))
            unsaturated = position_torque(
                readings.pendulum_angle, readings.pendulum_rate, set_angle,
                self._tuning.position_kp, self._tuning.position_kd, self._gravity_torque)
        torque = limited(unsaturated, self._tuning.torque_limit)
        if self._taking_over:
            self._taking_over = False
            if self._fade > 0.0:
                self._difference, self._since = in_force - torque, readings.stamp
        if self._difference:
            faded = unsaturated + self._faded(readings.stamp)
            torque = limited(torque + faded - unsaturated, self._tuning.torque_limit)
        return torque

    def _faded(self, stamp: float) -> float:
        """Return the remaining torque difference to the previous law [N m]."""
        left = 1.0 - (stamp - self._since) / self._fade
        if left <= 0.0:
            self._difference = left = 0.0
        return self._difference * left

    @property
    def _speed_numbers(self) -> Numbers:
        if self._numbers is None:
            self._numbers = SpeedLaw.tuned(self._robot, self._tuning)[:]
        return self._numbers

    @property
    def slope(self) -> float:
        """Return the slope that the speed law estimates, NaN in other modes [rad]."""
        return estimated_slope(self._learnt[1], self._speed_numbers) if self._learnt else math.nan

    @property
    def steepest_slope(self) -> float:
        """Return the steepest slope on which the speed law can hold the ball [rad]."""
        return steepest_slope(self._tuning.largest_lean, self._speed_numbers)

    @property
    def overcome(self) -> bool:
        """Return whether the resistance exceeds the largest that the speed law can hold."""
        return self._learnt is not None and not abs(self.slope) <= self.steepest_slope

    def _speed(self, readings: JointReadings) -> float:
        """Return the set angle of the speed law [rad]."""
        stamp, speed = readings.stamp, -self._robot.ball_radius * readings.ball_rate
        if self._learnt is not None and stamp > self._learnt[0]:
            self._before = self._learnt
        if self._before is None or not 0.0 < stamp - self._before[0] <= LONGEST_STEP:
            self._before = None
            self._learnt = stamp, speed_law_start(
                speed, readings.pendulum_angle, 0.0, self._speed_numbers)
            return readings.pendulum_angle
        # Repeated readings, under another set speed, step from the same state.
        state, set_angle = speed_law_step(
            self._before[1], speed, readings.pendulum_angle, self.set_point.value,
            self._tuning.largest_lean, stamp - self._before[0], self._speed_numbers)
        if not math.isfinite(sum(state)):  # implausible readings
            self._before = self._learnt = None
            return readings.pendulum_angle
        self._learnt = stamp, state
        return set_angle

    def _drive(self, readings: JointReadings) -> float:
        """Return the unsaturated torque of law (12) [N m]; its integral does not wind up."""
        if self._start is None:
            self._start = readings
        elapsed = readings.stamp - self._start.stamp
        turned = readings.joint_angle - self._start.joint_angle
        lag = self.set_point.value * elapsed - turned - self._surplus
        unsaturated = self._velocity_law(readings, lag)
        deeper = (lag - self._lag) * unsaturated > 0.0
        if abs(unsaturated) > self._tuning.torque_limit and deeper:
            self._surplus += lag - self._lag
            lag = self._lag
            unsaturated = self._velocity_law(readings, lag)
        self._lag = lag
        return unsaturated

    def _velocity_law(self, readings: JointReadings, lag: float) -> float:
        """Return the unsaturated torque of law (12) [N m]."""
        return velocity_torque(
            readings.pendulum_angle, readings.joint_rate, lag, self.set_point.value,
            self._tuning.velocity_kp, self._tuning.velocity_ki, self._gravity_torque)
