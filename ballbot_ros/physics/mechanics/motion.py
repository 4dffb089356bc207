# SPDX-License-Identifier: Apache-2.0
"""
How a motion goes on in a frozen mode: what a step of the adaptive method calls again and again.

The same as `modes.mode_derivative` without the flows of energy, and without a table of contacts:
all numbers stay in registers.
"""
import math

from ballbot_ros.compiled import compiled, inlined
from ballbot_ros.physics.mechanics.contact import pressed_and_slid
from ballbot_ros.physics.mechanics.contact_law import normal_and_friction
from ballbot_ros.physics.mechanics.equations import unsaturated_torque
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, FEATURE, MOTOR, PRESSED, SLIDING)
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y)
from ballbot_ros.physics.model.terrain import Array


@compiled
def pushed(motion: Array, row: int, system: System,
           mode: ContactMode) -> tuple[float, float, float]:
    """Return force [N] and torque [N m] of one contact on the ball; eqs. (7)-(10)."""
    parameters = system.parameters
    normal_x, normal_y, distance, friction, force, slip = pressed_and_slid(
        mode.signs[row, FEATURE], motion, system.ground, parameters)
    pressing, rubbing = normal_and_friction(
        force, slip, mode.signs[row, PRESSED], mode.signs[row, SLIDING], parameters, friction)
    return (pressing * normal_x + rubbing * normal_y, pressing * normal_y - rubbing * normal_x,
            rubbing * distance)


@inlined
def accelerations(time: float, motion: Array, system: System,
                  mode: ContactMode) -> tuple[float, float, float, float]:
    """Return the four accelerations in a frozen mode without a CORNER; see `equations`."""
    parameters = system.parameters
    per_mass = 1.0 / parameters.mass  # a division in each call would take as long as all else
    force_x = force_y = torque = 0.0
    for row in range(contact_count(mode)):
        push_x, push_y, turn = pushed(motion, row, system, mode)
        force_x += push_x
        force_y += push_y
        torque += turn
    spin, swing = motion[BALL_RATE], 0.0
    torque -= parameters.rolling_friction * spin
    if parameters.swing_inertia > 0.0:
        saturated = mode.signs[len(mode.signs) - 1, MOTOR]
        motor = saturated * system.actuator.limit
        if saturated == 0:
            motor = unsaturated_torque(time, motion, system.actuator)
        angle, rate = motion[PENDULUM_ANGLE], motion[PENDULUM_RATE]
        sine, cosine = math.sin(angle), math.cos(angle)
        motor -= parameters.joint_friction * (rate - spin)
        moment = parameters.pendulum_moment
        swing = (1.0 / parameters.swing_inertia) * (
            motor - moment * per_mass * (force_x * cosine + force_y * sine))
        torque -= motor
        force_x -= moment * (cosine * swing - sine * rate * rate)
        force_y -= moment * (sine * swing + cosine * rate * rate)
    return ((1.0 / parameters.ball_inertia) * torque, swing, per_mass * force_x,
            per_mass * force_y - parameters.gravity)


@compiled
def write_motion(time: float, motion: Array, system: System, mode: ContactMode,
                 out: Array) -> None:
    """
    Write how a motion goes on in a frozen mode.

    Parameters
    ----------
    time : float
        [s]
    motion, out : (8,) arrays, or longer
        Coordinates and velocities; velocities and accelerations.
    system, mode
        See `modes.mode_derivative`.

    """
    out[0] = motion[BALL_RATE]
    out[1] = motion[PENDULUM_RATE] if system.parameters.swing_inertia > 0.0 else 0.0
    out[2], out[3] = motion[VELOCITY_X], motion[VELOCITY_Y]
    out[4], out[5], out[6], out[7] = accelerations(time, motion, system, mode)

