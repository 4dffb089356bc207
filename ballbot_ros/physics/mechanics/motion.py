# SPDX-License-Identifier: Apache-2.0
"""
How a motion goes on in a frozen mode: what a step of the adaptive method calls again and again.

The same as `modes.mode_derivative` without the flows of energy, and without a table of contacts:
all numbers stay in registers.  Nothing else can begin before the forces of the ground are known,
so what the motion does without them, and what each newton of them adds, is computed beforehand.
"""
from ballbot_ros.jit import compiled, inlined
from ballbot_ros.physics.mechanics.contact import pressed_and_slid
from ballbot_ros.physics.mechanics.contact_law import normal_and_friction
from ballbot_ros.physics.mechanics.equations import torque_asked
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, FEATURE, MOTOR, PRESSED, SLIDING)
from ballbot_ros.physics.mechanics.turned import Direction, direction_near, Turned
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, PENDULUM_RATE, VELOCITY_X, VELOCITY_Y)
from ballbot_ros.physics.model.terrain import Array

Accelerations = tuple[float, float, float, float]  # of ball, pendulum, x and y
# What a newton along x and y adds: to the pendulum (two), to x along x, to x along y and to y
# along x, to y along y.
Compliance = tuple[float, float, float, float, float]


@compiled
def without_ground(time: float, motion: Array, hanging: Direction, system: System,
                   mode: ContactMode) -> tuple[Accelerations, Compliance]:
    """Return the accelerations in a frozen mode without the ground, and what forces add."""
    (sine, cosine), parameters = hanging, system.parameters
    per_mass = 1.0 / parameters.mass  # a division in each call would take as long as all else
    per_inertia = 1.0 / parameters.ball_inertia
    spin = motion[BALL_RATE]
    rolling = parameters.rolling_friction * spin
    if parameters.swing_inertia <= 0.0:
        return ((-per_inertia * rolling, 0.0, 0.0, -parameters.gravity),
                (0.0, 0.0, per_mass, 0.0, per_mass))
    saturated = mode.signs[len(mode.signs) - 1, MOTOR]
    if saturated == 0:
        motor = torque_asked(time, motion, sine, system.actuator)
    else:
        motor = saturated * system.actuator.limit
    rate = motion[PENDULUM_RATE]
    motor -= parameters.joint_friction * (rate - spin)
    per_swing = 1.0 / parameters.swing_inertia
    arm = parameters.pendulum_moment * per_mass
    share, away, own = arm * per_swing, arm * rate * rate, per_swing * motor
    sway_x, sway_y = share * cosine, share * sine
    arm_x, arm_y = arm * cosine, arm * sine
    return ((-per_inertia * (rolling + motor), own, away * sine - arm_x * own,
             -parameters.gravity - away * cosine - arm_y * own),
            (-sway_x, -sway_y, per_mass + arm_x * sway_x, arm_x * sway_y,
             per_mass + arm_y * sway_y))


@compiled
def of_ball_alone(time: float, motion: Array, system: System, mode: ContactMode) -> Accelerations:
    """Return what `accelerations` does for a ball without a pendulum."""
    parameters = system.parameters
    (turn, _, along_x, along_y), (_, _, per_mass, _, _) = without_ground(
        time, motion, (0.0, 1.0), system, mode)
    per_inertia = 1.0 / parameters.ball_inertia
    for row in range(contact_count(mode)):
        normal_x, normal_y, distance, friction, force, slip = pressed_and_slid(
            mode.signs[row, FEATURE], motion, system.ground, parameters)
        pressing, rubbing = normal_and_friction(
            force, slip, mode.signs[row, PRESSED], mode.signs[row, SLIDING], parameters, friction)
        along_x += per_mass * pressing * normal_x + per_mass * rubbing * normal_y
        along_y += per_mass * pressing * normal_y - per_mass * rubbing * normal_x
        turn += rubbing * (per_inertia * distance)
    return turn, 0.0, along_x, along_y


@inlined
def accelerations(time: float, motion: Array, start: Turned, system: System,
                  mode: ContactMode) -> Accelerations:
    """Return the four accelerations in a frozen mode without a CORNER; see `write_motion`."""
    parameters = system.parameters
    if parameters.swing_inertia <= 0.0:
        return of_ball_alone(time, motion, system, mode)
    hanging = direction_near(motion[PENDULUM_ANGLE], start)
    (turn, swing, along_x, along_y), (sway_x, sway_y, own_x, cross, own_y) = without_ground(
        time, motion, hanging, system, mode)
    per_inertia = 1.0 / parameters.ball_inertia
    for row in range(contact_count(mode)):
        normal_x, normal_y, distance, friction, force, slip = pressed_and_slid(
            mode.signs[row, FEATURE], motion, system.ground, parameters)
        pressing, rubbing = normal_and_friction(
            force, slip, mode.signs[row, PRESSED], mode.signs[row, SLIDING], parameters, friction)
        # Friction, along the tangent (normal_y, -normal_x), is known last.
        swing += pressing * (sway_x * normal_x + sway_y * normal_y)
        along_x += pressing * (own_x * normal_x + cross * normal_y)
        along_y += pressing * (cross * normal_x + own_y * normal_y)
        turn += rubbing * (per_inertia * distance)
        swing += rubbing * (sway_x * normal_y - sway_y * normal_x)
        along_x += rubbing * (own_x * normal_y - cross * normal_x)
        along_y += rubbing * (cross * normal_y - own_y * normal_x)
    return turn, swing, along_x, along_y


@compiled
def write_rates(motion: Array, found: Accelerations, system: System, out: Array) -> None:
    """Write velocities and accelerations of a motion."""
    out[0] = motion[BALL_RATE]
    out[1] = motion[PENDULUM_RATE] if system.parameters.swing_inertia > 0.0 else 0.0
    out[2], out[3] = motion[VELOCITY_X], motion[VELOCITY_Y]
    out[4], out[5], out[6], out[7] = found


@compiled
def write_motion_under(time: float, motion: Array, hanging: Direction,
                       push: tuple[float, float, float], system: System, mode: ContactMode,
                       out: Array) -> None:
    """
    Write what `write_motion` does, where more is known.

    The direction of the pendulum, and force [N] and torque [N m] of the ground on the ball.
    """
    (turn, swing, along_x, along_y), (sway_x, sway_y, own_x, cross, own_y) = without_ground(
        time, motion, hanging, system, mode)
    force_x, force_y, torque = push
    write_rates(motion, (turn + torque / system.parameters.ball_inertia,
                         swing + (sway_x * force_x + sway_y * force_y),
                         along_x + (own_x * force_x + cross * force_y),
                         along_y + (cross * force_x + own_y * force_y)), system, out)


@compiled
def write_motion(time: float, motion: Array, start: Turned, system: System, mode: ContactMode,
                 out: Array) -> None:
    """
    Write how a motion goes on in a frozen mode.

    Parameters
    ----------
    time : float
        [s]
    motion, out : (8,) arrays, or longer
        Coordinates and velocities; velocities and accelerations.
    start : tuple
        A pendulum angle nearby and its direction, see `turned`.
    system, mode
        See `modes.mode_derivative`.

    """
    write_rates(motion, accelerations(time, motion, start, system, mode), system, out)
