# SPDX-License-Identifier: Apache-2.0
"""
Model, exact and linearised, of a ball that rolls without slip on a slope a, positive uphill.

The path is -R theta1, so two degrees of freedom remain, the pendulum angle phi and theta1::

    T = (J1 + M R^2) theta1'^2 / 2 + (J2 + M2 e^2) phi'^2 / 2 - M2 e R cos(phi - a) theta1' phi'
    V = -M2 g e cos(phi) - M g R sin(a) theta1

    (J2 + M2 e^2) phi'' - C theta1'' + M2 g e sin(phi) = tau2 - c2 (phi' - theta1')
    (J1 + M R^2) theta1'' - C phi'' + M2 e R sin(phi - a) phi'^2
        = -tau2 + c2 (phi' - theta1') - c1 theta1' + M g R sin(a)

with C = M2 e R cos(phi - a).  Stability analysis and pendulum filter use this model on a level
floor, the rollouts of a decision on slopes; the simulator models contact and slip.

While the ball slips or flies, no horizontal contact force depends on its motion.  Then the joint
drives the two inertias J1 and I = J2 + M2 e^2 M1 / M alone (see `solvers.flight`), so the same
equations hold with these and C = 0.  This is the smallest inertia that the joint can drive.

The functions are pure and compiled: the filter calls them in each period of the motor loop.
`RollingModel` calls the same functions.
"""
import math
from typing import NamedTuple, Tuple

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array


def require_pendulum(robot: Robot) -> None:
    """Raise `ConfigurationError` if the robot has no pendulum."""
    if not robot.has_pendulum:
        raise ConfigurationError(
            f'{robot.name} has no pendulum (pendulum_mass is 0): there is nothing to control or '
            'to estimate; use a robot with a pendulum', 'inconsistent', 'pendulum_mass')


# An angular acceleration [rad/s2] and its derivatives by phi, phi' and theta1'.
Slopes = Tuple[float, float, float, float]


class RollingNumbers(NamedTuple):
    """Parameters of a robot for the functions of this module."""

    pendulum_inertia: float  # J2 + M2 e^2 [kg m2]
    ball_inertia: float  # J1 + M R^2 [kg m2]
    lever: float  # M2 e R, C at angle 0 [kg m2]
    gravity_torque: float  # M2 g e [N m]
    joint_friction: float  # c2 [N m s/rad]
    rolling_friction: float  # c1 [N m s/rad]
    weight_torque: float  # M g R [N m]


# The numbers of a `RollingNumbers`.
Rolling = Tuple[float, float, float, float, float, float, float]


@compiled
def rolling_loads(angle: float, rate: float, ball_rate: float, slope: float,
                  rolling: Rolling) -> Tuple[float, float, float]:
    """Return the torques on pendulum and ball without that of the motor [N m], and C [kg m2]."""
    own = RollingNumbers(*rolling)
    friction, aside = own.joint_friction * (rate - ball_rate), angle - slope
    return (-friction - own.gravity_torque * math.sin(angle),
            friction - own.rolling_friction * ball_rate
            - own.lever * math.sin(aside) * rate**2 + own.weight_torque * math.sin(slope),
            own.lever * math.cos(aside))


@compiled
def rolling_response(angle: float, on_pendulum: float, on_ball: float, rolling: Rolling
                     ) -> Tuple[float, float]:
    """Return phi'' and theta1'' [rad/s2] under generalised torques [N m]."""
    own = RollingNumbers(*rolling)
    coupling = own.lever * math.cos(angle)
    determinant = own.pendulum_inertia * own.ball_inertia - coupling**2
    return ((own.ball_inertia * on_pendulum + coupling * on_ball) / determinant,
            (coupling * on_pendulum + own.pendulum_inertia * on_ball) / determinant)


@compiled
def rolling_accelerations(angle: float, rate: float, ball_rate: float, torque: float,
                          rolling: Rolling) -> Tuple[float, float]:
    """Return phi'' and theta1'' [rad/s2]; see `RollingModel` for the arguments."""
    on_pendulum, on_ball, _ = rolling_loads(angle, rate, ball_rate, 0.0, rolling)
    return rolling_response(angle, torque + on_pendulum, on_ball - torque, rolling)


@compiled
def rolling_linearised(angle: float, rate: float, ball_rate: float, torque: float,
                       rolling: Rolling) -> Tuple[Slopes, Slopes]:
    """Return phi'' and theta1'', each with its derivatives; see `Slopes`."""
    own = RollingNumbers(*rolling)
    pendulum, ball = rolling_accelerations(angle, rate, ball_rate, torque, rolling)
    sine, cosine = math.sin(angle), math.cos(angle)
    # The coupling depends on the angle, too: M q'' = Q gives M dq'' = dQ - dM q''.
    by_angle = rolling_response(
        angle, -own.gravity_torque * cosine - own.lever * sine * ball,
        -own.lever * cosine * rate**2 - own.lever * sine * pendulum, rolling)
    by_rate = rolling_response(angle, -own.joint_friction,
                               own.joint_friction - 2.0 * own.lever * sine * rate, rolling)
    by_ball_rate = rolling_response(
        angle, own.joint_friction, -own.joint_friction - own.rolling_friction, rolling)
    return ((pendulum, by_angle[0], by_rate[0], by_ball_rate[0]),
            (ball, by_angle[1], by_rate[1], by_ball_rate[1]))


class RollingModel:
    """
    The equations above for one robot.

    In all methods `angle` [rad] and `rate` [rad/s] are absolute and of the pendulum, phi and
    phi'.  `ball_rate` is theta1' [rad/s]: rolling to +x at v, it is -v / R.  `torque` is
    tau2 [N m].  With `rolls` false the ball slips or flies.

    Attributes
    ----------
    robot : Robot
    own : RollingNumbers
        With I for the inertia of the pendulum where the ball does not roll.
    numbers : tuple of floats
        Those of `own`, for the compiled functions.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """

    def __init__(self, robot: Robot, rolls: bool = True):
        require_pendulum(robot)
        self.robot = robot
        own = RollingNumbers(
            robot.joint_inertia, robot.ball_inertia + robot.total_mass * robot.ball_radius**2,
            robot.pendulum_moment * robot.ball_radius, robot.largest_gravity_torque,
            robot.joint_friction, robot.rolling_friction, robot.weight * robot.ball_radius)
        self.own = own if rolls else own._replace(
            pendulum_inertia=robot.swing_inertia, ball_inertia=robot.ball_inertia, lever=0.0,
            weight_torque=0.0)
        self.numbers: Rolling = self.own[:]

    def response(self, angle: float, on_pendulum: float, on_ball: float) -> Tuple[float, float]:
        """Return phi'' and theta1'' [rad/s2] under generalised torques [N m]."""
        return rolling_response(angle, on_pendulum, on_ball, self.numbers)

    def held_acceleration(self, angle: float) -> float:
        """
        Return the acceleration of the ball while its pendulum is held at an angle [m/s2].

        Without friction: R M2 g e sin(phi) / (J1 + M R^2 - M2 e R cos(phi)).
        """
        return (self.robot.ball_radius * self.own.gravity_torque * math.sin(angle)
                / (self.own.ball_inertia - self.own.lever * math.cos(angle)))

    def about_held(self, angle: float) -> Tuple[Array, Array]:
        """
        Return matrix and column of the model linearised about a held pendulum.

        They apply to deviations of (phi, phi', theta1') and to tau2.  A held
        pendulum accelerates the ball, so this is not an equilibrium: the model describes small
        deviations from that accelerated rolling, at low speed.
        """
        # The torque that holds it: phi'' = 0 in the first of the two equations.
        torque = (self.own.gravity_torque * math.sin(angle)
                  + self.robot.pendulum_moment * math.cos(angle) * self.held_acceleration(angle))
        slopes = [one[1:] for one in rolling_linearised(angle, 0.0, 0.0, torque, self.numbers)]
        return (np.array([[0.0, 1.0, 0.0], *slopes]),
                np.array([0.0, *self.response(angle, 1.0, -1.0)]))
