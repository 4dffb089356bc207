# SPDX-License-Identifier: Apache-2.0
"""
The ball that rolls without slip on a level floor: exact, and linearised.

With x = -R theta1 two degrees of freedom are left, the pendulum angle phi and theta1::

    T = (J1 + M R^2) theta1'^2 / 2 + (J2 + M2 e^2) phi'^2 / 2 - M2 e R cos(phi) theta1' phi'
    V = -M2 g e cos(phi)

    (J2 + M2 e^2) phi'' - C theta1'' + M2 g e sin(phi) = tau2 - c2 (phi' - theta1')
    (J1 + M R^2) theta1'' - C phi'' + M2 e R sin(phi) phi'^2
        = -tau2 + c2 (phi' - theta1') - c1 theta1'

with C = M2 e R cos(phi).  Controllers are judged on this model; the simulator has the full
one with contact and slip.
"""
import math

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.robot import Robot


def _inertias(robot: Robot, angle: float) -> tuple:
    """Return pendulum inertia, ball inertia and their coupling C at `angle` [kg m2]."""
    if not robot.has_pendulum:
        raise ConfigurationError(
            f'{robot.name} has no pendulum (pendulum_mass is 0): there is nothing to '
            'control; use a robot with a pendulum')
    lever = robot.pendulum_mass * robot.pendulum_length
    return (robot.pendulum_inertia + lever * robot.pendulum_length,
            robot.ball_inertia + robot.total_mass * robot.ball_radius**2,
            lever * robot.ball_radius * math.cos(angle))


def rolling_accelerations(robot: Robot, angle: float, rate: float, ball_rate: float,
                          torque: float) -> tuple:
    """
    Return phi'' and theta1'' of the exact rolling model [rad/s2].

    Parameters
    ----------
    robot : Robot
    angle, rate : float
        Pendulum angle phi [rad] and its rate [rad/s], absolute.
    ball_rate : float
        theta1' [rad/s]; rolling to +x at v, it is -v / R.
    torque : float
        tau2 [N m].

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """
    pendulum, ball, coupling = _inertias(robot, angle)
    joint = torque - robot.joint_friction * (rate - ball_rate)
    lever = robot.pendulum_mass * robot.pendulum_length
    on_pendulum = joint - robot.largest_gravity_torque * math.sin(angle)
    on_ball = (-joint - robot.rolling_friction * ball_rate
               - lever * robot.ball_radius * math.sin(angle) * rate**2)
    determinant = pendulum * ball - coupling**2
    return ((ball * on_pendulum + coupling * on_ball) / determinant,
            (coupling * on_pendulum + pendulum * on_ball) / determinant)


def held_acceleration(robot: Robot, angle: float) -> float:
    """
    Return the acceleration of the ball while its pendulum is held at an angle [m/s2].

    Friction left out: R M2 g e sin(phi) / (J1 + M R^2 - M2 e R cos(phi)).

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """
    _, ball, coupling = _inertias(robot, angle)
    return (robot.ball_radius * robot.largest_gravity_torque * math.sin(angle)
            / (ball - coupling))


def linear_rolling(robot: Robot, angle: float) -> tuple:
    """
    Return matrix and column of the rolling model, linearised about a held pendulum.

    A held pendulum accelerates the ball, so this is no equilibrium: the model describes
    small deviations from that accelerated rolling, at low speed.

    Parameters
    ----------
    robot : Robot
    angle : float
        Held pendulum angle [rad].

    Returns
    -------
    matrix : (3, 3) array
        Of the deviations (phi, phi', theta1').
    column : (3,) array
        Effect of tau2.

    Raises
    ------
    ConfigurationError
        If the robot has no pendulum.

    """
    pendulum, ball, coupling = _inertias(robot, angle)
    lever = robot.pendulum_mass * robot.pendulum_length * robot.ball_radius
    ball_acceleration = -held_acceleration(robot, angle) / robot.ball_radius
    # The second term: leaning further changes how strongly the accelerating ball shakes
    # the pendulum.
    stiffness = (robot.largest_gravity_torque * math.cos(angle)
                 + lever * math.sin(angle) * ball_acceleration)
    joint, rolling = robot.joint_friction, robot.rolling_friction
    forces = np.array([[-stiffness, -joint, joint, 1.0],
                       [0.0, joint, -joint - rolling, -1.0]])
    inertia = np.array([[pendulum, -coupling], [-coupling, ball]])
    accelerations = np.linalg.solve(inertia, forces)
    matrix = np.vstack([[0.0, 1.0, 0.0], accelerations[:, :3]])
    return matrix, np.concatenate([[0.0], accelerations[:, 3]])
