# SPDX-License-Identifier: Apache-2.0
"""
How a motion goes on in a frozen mode: what a step of the adaptive method calls again and again.

The same as `modes.mode_derivative` without the flows of energy, and without a table of contacts:
all numbers stay in registers.  Nothing else can begin before the forces of the ground are known,
so what the motion does without them, and what each newton of them adds, is computed beforehand.
"""
from ballbot_ros.jit import compiled, inlined
from ballbot_ros.physics.mechanics.contact import Accelerations, contact_sum, QUICK
from ballbot_ros.physics.mechanics.equations import forced, unforced
from ballbot_ros.physics.mechanics.equations import write_motion as write_found
from ballbot_ros.physics.mechanics.modes import contact_count, ContactMode, mode_torque
from ballbot_ros.physics.mechanics.turned import Direction, direction_near, Turned
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import PENDULUM_ANGLE
from ballbot_ros.physics.model.terrain import Array


@inlined
def accelerations(time: float, motion: Array, start: Turned, system: System,
                  mode: ContactMode) -> Accelerations:
    """Return the four accelerations in a frozen mode without a CORNER; see `write_motion`."""
    hanging = direction_near(motion[PENDULUM_ANGLE], start)
    motor = mode_torque(time, motion, hanging[0], system, mode)
    turn, swing, along_x, along_y, _, _ = contact_sum(
        motion, system.parameters, system.ground, mode.contacts, mode.signs, contact_count(mode),
        QUICK, unforced(motion, hanging, motor, system.parameters))
    return turn, swing, along_x, along_y


@compiled
def write_motion_under(time: float, motion: Array, hanging: Direction,
                       push: tuple[float, float, float], system: System, mode: ContactMode,
                       out: Array) -> None:
    """
    Write what `write_motion` does, where more is known.

    The direction of the pendulum, and force [N] and torque [N m] of the ground on the ball.
    """
    force_x, force_y, torque = push
    motor = mode_torque(time, motion, hanging[0], system, mode)
    free, compliance = unforced(motion, hanging, motor, system.parameters)
    write_found(motion, forced(free, compliance, force_x, force_y, torque), system.parameters, out)


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
    write_found(motion, accelerations(time, motion, start, system, mode), system.parameters, out)
