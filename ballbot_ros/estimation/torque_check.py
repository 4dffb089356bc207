# SPDX-License-Identifier: Apache-2.0
"""
Check that the joint follows its torque: the momentum observer of collision detection.

The filter predicts the pendulum with the commanded torque, gravity and the acceleration that the
IMU measures.  The correction of the pendulum rate by the encoder, times the inertia and divided by
the time, is a torque that the model does not explain.  With friction, pushes and errors of the
model it stays well below the commanded torque, and an impact is short.  It cancels the commanded
torque for a long time if the encoder is frozen or the joint is blocked, and is twice the commanded
torque if the encoder counts backwards.
"""
import math
from typing import NamedTuple

from ballbot_ros.physics.model.robot import Robot

# Time constant of the low-pass filter of both torques [s].
SMOOTHING = 0.1
# Checked from this commanded torque on, as a part of the largest gravity torque.
TORQUE_MIN = 0.5
# An unexplained torque of this part of the commanded one, against it,
UNEXPLAINED_MIN = 0.6
# where that of one reading is limited to this part, to reduce the weight of a short impact,
UNEXPLAINED_MAX = 2.5
# while the joint turns no faster than this in the direction of the torque [rad/s],
FOLLOWING_RATE = 2.0
# for this long, contradicts the encoder [s]: an impact is shorter.
CONTRADICTION_TIME = 0.04


class TorqueCheck(NamedTuple):
    """Commanded and unexplained torque, smoothed [N m]; `after` gives the next."""

    commanded: float = 0.0
    unexplained: float = 0.0
    contradicted_for: float = 0.0  # [s]

    def after(self, robot: Robot, period: float, torque: float, rate_correction: float,
              joint_rate: float) -> 'TorqueCheck':
        """
        Return the check after an encoder reading.

        Parameters
        ----------
        robot : Robot
        period : float
            Since the previous reading [s].
        torque : float
            At the pendulum in this period [N m].
        rate_correction : float
            Of the pendulum rate, by this reading [rad/s].
        joint_rate : float
            After it [rad/s].

        """
        if period <= 0.0:
            return self
        inertia = robot.pendulum_inertia + robot.pendulum_mass * robot.pendulum_length**2
        part = 1.0 - math.exp(-period / SMOOTHING)
        commanded = self.commanded + part * (torque - self.commanded)
        largest = UNEXPLAINED_MAX * abs(torque)
        unexplained = self.unexplained + part * (
            min(max(inertia * rate_correction / period, -largest), largest) - self.unexplained)
        contradicted = (
            abs(commanded) >= TORQUE_MIN * robot.largest_gravity_torque
            and -unexplained * commanded >= UNEXPLAINED_MIN * commanded**2
            and joint_rate * math.copysign(1.0, commanded) < FOLLOWING_RATE)
        return TorqueCheck(commanded, unexplained,
                           self.contradicted_for + period if contradicted else 0.0)

    @property
    def contradicts(self) -> str:
        """Return why the encoder cannot be relied on, empty while it can."""
        if self.contradicted_for < CONTRADICTION_TIME:
            return ''
        return (f'the joint does not follow its torque: {self.commanded:.2f} N m were commanded '
                f'and {self.unexplained:.2f} N m are unexplained, so encoder or IMU are '
                'frozen, reversed or in other units, or the joint is blocked; look at both '
                'sensors, the coupling and `direction` of the hardware file')
