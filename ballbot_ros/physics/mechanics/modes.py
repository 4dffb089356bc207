# SPDX-License-Identifier: Apache-2.0
"""
The smooth pieces (modes) of the contact law, and the events between them.

The forces of eqs. (7)-(10) are piecewise smooth: a contact begins or ends, the damper would
pull, the slip passes the threshold of eq. (9), the motor reaches its limit.  A *mode* stores
the side of the state for each of these conditions.  Within a mode the forces are smooth
formulas without `max`, which extend beyond the end of the mode; that end is a zero of one of
the *guards*, each positive inside.  An integrator that freezes the mode, locates the zero and
restarts there keeps its order.
"""
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.jit import compiled, inlined
from ballbot_ros.physics.mechanics.contact import (
    contact_table, first_segment, pressed_and_slid, share_friction, write_contact)
from ballbot_ros.physics.mechanics.contact_law import (
    contact_load, CORNER, force_and_slip, FRICTION, KIND, pressed_sign, sign_beyond, sliding_sign)
from ballbot_ros.physics.mechanics.equations import Loads, unsaturated_torque, write_rates
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import X, Y
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y

IntArray = NDArray[np.int64]

# Columns of the signs of a mode: a row per contact in force, from left to right ...
FEATURE = 0   # of the ground, see `contact`
PRESSED = 1   # see `contact_law`
SLIDING = 2
# ... and in the last row:
MOTOR = 0     # sign of the torque where it is at its limit, 0 within
COUNT = 1     # of contacts in force
CORNERS = 2   # among them
COLUMNS = 3


class ContactMode(NamedTuple):
    """The piece of the law that is in force."""

    signs: IntArray  # (2 n + 1, 3), see above
    contacts: Array  # (2 n, 7): the table of its contacts, at the state last looked at

    @classmethod
    def of(cls, vertices: int) -> 'ContactMode':
        """Return an empty mode with room for every contact that a profile can give."""
        return cls(np.zeros((2 * vertices + 1, COLUMNS), dtype=np.int64), contact_table(vertices))


@compiled
def contact_count(mode: ContactMode) -> int:
    """Return how many contacts are in force."""
    return mode.signs[len(mode.signs) - 1, COUNT]


@compiled
def in_contact(feature: int, mode: ContactMode) -> bool:
    """Return whether a feature of the ground is among the contacts of a mode."""
    for row in range(contact_count(mode)):
        if mode.signs[row, FEATURE] == feature:
            return True
    return False


@compiled
def smooth_contacts(mode: ContactMode) -> bool:
    """Return whether no contact of a mode is a CORNER, which changes what its neighbours do."""
    return mode.signs[len(mode.signs) - 1, CORNERS] == 0


@compiled
def feature_guard(feature: int, x: float, y: float, radius: float, ground: Array) -> float:
    """
    Return by how much the ball touches a feature, negative if it does not [m].

    It touches a segment that holds the foot of the perpendicular, a vertex in whose cone the
    centre is, and both only nearer than the radius: the least of three distances.
    """
    segment = feature // 2
    last = len(ground) - 2
    end_x, end_y = x - ground[segment + 1, VERTEX_X], y - ground[segment + 1, VERTEX_Y]
    tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    after_end = end_x * tangent_x + end_y * tangent_y
    if feature % 2 == 1:
        next_after = (end_x * ground[segment + 1, TANGENT_X]
                      + end_y * ground[segment + 1, TANGENT_Y])
        depth = radius - math.sqrt(end_x * end_x + end_y * end_y)
        if ground[segment + 1, TURN] > 0.0:
            return min(depth, -after_end, next_after)
        return min(depth, after_end, -next_after)
    start_x, start_y = x - ground[segment, VERTEX_X], y - ground[segment, VERTEX_Y]
    distance = start_y * tangent_x - start_x * tangent_y
    guard = min(radius - distance, distance)
    if segment > 0:
        guard = min(guard, start_x * tangent_x + start_y * tangent_y)
    if segment < last:
        guard = min(guard, -after_end)
    return guard


@compiled
def touches(feature: int, guard: float, ground: Array) -> bool:
    """Return whether a guard means contact; a convex vertex includes the rim of its cone."""
    rim = feature % 2 == 1 and ground[feature // 2 + 1, TURN] <= 0.0
    return guard > 0.0 or (rim and guard == 0.0)


@compiled
def features_within(x: float, reach: float, ground: Array) -> tuple[int, int]:
    """Return the first feature within `reach` of x, and the one after the last."""
    first = 2 * first_segment(ground, x - reach)
    # The last segment is infinite and has no vertex at its end.
    return first, min(2 * first_segment(ground, x + reach) + 2, 2 * len(ground) - 3)


@compiled
def write_contacts(state: Array, system: System, mode: ContactMode) -> None:
    """Write the contacts of a mode at a state into its table, whether they touch or not."""
    corners = False
    for row in range(contact_count(mode)):
        write_contact(mode.contacts, row, mode.signs[row, FEATURE], state[X], state[Y],
                      system.parameters.radius, system.ground)
        corners = corners or mode.contacts[row, KIND] == CORNER
    if corners:
        share_friction(mode.contacts, contact_count(mode))


@inlined
def mode_loads(state: Array, system: System, mode: ContactMode) -> Loads:
    """Return what `contact.contact_loads` returns, by the formulas of a frozen mode."""
    force_x = force_y = torque = contact_loss = friction_loss = 0.0
    write_contacts(state, system, mode)
    for row in range(contact_count(mode)):
        load = contact_load(state, mode.signs[row, PRESSED], mode.signs[row, SLIDING],
                            system.parameters, mode.contacts, row)
        force_x += load[0]
        force_y += load[1]
        torque += load[2]
        contact_loss += load[3]
        friction_loss -= load[4]
    return force_x, force_y, torque, contact_loss, friction_loss


@compiled
def mode_derivative(time: float, state: Array, system: System, mode: ContactMode,
                    rates: Array) -> None:
    """Write the time derivative of `state` by the formulas of a frozen mode."""
    loads = mode_loads(state, system, mode)
    motor = 0.0
    if system.parameters.swing_inertia > 0.0:
        saturated = mode.signs[len(mode.signs) - 1, MOTOR]
        motor = (unsaturated_torque(time, state, system.actuator) if saturated == 0
                 else saturated * system.actuator.limit)
    write_rates(state, system.parameters, loads, motor, rates)


@compiled
def find_mode(time: float, state: Array, system: System, mode: ContactMode) -> int:
    """Write the mode of a state into `mode` and return how many contacts it has."""
    signs, parameters, ground, actuator = mode.signs, system.parameters, system.ground, \
        system.actuator
    count = 0
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
        if (force > 0.0) != (signs[row, PRESSED] > 0):
            violated[found, 0], violated[found, 1] = OF_FORCE, row
            found += 1
        rough = mode.contacts[row, FRICTION] > 0.0 and signs[row, PRESSED] != 0
        if rough and side(slip, signs[row, SLIDING], parameters.slip_threshold) < 0.0:
            violated[found, 0], violated[found, 1] = OF_SLIP, row
            found += 1
    if motor_guard(time, state, system, mode) < 0.0:
        violated[found, 0], violated[found, 1] = OF_MOTOR, 0
        found += 1
    return found
