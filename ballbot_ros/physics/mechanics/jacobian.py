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
place, too; that is left out, and `smooth_contacts` says whether the derivative is complete.
"""
import math

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.contact_law import (
    CORNER, force_and_slip, FRICTION, friction_scale, friction_slope, KIND, normal_and_friction,
    NORMAL_X, NORMAL_Y, PENETRATION, SURFACE)
from ballbot_ros.physics.mechanics.equations import torque_slopes, unsaturated_torque
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, MOTOR, PRESSED, SLIDING, write_contacts)
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array

# Rows: accelerations, then flows of energy; in the order of the state vector.
BALL, PENDULUM, ALONG_X, ALONG_Y, TO_DAMPERS, TO_FRICTION, TO_ROLLING, TO_JOINT, FROM_MOTOR = (
    range(9))
TIME = 8  # the last column; the first eight are those of the state vector
# How the loads of the ground change, kept below the rows above: five loads, five causes.
LOADS = 9
ROWS = 14
CAUSES = np.array([X, Y, VELOCITY_X, VELOCITY_Y, BALL_RATE])  # their columns in the rows above


def jacobian_table() -> Array:
    """Return the array that `write_jacobian` works in."""
    return np.zeros((ROWS, 9))


@compiled
def smooth_contacts(mode: ContactMode) -> bool:
    """Return whether the derivative is complete for the contacts of a mode."""
    for row in range(contact_count(mode)):
        if mode.contacts[row, KIND] == CORNER:
            return False
    return True


@compiled
def add_outer(out: Array, row: int, factor: float,
              slopes: tuple[float, float, float, float, float]) -> None:
    """Add a multiple of a gradient to the row of a load."""
    # Written out: an index that varies makes a tuple slow.
    out[LOADS + row, 0] += factor * slopes[0]
    out[LOADS + row, 1] += factor * slopes[1]
    out[LOADS + row, 2] += factor * slopes[2]
    out[LOADS + row, 3] += factor * slopes[3]
    out[LOADS + row, 4] += factor * slopes[4]


@compiled
def add_contact(state: Array, row: int, system: System, mode: ContactMode,
                out: Array) -> tuple[float, float]:
    """
    Add how the loads of one contact change with x, y, velocity_x, velocity_y, ball_rate.

    Returns its share of force_x and force_y.
    """
    parameters, contacts = system.parameters, mode.contacts
    normal_x, normal_y = contacts[row, NORMAL_X], contacts[row, NORMAL_Y]
    tangent_x, tangent_y = normal_y, -normal_x
    spin, stiffness = state[BALL_RATE], parameters.stiffness
    distance = parameters.radius - contacts[row, PENETRATION]
    bend = 0.0 if contacts[row, KIND] == SURFACE else 1.0 / distance
    force, slip, closing = force_and_slip(state, parameters, contacts, row)
    along = state[VELOCITY_X] * tangent_x + state[VELOCITY_Y] * tangent_y
    # Gradients; of the normal velocity: (closing_x, closing_y, normal_x, normal_y, 0).
    closing_x, closing_y = bend * along * tangent_x, bend * along * tangent_y
    drift_x, drift_y = -bend * closing * tangent_x, -bend * closing * tangent_y
    pressed, sliding = mode.signs[row, PRESSED], mode.signs[row, SLIDING]
    normal, friction = normal_and_friction(
        force, slip, pressed, sliding, parameters, contacts[row, FRICTION])
    # The force of a CORNER, which has no friction, counts with the other sign.
    sign = -1.0 if contacts[row, KIND] == CORNER else 1.0
    slope_x = -stiffness * normal_x - parameters.damping * closing_x if pressed != 0 else 0.0
    slope_y = -stiffness * normal_y - parameters.damping * closing_y if pressed != 0 else 0.0
    damping = -parameters.damping if pressed != 0 else 0.0
    # Friction: -sign N mu scale(slip).
    rough = -pressed * contacts[row, FRICTION]
    share = rough * friction_scale(slip, sliding, parameters)
    steep = rough * normal * friction_slope(slip, sliding, parameters)
    lever, growing = parameters.radius, 0.0
    if parameters.radius_lever == 0.0:
        lever, growing = distance, spin
    pressing = slope_x, slope_y, damping * normal_x, damping * normal_y, 0.0
    rubbing = (share * slope_x + steep * (drift_x + growing * normal_x),
               share * slope_y + steep * (drift_y + growing * normal_y),
               share * damping * normal_x + steep * tangent_x,
               share * damping * normal_y + steep * tangent_y, steep * lever)
    turning = tangent_x, tangent_y, 0.0, 0.0, 0.0
    # force = normal n + friction t, and both directions turn.
    add_outer(out, 0, sign * normal_x, pressing)
    add_outer(out, 0, tangent_x, rubbing)
    add_outer(out, 0, bend * (sign * normal * tangent_x - friction * normal_x), turning)
    add_outer(out, 1, sign * normal_y, pressing)
    add_outer(out, 1, tangent_y, rubbing)
    add_outer(out, 1, bend * (sign * normal * tangent_y - friction * normal_y), turning)
    # torque = friction distance
    add_outer(out, 2, distance, rubbing)
    add_outer(out, 2, friction, (normal_x, normal_y, 0.0, 0.0, 0.0))
    # contact loss = (k penetration - normal) closing
    held = sign * (stiffness * contacts[row, PENETRATION] - normal)
    add_outer(out, 3, sign * closing, (-stiffness * normal_x - slope_x,
              -stiffness * normal_y - slope_y, -damping * normal_x, -damping * normal_y, 0.0))
    add_outer(out, 3, held, (closing_x, closing_y, normal_x, normal_y, 0.0))
    # friction loss = -friction (along + distance spin)
    add_outer(out, 4, -(along + distance * spin), rubbing)
    add_outer(out, 4, -friction, (drift_x + spin * normal_x, drift_y + spin * normal_y,
                                  tangent_x, tangent_y, distance))
    return (sign * normal * normal_x + friction * tangent_x,
            sign * normal * normal_y + friction * tangent_y)


@compiled
def write_jacobian(time: float, state: Array, system: System, mode: ContactMode,
                   out: Array) -> None:
    """
    Write the derivative of `modes.mode_derivative` into the first nine rows of `out`.

    Parameters
    ----------
    time, state, system, mode
        See `modes.mode_derivative`.
    out : (14, 9) array
        See `jacobian_table`; SI.

    """
    parameters = system.parameters
    for row in range(ROWS):
        for column in range(9):
            out[row, column] = 0.0
    write_contacts(state, system, mode)
    force_x = force_y = 0.0
    for row in range(contact_count(mode)):
        share_x, share_y = add_contact(state, row, system, mode, out)
        force_x += share_x
        force_y += share_y
    for cause in range(5):
        column = CAUSES[cause]
        out[BALL, column] = out[LOADS + 2, cause] / parameters.ball_inertia
        out[ALONG_X, column] = out[LOADS, cause] / parameters.mass
        out[ALONG_Y, column] = out[LOADS + 1, cause] / parameters.mass
        out[TO_DAMPERS, column] = out[LOADS + 3, cause]
        out[TO_FRICTION, column] = out[LOADS + 4, cause]
    spin = state[BALL_RATE]
    out[BALL, BALL_RATE] -= parameters.rolling_friction / parameters.ball_inertia
    out[TO_ROLLING, BALL_RATE] = 2.0 * parameters.rolling_friction * spin
    if parameters.swing_inertia > 0.0:
        saturated = mode.signs[len(mode.signs) - 1, MOTOR]
        add_pendulum(time, state, saturated, system, (force_x, force_y), out)


@compiled
def add_pendulum(time: float, state: Array, saturated: int, system: System,
                 force: tuple[float, float], out: Array) -> None:
    """Add to the derivative what the pendulum and its motor do, and how they feel the loads."""
    (force_x, force_y), actuator, parameters = force, system.actuator, system.parameters
    sine, cosine = math.sin(state[PENDULUM_ANGLE]), math.cos(state[PENDULUM_ANGLE])
    rate = state[PENDULUM_RATE]
    joint_rate = rate - state[BALL_RATE]
    motor = saturated * actuator.limit
    # Slopes of the torque with ball and pendulum angle, ball and pendulum rate, and time.
    by_ball = by_angle = by_spin = by_rate = by_time = 0.0
    if saturated == 0:
        motor = unsaturated_torque(time, state, actuator)
        by_ball, by_angle, by_spin, by_rate, by_time = torque_slopes(state, actuator)
    damping, inertia = parameters.joint_friction, parameters.swing_inertia
    moment = parameters.pendulum_moment / parameters.mass
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
    out[BALL, 0] -= by_ball / parameters.ball_inertia
    out[BALL, PENDULUM_ANGLE] -= by_angle / parameters.ball_inertia
    out[BALL, BALL_RATE] -= (by_spin + damping) / parameters.ball_inertia
    out[BALL, PENDULUM_RATE] += (damping - by_rate) / parameters.ball_inertia
    out[BALL, TIME] -= by_time / parameters.ball_inertia
    out[TO_JOINT, BALL_RATE] = -2.0 * damping * joint_rate
    out[TO_JOINT, PENDULUM_RATE] = 2.0 * damping * joint_rate
    out[FROM_MOTOR, 0] = by_ball * joint_rate
    out[FROM_MOTOR, PENDULUM_ANGLE] = by_angle * joint_rate
    out[FROM_MOTOR, BALL_RATE] = by_spin * joint_rate - motor
    out[FROM_MOTOR, PENDULUM_RATE] = by_rate * joint_rate + motor
    out[FROM_MOTOR, TIME] = by_time * joint_rate
