# SPDX-License-Identifier: Apache-2.0
"""
The pieces that the contact law is made of, and where one piece ends.

The forces of eqs. (7)-(10) are smooth but for kinks: a contact begins or ends, the damper
would pull, the slip passes the threshold of eq. (9), the motor reaches its limit.  A *mode*
says for each of these on which side the state is.  Within a mode the forces are given by
formulas without a single `max`, which can be continued beyond the end of the mode; that end
is a zero of one of the *margins*, each positive inside.  An integrator that freezes the mode,
finds the zero and starts anew there keeps its order through every kink.
"""
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled, inlined
from ballbot_ros.physics.mechanics.contact import (
    CORNER, EDGE, first_segment, FRICTION, friction_scale, KIND, NORMAL_X, NORMAL_Y, PENETRATION,
    share_friction, SURFACE, write_contact)
from ballbot_ros.physics.mechanics.equations import (
    BALL_RATE, VELOCITY_X, VELOCITY_Y, wanted_torque, write_rates, X, Y)
from ballbot_ros.physics.model.terrain import (
    EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)

# A feature of the ground is a number: 2 j for segment j, 2 j + 1 for the vertex at its end.
# The mode is an array with a row per contact in force, from left to right, and one more for
# the motor.
FEATURE = 0   # of the contact
PRESSED = 1   # sign of the normal force, 0 where the damper would pull and is not let
SLIDING = 2   # sign of the slip where it is beyond the threshold, 0 within
MOTOR = 0     # in the last row: sign of the torque where it is at its limit, 0 within
GEAR = 1      # and there, kept for the integrator: 1 where its steps were implicit
MODE_COLUMNS = 3


def mode_table(vertices: int) -> NDArray[np.int64]:
    """Return an empty mode with room for every contact that a profile can give."""
    return np.zeros((2 * vertices + 1, MODE_COLUMNS), dtype=np.int64)


@compiled
def feature_margin(feature: int, x: float, y: float, radius: float, ground: Any) -> float:
    """
    Return by how much the ball touches a feature, negative if it does not [m].

    It touches a segment that holds the foot of the perpendicular, a vertex in whose cone the
    centre is, and both only nearer than the radius: the least of three margins.
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
    margin = min(radius - distance, distance)
    if segment > 0:
        margin = min(margin, start_x * tangent_x + start_y * tangent_y)
    if segment < last:
        margin = min(margin, -after_end)
    return margin


@compiled
def touches(feature: int, margin: float, ground: Any) -> bool:
    """Tell whether a margin means contact; a convex vertex includes the rim of its cone."""
    rim = feature % 2 == 1 and ground[feature // 2 + 1, TURN] <= 0.0
    return margin > 0.0 or (rim and margin == 0.0)


@compiled
def features_within(x: float, reach: float, ground: Any) -> tuple:
    """Return the first feature within `reach` of x, and the one after the last."""
    first = 2 * first_segment(ground, x - reach)
    # The last segment goes on for ever and has no vertex at its end.
    return first, min(2 * first_segment(ground, x + reach) + 2, 2 * len(ground) - 3)


@compiled
def fill_table(state: Any, mode: Any, count: int, robot: Any, ground: Any, table: Any) -> None:
    """Write the contacts of a mode into `table`, whether they still touch or not."""
    x, y = state[X], state[Y]
    corners = False
    for row in range(count):
        segment = mode[row, FEATURE] // 2
        if mode[row, FEATURE] % 2 == 0:
            tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
            distance = ((y - ground[segment, VERTEX_Y]) * tangent_x
                        - (x - ground[segment, VERTEX_X]) * tangent_y)
            write_contact(table, row, SURFACE, x, y, -tangent_y, tangent_x, distance,
                          robot.radius, ground[segment, SURFACE_FRICTION])
        else:
            away_x = x - ground[segment + 1, VERTEX_X]
            away_y = y - ground[segment + 1, VERTEX_Y]
            distance = math.sqrt(away_x * away_x + away_y * away_y)
            concave = ground[segment + 1, TURN] > 0.0
            corners = corners or concave
            write_contact(table, row, CORNER if concave else EDGE, x, y, away_x / distance,
                          away_y / distance, distance, robot.radius,
                          0.0 if concave else ground[segment + 1, EDGE_FRICTION])
    if corners:
        for row in range(1, count - 1):
            if table[row, KIND] == CORNER:
                share_friction(table, row)


@compiled
def normal_and_slip(state: Any, robot: Any, table: Any, row: int) -> tuple:
    """Return spring-damper force, slip and normal velocity of one contact, without kinks."""
    normal_x, normal_y = table[row, NORMAL_X], table[row, NORMAL_Y]
    velocity_x, velocity_y = state[VELOCITY_X], state[VELOCITY_Y]
    penetration = table[row, PENETRATION]
    normal_velocity = velocity_x * normal_x + velocity_y * normal_y
    force = robot.stiffness * penetration - robot.damping * normal_velocity
    lever = robot.radius - (0.0 if robot.radius_lever > 0.0 else penetration)
    slip = velocity_x * normal_y - velocity_y * normal_x + lever * state[BALL_RATE]
    return force, slip, normal_velocity


@compiled
def unlimited_scale(slip: float, robot: Any) -> float:
    """
    Return mu_scale of eq. (9), continued smoothly beyond the threshold.

    The cubic would soon change its sign there, and a trial step would run away; it ends
    with zero slope, and a constant continues it smoothly enough.
    """
    if robot.smooth_friction > 0.0:
        return friction_scale(slip, robot.slip_threshold, robot.smooth_friction)
    return slip / robot.slip_threshold


@inlined
def mode_loads(state: Any, mode: Any, count: int, robot: Any, ground: Any, table: Any) -> tuple:
    """Return what `contact.contact_loads` returns, by the formulas of a frozen mode."""
    force_x = force_y = torque = contact_loss = friction_loss = 0.0
    fill_table(state, mode, count, robot, ground, table)
    for row in range(count):
        normal_x, normal_y = table[row, NORMAL_X], table[row, NORMAL_Y]
        distance = robot.radius - table[row, PENETRATION]
        force, slip, normal_velocity = normal_and_slip(state, robot, table, row)
        spring = robot.stiffness * table[row, PENETRATION]
        normal = 0.0 if mode[row, PRESSED] == 0 else force
        scale = float(mode[row, SLIDING])
        if mode[row, SLIDING] == 0:
            scale = unlimited_scale(slip, robot)
        friction = -normal * mode[row, PRESSED] * table[row, FRICTION] * scale
        if table[row, KIND] == CORNER:
            normal, spring = -normal, -spring
        force_x += normal * normal_x + friction * normal_y
        force_y += normal * normal_y - friction * normal_x
        torque += friction * distance
        contact_loss += (spring - normal) * normal_velocity
        friction_loss -= friction * (state[VELOCITY_X] * normal_y
                                     - state[VELOCITY_Y] * normal_x
                                     + distance * state[BALL_RATE])
    return force_x, force_y, torque, contact_loss, friction_loss


@compiled
def mode_derivative(time: float, state: Any, mode: Any, count: int, robot: Any, ground: Any,
                    drive: Any, table: Any, rates: Any) -> None:
    """Write the time derivative of `state` by the formulas of a frozen mode."""
    loads = mode_loads(state, mode, count, robot, ground, table)
    motor = 0.0
    if robot.swing_inertia > 0.0:
        saturated = mode[len(mode) - 1, MOTOR]
        motor = wanted_torque(time, state, drive) if saturated == 0 else saturated * drive.limit
    write_rates(state, robot, loads, motor, rates)


@compiled
def sign_beyond(value: float, limit: float) -> int:
    """Return the sign of a value that is beyond +-limit, 0 for one within."""
    return int(value > limit) - int(value < -limit)


@compiled
def find_mode(time: float, state: Any, robot: Any, ground: Any, drive: Any, table: Any,
              mode: Any) -> int:
    """Write the mode of a state into `mode` and return how many contacts it has."""
    count = 0
    first, behind = features_within(state[X], robot.radius, ground)
    for feature in range(first, behind):
        margin = feature_margin(feature, state[X], state[Y], robot.radius, ground)
        if touches(feature, margin, ground):
            mode[count, FEATURE] = feature
            count += 1
    fill_table(state, mode, count, robot, ground, table)
    for row in range(count):
        force, slip, _ = normal_and_slip(state, robot, table, row)
        mode[row, PRESSED] = 1 if force > 0.0 else (-1 if robot.pulling > 0.0 else 0)
        mode[row, SLIDING] = sign_beyond(slip, robot.slip_threshold)
    mode[len(mode) - 1, MOTOR] = sign_beyond(wanted_torque(time, state, drive), drive.limit)
    return count


# What a margin may belong to.
OF_FEATURE, OF_FORCE, OF_SLIP, OF_MOTOR = range(4)


@compiled
def margin_of(kind: int, item: int, time: float, state: Any, mode: Any, count: int, robot: Any,
              ground: Any, drive: Any, table: Any) -> float:
    """
    Return a margin: positive inside the mode, negative beyond its end.

    Parameters
    ----------
    kind : int
        OF_FEATURE (`item` is the feature), OF_FORCE or OF_SLIP (`item` is the row of the
        contact), or OF_MOTOR.

    """
    if kind == OF_FEATURE:
        margin = feature_margin(item, state[X], state[Y], robot.radius, ground)
        for row in range(count):
            if mode[row, FEATURE] == item:
                return margin
        return -margin
    if kind == OF_MOTOR:
        return side(wanted_torque(time, state, drive), mode[len(mode) - 1, MOTOR], drive.limit)
    fill_table(state, mode, count, robot, ground, table)
    force, slip, _ = normal_and_slip(state, robot, table, item)
    if kind == OF_FORCE:
        return force if mode[item, PRESSED] > 0 else -force
    return side(slip, mode[item, SLIDING], robot.slip_threshold)


@compiled
def side(value: float, sign: int, limit: float) -> float:
    """Return how far a value is inside +-limit (sign 0), or beyond it on the side of `sign`."""
    if sign == 0:
        return limit - abs(value)
    return sign * value - limit


@compiled
def broken(time: float, state: Any, mode: Any, count: int, first: int, behind: int, robot: Any,
           ground: Any, drive: Any, table: Any, kinds: Any, items: Any) -> int:
    """
    List the margins that have become negative, among features from `first` to `behind`.

    Returns how many there are; `kinds` and `items` say which.
    """
    found = row = 0
    for feature in range(first, behind):
        margin = feature_margin(feature, state[X], state[Y], robot.radius, ground)
        # Both go from left to right: no need to search, which takes long on rough ground.
        while row < count and mode[row, FEATURE] < feature:
            row += 1
        inside = row < count and mode[row, FEATURE] == feature
        if touches(feature, margin, ground) != inside:
            kinds[found], items[found] = OF_FEATURE, feature
            found += 1
    if count > 0:
        fill_table(state, mode, count, robot, ground, table)
    for row in range(count):
        force, slip, _ = normal_and_slip(state, robot, table, row)
        if (force > 0.0) != (mode[row, PRESSED] > 0):
            kinds[found], items[found] = OF_FORCE, row
            found += 1
        rough = table[row, FRICTION] > 0.0 and mode[row, PRESSED] != 0
        if rough and side(slip, mode[row, SLIDING], robot.slip_threshold) < 0.0:
            kinds[found], items[found] = OF_SLIP, row
            found += 1
    if side(wanted_torque(time, state, drive), mode[len(mode) - 1, MOTOR], drive.limit) < 0.0:
        kinds[found], items[found] = OF_MOTOR, 0
        found += 1
    return found
