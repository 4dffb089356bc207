# SPDX-License-Identifier: Apache-2.0
"""
Whether a frozen mode holds throughout a step: a bound of each guard, which most steps pass.

Along the dense output (see `dense`) what is linear in the motion is a polynomial, too, and the
functions that its coefficients are multiplied with lie between 0 and 1, 1/4, 4/27 and 1/16.  So
its least value is at least the sum of the least values of its terms.  Where such a bound says
nothing, `events` looks at the guards at some times within the step.

On a vertex the normal turns with the centre.  With n, t the normal and tangent at the begin, the
centre at ``u n + w t`` from the vertex, and |w| at most W::

    u <= distance <= u + W^2 / 2u        |n' - n| <= W / u, and along n itself W^2 / 2u^2
"""
import math

from ballbot_ros.jit import compiled
from ballbot_ros.physics.mechanics.contact import away_from, meeting
from ballbot_ros.physics.mechanics.contact_law import FEATURE, PRESSED, SLIDING
from ballbot_ros.physics.mechanics.equations import torque_slopes, unsaturated_torque
from ballbot_ros.physics.mechanics.guards import in_contact
from ballbot_ros.physics.mechanics.modes import contact_count, ContactMode, MOTOR, smooth_contacts
from ballbot_ros.physics.model.parameters import System
from ballbot_ros.physics.model.state import BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, VELOCITY_X, X
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y
from ballbot_ros.physics.solvers import rows
from ballbot_ros.physics.solvers.rows import MOTION, WIDTH

# The coefficients of a quantity along a step, see `dense.interpolate`.
Course = tuple[float, float, float, float, float]


@compiled
def course_of(work: Array, item: int, along_x: float, along_y: float) -> Course:
    """Return ``along_x`` times an item of the motion plus ``along_y`` times the next."""
    at = rows.DENSE + item
    return (along_x * work[at] + along_y * work[at + 1],
            along_x * work[at + WIDTH] + along_y * work[at + WIDTH + 1],
            along_x * work[at + 2 * WIDTH] + along_y * work[at + 2 * WIDTH + 1],
            along_x * work[at + 3 * WIDTH] + along_y * work[at + 3 * WIDTH + 1],
            along_x * work[at + 4 * WIDTH] + along_y * work[at + 4 * WIDTH + 1])


@compiled
def combined(one: float, first: Course, other: float, second: Course) -> Course:
    """Return a sum of two multiples."""
    return (one * first[0] + other * second[0], one * first[1] + other * second[1],
            one * first[2] + other * second[2], one * first[3] + other * second[3],
            one * first[4] + other * second[4])


@compiled
def started_at(value: float, course: Course) -> Course:
    """Return the course of a quantity that goes on as another one does, from its own begin."""
    return value, course[1], course[2], course[3], course[4]


@compiled
def least(course: Course) -> float:
    """Return a lower bound."""
    return course[0] + (min(course[1], 0.0) + 0.25 * min(course[2], 0.0)) + (
        (4.0 / 27.0) * min(course[3], 0.0) + 0.0625 * min(course[4], 0.0))


@compiled
def most(course: Course) -> float:
    """Return an upper bound."""
    return -least((-course[0], -course[1], -course[2], -course[3], -course[4]))


@compiled
def largest(course: Course) -> float:
    """Return an upper bound of the absolute value."""
    return max(most(course), -least(course))


@compiled
def pressed_throughout(work: Array, row: int, normal: tuple[float, float, float], friction: float,
                       apart: tuple[float, Course], system: System, mode: ContactMode) -> bool:
    """
    Return whether a contact stays one that is pressed, and sliding or not as it was.

    Parameters
    ----------
    normal : tuple
        At the begin of the step, and the distance then [m].
    friction : float
        Coefficient.
    apart : tuple
        How far the centre goes along the tangent at most, where that turns the normal, else 0; and
        its course along the normal, from the feature [m].

    """
    (normal_x, normal_y, distance), (aside, away), parameters = normal, apart, system.parameters
    closing = course_of(work, VELOCITY_X, normal_x, normal_y)
    passing = course_of(work, VELOCITY_X, normal_y, -normal_x)
    spin = course_of(work, BALL_RATE, 1.0, 0.0)
    nearest, farthest = least(away), most(away)
    if nearest <= 0.5 * parameters.radius:
        return False
    beyond = shorter = turned = fastest = quickest = 0.0
    if aside > 0.0:
        turned = aside / nearest
        beyond, shorter = 0.5 * turned * aside, 0.5 * turned * turned
        fastest, quickest = largest(closing), largest(passing)
    force = combined(-parameters.stiffness, away, -parameters.damping, closing)
    force_left = parameters.stiffness * (parameters.radius - beyond) + least(force) - (
        parameters.damping * (shorter * fastest + turned * quickest))
    if parameters.dissipation > 0.0:  # N = k p - (kd + h p) v_n with bounds of p and v_n
        force_left -= parameters.dissipation * max(parameters.radius - nearest, 0.0) * max(
            most(closing) + shorter * fastest + turned * quickest, 0.0)
    if not (farthest + beyond < parameters.radius and force_left > 0.0):
        return False
    if friction <= 0.0:
        return True
    lever, change = parameters.radius, 0.0
    if parameters.radius_lever == 0.0:
        lever, change = distance, max(farthest - distance, distance - nearest) + beyond
    slip = combined(1.0, passing, lever, spin)
    unsure = shorter * quickest + turned * fastest + change * largest(spin)
    sliding, threshold = mode.signs[row, SLIDING], parameters.slip_threshold
    if sliding == 0:
        return largest(slip) + unsure < threshold
    return (least(slip) if sliding > 0 else -most(slip)) - unsure > threshold


@compiled
def contact_persists(work: Array, row: int, system: System, mode: ContactMode) -> bool:
    """Return whether a contact of a mode holds throughout the last step, with its neighbours."""
    feature, ground = mode.signs[row, FEATURE], system.ground
    if mode.signs[row, PRESSED] <= 0:
        return False
    segment, last = feature >> 1, len(ground) - 2
    normal_x, normal_y, distance, friction = meeting(
        feature, work[rows.DENSE + X], work[rows.DENSE + X + 1], ground)
    vertex = segment + (feature & 1)
    across = normal_x * ground[vertex, VERTEX_X] + normal_y * ground[vertex, VERTEX_Y]
    away, aside = course_of(work, X, normal_x, normal_y), 0.0
    away = started_at(away[0] - across, away)
    if feature & 1 == 0:
        foot = course_of(work, X, ground[segment, TANGENT_X], ground[segment, TANGENT_Y])
        if segment > 0 and least(foot) <= place(segment, segment, ground) + reach_of(
                segment, segment - 1, system, mode):
            return False
        if segment < last and most(foot) >= place(segment + 1, segment, ground) - reach_of(
                segment + 1, segment + 1, system, mode):
            return False
    else:
        before = course_of(work, X, ground[segment, TANGENT_X], ground[segment, TANGENT_Y])
        behind = course_of(work, X, ground[vertex, TANGENT_X], ground[vertex, TANGENT_Y])
        if least(before) < place(vertex, segment, ground) or (
                most(behind) > place(vertex, vertex, ground)):
            return False
        aside = largest(started_at(0.0, course_of(work, X, normal_y, -normal_x)))
    return pressed_throughout(work, row, (normal_x, normal_y, distance), friction, (aside, away),
                              system, mode)


@compiled
def place(vertex: int, segment: int, ground: Array) -> float:
    """Return where a vertex is along a segment, as the dot product with its tangent [m]."""
    along: float = (ground[vertex, VERTEX_X] * ground[segment, TANGENT_X]
                    + ground[vertex, VERTEX_Y] * ground[segment, TANGENT_Y])
    return along


@compiled
def reach_of(vertex: int, behind: int, system: System, mode: ContactMode) -> float:
    """
    Return how far before a vertex an approaching ball may touch it [m].

    A concave vertex may touch as early as the segment behind it, where no other check covers
    that segment.
    """
    if system.ground[vertex, TURN] > 0.0 and covered_by_active_contact(behind, system, mode):
        return system.parameters.radius
    return 0.0


@compiled
def falls_off(vertex: int, ground: Array) -> bool:
    """Return whether the ground turns down at a vertex, by a right angle at most."""
    return ground[vertex, TURN] <= 0.0 and (
        ground[vertex - 1, TANGENT_X] * ground[vertex, TANGENT_X]
        + ground[vertex - 1, TANGENT_Y] * ground[vertex, TANGENT_Y]) >= 0.0


@compiled
def covered_by_active_contact(segment: int, system: System, mode: ContactMode) -> bool:
    """
    Return whether `contact_persists` of what is in contact says enough of a segment and its end.

    That is so of what is in contact itself, and of its neighbours: the centre stays before the
    start of one, or behind the end of the other.
    """
    ground, own, last = system.ground, 2 * segment, len(system.ground) - 2
    if in_contact(own, mode) or in_contact(own + 1, mode):
        return True
    if segment < last and in_contact(own + 2, mode) and falls_off(segment + 1, ground):
        return True
    return segment > 0 and (in_contact(own - 1, mode) or (
        in_contact(own - 2, mode) and falls_off(segment, ground))) and (
            segment == last or place(segment + 1, segment, ground)
            - place(segment, segment, ground) > system.parameters.radius)


@compiled
def contact_excluded(work: Array, segment: int, system: System) -> bool:
    """
    Return whether a segment surely does not touch within the last step.

    All of it lies behind the line through the point that is nearest at the begin, across the way
    to the centre: it is as far away as that line at least.
    """
    ground = system.ground
    tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    across = ground[segment, VERTEX_Y] * tangent_x - ground[segment, VERTEX_X] * tangent_y
    if least(course_of(work, X, -tangent_y, tangent_x)) - across > system.parameters.radius:
        return True
    x, y = work[rows.DENSE + X], work[rows.DENSE + X + 1]
    away_x, away_y = away_from(segment, x, y, ground)
    distance = math.sqrt(away_x * away_x + away_y * away_y)
    if not distance > system.parameters.radius:
        return False
    course = course_of(work, X, away_x / distance, away_y / distance)
    return least(started_at(distance, course)) > system.parameters.radius


@compiled
def motor_stays(time: float, step: float, work: Array, system: System, mode: ContactMode) -> bool:
    """
    Return whether the torque stays within the limit of the motor, or beyond it.

    All laws are linear but for gravity compensation, whose sine changes by no more than the angle.
    """
    actuator = system.actuator
    by_ball, by_angle, by_spin, by_rate, by_time = torque_slopes(actuator)
    begin = unsaturated_torque(time, work[rows.DENSE:rows.DENSE + MOTION], actuator)
    change = started_at(0.0, combined(1.0, course_of(work, BALL_ANGLE, by_ball, by_angle),
                                    1.0, course_of(work, BALL_RATE, by_spin, by_rate)))
    swung = largest(started_at(0.0, course_of(work, PENDULUM_ANGLE, 1.0, 0.0)))
    unsure = abs(actuator.gravity_torque) * swung + abs(by_time) * step
    weakest, strongest = begin + least(change) - unsure, begin + most(change) + unsure
    saturated, limit = mode.signs[len(mode.signs) - 1, MOTOR], actuator.limit
    if saturated == 0:
        return -limit < weakest and strongest < limit
    return weakest > limit if saturated > 0 else strongest < -limit


@compiled
def holds_throughout(time: float, step: float, work: Array, first: int, behind: int,
                     system: System, mode: ContactMode) -> bool:
    """
    Return whether no guard is violated within the last step, among features as `modes` has them.

    Conservative: False means not proven.
    """
    if not smooth_contacts(mode):
        return False
    for row in range(contact_count(mode)):
        if not contact_persists(work, row, system, mode):
            return False
    for segment in range(first >> 1, (behind + 1) >> 1):
        if not (covered_by_active_contact(segment, system, mode)
                or contact_excluded(work, segment, system)):
            return False
    return system.actuator.limit == math.inf or motor_stays(time, step, work, system, mode)
