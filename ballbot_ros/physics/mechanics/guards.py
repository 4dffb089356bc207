# SPDX-License-Identifier: Apache-2.0
"""
The guards of a mode: contact and separation, the sign of the normal force, slip, motor.

Each guard is positive inside the mode and negative beyond its end.  `find_mode` finds the mode of
a state, `mode_holds` is a quick look whether it still holds, which most steps pass, and
`violated_guards` lists what has ended it.
"""
import math

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import (
    feature_guard, features_within, IntArray, line_distance, pressed_and_slid, touches)
from ballbot_ros.physics.mechanics.contact_law import (
    CORNER, FEATURE, force_and_slip, FRICTION, KIND, PRESSED, pressed_sign, sign_beyond, SLIDING,
    sliding_sign)
from ballbot_ros.physics.mechanics.equations import unsaturated_torque
from ballbot_ros.physics.mechanics.modes import (
    contact_count, ContactMode, CORNERS, COUNT, MOTOR, smooth_contacts, write_contacts)
from ballbot_ros.physics.model.parameters import Parameters, System
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.model.terrain import Array


@compiled
def in_contact(feature: int, mode: ContactMode) -> bool:
    """Return whether a feature of the ground is among the contacts of a mode."""
    for row in range(contact_count(mode)):
        if mode.signs[row, FEATURE] == feature:
            return True
    return False


@compiled
def find_mode(time: float, state: Array, system: System, mode: ContactMode) -> int:
    """Write the mode of a state into `mode` and return how many contacts it has."""
    signs, parameters, actuator = mode.signs, system.parameters, system.actuator
    ground, count = system.ground, 0
    first, behind = features_within(state[X], parameters.radius, ground)
    for feature in range(first, behind):
        guard = feature_guard(feature, state[X], state[Y], parameters.radius, ground)
        if touches(feature, guard, ground):
            signs[count, FEATURE] = feature
            count += 1
    last = len(signs) - 1
    signs[last, COUNT], signs[last, CORNERS] = count, 0
    write_contacts(state, system, mode)
    for row in range(count):
        signs[last, CORNERS] += int(mode.contacts[row, KIND] == CORNER)
        force, slip, _ = force_and_slip(state, parameters, mode.contacts, row)
        signs[row, PRESSED] = pressed_sign(force, parameters)
        signs[row, SLIDING] = sliding_sign(slip, parameters)
    signs[last, MOTOR] = sign_beyond(unsaturated_torque(time, state, actuator), actuator.limit)
    return count


# What a guard belongs to.
OF_FEATURE, OF_FORCE, OF_SLIP, OF_MOTOR = range(4)


@compiled
def side(value: float, sign: int, limit: float) -> float:
    """Return how far a value is inside +-limit (sign 0), or beyond it on the side of `sign`."""
    if sign == 0:
        return limit - abs(value)
    return sign * value - limit


@compiled
def stays_pressed(force: float, pressed: int) -> bool:
    """Return whether the force of spring and damper has the sign of its piece of the law."""
    return (force > 0.0) == (pressed > 0)


@compiled
def stays_sliding(slip: float, friction: float, pressed: int, sliding: int,
                  parameters: Parameters) -> bool:
    """Return whether the slip is on its side of the threshold, where there is friction at all."""
    return not (friction > 0.0 and pressed != 0
                and side(slip, sliding, parameters.slip_threshold) < 0.0)


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
    _, _, _, _, force, slip = pressed_and_slid(
        mode.signs[item, FEATURE], state, system.ground, system.parameters)
    if kind == OF_FORCE:
        return force if mode.signs[item, PRESSED] > 0 else -force
    return side(slip, mode.signs[item, SLIDING], system.parameters.slip_threshold)


@compiled
def violated_guards(time: float, state: Array, system: System, mode: ContactMode, first: int,
                    behind: int, violated: IntArray) -> int:
    """
    List the guards that have become negative, among features from `first` to `behind`.

    Returns how many there are; the rows of `violated` say kind and item of each.
    """
    signs, parameters, count = mode.signs, system.parameters, contact_count(mode)
    found = row = 0
    for feature in range(first, behind):
        guard = feature_guard(feature, state[X], state[Y], parameters.radius, system.ground)
        # Both go from left to right: no need to search, which takes long on rough ground.
        while row < count and signs[row, FEATURE] < feature:
            row += 1
        inside = row < count and signs[row, FEATURE] == feature
        if touches(feature, guard, system.ground) != inside:
            violated[found, 0], violated[found, 1] = OF_FEATURE, feature
            found += 1
    if count > 0:
        write_contacts(state, system, mode)
    for row in range(count):
        force, slip, _ = force_and_slip(state, parameters, mode.contacts, row)
        if not stays_pressed(force, signs[row, PRESSED]):
            violated[found, 0], violated[found, 1] = OF_FORCE, row
            found += 1
        if not stays_sliding(slip, mode.contacts[row, FRICTION], signs[row, PRESSED],
                             signs[row, SLIDING], parameters):
            violated[found, 0], violated[found, 1] = OF_SLIP, row
            found += 1
    if motor_guard(time, state, system, mode) < 0.0:
        violated[found, 0], violated[found, 1] = OF_MOTOR, 0
        found += 1
    return found


@compiled
def contact_holds(motion: Array, row: int, system: System, mode: ContactMode) -> bool:
    """Return whether a contact of a mode is still there, pressed and sliding as it was."""
    signs, parameters = mode.signs, system.parameters
    feature, pressed, x, y = signs[row, FEATURE], signs[row, PRESSED], motion[X], motion[Y]
    if not touches(feature, feature_guard(feature, x, y, parameters.radius, system.ground),
                   system.ground):
        return False
    _, _, _, friction, force, slip = pressed_and_slid(feature, motion, system.ground, parameters)
    return stays_pressed(force, pressed) and stays_sliding(
        slip, friction, pressed, signs[row, SLIDING], parameters)


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

    With a CORNER it does not say: then `violated_guards` is to be asked, as where the mode
    does not hold.
    """
    if not smooth_contacts(mode):
        return False
    x, y, ground, radius = motion[X], motion[Y], system.ground, system.parameters.radius
    for row in range(contact_count(mode)):
        if not contact_holds(motion, row, system, mode):
            return False
    for segment in range(first >> 1, (behind + 1) >> 1):
        if line_distance(segment, x, y, ground) <= radius:
            feature = 2 * segment
            if is_new(feature, x, y, system, mode) or (
                    feature + 1 < behind and is_new(feature + 1, x, y, system, mode)):
                return False
    return not (system.actuator.limit < math.inf
                and motor_guard(time, motion, system, mode) < 0.0)
