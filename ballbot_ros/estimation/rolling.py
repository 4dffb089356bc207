# SPDX-License-Identifier: Apache-2.0
"""The rolling ball as a filter needs it: accelerations together with their derivatives."""
import math
from typing import NamedTuple, Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot


class Slopes(NamedTuple):
    """Derivatives of one acceleration by pendulum angle, pendulum rate and ball rate."""

    angle: float
    rate: float
    ball_rate: float


class Rolling:
    """
    A ball that rolls without slip on a level floor; the equations of `control.linear`.

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    gravity, radius, pendulum_moment, pendulum_inertia, joint_friction : float
        g, R, M2 e, J2 + M2 e^2 and c2, all SI.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """

    def __init__(self, robot: Robot):
        """Work the constants out once."""
        if not robot.has_pendulum:
            raise ConfigurationError(
                f'{robot.name} has no pendulum (pendulum_mass is 0): there is nothing to '
                'estimate; use a robot with a pendulum')
        self.gravity, self.radius = robot.gravity, robot.ball_radius
        self.pendulum_moment = robot.pendulum_mass * robot.pendulum_length
        self.pendulum_inertia = (
            robot.pendulum_inertia + self.pendulum_moment * robot.pendulum_length)
        self._ball_inertia = robot.ball_inertia + robot.total_mass * robot.ball_radius**2
        self.joint_friction, self._rolling_friction = robot.joint_friction, robot.rolling_friction
        self._weight_moment = robot.largest_gravity_torque

    def accelerations(self, angle: float, rate: float, ball_rate: float, torque: float
                      ) -> Tuple[float, float, Slopes, Slopes]:
        """
        Return phi'' and theta1'' [rad/s2], and the derivatives of each.

        Parameters
        ----------
        angle, rate : float
            Absolute pendulum angle [rad] and rate [rad/s].
        ball_rate : float
            theta1' [rad/s].
        torque : float
            tau2 [N m].

        """
        sine, cosine = math.sin(angle), math.cos(angle)
        lever = self.pendulum_moment * self.radius
        friction, coupling = self.joint_friction, lever * cosine
        pendulum, ball = self.pendulum_inertia, self._ball_inertia
        joint = torque - friction * (rate - ball_rate)
        on_pendulum = joint - self._weight_moment * sine
        on_ball = -joint - self._rolling_friction * ball_rate - lever * sine * rate**2
        determinant = pendulum * ball - coupling**2

        def solved(first: float, second: float) -> Tuple[float, float]:
            return ((ball * first + coupling * second) / determinant,
                    (coupling * first + pendulum * second) / determinant)

        swing, roll = solved(on_pendulum, on_ball)
        # With the angle the coupling changes, too: M q'' = Q gives M dq'' = dQ - dM q''.
        by_angle = solved(-self._weight_moment * cosine - lever * sine * roll,
                          -lever * cosine * rate**2 - lever * sine * swing)
        by_rate = solved(-friction, friction - 2.0 * lever * sine * rate)
        by_ball = solved(friction, -friction - self._rolling_friction)
        return (swing, roll, Slopes(by_angle[0], by_rate[0], by_ball[0]),
                Slopes(by_angle[1], by_rate[1], by_ball[1]))
