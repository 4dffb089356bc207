# SPDX-License-Identifier: Apache-2.0
"""Whether a frozen mode still holds: a quick look, which most steps pass."""
import math

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import pressed_and_slid
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, FEATURE, feature_guard, in_contact, motor_guard, PRESSED, side,
    SLIDING, smooth_contacts, touches)
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y


@compiled
def contact_holds(motion: Array, row: int, system: System, mode: ContactMode) -> bool:
    """Return whether a contact of a mode is still there, pressed and sliding as it was."""
    signs, parameters = mode.signs, system.parameters
    feature, pressed, x, y = signs[row, FEATURE], signs[row, PRESSED], motion[X], motion[Y]
    if not touches(feature, feature_guard(feature, x, y, parameters.radius, system.ground),
                   system.ground):
        return False
    _, _, _, friction, force, slip = pressed_and_slid(feature, motion, system.ground, parameters)
    if (force > 0.0) != (pressed > 0):
        return False
    return not (friction > 0.0 and pressed != 0
                and side(slip, signs[row, SLIDING], parameters.slip_threshold) < 0.0)


@compiled
def is_new(feature: int, x: float, y: float, system: System, mode: ContactMode) -> bool:
    """Return whether the ball touches a feature that is not in its mode."""
    return not in_contact(feature, mode) and touches(
        feature, feature_guard(feature, x, y, system.parameters.radius, system.ground),
        system.ground)


@compiled
def mode_holds(time: float, motion: Array, first: int, behind: int, system: System,
               mode: ContactMode) -> bool:
    """
    Return whether no guard is violated, among features from `first` to `behind`.

    With a CORNER it does not say: then `modes.violated_guards` is to be asked, as where the mode
    does not hold.
    """
    if not smooth_contacts(mode):
        return False
    x, y, ground, radius = motion[X], motion[Y], system.ground, system.parameters.radius
    for row in range(contact_count(mode)):
        if not contact_holds(motion, row, system, mode):
            return False
    for segment in range(first >> 1, (behind + 1) >> 1):
        distance = ((y - ground[segment, VERTEX_Y]) * ground[segment, TANGENT_X]
                    - (x - ground[segment, VERTEX_X]) * ground[segment, TANGENT_Y])
        # Out of reach of a line is out of reach of all on it.
        if distance <= radius:
            feature = 2 * segment
            if is_new(feature, x, y, system, mode) or (
                    feature + 1 < behind and is_new(feature + 1, x, y, system, mode)):
                return False
    return not (system.actuator.limit < math.inf
                and motor_guard(time, motion, system, mode) < 0.0)
