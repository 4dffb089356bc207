# SPDX-License-Identifier: Apache-2.0
"""
Contact detection, and the sum of the contact forces.

The ball touches wherever the distance from its centre to the profile has a
local minimum shorter than the radius: on each segment that holds the foot of the
perpendicular, and on each convex vertex whose normal cone holds the centre.  The lower
plane, corner and upper plane of the paper's Fig. 2 are three cases of that rule; a face
higher than the radius is a wall, and a concave corner gives two contacts.

Local *maxima* within reach (only concave vertices have them) count negatively.  A ball in
a wall corner never reaches the vertex, so nothing changes there; but where a floor turns
gently into a ramp, the two contacts merge into one at the vertex, and without the negative
one a whole contact force would appear or vanish within one step and violate energy balance.
Friction acts at the minima only, where it always dissipates; a maximum takes its share
from the coefficients of the two minima that it lies between, see `share_friction`.

A *feature* of the ground is a number: 2 j for segment j, 2 j + 1 for the vertex at its end.  The
force of each contact is in `contact_law`.
"""
import math

import numpy as np

from ballbot_ros.jit import compiled, inlined
from ballbot_ros.physics.mechanics.contact_law import (
    COLUMNS, contact_load, CORNER, EDGE, force_and_slip, FRICTION, KIND, NORMAL_X, NORMAL_Y,
    PENETRATION, POINT_X, POINT_Y, pressed_sign, pressing_and_slipping, sliding_sign, slip_lever,
    stored_energy, SURFACE)
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import BALL_RATE, VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.model.terrain import (
    Array, EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)


def contact_table(vertices: int) -> Array:
    """Return an empty table with room for every contact that a profile can give."""
    return np.zeros((2 * vertices, COLUMNS))


@compiled
def first_segment(ground: Array, left: float) -> int:
    """Return the last segment that starts at or before `left`, by bisection."""
    low, high = 0, len(ground) - 2
    while low < high:
        middle = (low + high + 1) // 2
        if ground[middle, VERTEX_X] <= left:
            low = middle
        else:
            high = middle - 1
    return low


@compiled
def ground_height(ground: Array, x: float) -> float:
    """Return the height of the ground at `x` [m]."""
    segment = first_segment(ground, x)
    slope = ground[segment, TANGENT_Y] / ground[segment, TANGENT_X]
    height: float = ground[segment, VERTEX_Y] + slope * (x - ground[segment, VERTEX_X])
    return height


@compiled
def away_from(segment: int, x: float, y: float, ground: Array) -> tuple[float, float]:
    """Return the vector to a point from the point of a segment that is nearest to it [m]."""
    away_x, away_y = x - ground[segment, VERTEX_X], y - ground[segment, VERTEX_Y]
    along_x, along_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    along = away_x * along_x + away_y * along_y
    # The foot of the perpendicular, or an end that is not infinite.
    if along < 0.0 and segment > 0:
        along = 0.0
    if segment < len(ground) - 2:
        along = min(along, (ground[segment + 1, VERTEX_X] - ground[segment, VERTEX_X]) * along_x
                    + (ground[segment + 1, VERTEX_Y] - ground[segment, VERTEX_Y]) * along_y)
    return away_x - along * along_x, away_y - along * along_y


@compiled
def meeting(feature: int, x: float, y: float,
            ground: Array) -> tuple[float, float, float, float]:
    """
    Return where a feature of the ground lies from a point.

    Returns
    -------
    normal_x, normal_y : float
        Unit vector from the ground to the point.
    distance : float
        [m]
    friction : float
        Coefficient; that of an edge also where the vertex is a CORNER, which has none.

    """
    segment = feature >> 1
    if feature & 1 == 0:
        tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
        return (-tangent_y, tangent_x, (y - ground[segment, VERTEX_Y]) * tangent_x
                - (x - ground[segment, VERTEX_X]) * tangent_y, ground[segment, SURFACE_FRICTION])
    away_x, away_y = x - ground[segment + 1, VERTEX_X], y - ground[segment + 1, VERTEX_Y]
    square = away_x * away_x + away_y * away_y
    distance = math.sqrt(square)
    per_distance = distance * (1.0 / square)  # root and division do not wait for each other
    return (away_x * per_distance, away_y * per_distance, distance,
            ground[segment + 1, EDGE_FRICTION])


@compiled
def pressed_and_slid(feature: int, motion: Array, ground: Array,
                     parameters: Parameters) -> tuple[float, float, float, float, float, float]:
    """Return what `meeting` does for the centre of the ball, then the force and slip there."""
    normal_x, normal_y, distance, friction = meeting(feature, motion[X], motion[Y], ground)
    force, slip, _, _ = pressing_and_slipping(
        normal_x, normal_y, parameters.radius - distance, slip_lever(distance, parameters),
        motion[VELOCITY_X], motion[VELOCITY_Y], motion[BALL_RATE], parameters)
    return normal_x, normal_y, distance, friction, force, slip


@compiled
def write_contact(contacts: Array, row: int, feature: int, x: float, y: float, radius: float,
                  ground: Array) -> None:
    """Fill one row of the table of contacts, whether the ball touches that feature or not."""
    normal_x, normal_y, distance, friction = meeting(feature, x, y, ground)
    kind = SURFACE if feature & 1 == 0 else EDGE
    if kind == EDGE and ground[(feature >> 1) + 1, TURN] > 0.0:
        kind, friction = CORNER, 0.0
    contacts[row, KIND], contacts[row, FRICTION] = kind, friction
    contacts[row, POINT_X] = x - distance * normal_x
    contacts[row, POINT_Y] = y - distance * normal_y
    contacts[row, NORMAL_X], contacts[row, NORMAL_Y] = normal_x, normal_y
    contacts[row, PENETRATION] = radius - distance


@compiled
def share_friction(contacts: Array, count: int) -> None:
    """
    Take from the two neighbours of each CORNER the friction that it counts for.

    A neighbour that is about to merge with the corner loses all of its friction, the other
    one none of it, and in between both a share: friction stays continuous.  To count it
    negatively, as the normal force, would give energy: the three slips are not the same.
    """
    # Minima and maxima alternate along the ground.
    for row in range(1, count - 1):
        if contacts[row, KIND] == CORNER:
            x, y = contacts[row, POINT_X], contacts[row, POINT_Y]
            depth = contacts[row, PENETRATION]
            left = math.hypot(contacts[row - 1, POINT_X] - x, contacts[row - 1, POINT_Y] - y)
            right = math.hypot(contacts[row + 1, POINT_X] - x, contacts[row + 1, POINT_Y] - y)
            # On a straight line all three may be the same point.
            share = right / (left + right) if left + right > 0.0 else 0.5
            contacts[row - 1, FRICTION] *= 1.0 - share * depth / contacts[row - 1, PENETRATION]
            contacts[row + 1, FRICTION] *= (
                1.0 - (1.0 - share) * depth / contacts[row + 1, PENETRATION])


@inlined
def find_contacts(x: float, y: float, radius: float, ground: Array, contacts: Array) -> int:
    """
    Write all contacts of a ball into `contacts` and return how many there are.

    Parameters
    ----------
    x, y : float
        Centre of the ball [m].
    radius : float
        [m]
    ground : (n, 7) array
        See `Terrain.profile`.
    contacts : (2 n, 7) array
        See `contact_table`; rows are overwritten, from left to right.

    """
    last = len(ground) - 2
    count = corners = 0
    for segment in range(first_segment(ground, x - radius), last + 1):
        start_x, start_y = ground[segment, VERTEX_X], ground[segment, VERTEX_Y]
        if start_x > x + radius and segment > 0:
            break
        tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
        end_x, end_y = x - ground[segment + 1, VERTEX_X], y - ground[segment + 1, VERTEX_Y]
        # How far the foot of the perpendicular lies behind either end of the segment.
        after_start = (x - start_x) * tangent_x + (y - start_y) * tangent_y
        after_end = end_x * tangent_x + end_y * tangent_y
        if (segment == 0 or after_start > 0.0) and (segment == last or after_end < 0.0):
            distance = (y - start_y) * tangent_x - (x - start_x) * tangent_y
            if 0.0 < distance < radius:
                write_contact(contacts, count, 2 * segment, x, y, radius, ground)
                count += 1
        if segment == last:
            break
        next_after = (end_x * ground[segment + 1, TANGENT_X]
                      + end_y * ground[segment + 1, TANGENT_Y])
        concave = ground[segment + 1, TURN] > 0.0
        nearest = not concave and after_end >= 0.0 and next_after <= 0.0
        farthest = concave and after_end < 0.0 and next_after > 0.0
        if nearest or farthest:
            if 0.0 < math.sqrt(end_x * end_x + end_y * end_y) < radius:
                write_contact(contacts, count, 2 * segment + 1, x, y, radius, ground)
                count += 1
                corners += 0 if nearest else 1
    if corners > 0:
        share_friction(contacts, count)
    return count


@inlined
def sum_of_loads(state: Array, parameters: Parameters, contacts: Array,
                 count: int) -> tuple[float, float, float, float, float]:
    """
    Return what all contacts together do to the ball.

    Parameters
    ----------
    contacts, count
        See `find_contacts`.

    Returns
    -------
    force_x, force_y : float
        [N]
    torque : float
        About the centre, counter-clockwise [N m]; eq. (10).
    contact_loss, friction_loss : float
        Power that dampers and friction take out [W].

    """
    force_x = force_y = torque = contact_loss = friction_loss = 0.0
    for row in range(count):
        force, slip, _ = force_and_slip(state, parameters, contacts, row)
        load = contact_load(state, pressed_sign(force, parameters),
                            sliding_sign(slip, parameters), parameters, contacts, row)
        force_x += load[0]
        force_y += load[1]
        torque += load[2]
        contact_loss += load[3]
        friction_loss -= load[4]
    return force_x, force_y, torque, contact_loss, friction_loss


@inlined
def contact_loads(state: Array, parameters: Parameters, ground: Array,
                  contacts: Array) -> tuple[float, float, float, float, float]:
    """Find all contacts of a state, and return their `sum_of_loads`."""
    count = find_contacts(state[X], state[Y], parameters.radius, ground, contacts)
    return sum_of_loads(state, parameters, contacts, count)


@compiled
def spring_energy(state: Array, parameters: Parameters, ground: Array, contacts: Array) -> float:
    """Return the energy stored in the contact springs [J]."""
    energy = 0.0
    for row in range(find_contacts(state[X], state[Y], parameters.radius, ground, contacts)):
        energy += stored_energy(parameters, contacts, row)
    return energy
