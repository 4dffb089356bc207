# SPDX-License-Identifier: Apache-2.0
r"""
The analytical Jacobian of the equations of motion in a frozen mode.

An implicit step needs the derivative of the rates with respect to the state.  The rates of the
coordinates depend only on the velocities, and no rate depends on the energies, so the nontrivial
part is a table of four rows (the accelerations) and nine columns (four coordinates, four
velocities, time).

Each contact adds loads that depend on position, velocity and spin of the ball.  With normal n,
tangent t, distance d from the centre, and curvature kappa (0 on a segment, 1/d on a vertex), a
displacement dr turns the normal by ``kappa (t dr)``, and all else follows::

    d(v_n) = kappa v_t (t dr) + n dv        d(v_t) = -kappa v_n (t dr) + t dv
    dN = (dD/dp - k) (n dr) - dD/dv_n d(v_n)         d(slip) = d(v_t) + lever domega + omega (n dr)

At a CORNER, the share of friction that it takes from its neighbours also depends on the
position; this term is omitted, and `smooth_contacts` returns whether the Jacobian is complete.
"""
import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import meeting
from ballbot_ros.physics.mechanics.contact_law import (
    CORNER, FEATURE, FRICTION, friction_scale, friction_slope, KIND, normal_and_friction,
    PRESSED, pressing_and_slipping, SLIDING, slip_lever)
from ballbot_ros.physics.mechanics.equations import Direction, torque_slopes
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, mode_torque, MOTOR, smooth_contacts)
from ballbot_ros.physics.model.contact_laws import damper
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array

# Rows: the accelerations, in the order of the state vector.
BALL, PENDULUM, ALONG_X, ALONG_Y = range(4)
TIME = 8  # the last column; the first eight are those of the state vector
# How the loads of the ground change, kept below the rows above: force_x, force_y and torque with
# x, y, velocity_x, velocity_y, ball_rate.
LOADS = 4
ROWS = 7


def jacobian_table() -> Array:
    """Return the array that `write_jacobian` works in."""
    return np.zeros((ROWS, 9))


@compiled
def add_load(out: Array, load: int, factor: float,
             slopes: tuple[float, float, float, float, float]) -> None:
    """Add a multiple of a gradient to the row of a load."""
    # Written out: an index that varies makes a tuple slow.
    out[LOADS + load, 0] += factor * slopes[0]
    out[LOADS + load, 1] += factor * slopes[1]
    out[LOADS + load, 2] += factor * slopes[2]
    out[LOADS + load, 3] += factor * slopes[3]
    out[LOADS + load, 4] += factor * slopes[4]


@compiled
def add_contact(state: Array, row: int, system: System, mode: ContactMode,
                out: Array) -> tuple[float, float, float]:
    """
    Add how the loads of one contact change with x, y, velocity_x, velocity_y, ball_rate.

    Returns its share of force_x and force_y [N], and of the torque [N m].
    """
    parameters, feature = system.parameters, mode.signs[row, FEATURE]
    normal_x, normal_y, distance, coefficient = meeting(
        feature, state[X], state[Y], system.ground)
    corner = False
    if not smooth_contacts(mode):
        corner = mode.contacts[row, KIND] == CORNER
        coefficient = mode.contacts[row, FRICTION]
    tangent_x, tangent_y = normal_y, -normal_x
    spin = state[BALL_RATE]
    bend = 0.0 if feature & 1 == 0 else 1.0 / distance
    lever = slip_lever(distance, parameters)
    force, slip, closing, along, _ = pressing_and_slipping(
        normal_x, normal_y, parameters.radius - distance, lever, state[VELOCITY_X],
        state[VELOCITY_Y], spin, parameters)
    # Gradients; of the normal velocity: (closing_x, closing_y, normal_x, normal_y, 0).
    closing_x, closing_y = bend * along * tangent_x, bend * along * tangent_y
    drift_x, drift_y = -bend * closing * tangent_x, -bend * closing * tangent_y
    pressed, sliding = mode.signs[row, PRESSED], mode.signs[row, SLIDING]
    normal, friction = normal_and_friction(force, slip, pressed, sliding, parameters, coefficient)
    # The force of a CORNER, which has no friction, counts with the other sign.
    sign = -1.0 if corner else 1.0
    _, softer, damping = damper(parameters.radius - distance, closing, parameters)
    stiffness, damping = parameters.stiffness - softer, damping if pressed != 0 else 0.0
    slope_x = -stiffness * normal_x - damping * closing_x if pressed != 0 else 0.0
    slope_y = -stiffness * normal_y - damping * closing_y if pressed != 0 else 0.0
    # Friction: -sign N mu scale(slip).
    rough = -pressed * coefficient
    share = rough * friction_scale(slip, sliding, parameters)
    steep = rough * normal * friction_slope(slip, sliding, parameters)
    growing = 0.0 if parameters.radius_lever > 0.0 else spin
    pressing = slope_x, slope_y, -damping * normal_x, -damping * normal_y, 0.0
    rubbing = (share * slope_x + steep * (drift_x + growing * normal_x),
               share * slope_y + steep * (drift_y + growing * normal_y),
               -share * damping * normal_x + steep * tangent_x,
               -share * damping * normal_y + steep * tangent_y, steep * lever)
    turning = tangent_x, tangent_y, 0.0, 0.0, 0.0
    # force = normal n + friction t, and both directions turn.
    add_load(out, 0, sign * normal_x, pressing)
    add_load(out, 0, tangent_x, rubbing)
    add_load(out, 0, bend * (sign * normal * tangent_x - friction * normal_x), turning)
    add_load(out, 1, sign * normal_y, pressing)
    add_load(out, 1, tangent_y, rubbing)
    add_load(out, 1, bend * (sign * normal * tangent_y - friction * normal_y), turning)
    # torque = friction distance
    add_load(out, 2, distance, rubbing)
    add_load(out, 2, friction, (normal_x, normal_y, 0.0, 0.0, 0.0))
    return (sign * normal * normal_x + friction * tangent_x,
            sign * normal * normal_y + friction * tangent_y, friction * distance)


@compiled
def write_jacobian(time: float, state: Array, hanging: Direction, system: System,
                   mode: ContactMode, out: Array) -> tuple[float, float, float]:
    """
    Write the derivative of `modes.mode_accelerations` into the first four rows of `out`.

    Parameters
    ----------
    time, state, system, mode
        See `modes.mode_derivative`; only the motion of the state is looked at.
    hanging : tuple
        Sine and cosine of the pendulum angle.
    out : (7, 9) array
        See `jacobian_table`; SI.

    Returns
    -------
    force_x, force_y, torque : float
        Loads of the ground on the ball in that state [N], [N m].

    """
    parameters = system.parameters
    for row in range(ROWS):
        for column in range(9):
            out[row, column] = 0.0
    force_x = force_y = torque = 0.0
    for row in range(contact_count(mode)):
        share_x, share_y, turn = add_contact(state, row, system, mode, out)
        force_x += share_x
        force_y += share_y
        torque += turn
    per_mass, per_inertia = 1.0 / parameters.mass, 1.0 / parameters.ball_inertia
    for shift in range(2):
        for row in range(3):
            # The places among the coordinates, then their velocities.
            factor = per_mass if row < 2 else per_inertia
            to = ALONG_X + row if row < 2 else BALL
            out[to, X + shift] = factor * out[LOADS + row, shift]
            out[to, VELOCITY_X + shift] = factor * out[LOADS + row, 2 + shift]
    out[BALL, BALL_RATE] = per_inertia * (out[LOADS + 2, 4] - parameters.rolling_friction)
    out[ALONG_X, BALL_RATE] = per_mass * out[LOADS, 4]
    out[ALONG_Y, BALL_RATE] = per_mass * out[LOADS + 1, 4]
    if parameters.swing_inertia > 0.0:
        add_pendulum(time, state, hanging, system, mode, (force_x, force_y), out)
    return force_x, force_y, torque


@compiled
def add_pendulum(time: float, state: Array, hanging: Direction, system: System,
                 mode: ContactMode, force: tuple[float, float], out: Array) -> None:
    """Add the terms of pendulum and motor, and their response to the loads, to the derivative."""
    (force_x, force_y), actuator, parameters = force, system.actuator, system.parameters
    (sine, cosine), rate = hanging, state[PENDULUM_RATE]
    # Slopes of the torque with ball and pendulum angle, ball and pendulum rate, and time.
    by_ball = by_angle = by_spin = by_rate = by_time = 0.0
    motor = mode_torque(time, state, sine, system, mode)
    if mode.signs[len(mode.signs) - 1, MOTOR] == 0:
        by_ball, by_angle, by_spin, by_rate, by_time = torque_slopes(actuator)
        by_angle += actuator.gravity_torque * cosine
    damping, per_inertia = parameters.joint_friction, 1.0 / parameters.swing_inertia
    per_ball, moment = 1.0 / parameters.ball_inertia, parameters.pendulum_moment / parameters.mass
    swing = per_inertia * (motor - damping * (rate - state[BALL_RATE]) - moment * (
        force_x * cosine + force_y * sine))
    sway_x, sway_y = -per_inertia * moment * cosine, -per_inertia * moment * sine
    for shift in range(2):
        out[PENDULUM, X + shift] = (
            sway_x * out[LOADS, shift] + sway_y * out[LOADS + 1, shift])
        out[PENDULUM, VELOCITY_X + shift] = (
            sway_x * out[LOADS, 2 + shift] + sway_y * out[LOADS + 1, 2 + shift])
    out[PENDULUM, 0] = by_ball * per_inertia
    out[PENDULUM, PENDULUM_ANGLE] = per_inertia * (
        by_angle + moment * (force_x * sine - force_y * cosine))
    out[PENDULUM, BALL_RATE] = (sway_x * out[LOADS, 4] + sway_y * out[LOADS + 1, 4]
                                + per_inertia * (by_spin + damping))
    out[PENDULUM, PENDULUM_RATE] = per_inertia * (by_rate - damping)
    out[PENDULUM, TIME] = per_inertia * by_time
    for column in range(9):
        out[ALONG_X, column] -= moment * cosine * out[PENDULUM, column]
        out[ALONG_Y, column] -= moment * sine * out[PENDULUM, column]
    out[ALONG_X, PENDULUM_ANGLE] += moment * (sine * swing + cosine * rate * rate)
    out[ALONG_Y, PENDULUM_ANGLE] -= moment * (cosine * swing - sine * rate * rate)
    out[ALONG_X, PENDULUM_RATE] += 2.0 * moment * sine * rate
    out[ALONG_Y, PENDULUM_RATE] -= 2.0 * moment * cosine * rate
    out[BALL, 0] -= by_ball * per_ball
    out[BALL, PENDULUM_ANGLE] -= by_angle * per_ball
    out[BALL, BALL_RATE] -= (by_spin + damping) * per_ball
    out[BALL, PENDULUM_RATE] += (damping - by_rate) * per_ball
    out[BALL, TIME] -= by_time * per_ball
