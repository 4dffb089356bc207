# SPDX-License-Identifier: Apache-2.0
"""
The smooth pieces (modes) of the contact law: motion, Jacobian, and the guards at their ends.

The forces of eqs. (7)-(10) are piecewise smooth: a contact starts or ends, the damper would
pull, the slip passes the threshold of eq. (9), the motor reaches its limit.  A *mode* stores
the side of the state for each of these conditions.  Within a mode the forces are smooth
formulas without `max`, which extend beyond the end of the mode; that end is a zero of one of
the *guards*, each positive inside and negative beyond.  An integrator that freezes the mode,
locates the zero and restarts there keeps its order.

`find_mode` finds the mode of a state, and `violated_guards` lists the guards that have ended it.

An implicit step needs the derivative of the rates with respect to the state.  The rates of the
coordinates depend only on the velocities, and no rate depends on the energies, so the nontrivial
part is a table of four rows (the accelerations) and nine columns (four coordinates, four
velocities, time).  It is complete if all contacts are smooth, see `contact`.
"""
import math

import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import (
    Accelerations, add_contact, contact_sum, ContactMode, CORNER, FEATURE, feature_guard,
    find_contacts, force_and_slip, FRICTION, FROZEN, IntArray, KIND, loads_of, PRESSED,
    pressed_sign, QUICK, share_friction, sign_beyond, SLIDING, TOUCHED, touches, write_contact)
from ballbot_ros.physics.mechanics.equations import (
    AngleTrig, Direction, direction_near, System, unforced, write_rates)
from ballbot_ros.physics.model.actuation import torque_asked, torque_slopes, unsaturated_torque
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, X, Y)
from ballbot_ros.physics.model.terrain import Array

# Columns of the last row of the signs of a mode; the others, one per active contact, have the
# columns of `contact`.
MOTOR = 0     # sign of the torque where it is at its limit, 0 within
COUNT = 1     # number of active contacts
CORNERS = 2   # number of CORNERs among them

# Rows of a Jacobian: the accelerations, in the order of the state vector.
BALL, PENDULUM, ALONG_X, ALONG_Y = range(4)
TIME = 8  # the last column; the first eight are those of the state vector
# Derivatives of the ground loads, stored below the rows above: of force_x, force_y and torque by
# x, y, velocity_x, velocity_y, ball_rate.
LOADS = 4
ROWS = 7


@compiled
def contact_count(mode: ContactMode) -> int:
    """Return the number of active contacts."""
    return mode.signs[len(mode.signs) - 1, COUNT]


@compiled
def smooth_contacts(mode: ContactMode) -> bool:
    """Return whether no contact of a mode is a CORNER, which changes its neighbours' forces."""
    return mode.signs[len(mode.signs) - 1, CORNERS] == 0


@compiled
def write_contacts(state: Array, system: System, mode: ContactMode) -> None:
    """Write the contacts of a mode at a state into its table, whether they touch or not."""
    for row in range(contact_count(mode)):
        write_contact(mode.contacts, row, mode.signs[row, FEATURE], state[X], state[Y],
                      system.parameters.radius, system.ground)
    share_friction(mode.contacts, contact_count(mode))


@compiled
def mode_torque(time: float, motion: Array, sine: float, system: System,
                mode: ContactMode) -> float:
    """Return the torque of the motor in a frozen mode [N m]; `sine` is of the pendulum angle."""
    if system.parameters.swing_inertia <= 0.0:
        return 0.0
    saturated = mode.signs[len(mode.signs) - 1, MOTOR]
    if saturated != 0:
        return saturated * system.actuator.limit
    return torque_asked(time, motion, sine, system.actuator)


@compiled
def mode_derivative(time: float, state: Array, system: System, mode: ContactMode,
                    rates: Array) -> None:
    """Write the time derivative of `state` by the formulas of a frozen mode."""
    write_contacts(state, system, mode)
    loads = loads_of(
        state, system.parameters, system.ground, mode, contact_count(mode), FROZEN)
    motor = mode_torque(time, state, math.sin(state[PENDULUM_ANGLE]), system, mode)
    write_rates(state, system.parameters, loads, motor, rates)


@compiled
def mode_accelerations(time: float, motion: Array, start: AngleTrig, system: System,
                       mode: ContactMode) -> Accelerations:
    """
    Return the four accelerations in a frozen mode without a CORNER: the most frequent call.

    Equals `mode_derivative` without the energy flows, and without a table of contacts: all numbers
    stay in registers.  The motion without ground forces, and the response to unit forces, are
    computed before these forces are available.

    Parameters
    ----------
    time : float
        [s]
    motion : (8,) array, or longer
        Coordinates and velocities.
    start : tuple
        A nearby pendulum angle and its direction, see `angle_trig`.

    """
    pendulum_trig = direction_near(motion[PENDULUM_ANGLE], start)
    motor = mode_torque(time, motion, pendulum_trig[0], system, mode)
    turn, swing, along_x, along_y, _, _ = contact_sum(
        motion, system.parameters, system.ground, mode, contact_count(mode), QUICK,
        unforced(motion, pendulum_trig, motor, system.parameters))
    return turn, swing, along_x, along_y


@compiled
def in_contact(feature: int, mode: ContactMode) -> bool:
    """Return whether a feature of the ground is among the contacts of a mode."""
    for row in range(contact_count(mode)):
        if mode.signs[row, FEATURE] == feature:
            return True
    return False


@compiled
def find_mode(time: float, state: Array, system: System, mode: ContactMode) -> int:
    """Write the mode of a state into `mode` and return its number of contacts."""
    signs, parameters, actuator = mode.signs, system.parameters, system.actuator
    count = find_contacts(state[X], state[Y], parameters.radius, system.ground, mode.contacts)
    last = len(signs) - 1
    signs[last, COUNT], signs[last, CORNERS] = count, 0
    for row in range(count):
        signs[row, FEATURE] = int(mode.contacts[row, TOUCHED])
        signs[last, CORNERS] += int(mode.contacts[row, KIND] == CORNER)
        force, slip = force_and_slip(state, parameters, mode.contacts, row)
        signs[row, PRESSED] = pressed_sign(force, parameters)
        signs[row, SLIDING] = sign_beyond(slip, parameters.slip_threshold)
    signs[last, MOTOR] = sign_beyond(unsaturated_torque(time, state, actuator), actuator.limit)
    return count


# Kind of a guard.
OF_FEATURE, OF_FORCE, OF_SLIP, OF_MOTOR = range(4)


@compiled
def side(value: float, sign: int, limit: float) -> float:
    """Return how far a value is inside +-limit (sign 0), or beyond it on the side of `sign`."""
    if sign == 0:
        return limit - abs(value)
    return sign * value - limit


@compiled
def motor_guard(time: float, state: Array, system: System, mode: ContactMode) -> float:
    """Return how far the torque is inside its limit, or beyond it where it is at the limit."""
    actuator = system.actuator
    return side(unsaturated_torque(time, state, actuator),
                mode.signs[len(mode.signs) - 1, MOTOR], actuator.limit)


@compiled
def guard_of(kind: int, item: int, time: float, state: Array, system: System,
             mode: ContactMode) -> float:
    """
    Return a guard: positive inside the mode, negative beyond its end.

    Parameters
    ----------
    kind : int
        OF_FEATURE (`item` is the feature), OF_FORCE or OF_SLIP (`item` is the row of the
        contact), or OF_MOTOR.

    """
    if kind == OF_FEATURE:
        guard = feature_guard(item, state[X], state[Y], system.parameters.radius, system.ground)
        return guard if in_contact(item, mode) else -guard
    if kind == OF_MOTOR:
        return motor_guard(time, state, system, mode)
    write_contact(mode.contacts, item, mode.signs[item, FEATURE], state[X], state[Y],
                  system.parameters.radius, system.ground)
    force, slip = force_and_slip(state, system.parameters, mode.contacts, item)
    if kind == OF_FORCE:
        return force if mode.signs[item, PRESSED] > 0 else -force
    return side(slip, mode.signs[item, SLIDING], system.parameters.slip_threshold)


@compiled
def violated_guards(time: float, state: Array, system: System, mode: ContactMode, first: int,
                    behind: int, violated: IntArray) -> int:
    """
    List the guards that have become negative, among features from `first` to `behind`.

    Returns their number; the rows of `violated` contain kind and item of each.
    """
    signs, parameters, count = mode.signs, system.parameters, contact_count(mode)
    found = row = 0
    for feature in range(first, behind):
        guard = feature_guard(feature, state[X], state[Y], parameters.radius, system.ground)
        # Both are ordered from left to right: no search, which would be slow on rough ground.
        while row < count and signs[row, FEATURE] < feature:
            row += 1
        inside = row < count and signs[row, FEATURE] == feature
        if touches(feature, guard, system.ground) != inside:
            violated[found, 0], violated[found, 1] = OF_FEATURE, feature
            found += 1
    if count > 0:
        write_contacts(state, system, mode)
    for row in range(count):
        force, slip = force_and_slip(state, parameters, mode.contacts, row)
        if (force > 0.0) != (signs[row, PRESSED] > 0):
            violated[found, 0], violated[found, 1] = OF_FORCE, row
            found += 1
        if (mode.contacts[row, FRICTION] > 0.0 and signs[row, PRESSED] != 0
                and side(slip, signs[row, SLIDING], parameters.slip_threshold) < 0.0):
            violated[found, 0], violated[found, 1] = OF_SLIP, row
            found += 1
    if motor_guard(time, state, system, mode) < 0.0:
        violated[found, 0], violated[found, 1] = OF_MOTOR, 0
        found += 1
    return found


def jacobian_table() -> Array:
    """Return the array into which `write_jacobian` writes."""
    return np.zeros((ROWS, 9))


@compiled
def write_jacobian(time: float, state: Array, pendulum_trig: Direction, system: System,
                   mode: ContactMode, out: Array) -> tuple[float, float, float]:
    """
    Write the derivative of `mode_accelerations` into the first four rows of `out`.

    Parameters
    ----------
    time, state, system, mode
        See `mode_derivative`; only the motion of the state is used.
    pendulum_trig : tuple
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
        share_x, share_y, turn = add_contact(
            state, parameters, system.ground, mode, row, smooth_contacts(mode), out[LOADS:])
        force_x += share_x
        force_y += share_y
        torque += turn
    per_mass, per_inertia = 1.0 / parameters.mass, 1.0 / parameters.ball_inertia
    for shift in range(2):
        for row in range(3):
            # Derivatives by the position, then by the velocity.
            factor = per_mass if row < 2 else per_inertia
            to = ALONG_X + row if row < 2 else BALL
            out[to, X + shift] = factor * out[LOADS + row, shift]
            out[to, VELOCITY_X + shift] = factor * out[LOADS + row, 2 + shift]
    out[BALL, BALL_RATE] = per_inertia * (out[LOADS + 2, 4] - parameters.rolling_friction)
    out[ALONG_X, BALL_RATE] = per_mass * out[LOADS, 4]
    out[ALONG_Y, BALL_RATE] = per_mass * out[LOADS + 1, 4]
    if parameters.swing_inertia > 0.0:
        add_pendulum(time, state, pendulum_trig, system, mode, (force_x, force_y), out)
    return force_x, force_y, torque


@compiled
def add_pendulum(time: float, state: Array, pendulum_trig: Direction, system: System,
                 mode: ContactMode, force: tuple[float, float], out: Array) -> None:
    """Add the terms of pendulum and motor, and their response to the loads, to the derivative."""
    (force_x, force_y), actuator, parameters = force, system.actuator, system.parameters
    (sine, cosine), rate = pendulum_trig, state[PENDULUM_RATE]
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
