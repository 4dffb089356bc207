# SPDX-License-Identifier: Apache-2.0
"""
Contacts of the ball with the ground: detection, loads, their sum, and their derivatives.

The ball touches wherever the distance from its centre to the profile has a
local minimum shorter than the radius: on each segment that contains the foot of the
perpendicular, and on each convex vertex whose normal cone contains the centre.  The lower
plane, corner and upper plane of the paper's Fig. 2 are three cases of that rule; a face
higher than the radius is a wall, and a concave corner gives two contacts.

Local *maxima* within reach (only concave vertices have them) count negatively.  A ball in
a wall corner never reaches the vertex, so nothing changes there; but where a floor turns
gently into a ramp, the two contacts merge into one at the vertex, and without the negative
contact an entire contact force would appear or vanish within one step and violate the energy
balance.  Friction acts only at the minima, where it always dissipates; a maximum reduces the
coefficients of its two neighbouring minima, see `share_friction`.

A *feature* of the ground has a number: 2 j for segment j, 2 j + 1 for the vertex at its end.

The loads at a contact are eqs. (7)-(10): the normal force of one of the `contact_laws`, which
pulls only if `pulling` is set; friction by the slip velocity at the contact point, eq. (8), whose
coefficient grows to its full value over a small slip, eq. (9); and the torque of that friction,
eq. (10).

These laws have kinks.  Between them they are smooth, and two signs select the smooth piece:
*pressed*, of the normal force (0 where the damper would pull but must not), and *sliding*, of a
slip beyond the threshold (0 within it).  With the signs of the state itself (`pressed_sign`,
`sign_beyond`) a load follows the law; with those of a frozen mode (see `modes`) it is the smooth
continuation for an integrator.

With normal n, tangent t, distance d from the centre, and curvature kappa (0 on a segment, 1/d on a
vertex), a displacement dr turns the normal by ``kappa (t dr)``, and the derivatives follow::

    d(v_n) = kappa v_t (t dr) + n dv        d(v_t) = -kappa v_n (t dr) + t dv
    dN = (dD/dp - k) (n dr) - dD/dv_n d(v_n)         d(slip) = d(v_t) + lever domega + omega (n dr)

The fraction by which a CORNER reduces the friction of its neighbours also depends on the
position; this term is omitted.
"""
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.contact_laws import damper
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import BALL_RATE, VELOCITY_X, VELOCITY_Y, X, Y
from ballbot_ros.physics.model.terrain import (
    Array, EDGE_FRICTION, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)

IntArray = NDArray[np.int64]
Loads = tuple[float, float, float, float, float]  # see `loads_of`
Accelerations = tuple[float, float, float, float]  # of ball, pendulum, x and y
# Accelerations per unit load of the ground: of the pendulum by a force along x and y (two), of x
# by x, of y by x and of x by y, of y by y; of the ball by a torque.
Compliance = tuple[float, float, float, float, float, float]
Response = tuple[Accelerations, Compliance]
SUMMED: Response = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 1.0, 1.0)
ContactSum = tuple[float, float, float, float, float, float]  # see `contact_sum`
OWN, FROZEN, QUICK = range(3)  # forms of a `contact_sum`

# Kinds of contact; the values are those of the message ballbot_ros/Contact.
SURFACE = 1
EDGE = 2
CORNER = 3

# Columns of a table of contacts, which `find_contacts` fills.
KIND, POINT_X, POINT_Y, NORMAL_X, NORMAL_Y, PENETRATION, FRICTION, TOUCHED = range(8)
COLUMNS = 8  # the last one is the feature

# Columns of the active pieces of the law, a row per contact from left to right; see `modes`.
FEATURE, PRESSED, SLIDING = range(3)


class ContactMode(NamedTuple):
    """The active piece of the contact law, see `modes`, and a table of contacts."""

    signs: IntArray  # (2 n + 1, 3), see above; the last row has the columns of `modes`
    contacts: Array  # (2 n, 8): the contacts of the last evaluated state

    @classmethod
    def of(cls, vertices: int) -> 'ContactMode':
        """Return an empty mode for all contacts that a profile can have."""
        return cls(np.zeros((2 * vertices + 1, 3), dtype=np.int64), contact_table(vertices))


@compiled
def slip_lever(distance: float, parameters: Parameters) -> float:
    """Return the lever of the spin in eq. (8), for a centre at a distance from the contact [m]."""
    return parameters.radius if parameters.radius_lever > 0.0 else distance


@compiled
def pressing_and_slipping(normal_x: float, normal_y: float, penetration: float, lever: float,
                          velocity_x: float, velocity_y: float, spin: float,
                          parameters: Parameters) -> tuple[float, float, float, float, float]:
    """
    Return the quantities of eqs. (7) and (8): normal [-], penetration and `slip_lever` [m].

    Returns
    -------
    force, slip : float
        See `force_and_slip`.
    normal_velocity : float
        Positive away from the ground [m/s].
    along : float
        Velocity of the centre along the tangent [m/s].
    damping : float
        Non-elastic part of the force [N].

    """
    normal_velocity = velocity_x * normal_x + velocity_y * normal_y
    along = velocity_x * normal_y - velocity_y * normal_x
    damping, _, _ = damper(parameters.law, penetration, normal_velocity, parameters)
    return (parameters.stiffness * penetration - damping, along + lever * spin, normal_velocity,
            along, damping)


@compiled
def force_and_slip(state: Array, parameters: Parameters, contacts: Array,
                   row: int) -> tuple[float, float]:
    """
    Return the results of eqs. (7) and (8) for one contact, before any limit.

    Parameters
    ----------
    state : (13,) array
    contacts : (2 n, 8) array
        See `find_contacts`.
    row : int
        Row of the contact.

    Returns
    -------
    force : float
        Force of spring and damper, positive out of the ground [N].
    slip : float
        Velocity along the tangent (normal_y, -normal_x), which points to +x on a floor [m/s].

    """
    penetration = contacts[row, PENETRATION]
    force, slip, _, _, _ = pressing_and_slipping(
        contacts[row, NORMAL_X], contacts[row, NORMAL_Y], penetration,
        slip_lever(parameters.radius - penetration, parameters), state[VELOCITY_X],
        state[VELOCITY_Y], state[BALL_RATE], parameters)
    return force, slip


@compiled
def pressed_sign(force: float, parameters: Parameters) -> int:
    """Return the sign of the normal force, 0 where the damper would pull but must not."""
    return 1 if force > 0.0 else (-1 if parameters.pulling > 0.0 else 0)


@compiled
def sign_beyond(value: float, limit: float) -> int:
    """Return the sign of a value beyond +-limit, 0 within."""
    return int(value > limit) - int(value < -limit)


@compiled
def friction_scale(slip: float, sliding: int, parameters: Parameters) -> float:
    """
    Return mu_scale of eq. (9) with the sign of the slip.

    It reaches 1 at the threshold: along a straight line, or (smooth) along the cubic that ends
    there with zero slope.  The line continues beyond; the cubic would change its sign there
    and make a trial step diverge, so a constant continues it, with a continuous slope.
    """
    if sliding != 0:
        return float(sliding)
    ratio = slip * (1.0 / parameters.slip_threshold)
    if parameters.smooth_friction > 0.0:
        ratio = min(max(ratio, -1.0), 1.0)
        return 0.5 * ratio * (3.0 - ratio * ratio)
    return ratio


@compiled
def friction_slope(slip: float, sliding: int, parameters: Parameters) -> float:
    """Return the derivative of `friction_scale` with respect to the slip [s/m]."""
    if sliding != 0:
        return 0.0
    if parameters.smooth_friction > 0.0:
        ratio = slip / parameters.slip_threshold
        return 1.5 * max(0.0, 1.0 - ratio * ratio) / parameters.slip_threshold
    return 1.0 / parameters.slip_threshold


@compiled
def normal_and_friction(force: float, slip: float, pressed: int, sliding: int,
                        parameters: Parameters, friction: float) -> tuple[float, float]:
    """
    Return normal force and friction force of one contact [N]; eqs. (7) and (9).

    Parameters
    ----------
    force, slip : float
        See `force_and_slip`.
    pressed, sliding : int
        See the docstring of the module.
    friction : float
        Coefficient of friction.

    """
    normal = 0.0 if pressed == 0 else force
    return normal, -normal * pressed * friction * friction_scale(slip, sliding, parameters)


@compiled
def contact_force(state: Array, parameters: Parameters, contacts: Array,
                  row: int) -> tuple[float, float, float]:
    """
    Return normal force, friction force and slip velocity of one contact [N, N, m/s].

    The forces are along normal and tangent, see `force_and_slip`.  The normal force of a CORNER
    has the reversed sign, and its friction is 0.
    """
    force, slip = force_and_slip(state, parameters, contacts, row)
    normal, friction = normal_and_friction(
        force, slip, pressed_sign(force, parameters), sign_beyond(slip, parameters.slip_threshold),
        parameters, contacts[row, FRICTION])
    if contacts[row, KIND] == CORNER:
        return -normal, 0.0, slip
    return normal, friction, slip


def contact_table(vertices: int) -> Array:
    """Return an empty table for all contacts that a profile can have."""
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
def touching_at(radius: float, distance: float, height: float, cosine: float,
                sine: float) -> float:
    """
    Return the position along the ground, from the foot, at which a ball touches a step [m].

    The centre is at a `distance` from the ground, whose slope has this cosine and sine.
    """
    along = (distance * sine - radius) / cosine  # touch of an infinitely high wall
    if along * sine + distance * cosine > height:
        rise = distance - height * cosine
        along = height * sine - math.sqrt(max(radius**2 - rise * rise, 0.0))
    return along


@compiled
def line_distance(segment: int, x: float, y: float, ground: Array) -> float:
    """
    Return the distance of a point above the line of a segment [m].

    Every point of the segment, including its ends, is at least that far away.
    """
    return ((y - ground[segment, VERTEX_Y]) * ground[segment, TANGENT_X]
            - (x - ground[segment, VERTEX_X]) * ground[segment, TANGENT_Y])


@compiled
def feature_guard(feature: int, x: float, y: float, radius: float, ground: Array) -> float:
    """
    Return the guard of a feature, positive if the ball touches it, negative if not [m].

    The ball touches a segment that contains the foot of the perpendicular, or a vertex whose cone
    contains the centre, within the radius; the guard is the least of these three distances.
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
    distance = line_distance(segment, x, y, ground)
    guard = min(radius - distance, distance)
    if segment > 0:
        guard = min(guard, (x - ground[segment, VERTEX_X]) * tangent_x
                    + (y - ground[segment, VERTEX_Y]) * tangent_y)
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
def away_from(segment: int, x: float, y: float, ground: Array) -> tuple[float, float]:
    """Return the vector from the nearest point of a segment to a point [m]."""
    away_x, away_y = x - ground[segment, VERTEX_X], y - ground[segment, VERTEX_Y]
    along_x, along_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    along = away_x * along_x + away_y * along_y
    # The foot of the perpendicular, or a finite end.
    if along < 0.0 and segment > 0:
        along = 0.0
    if segment < len(ground) - 2:
        along = min(along, (ground[segment + 1, VERTEX_X] - ground[segment, VERTEX_X]) * along_x
                    + (ground[segment + 1, VERTEX_Y] - ground[segment, VERTEX_Y]) * along_y)
    return away_x - along * along_x, away_y - along * along_y


@compiled
def clear_time(x: float, y: float, velocity_x: float, velocity_y: float, bend: float,
               reach: float, radius: float, ground: Array) -> float:
    """
    Return a time before which no contact force acts on a released ball [s].

    Parameters
    ----------
    bend : float
        Bound of the acceleration of the centre [m/s2], above 0.
    reach : float
        Segments farther from x than this are ignored [m].

    """
    least = math.inf
    last = len(ground) - 2
    for segment in range(first_segment(ground, x - reach), last + 1):
        if ground[segment, VERTEX_X] - x > reach and segment > 0:
            break
        away_x, away_y = away_from(segment, x, y, ground)
        distance = math.sqrt(away_x * away_x + away_y * away_y)
        gap = distance - radius
        speed = (velocity_x * away_x + velocity_y * away_y) / distance
        square = speed * speed + 2.0 * bend * gap
        # The later root of gap + speed h - bend h^2 / 2, without cancellation.
        wait = 0.0
        if speed > 0.0 and square > 0.0:
            wait = (speed + math.sqrt(square)) / bend
        elif gap > 0.0:
            wait = 2.0 * gap / (math.sqrt(square) - speed)
        least = min(least, wait)
    return least


@compiled
def meeting(feature: int, x: float, y: float,
            ground: Array) -> tuple[float, float, float, float]:
    """
    Return the position of a feature of the ground relative to a point.

    Returns
    -------
    normal_x, normal_y : float
        Unit vector from the ground to the point.
    distance : float
        [m]
    friction : float
        Coefficient; for a CORNER, which has no friction, that of an edge.

    """
    segment = feature >> 1
    if feature & 1 == 0:
        return (-ground[segment, TANGENT_Y], ground[segment, TANGENT_X],
                line_distance(segment, x, y, ground), ground[segment, SURFACE_FRICTION])
    away_x, away_y = x - ground[segment + 1, VERTEX_X], y - ground[segment + 1, VERTEX_Y]
    square = away_x * away_x + away_y * away_y
    distance = math.sqrt(square)
    per_distance = distance * (1.0 / square)  # root and division can run in parallel
    return (away_x * per_distance, away_y * per_distance, distance,
            ground[segment + 1, EDGE_FRICTION])


@compiled
def write_contact(contacts: Array, row: int, feature: int, x: float, y: float, radius: float,
                  ground: Array) -> None:
    """Fill one row of the table of contacts, whether the ball touches the feature or not."""
    normal_x, normal_y, distance, friction = meeting(feature, x, y, ground)
    kind = SURFACE if feature & 1 == 0 else EDGE
    if kind == EDGE and ground[(feature >> 1) + 1, TURN] > 0.0:
        kind, friction = CORNER, 0.0
    contacts[row, KIND], contacts[row, FRICTION], contacts[row, TOUCHED] = kind, friction, feature
    contacts[row, POINT_X] = x - distance * normal_x
    contacts[row, POINT_Y] = y - distance * normal_y
    contacts[row, NORMAL_X], contacts[row, NORMAL_Y] = normal_x, normal_y
    contacts[row, PENETRATION] = radius - distance


@compiled
def share_friction(contacts: Array, count: int) -> None:
    """
    Reduce the friction of the two neighbours of each CORNER.

    For a neighbour that is about to merge with the corner it becomes 0, for the other it does not
    change; in between, both keep a fraction, so friction stays continuous.  Negative friction at
    the corner, like its normal force, would add energy, because the three slips differ.
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


@compiled
def find_contacts(x: float, y: float, radius: float, ground: Array, contacts: Array) -> int:
    """
    Write all contacts of a ball into `contacts` and return their number.

    Parameters
    ----------
    x, y : float
        Centre of the ball [m].
    radius : float
        [m]
    ground : (n, 7) array
        See `Terrain.profile`.
    contacts : (2 n, 8) array
        See `contact_table`; rows are overwritten, from left to right.

    """
    count = 0
    first, behind = features_within(x, radius, ground)
    for feature in range(first, behind):
        if touches(feature, feature_guard(feature, x, y, radius, ground), ground):
            write_contact(contacts, count, feature, x, y, radius, ground)
            count += 1
    share_friction(contacts, count)
    return count


@compiled
def contact_sum(motion: Array, parameters: Parameters, ground: Array, mode: ContactMode,
                count: int, form: int, response: Response) -> ContactSum:
    """
    Return the sum of all contact loads on the ball: eqs. (7) to (10).

    Parameters
    ----------
    motion : (8,) array, or longer
    parameters : Parameters
    ground : (n, 7) array
        See `Terrain.profile`.
    mode : ContactMode
    count : int
        Number of contacts.
    form : int
        OWN: contacts from the table, pieces of the law from the motion.  FROZEN: contacts from
        the table, pieces from the signs.  QUICK: features and pieces from the signs, without the
        table; there must be no CORNER then.
    response : tuple
        Response to the contact forces: see `equations.unforced`.  With `SUMMED` the result is
        force and torque.

    Returns
    -------
    turn, swing, along_x, along_y : float
        Accelerations; with `SUMMED`, torque, 0, and force.
    contact_loss, friction_loss : float
        Power dissipated by dampers and friction [W].

    """
    (turn, swing, along_x, along_y), (sway_x, sway_y, own_x, cross, own_y, per_inertia) = response
    contact_loss = friction_loss = 0.0
    signs, contacts = mode.signs, mode.contacts
    velocity_x, velocity_y, spin = motion[VELOCITY_X], motion[VELOCITY_Y], motion[BALL_RATE]
    for row in range(count):
        sign = 1.0  # the normal force of a CORNER counts negatively
        if form != QUICK:
            normal_x, normal_y = contacts[row, NORMAL_X], contacts[row, NORMAL_Y]
            penetration, friction = contacts[row, PENETRATION], contacts[row, FRICTION]
            distance = parameters.radius - penetration
            if contacts[row, KIND] == CORNER:
                sign = -1.0
        else:
            normal_x, normal_y, distance, friction = meeting(
                signs[row, FEATURE], motion[X], motion[Y], ground)
            penetration = parameters.radius - distance
        force, slip, away, along, damping = pressing_and_slipping(
            normal_x, normal_y, penetration, slip_lever(distance, parameters), velocity_x,
            velocity_y, spin, parameters)
        if form != OWN:
            pressed, sliding = signs[row, PRESSED], signs[row, SLIDING]
        else:
            pressed = pressed_sign(force, parameters)
            sliding = sign_beyond(slip, parameters.slip_threshold)
        pressing, rubbing = normal_and_friction(
            force, slip, pressed, sliding, parameters, friction)
        # All power except that of the spring is dissipated, even for a clipped pulling force.
        lost = damping if pressed != 0 else parameters.stiffness * penetration
        contact_loss += sign * lost * away
        friction_loss -= rubbing * (along + distance * spin)
        pressing *= sign
        # Friction, along the tangent (normal_y, -normal_x), is available last.
        swing += pressing * (sway_x * normal_x + sway_y * normal_y)
        along_x += pressing * (own_x * normal_x + cross * normal_y)
        along_y += pressing * (cross * normal_x + own_y * normal_y)
        turn += rubbing * (per_inertia * distance)
        swing += rubbing * (sway_x * normal_y - sway_y * normal_x)
        along_x += rubbing * (own_x * normal_y - cross * normal_x)
        along_y += rubbing * (cross * normal_y - own_y * normal_x)
    return turn, swing, along_x, along_y, contact_loss, friction_loss


@compiled
def loads_of(motion: Array, parameters: Parameters, ground: Array, mode: ContactMode, count: int,
             form: int) -> Loads:
    """
    Return force_x, force_y [N], torque about the centre [N m], and the losses of `contact_sum`.

    The torque is counter-clockwise, eq. (10).
    """
    torque, _, force_x, force_y, contact_loss, friction_loss = contact_sum(
        motion, parameters, ground, mode, count, form, SUMMED)
    return force_x, force_y, torque, contact_loss, friction_loss


@compiled
def contact_loads(motion: Array, parameters: Parameters, ground: Array, mode: ContactMode
                  ) -> Loads:
    """Write all contacts of a motion into the table of a mode, and return their `loads_of`."""
    count = find_contacts(motion[X], motion[Y], parameters.radius, ground, mode.contacts)
    return loads_of(motion, parameters, ground, mode, count, OWN)


@compiled
def spring_energy(state: Array, parameters: Parameters, ground: Array, contacts: Array) -> float:
    """Return the energy stored in the contact springs [J]; that of a CORNER is negative."""
    energy = 0.0
    for row in range(find_contacts(state[X], state[Y], parameters.radius, ground, contacts)):
        depth = contacts[row, PENETRATION]
        stored = 0.5 * parameters.stiffness * (depth * depth)
        energy += -stored if contacts[row, KIND] == CORNER else stored
    return energy


@compiled
def add_load(out: Array, load: int, factor: float,
             slopes: tuple[float, float, float, float, float]) -> None:
    """Add a multiple of a gradient to the row of a load."""
    # Unrolled: a variable index makes a tuple slow.
    out[load, 0] += factor * slopes[0]
    out[load, 1] += factor * slopes[1]
    out[load, 2] += factor * slopes[2]
    out[load, 3] += factor * slopes[3]
    out[load, 4] += factor * slopes[4]


@compiled
def add_contact(state: Array, parameters: Parameters, ground: Array, mode: ContactMode, row: int,
                smooth: bool, out: Array) -> tuple[float, float, float]:
    """
    Add the derivatives of a contact's loads by x, y, velocity_x, velocity_y, ball_rate.

    Parameters
    ----------
    state, parameters, ground, mode
        See `contact_sum`; the table is read only if not all contacts are `smooth`.
    row : int
        Row of the contact.
    out : (3, 5) array, or larger
        The derivatives of force_x, force_y and torque.

    Returns
    -------
    force_x, force_y, torque : float
        The loads [N], [N m].

    """
    signs, contacts = mode.signs, mode.contacts
    feature = signs[row, FEATURE]
    normal_x, normal_y, distance, coefficient = meeting(feature, state[X], state[Y], ground)
    corner = False
    if not smooth:
        corner = contacts[row, KIND] == CORNER
        coefficient = contacts[row, FRICTION]
    tangent_x, tangent_y = normal_y, -normal_x
    spin = state[BALL_RATE]
    bend = 0.0 if feature & 1 == 0 else 1.0 / distance
    lever = slip_lever(distance, parameters)
    force, slip, closing, along, _ = pressing_and_slipping(
        normal_x, normal_y, parameters.radius - distance, lever, state[VELOCITY_X],
        state[VELOCITY_Y], spin, parameters)
    # Gradients; of the normal velocity: (closing_x, closing_y, normal_x, normal_y, 0).
    closing_x, closing_y = bend * along * tangent_x, bend * along * tangent_y
    drift_x, drift_y = -bend * closing * tangent_x, -bend * closing * tangent_y
    pressed, sliding = signs[row, PRESSED], signs[row, SLIDING]
    normal, friction = normal_and_friction(force, slip, pressed, sliding, parameters, coefficient)
    # The force of a CORNER, which has no friction, has the reversed sign.
    sign = -1.0 if corner else 1.0
    _, softer, damping = damper(
        parameters.law, parameters.radius - distance, closing, parameters)
    stiffness, damping = parameters.stiffness - softer, damping if pressed != 0 else 0.0
    slope_x = -stiffness * normal_x - damping * closing_x if pressed != 0 else 0.0
    slope_y = -stiffness * normal_y - damping * closing_y if pressed != 0 else 0.0
    # Friction: -sign N mu scale(slip).
    rough = -pressed * coefficient
    share = rough * friction_scale(slip, sliding, parameters)
    steep = rough * normal * friction_slope(slip, sliding, parameters)
    growing = 0.0 if parameters.radius_lever > 0.0 else spin
    pressing = slope_x, slope_y, -damping * normal_x, -damping * normal_y, 0.0
    rubbing = (share * slope_x + steep * (drift_x + growing * normal_x),
               share * slope_y + steep * (drift_y + growing * normal_y),
               -share * damping * normal_x + steep * tangent_x,
               -share * damping * normal_y + steep * tangent_y, steep * lever)
    turning = tangent_x, tangent_y, 0.0, 0.0, 0.0
    # force = normal n + friction t, and both directions rotate.
    add_load(out, 0, sign * normal_x, pressing)
    add_load(out, 0, tangent_x, rubbing)
    add_load(out, 0, bend * (sign * normal * tangent_x - friction * normal_x), turning)
    add_load(out, 1, sign * normal_y, pressing)
    add_load(out, 1, tangent_y, rubbing)
    add_load(out, 1, bend * (sign * normal * tangent_y - friction * normal_y), turning)
    # torque = friction distance
    add_load(out, 2, distance, rubbing)
    add_load(out, 2, friction, (normal_x, normal_y, 0.0, 0.0, 0.0))
    return (sign * normal * normal_x + friction * tangent_x,
            sign * normal * normal_y + friction * tangent_y, friction * distance)
