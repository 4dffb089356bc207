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
    spin = motion[BALL_RATE]
    torque -= parameters.rolling_friction * spin
    per_inertia = 1.0 / parameters.ball_inertia
    if parameters.swing_inertia <= 0.0:
        return (per_inertia * torque, 0.0, per_mass * force_x,
                per_mass * force_y - parameters.gravity)
    saturated = mode.signs[len(mode.signs) - 1, MOTOR]
    motor = saturated * system.actuator.limit
    if saturated == 0:
        motor = unsaturated_torque(time, motion, system.actuator)
    rate = motion[PENDULUM_RATE]
    motor -= parameters.joint_friction * (rate - spin)
    sine, cosine = math.sin(motion[PENDULUM_ANGLE]), math.cos(motion[PENDULUM_ANGLE])
    # What the motor and the swing do without the ground, and how each force counts: little is
    # left to compute once the forces are known.
    per_swing = 1.0 / parameters.swing_inertia
    arm = parameters.pendulum_moment * per_mass
    share, away, own = arm * per_swing, arm * rate * rate, per_swing * motor
    sway_x, sway_y = share * cosine, share * sine
    arm_x, arm_y = arm * cosine, arm * sine
    cross, alone_x = arm_x * sway_y, away * sine - arm_x * own
    alone_y = -parameters.gravity - away * cosine - arm_y * own
    return (per_inertia * (torque - motor), own - (sway_x * force_x + sway_y * force_y),
            alone_x + ((per_mass + arm_x * sway_x) * force_x + cross * force_y),
            alone_y + (cross * force_x + (per_mass + arm_y * sway_y) * force_y))


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

