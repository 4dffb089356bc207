# SPDX-License-Identifier: Apache-2.0
"""A ball on a stand, behind an emulated drive: a hand turns its shell and its pendulum."""
import math
import time

from ballbot_ros.physics.model.state import State
from ballbot_ros.plant import Imu

BY_HAND = 0.6  # rate at which a careful hand turns shell or pendulum [rad/s]
FRICTION = 0.25  # of a new bearing: swinging decays quickly [N m s/rad]


class StoodBall:
    """
    A substitute for `emulator.ball.Ball`.

    Attributes
    ----------
    pendulum, shell : float or None
        Absolute angle to which a hand turns it and holds it; None frees the pendulum [rad].
    extra : float
        Ratio of the actual torque to the one that the hardware file predicts.

    """

    def __init__(self, ball, robot, period, extra):
        """Start at rest with the pendulum down."""
        self.motor, self.state = ball.motor, State()
        self.pendulum, self.shell = None, 0.0
        self.plant = self
        self.torque, self._at = 0.0, 0.0
        self._robot, self._period, self._extra = robot, period, extra
        self._count = math.tau / 4096
        # A little noise: a real sensor never repeats a reading.
        self._imu = Imu(robot.gravity, gyro_sd=1e-4, force_sd=1e-3, seed=1)
        self._samples = 0
        self._read = self.state._replace(time=time.time())  # state at the last IMU reading

    @property
    def done(self):
        """Return whether shell and pendulum have reached their angles."""
        state = self.state
        return abs(state.ball_angle - self.shell) < 1e-9 and (
            self.pendulum is None or abs(state.pendulum_angle - self.pendulum) < 1e-9)

    @property
    def at_rest(self):
        """Return whether the pendulum hangs at rest."""
        return max(abs(self.state.pendulum_angle), abs(self.state.pendulum_rate)) < 0.005

    def advance(self, shaft_torque, _steering_torque):
        """Advance by a period; the stand blocks the second motor."""
        motor, before, period = self.motor, self.state, self._period
        # After a delay of the machine the hand does not catch up: the bridge, which receives late
        # replies, would detect a jump of the encoder.
        now = time.monotonic()
        by_hand, self._at = BY_HAND * period if now - self._at > 0.3 * period else 0.0, now
        self.torque = shaft_torque * motor.gear_ratio * motor.gear_efficiency * self._extra
        shell = _towards(before.ball_angle, self.shell, by_hand)
        shell_rate = (shell - before.ball_angle) / period
        if self.pendulum is not None:
            angle = _towards(before.pendulum_angle, self.pendulum, by_hand)
            rate = (angle - before.pendulum_angle) / period
        else:
            robot = self._robot
            inertia = robot.pendulum_inertia + robot.pendulum_mass * robot.pendulum_length**2
            rate = before.pendulum_rate + period / inertia * (
                self.torque - FRICTION * before.joint_rate
                - robot.largest_gravity_torque * math.sin(before.pendulum_angle))
            angle = before.pendulum_angle + period * rate
        self.state = before._replace(
            time=before.time + period, ball_angle=shell, ball_rate=shell_rate,
            pendulum_angle=angle, pendulum_rate=rate)
        return self.state

    def sensed(self, before, jump=0.0):
        """Return the measurements of the drive."""
        ratio = self.motor.gear_ratio
        angle = ratio * self.state.joint_angle + jump
        return before._replace(position=math.floor(angle / self._count) * self._count,
                               velocity=ratio * self.state.joint_rate)

    def imu(self):
        """
        Return a sample of an IMU in the shell, at the time of the system clock.

        The turn rate is the mean since the last sample, as in real sensors: if a busy machine
        samples rarely, instantaneous rates would not integrate to the rotation of the shell.
        """
        before, now, state = self._read, time.time(), self.state
        mean = (state.ball_angle - before.ball_angle) / (now - before.time)
        self._read = after = state._replace(time=now, ball_rate=mean)
        self._samples += 1
        return self._imu.sample(before._replace(ball_rate=mean), after, self._samples)


def _towards(value, wanted, step):
    return value + min(max(wanted - value, -step), step)
