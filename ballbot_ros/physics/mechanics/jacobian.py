# SPDX-License-Identifier: Apache-2.0
r"""
The derivative of the equations of motion in a frozen mode, by hand.

An implicit step needs to know how the rates change with the state.  Coordinates change the
coordinates only through the velocities, so the interesting part is a table of nine rows (four
accelerations, five flows of energy) and nine columns (four coordinates, four velocities, time).

Each contact adds loads that depend on place, velocity and spin of the ball.  With normal n,
tangent t, distance d from the centre, and curvature kappa (0 on a segment, 1/d on a vertex), a
displacement dr turns the normal by ``kappa (t dr)``, and all else follows::

    d(v_n) = kappa v_t (t dr) + n dv        d(v_t) = -kappa v_n (t dr) + t dv
    dN = -k (n dr) - c d(v_n)               d(slip) = d(v_t) + lever domega + omega (n dr)

Where there is a CORNER, the share of friction that it takes from its neighbours depends on the
place, too; that is left out, and `smooth_contacts` tells whether the derivative is complete.
"""
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.contact import (
    CORNER, FRICTION, KIND, NORMAL_X, NORMAL_Y, PENETRATION, SURFACE)
from ballbot_ros.physics.mechanics.equations import (
    BALL_RATE, drive_slopes, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y, wanted_torque,
    X, Y)
from ballbot_ros.physics.mechanics.modes import (
    fill_table, MOTOR, normal_and_slip, PRESSED, SLIDING, unlimited_scale)

# Rows: accelerations, then flows of energy; in the order of the state vector.
BALL, PENDULUM, ALONG_X, ALONG_Y, TO_DAMPERS, TO_FRICTION, TO_ROLLING, TO_JOINT, FROM_MOTOR = (
    range(9))
TIME = 8  # the last column; the first eight are those of the state vector
# How the loads of the ground change, kept below the rows above: five loads, five causes.
LOADS = 9
ROWS = 14
CAUSES = np.array([X, Y, VELOCITY_X, VELOCITY_Y, BALL_RATE])  # their columns in the rows above


def jacobian_table() -> NDArray[np.float64]:
    """Return the array that `write_jacobian` works in."""
    return np.zeros((ROWS, 9))


@compiled
def smooth_contacts(table: Any, count: int) -> bool:
    """Tell whether the derivative is complete for the contacts in `table`."""
    for row in range(count):
        if table[row, KIND] == CORNER:
            return False
    return True


@compiled
def friction_slope(slip: float, robot: Any) -> float:
    """Return the derivative of `modes.unlimited_scale` [s/m]."""
    if robot.smooth_friction > 0.0:
        ratio = slip / robot.slip_threshold
        return 1.5 * max(0.0, 1.0 - ratio * ratio) / robot.slip_threshold
    return 1.0 / robot.slip_threshold


@compiled
def add_outer(out: Any, row: int, factor: float, x: float, y: float, velocity_x: float,
              velocity_y: float, spin: float) -> None:
    """Add a multiple of a gradient to the row of a load."""
    out[LOADS + row, 0] += factor * x
    out[LOADS + row, 1] += factor * y
    out[LOADS + row, 2] += factor * velocity_x
    out[LOADS + row, 3] += factor * velocity_y
    out[LOADS + row, 4] += factor * spin


@compiled
def add_contact(state: Any, mode: Any, row: int, robot: Any, table: Any, out: Any) -> tuple:
    """
    Add how the loads of one contact change with x, y, velocity_x, velocity_y, ball_rate.

    Returns its part of force_x and force_y.
    """
    normal_x, normal_y = table[row, NORMAL_X], table[row, NORMAL_Y]
    tangent_x, tangent_y = normal_y, -normal_x
    spin, stiffness = state[BALL_RATE], robot.stiffness
    distance = robot.radius - table[row, PENETRATION]
    bend = 0.0 if table[row, KIND] == SURFACE else 1.0 / distance
    force, slip, closing = normal_and_slip(state, robot, table, row)
    along = state[VELOCITY_X] * tangent_x + state[VELOCITY_Y] * tangent_y
    # Gradients; of the normal velocity: (closing_x, closing_y, normal_x, normal_y, 0).
    closing_x, closing_y = bend * along * tangent_x, bend * along * tangent_y
    drift_x, drift_y = -bend * closing * tangent_x, -bend * closing * tangent_y
    pressed = mode[row, PRESSED] != 0
    normal = force if pressed else 0.0
    # The force of a CORNER, which has no friction, counts with the other sign.
    sign = -1.0 if table[row, KIND] == CORNER else 1.0
    slope_x = -stiffness * normal_x - robot.damping * closing_x if pressed else 0.0
    slope_y = -stiffness * normal_y - robot.damping * closing_y if pressed else 0.0
    damping = -robot.damping if pressed else 0.0
    # Friction: -sign N mu scale(slip).
    rough = -mode[row, PRESSED] * table[row, FRICTION]
    scale, steep = float(mode[row, SLIDING]), 0.0
    if mode[row, SLIDING] == 0:
        scale = unlimited_scale(slip, robot)
        steep = rough * normal * friction_slope(slip, robot)
    friction, share = rough * normal * scale, rough * scale
    lever, growing = robot.radius, 0.0
    if robot.radius_lever == 0.0:
        lever, growing = distance, spin
    rub_x = share * slope_x + steep * (drift_x + growing * normal_x)
    rub_y = share * slope_y + steep * (drift_y + growing * normal_y)
    rub_vx = share * damping * normal_x + steep * tangent_x
    rub_vy = share * damping * normal_y + steep * tangent_y
    rub_spin = steep * lever
    # force = normal n + friction t, and both directions turn.
    turn = bend * (sign * normal * tangent_x - friction * normal_x)
    add_outer(out, 0, sign * normal_x, slope_x, slope_y, damping * normal_x,
              damping * normal_y, 0.0)
    add_outer(out, 0, tangent_x, rub_x, rub_y, rub_vx, rub_vy, rub_spin)
    add_outer(out, 0, turn, tangent_x, tangent_y, 0.0, 0.0, 0.0)
    turn = bend * (sign * normal * tangent_y - friction * normal_y)
    add_outer(out, 1, sign * normal_y, slope_x, slope_y, damping * normal_x,
              damping * normal_y, 0.0)
    add_outer(out, 1, tangent_y, rub_x, rub_y, rub_vx, rub_vy, rub_spin)
    add_outer(out, 1, turn, tangent_x, tangent_y, 0.0, 0.0, 0.0)
    # torque = friction distance
    add_outer(out, 2, distance, rub_x, rub_y, rub_vx, rub_vy, rub_spin)
    add_outer(out, 2, friction, normal_x, normal_y, 0.0, 0.0, 0.0)
    # contact loss = (k penetration - normal) closing
    held = sign * (stiffness * table[row, PENETRATION] - normal)
    add_outer(out, 3, sign * closing, -stiffness * normal_x - slope_x,
              -stiffness * normal_y - slope_y, -damping * normal_x, -damping * normal_y, 0.0)
    add_outer(out, 3, held, closing_x, closing_y, normal_x, normal_y, 0.0)
    # friction loss = -friction (along + distance spin)
    add_outer(out, 4, -(along + distance * spin), rub_x, rub_y, rub_vx, rub_vy, rub_spin)
    add_outer(out, 4, -friction, drift_x + spin * normal_x, drift_y + spin * normal_y,
              tangent_x, tangent_y, distance)
    return (sign * normal * normal_x + friction * tangent_x,
            sign * normal * normal_y + friction * tangent_y)


@compiled
def write_jacobian(time: float, state: Any, mode: Any, count: int, robot: Any, ground: Any,
                   drive: Any, table: Any, out: Any) -> None:
    """
    Write the derivative of `modes.mode_derivative` into the first nine rows of `out`.

    Parameters
    ----------
    time, state, mode, count, robot, ground, drive, table
        See `modes.mode_derivative`.
    out : (14, 9) array
        See `jacobian_table`; SI.

    """
    for row in range(ROWS):
        for column in range(9):
            out[row, column] = 0.0
    fill_table(state, mode, count, robot, ground, table)
    force_x = force_y = 0.0
    for row in range(count):
        part_x, part_y = add_contact(state, mode, row, robot, table, out)
        force_x += part_x
        force_y += part_y
    for cause in range(5):
        column = CAUSES[cause]
        out[BALL, column] = out[LOADS + 2, cause] / robot.ball_inertia
        out[ALONG_X, column] = out[LOADS, cause] / robot.mass
        out[ALONG_Y, column] = out[LOADS + 1, cause] / robot.mass
        out[TO_DAMPERS, column] = out[LOADS + 3, cause]
        out[TO_FRICTION, column] = out[LOADS + 4, cause]
    spin = state[BALL_RATE]
    out[BALL, BALL_RATE] -= robot.rolling_friction / robot.ball_inertia
    out[TO_ROLLING, BALL_RATE] = 2.0 * robot.rolling_friction * spin
    if robot.swing_inertia > 0.0:
        saturated = mode[len(mode) - 1, MOTOR]
        add_pendulum(time, state, saturated, force_x, force_y, robot, drive, out)


@compiled
def add_pendulum(time: float, state: Any, saturated: int, force_x: float, force_y: float,
                 robot: Any, drive: Any, out: Any) -> None:
    """Add to the derivative what the pendulum and its motor do, and how they feel the loads."""
    sine, cosine = math.sin(state[PENDULUM_ANGLE]), math.cos(state[PENDULUM_ANGLE])
    rate = state[PENDULUM_RATE]
    joint_rate = rate - state[BALL_RATE]
    motor = saturated * drive.limit
    # Slopes of the torque with ball and pendulum angle, ball and pendulum rate, and time.
    by_ball = by_angle = by_spin = by_rate = by_time = 0.0
    if saturated == 0:
        motor = wanted_torque(time, state, drive)
        by_ball, by_angle, by_spin, by_rate, by_time = drive_slopes(state, drive)
    damping, inertia = robot.joint_friction, robot.swing_inertia
    moment = robot.pendulum_moment / robot.mass
    swing = (motor - damping * joint_rate - moment * (force_x * cosine + force_y * sine)
             ) / inertia
    for cause in range(5):
        column = CAUSES[cause]
        out[PENDULUM, column] = -moment * (
            out[LOADS, cause] * cosine + out[LOADS + 1, cause] * sine) / inertia
    out[PENDULUM, 0] = by_ball / inertia
    out[PENDULUM, PENDULUM_ANGLE] = (
        by_angle + moment * (force_x * sine - force_y * cosine)) / inertia
    out[PENDULUM, BALL_RATE] += (by_spin + damping) / inertia
    out[PENDULUM, PENDULUM_RATE] = (by_rate - damping) / inertia
    out[PENDULUM, TIME] = by_time / inertia
    for column in range(9):
        out[ALONG_X, column] -= moment * cosine * out[PENDULUM, column]
        out[ALONG_Y, column] -= moment * sine * out[PENDULUM, column]
    out[ALONG_X, PENDULUM_ANGLE] += moment * (sine * swing + cosine * rate * rate)
    out[ALONG_Y, PENDULUM_ANGLE] -= moment * (cosine * swing - sine * rate * rate)
    out[ALONG_X, PENDULUM_RATE] += 2.0 * moment * sine * rate
    out[ALONG_Y, PENDULUM_RATE] -= 2.0 * moment * cosine * rate
    out[BALL, 0] -= by_ball / robot.ball_inertia
    out[BALL, PENDULUM_ANGLE] -= by_angle / robot.ball_inertia
    out[BALL, BALL_RATE] -= (by_spin + damping) / robot.ball_inertia
    out[BALL, PENDULUM_RATE] += (damping - by_rate) / robot.ball_inertia
    out[BALL, TIME] -= by_time / robot.ball_inertia
    out[TO_JOINT, BALL_RATE] = -2.0 * damping * joint_rate
    out[TO_JOINT, PENDULUM_RATE] = 2.0 * damping * joint_rate
    out[FROM_MOTOR, 0] = by_ball * joint_rate
    out[FROM_MOTOR, PENDULUM_ANGLE] = by_angle * joint_rate
    out[FROM_MOTOR, BALL_RATE] = by_spin * joint_rate - motor
    out[FROM_MOTOR, PENDULUM_RATE] = by_rate * joint_rate + motor
    out[FROM_MOTOR, TIME] = by_time * joint_rate
