# SPDX-License-Identifier: Apache-2.0
"""
The ball that rolls without slip on a level floor: exact, and linearised.

With x = -R theta1 two degrees of freedom are left, the pendulum angle phi and theta1::

    T = (J1 + M R^2) theta1'^2 / 2 + (J2 + M2 e^2) phi'^2 / 2 - M2 e R cos(phi) theta1' phi'
    V = -M2 g e cos(phi)

    (J2 + M2 e^2) phi'' - C theta1'' + M2 g e sin(phi) = tau2 - c2 (phi' - theta1')
    (J1 + M R^2) theta1'' - C phi'' + M2 e R sin(phi) phi'^2
        = -tau2 + c2 (phi' - theta1') - c1 theta1'

with C = M2 e R cos(phi).  Controllers are judged, and the pendulum is estimated, on this model;
the simulator has the full one with contact and slip.
"""
import math
from typing import NamedTuple, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot

Array = NDArray[np.float64]


def require_pendulum(robot: Robot) -> None:
    """Raise `ConfigurationError` if the robot has no pendulum."""
    if not robot.has_pendulum:
        raise ConfigurationError(
            f'{robot.name} has no pendulum (pendulum_mass is 0): there is nothing to control or '
            'to estimate; use a robot with a pendulum')


class Acceleration(NamedTuple):
    """An angular acceleration [rad/s2] and its derivatives."""

    value: float
    by_angle: float  # by phi
    by_rate: float  # by phi'
    by_ball_rate: float  # by theta1'


class RollingModel:
    """
    The equations above for one robot.

    In all methods `angle` [rad] and `rate` [rad/s] are those of the pendulum, absolute: phi and
    phi'.  `ball_rate` is theta1' [rad/s]: rolling to +x at v, it is -v / R.  `torque` is
    tau2 [N m].

    Attributes
    ----------
    robot : Robot
    pendulum_moment, pendulum_inertia : float
        M2 e [kg m] and J2 + M2 e^2 [kg m2].

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """

    def __init__(self, robot: Robot):
        """Work the constants out once."""
        require_pendulum(robot)
        self.robot = robot
        self.pendulum_moment = robot.pendulum_mass * robot.pendulum_length
        self.pendulum_inertia = (
            robot.pendulum_inertia + self.pendulum_moment * robot.pendulum_length)
        self._ball_inertia = robot.ball_inertia + robot.total_mass * robot.ball_radius**2
        self._lever = self.pendulum_moment * robot.ball_radius  # C at angle 0
        self._gravity_torque = robot.largest_gravity_torque

    def response(self, angle: float, on_pendulum: float, on_ball: float) -> Tuple[float, float]:
        """Return phi'' and theta1'' [rad/s2] under generalised torques [N m]."""
        pendulum, ball = self.pendulum_inertia, self._ball_inertia
        coupling = self._lever * math.cos(angle)
        determinant = pendulum * ball - coupling**2
        return ((ball * on_pendulum + coupling * on_ball) / determinant,
                (coupling * on_pendulum + pendulum * on_ball) / determinant)

    def accelerations(self, angle: float, rate: float, ball_rate: float, torque: float
                      ) -> Tuple[float, float]:
        """Return phi'' and theta1'' [rad/s2]."""
        sine = math.sin(angle)
        joint = torque - self.robot.joint_friction * (rate - ball_rate)
        return self.response(
            angle, joint - self._gravity_torque * sine,
            -joint - self.robot.rolling_friction * ball_rate - self._lever * sine * rate**2)

    def linearised(self, angle: float, rate: float, ball_rate: float, torque: float
                   ) -> Tuple[Acceleration, Acceleration]:
        """Return phi'' and theta1'' with their derivatives."""
        pendulum, ball = self.accelerations(angle, rate, ball_rate, torque)
        sine, cosine = math.sin(angle), math.cos(angle)
        lever, friction = self._lever, self.robot.joint_friction
        # With the angle the coupling changes, too: M q'' = Q gives M dq'' = dQ - dM q''.
        columns = (
            self.response(angle, -self._gravity_torque * cosine - lever * sine * ball,
                          -lever * cosine * rate**2 - lever * sine * pendulum),
            self.response(angle, -friction, friction - 2.0 * lever * sine * rate),
            self.response(angle, friction, -friction - self.robot.rolling_friction))
        of_pendulum, of_ball = zip(*columns)
        return Acceleration(pendulum, *of_pendulum), Acceleration(ball, *of_ball)

    def held_acceleration(self, angle: float) -> float:
        """
        Return the acceleration of the ball while its pendulum is held at an angle [m/s2].

        Friction left out: R M2 g e sin(phi) / (J1 + M R^2 - M2 e R cos(phi)).
        """
        return (self.robot.ball_radius * self._gravity_torque * math.sin(angle)
                / (self._ball_inertia - self._lever * math.cos(angle)))

    def about_held(self, angle: float) -> Tuple[Array, Array]:
        """
        Return matrix and column of the model linearised about a held pendulum.

        A held pendulum accelerates the ball, so this is no equilibrium: the model describes
        small deviations from that accelerated rolling, at low speed.

        Returns
        -------
        matrix : (3, 3) array
            Of the deviations (phi, phi', theta1').
        column : (3,) array
            Effect of tau2.

        """
        # The torque that holds it: phi'' = 0 in the first of the two equations.
        torque = (self._gravity_torque * math.sin(angle)
                  + self.pendulum_moment * math.cos(angle) * self.held_acceleration(angle))
        slopes = [one[1:] for one in self.linearised(angle, 0.0, 0.0, torque)]
        return (np.array([[0.0, 1.0, 0.0], *slopes]),
                np.array([0.0, *self.response(angle, 1.0, -1.0)]))
