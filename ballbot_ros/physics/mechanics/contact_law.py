# SPDX-License-Identifier: Apache-2.0
"""
The loads on the ball at one contact: eqs. (7)-(10), and their derivatives.

The normal force of a contact law, eq. (7) or another, which does not pull unless asked to;
friction with a slip velocity at the contact point, eq. (8), that grows to its full coefficient
over a small slip, eq. (9); and the torque of that friction, eq. (10).

The law has kinks.  Between them it is smooth, and which piece holds is two signs: *pressed*, of
the normal force (0 where the damper would pull and is not let), and *sliding*, of a slip beyond
the threshold (0 within).  Every function here takes the signs as given, and continues its piece
smoothly beyond its ends: with the signs of the state itself (`pressed_sign`, `sliding_sign`) it
is the law, with those of a frozen mode (see `modes`) its smooth continuation for an integrator.

The force before these limits is that of one of the `contact_laws`.
"""
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.contact_laws import damper
from ballbot_ros.physics.model.parameters import Parameters
from ballbot_ros.physics.model.state import BALL_RATE, VELOCITY_X, VELOCITY_Y
from ballbot_ros.physics.model.terrain import Array

# Kinds of contact; the values are those of the message ballbot_ros/Contact.
SURFACE = 1
EDGE = 2
CORNER = 3

# Columns of a table of contacts, which `contact.find_contacts` fills.
KIND, POINT_X, POINT_Y, NORMAL_X, NORMAL_Y, PENETRATION, FRICTION = range(7)
COLUMNS = 7

# Columns of the pieces that are in force, a row per contact from left to right; see `modes`.
FEATURE, PRESSED, SLIDING = range(3)


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
    force, slip, normal_velocity : float
        See `force_and_slip`.
    along : float
        Velocity of the centre along the tangent [m/s].
    damping : float
        The part of the force that is not elastic [N].

    """
    normal_velocity = velocity_x * normal_x + velocity_y * normal_y
    along = velocity_x * normal_y - velocity_y * normal_x
    damping, _, _ = damper(penetration, normal_velocity, parameters)
    return (parameters.stiffness * penetration - damping, along + lever * spin, normal_velocity,
            along, damping)


@compiled
def force_and_slip(state: Array, parameters: Parameters, contacts: Array,
                   row: int) -> tuple[float, float, float]:
    """
    Return the results of eqs. (7) and (8) for one contact, before any limit.

    Parameters
    ----------
    state : (13,) array
    contacts : (2 n, 7) array
        See `contact.find_contacts`.
    row : int
        Which of them.

    Returns
    -------
    force : float
        Of spring and damper, positive out of the ground [N].
    slip : float
        Along the tangent (normal_y, -normal_x), which points to +x on a floor [m/s].
    normal_velocity : float
        Positive away from the ground [m/s].

    """
    penetration = contacts[row, PENETRATION]
    force, slip, normal_velocity, _, _ = pressing_and_slipping(
        contacts[row, NORMAL_X], contacts[row, NORMAL_Y], penetration,
        slip_lever(parameters.radius - penetration, parameters), state[VELOCITY_X],
        state[VELOCITY_Y], state[BALL_RATE], parameters)
    return force, slip, normal_velocity


@compiled
def pressed_sign(force: float, parameters: Parameters) -> int:
    """Return the sign of the normal force, 0 where the damper would pull and is not let."""
    return 1 if force > 0.0 else (-1 if parameters.pulling > 0.0 else 0)


@compiled
def sliding_sign(slip: float, parameters: Parameters) -> int:
    """Return the sign of a slip beyond the threshold of eq. (9), 0 for one within."""
    return sign_beyond(slip, parameters.slip_threshold)


@compiled
def sign_beyond(value: float, limit: float) -> int:
    """Return the sign of a value that is beyond +-limit, 0 for one within."""
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
    """Return the derivative of `friction_scale` by the slip [s/m]."""
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
        See the module.
    friction : float
        Coefficient of the contact.

    """
    normal = 0.0 if pressed == 0 else force
    return normal, -normal * pressed * friction * friction_scale(slip, sliding, parameters)


@compiled
def contact_force(state: Array, parameters: Parameters, contacts: Array,
                  row: int) -> tuple[float, float, float]:
    """
    Return normal force, friction force and slip velocity of one contact [N, N, m/s].

    Along normal and tangent, see `force_and_slip`.  The normal force of a CORNER is counted with
    reversed sign; it has no friction.
    """
    force, slip, _ = force_and_slip(state, parameters, contacts, row)
    normal, friction = normal_and_friction(
        force, slip, pressed_sign(force, parameters), sliding_sign(slip, parameters),
        parameters, contacts[row, FRICTION])
    if contacts[row, KIND] == CORNER:
        return -normal, 0.0, slip
    return normal, friction, slip
