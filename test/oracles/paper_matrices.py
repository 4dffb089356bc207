# SPDX-License-Identifier: Apache-2.0
"""
The equations of motion as printed in the paper: the matrices of eq. (6), solved as in eq. (13).

::

    A q'' + B [th1'^2, th2'^2, x'^2, y'^2] + C [th1' th2', th2' x', x' y', x' th1']
          + D q' + G = [tau1, tau2, Fx, Fy]              with q = (theta1, theta2, x, y)

`physics.mechanics.equations` contains the hand-derived solution of the same equations.  The angle
alpha of eqs. (4) and (5) is 0, because all angles of this package are relative to the vertical.
"""
import numpy as np

from ballbot_ros.physics import Robot, State
from ballbot_ros.physics.model.terrain import Array


def _levers(robot: Robot, state: State) -> tuple[float, float]:
    """Return M2 e cos(theta1 + theta2) and M2 e sin(theta1 + theta2) [kg m]."""
    moment = robot.pendulum_mass * robot.pendulum_length
    return (moment * float(np.cos(state.pendulum_angle)),
            moment * float(np.sin(state.pendulum_angle)))


def mass_matrix(robot: Robot, state: State) -> Array:
    """Return A of eq. (6), the mass matrix; it is singular for a robot without a pendulum."""
    cosine, sine = _levers(robot, state)
    swing = robot.pendulum_inertia + robot.pendulum_mass * robot.pendulum_length**2
    mass = robot.total_mass
    return np.array([
        [robot.ball_inertia + swing, swing, cosine, sine],
        [swing, swing, cosine, sine],
        [cosine, cosine, mass, 0.0],
        [sine, sine, 0.0, mass]])


def centrifugal_matrix(robot: Robot, state: State) -> Array:
    """Return B of eq. (6), which multiplies the squares of the rates."""
    cosine, sine = _levers(robot, state)
    matrix = np.zeros((4, 4))
    matrix[2, :2] = -sine
    matrix[3, :2] = cosine
    return matrix


def coriolis_matrix(robot: Robot, state: State) -> Array:
    """Return C of eq. (6), which multiplies the products of the rates."""
    cosine, sine = _levers(robot, state)
    matrix = np.zeros((4, 4))
    matrix[2, 0] = -2.0 * sine
    matrix[3, 0] = 2.0 * cosine
    return matrix


def friction_matrix(robot: Robot) -> Array:
    """Return D of eq. (6), the viscous friction; c2 acts on the relative rate theta2'."""
    return np.diag([robot.rolling_friction, robot.joint_friction, 0.0, 0.0])


def gravity_vector(robot: Robot, state: State) -> Array:
    """Return G of eq. (6)."""
    _, sine = _levers(robot, state)
    return robot.gravity * np.array([sine, sine, 0.0, robot.total_mass])


def accelerations_by_solve(robot: Robot, state: State, ball_torque: float, motor_torque: float,
                           force_x: float, force_y: float) -> Array:
    """
    Return the accelerations of theta1, theta2, x and y by eq. (13); requires a pendulum.

    Parameters
    ----------
    ball_torque : float
        tau1, the torque of the contacts about the centre [N m].
    motor_torque : float
        tau2, the torque of the pendulum motor [N m].
    force_x, force_y : float
        Contact forces [N].

    """
    ball, joint, x, y = rates = np.array(
        [state.ball_rate, state.joint_rate, state.velocity_x, state.velocity_y])
    forces = np.array([ball_torque, motor_torque, force_x, force_y])
    return np.linalg.solve(mass_matrix(robot, state), (
        forces - centrifugal_matrix(robot, state) @ rates**2
        - coriolis_matrix(robot, state) @ [ball * joint, joint * x, x * y, x * ball]
        - friction_matrix(robot) @ rates - gravity_vector(robot, state)))
