# SPDX-License-Identifier: Apache-2.0
"""
Where the ball touches the ground, and what the ground then does: eqs. (7)-(10).

**Where.**  The ball touches wherever the distance from its centre to the profile has a
local minimum shorter than the radius: on each segment that holds the foot of the
perpendicular, and on each convex vertex whose normal cone holds the centre.  The lower
plane, corner and upper plane of the paper's Fig. 2 are three cases of that rule; a face
higher than the radius is a wall, and a concave corner gives two contacts.

Local *maxima* within reach (only concave vertices have them) count negatively.  A ball in
a wall corner never reaches the vertex, so nothing changes there; but where a floor turns
gently into a ramp, the two contacts merge into one at the vertex, and without the negative
one a whole contact force would appear and vanish at once, with energy from nowhere.
Friction acts at the minima only, where it can but take energy; a maximum takes its share
from the coefficients of the two minima that it lies between, see `share_friction`.

**What.**  A spring and a damper along the normal, eq. (7), which do not pull unless asked
to; friction with a slip velocity at the contact point, eq. (8), that grows to its full
coefficient over a small slip, eq. (9); and the torque of that friction, eq. (10).
"""
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled, inlined
from ballbot_ros.physics.model.terrain import (
    EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)

# Kinds of contact; the values are those of the message ballbot_ros/Contact.
SURFACE = 1
EDGE = 2
CORNER = 3

# Columns of the table of contacts that find_contacts fills.
KIND, POINT_X, POINT_Y, NORMAL_X, NORMAL_Y, PENETRATION, FRICTION = range(7)
COLUMNS = 7


def contact_table(vertices: int) -> NDArray[np.float64]:
    """Return an empty table with room for every contact that a profile can give."""
    return np.zeros((2 * vertices, COLUMNS))


@compiled
def first_segment(ground: Any, left: float) -> int:
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
def write_contact(table: Any, row: int, kind: int, x: float, y: float, normal_x: float,
                  normal_y: float, distance: float, radius: float, friction: float) -> None:
    """Fill one row of the table of contacts."""
    table[row, KIND] = kind
    table[row, POINT_X] = x - distance * normal_x
    table[row, POINT_Y] = y - distance * normal_y
    table[row, NORMAL_X] = normal_x
    table[row, NORMAL_Y] = normal_y
    table[row, PENETRATION] = radius - distance
    table[row, FRICTION] = friction


@compiled
def share_friction(table: Any, row: int) -> None:
    """
    Take from the two neighbours of a CORNER the friction that it counts for.

    A neighbour that is about to merge with the corner loses all of its friction, the other
    one none of it, and in between both a share: friction stays continuous.  To count it
    negatively, as the normal force, would give energy: the three slips are not the same.
    """
    x, y, penetration = table[row, POINT_X], table[row, POINT_Y], table[row, PENETRATION]
    left = math.hypot(table[row - 1, POINT_X] - x, table[row - 1, POINT_Y] - y)
    right = math.hypot(table[row + 1, POINT_X] - x, table[row + 1, POINT_Y] - y)
    # On a straight line all three may be the same point.
    share = right / (left + right) if left + right > 0.0 else 0.5
    table[row - 1, FRICTION] *= 1.0 - share * penetration / table[row - 1, PENETRATION]
    table[row + 1, FRICTION] *= 1.0 - (1.0 - share) * penetration / table[row + 1, PENETRATION]


@inlined
def find_contacts(x: float, y: float, radius: float, ground: Any, table: Any) -> int:
    """
    Write all contacts of a ball into `table` and return how many there are.

    Parameters
    ----------
    x, y : float
        Centre of the ball [m].
    radius : float
        [m]
    ground : (n, 7) array
        See `Terrain.profile`.
    table : (2 n, 7) array
        See `contact_table`; rows are overwritten.

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
                write_contact(table, count, SURFACE, x, y, -tangent_y, tangent_x, distance,
                              radius, ground[segment, SURFACE_FRICTION])
                count += 1
        if segment == last:
            break
        next_after = (end_x * ground[segment + 1, TANGENT_X]
                      + end_y * ground[segment + 1, TANGENT_Y])
        concave = ground[segment + 1, TURN] > 0.0
        nearest = not concave and after_end >= 0.0 and next_after <= 0.0
        farthest = concave and after_end < 0.0 and next_after > 0.0
        if nearest or farthest:
            distance = math.sqrt(end_x * end_x + end_y * end_y)
            if 0.0 < distance < radius:
                write_contact(table, count, EDGE if nearest else CORNER, x, y,
                              end_x / distance, end_y / distance, distance, radius,
                              ground[segment + 1, EDGE_FRICTION] if nearest else 0.0)
                count += 1
                corners += 0 if nearest else 1
    if corners > 0:
        # Minima and maxima alternate along the ground.
        for row in range(1, count - 1):
            if table[row, KIND] == CORNER:
                share_friction(table, row)
    return count


@compiled
def friction_scale(slip: float, threshold: float, smooth: float) -> float:
    """
    Return mu_scale of eq. (9) with the sign of the slip, between -1 and 1.

    It reaches 1 at the threshold: along a straight line, or (`smooth`) along the cubic
    that ends there with zero slope.
    """
    ratio = min(max(slip / threshold, -1.0), 1.0)
    if smooth > 0.0:
        return 0.5 * ratio * (3.0 - ratio * ratio)
    return ratio


@compiled
def contact_force(robot: Any, table: Any, row: int, velocity_x: float, velocity_y: float,
                  ball_rate: float) -> tuple:
    """
    Return normal force, friction force, slip velocity and normal velocity of one contact.

    The normal force is positive out of the ground, friction and slip along the tangent
    (normal_y, -normal_x), which points to +x on a floor.  The normal force of a CORNER is
    counted with reversed sign; it has no friction.

    Parameters
    ----------
    robot : dynamics.Numbers
    table : (2 n, 7) array
        Contacts, from `find_contacts`.
    row : int
        Which of them.
    velocity_x, velocity_y : float
        Velocity of the centre [m/s].
    ball_rate : float
        theta1' [rad/s].

    """
    normal_x, normal_y = table[row, NORMAL_X], table[row, NORMAL_Y]
    penetration = table[row, PENETRATION]
    normal_velocity = velocity_x * normal_x + velocity_y * normal_y
    normal_force = robot.stiffness * penetration - robot.damping * normal_velocity
    if robot.pulling == 0.0:
        normal_force = max(normal_force, 0.0)
    lever = robot.radius - (0.0 if robot.radius_lever > 0.0 else penetration)
    slip = velocity_x * normal_y - velocity_y * normal_x + lever * ball_rate
    friction_force = -abs(normal_force) * table[row, FRICTION] * friction_scale(
        slip, robot.slip_threshold, robot.smooth_friction)
    if table[row, KIND] == CORNER:
        return -normal_force, 0.0, slip, normal_velocity
    return normal_force, friction_force, slip, normal_velocity


@inlined
def contact_loads(robot: Any, ground: Any, table: Any, x: float, y: float,
                  velocity_x: float, velocity_y: float, ball_rate: float) -> tuple:
    """
    Return what all contacts together do to the ball.

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
    for row in range(find_contacts(x, y, robot.radius, ground, table)):
        normal_x, normal_y = table[row, NORMAL_X], table[row, NORMAL_Y]
        penetration = table[row, PENETRATION]
        normal, friction, _, normal_velocity = contact_force(
            robot, table, row, velocity_x, velocity_y, ball_rate)
        distance = robot.radius - penetration
        force_x += normal * normal_x + friction * normal_y
        force_y += normal * normal_y - friction * normal_x
        torque += friction * distance
        # The spring takes -k pen v_n; what the normal force takes beyond that is lost.
        spring = robot.stiffness * penetration
        if table[row, KIND] == CORNER:
            spring = -spring
        contact_loss += (spring - normal) * normal_velocity
        friction_loss -= friction * (velocity_x * normal_y - velocity_y * normal_x
                                     + distance * ball_rate)
    return force_x, force_y, torque, contact_loss, friction_loss


@compiled
def spring_energy(robot: Any, ground: Any, table: Any, x: float, y: float) -> float:
    """Return the energy stored in the contact springs [J]."""
    energy = 0.0
    for row in range(find_contacts(x, y, robot.radius, ground, table)):
        stored = 0.5 * robot.stiffness * table[row, PENETRATION]**2
        energy += -stored if table[row, KIND] == CORNER else stored
    return energy
