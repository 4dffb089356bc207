# SPDX-License-Identifier: Apache-2.0
"""
The end of a frozen mode within a step: bounds of the guards, then location of a violated guard.

Most steps end in their mode, and a bound proves it.  Along the dense output (see `dense`) a linear
function of the motion is a polynomial, too, and the basis functions of its coefficients lie
between 0 and 1, 1/4, 4/27 and 1/16.  So its minimum is at least the sum of the minima of its
terms.  If such a bound is inconclusive, the guards are evaluated at some times within the step,
and the zero of a violated guard is located.

On a vertex the normal rotates with the centre.  With n, t the normal and tangent at the start, the
centre at ``u n + w t`` from the vertex, and |w| at most W::

    u <= distance <= u + W^2 / 2u        |n' - n| <= W / u, and along n itself W^2 / 2u^2
"""
import math

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import (
    away_from, clear_time, ContactMode, FEATURE, meeting, PRESSED, SLIDING, touches)
from ballbot_ros.physics.mechanics.equations import System
from ballbot_ros.physics.mechanics.modes import (
    contact_count, guard_of, in_contact, MOTOR, OF_FEATURE, OF_FORCE, smooth_contacts,
    violated_guards)
from ballbot_ros.physics.model.actuation import torque_slopes, unsaturated_torque
from ballbot_ros.physics.model.contact_laws import damping_bound
from ballbot_ros.physics.model.state import (
    BALL_ANGLE, BALL_RATE, PENDULUM_ANGLE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y
from ballbot_ros.physics.solvers import values
from ballbot_ros.physics.solvers.controller import smallest_step, time_width
from ballbot_ros.physics.solvers.dense import motion_at
from ballbot_ros.physics.solvers.values import EventRate, MOTION, WIDTH, Workspace

# The coefficients of a quantity along a step, see `dense.interpolate`.
Course = tuple[float, float, float, float, float]


@compiled
def course_of(work: Array, item: int, along_x: float, along_y: float) -> Course:
    """Return ``along_x`` times an item of the motion plus ``along_y`` times the next item."""
    at = values.DENSE + item
    return (along_x * work[at] + along_y * work[at + 1],
            along_x * work[at + WIDTH] + along_y * work[at + WIDTH + 1],
            along_x * work[at + 2 * WIDTH] + along_y * work[at + 2 * WIDTH + 1],
            along_x * work[at + 3 * WIDTH] + along_y * work[at + 3 * WIDTH + 1],
            along_x * work[at + 4 * WIDTH] + along_y * work[at + 4 * WIDTH + 1])


@compiled
def combined(one: float, first: Course, other: float, second: Course) -> Course:
    """Return a linear combination of two courses."""
    return (one * first[0] + other * second[0], one * first[1] + other * second[1],
            one * first[2] + other * second[2], one * first[3] + other * second[3],
            one * first[4] + other * second[4])


@compiled
def started_at(value: float, course: Course) -> Course:
    """Return a course with another initial value and the same changes."""
    return value, course[1], course[2], course[3], course[4]


@compiled
def least(course: Course) -> float:
    """Return a lower bound of a course."""
    return course[0] + (min(course[1], 0.0) + 0.25 * min(course[2], 0.0)) + (
        (4.0 / 27.0) * min(course[3], 0.0) + 0.0625 * min(course[4], 0.0))


@compiled
def most(course: Course) -> float:
    """Return an upper bound of a course."""
    return -least((-course[0], -course[1], -course[2], -course[3], -course[4]))


@compiled
def largest(course: Course) -> float:
    """Return an upper bound of the absolute value of a course."""
    return max(most(course), -least(course))


@compiled
def pressed_throughout(work: Array, row: int, normal: tuple[float, float, float], friction: float,
                       apart: tuple[float, Course], system: System, mode: ContactMode) -> bool:
    """
    Return whether a contact stays in contact, pressed, and sliding or not, as it was.

    Parameters
    ----------
    normal : tuple
        Normal at the start of the step, and the distance then [m].
    friction : float
        Coefficient of friction.
    apart : tuple
        Bound of the motion of the centre along the tangent if that rotates the normal, else 0; and
        the course of the centre along the normal, from the feature [m].

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
    faster = shorter * fastest + turned * quickest
    damping, remainder = damping_bound(
        parameters.law, parameters.radius - nearest, most(closing) + faster, parameters)
    force = combined(-parameters.stiffness, away, -damping, closing)
    force_left = parameters.stiffness * (parameters.radius - beyond) + least(force) - (
        damping * faster) + remainder
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
    """Return whether a contact persists throughout the last step, and no neighbour touches."""
    feature, ground = mode.signs[row, FEATURE], system.ground
    if mode.signs[row, PRESSED] <= 0:
        return False
    segment, last = feature >> 1, len(ground) - 2
    normal_x, normal_y, distance, friction = meeting(
        feature, work[values.DENSE + X], work[values.DENSE + X + 1], ground)
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
    """Return the position of a vertex along a segment, the dot product with its tangent [m]."""
    along: float = (ground[vertex, VERTEX_X] * ground[segment, TANGENT_X]
                    + ground[vertex, VERTEX_Y] * ground[segment, TANGENT_Y])
    return along


@compiled
def reach_of(vertex: int, behind: int, system: System, mode: ContactMode) -> float:
    """
    Return how far before a vertex an approaching ball may touch it [m].

    At a concave vertex the ball may touch the segment behind it earlier, if no other check covers
    that segment.
    """
    if system.ground[vertex, TURN] > 0.0 and covered_by_active_contact(behind, system, mode):
        return system.parameters.radius
    return 0.0


@compiled
def falls_off(vertex: int, ground: Array) -> bool:
    """Return whether the ground turns down at a vertex, by at most a right angle."""
    return ground[vertex, TURN] <= 0.0 and (
        ground[vertex - 1, TANGENT_X] * ground[vertex, TANGENT_X]
        + ground[vertex - 1, TANGENT_Y] * ground[vertex, TANGENT_Y]) >= 0.0


@compiled
def covered_by_active_contact(segment: int, system: System, mode: ContactMode) -> bool:
    """
    Return whether `contact_persists` of active contacts also covers a segment and its end.

    This holds for features in contact, and for their neighbours: the centre remains before the
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
    Return whether a segment provably has no contact within the last step.

    The segment is behind the line through its initially nearest point, perpendicular to the
    direction to the centre: its distance is at least that of the line.
    """
    ground = system.ground
    tangent_x, tangent_y = ground[segment, TANGENT_X], ground[segment, TANGENT_Y]
    across = ground[segment, VERTEX_Y] * tangent_x - ground[segment, VERTEX_X] * tangent_y
    if least(course_of(work, X, -tangent_y, tangent_x)) - across > system.parameters.radius:
        return True
    x, y = work[values.DENSE + X], work[values.DENSE + X + 1]
    away_x, away_y = away_from(segment, x, y, ground)
    distance = math.sqrt(away_x * away_x + away_y * away_y)
    if not distance > system.parameters.radius:
        return False
    course = course_of(work, X, away_x / distance, away_y / distance)
    return least(started_at(distance, course)) > system.parameters.radius


@compiled
def motor_stays(time: float, step: float, work: Array, system: System, mode: ContactMode) -> bool:
    """
    Return whether the torque remains within the limit of the motor, or beyond it.

    All laws are linear except gravity compensation, whose sine changes by no more than the angle.
    """
    actuator = system.actuator
    by_ball, by_angle, by_spin, by_rate, by_time = torque_slopes(actuator)
    begin = unsaturated_torque(time, work[values.DENSE:values.DENSE + MOTION], actuator)
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
    Return whether no guard is violated within the last step, see `modes.violated_guards`.

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


MOST_EVENTS = 64      # located up to one check; of more, an early one suffices
LOOKS = 4             # times within a step at which the mode is checked
NO_EVENT = 2.0        # for theta, which is 0 to 1 within the step
INSIDE = 1e-300       # value of a guard that is zero by rounding
FALSI_ALONE, MOST_TURNS = 10, 100  # iterations for an event: before it bisects, and in total

STEP_LOOKS = 64     # checks for a touch within a step; then only those at fixed times remain
SHORTEST = 1e-4     # relative to the step: a shorter touch may be missed

CHATTER = 1e-9        # [s]: maximum time between events caused by rounding
CHATTERING = 20         # number of such events before steps skip them, with growing length
SOON, CROWD = 0.1, 3  # of the step; number of events within it before steps shorten
STUCK = 1000          # events, or smallest steps, in a row without any time between them


@compiled
def ends_at_zero(kind: int, item: int, mode: ContactMode, ground: Array) -> bool:
    """Return whether a mode has ended where a guard is zero; else it ends only below zero."""
    if kind == OF_FORCE:
        return mode.signs[item, PRESSED] > 0
    if kind != OF_FEATURE:
        return False
    return in_contact(item, mode) != touches(item, 0.0, ground)


@compiled
def guard_at(theta: float, index: int, time: float, step: float, system: System,
             workspace: Workspace) -> float:
    """
    Return a violated guard at `theta` of the last step.

    By rounding it may be zero for a while; it counts as positive if that is still in the mode.
    Else the next step would start in the same mode and could miss a contact between two checks.
    """
    motion_at(theta, workspace.work)
    kind, item = workspace.violated[index, 0], workspace.violated[index, 1]
    guard = guard_of(kind, item, time + theta * step, workspace.work[values.PROBE:], system,
                     workspace.mode)
    if guard == 0.0 and not ends_at_zero(kind, item, workspace.mode, system.ground):
        return INSIDE
    return guard


@compiled
def anderson_bjorck_weight(guard: float, before: float) -> float:
    """Return the factor for the guard at the end of the bracket that was kept twice."""
    share = 1.0 - guard / before
    return share if share > 0.0 else 0.5


@compiled
def locate(index: int, low: float, high: float, time: float, step: float, system: System,
           workspace: Workspace) -> float:
    """
    Return theta where a violated guard has just become negative, within a bracket.

    Regula falsi by Anderson and Bjoerck on the dense output; it ends on the far side of the zero,
    so that the next mode differs.  A guard may be far from linear, as where a ball rolls off an
    edge; so after the first few iterations, every other one is a bisection.
    """
    at_low = guard_at(low, index, time, step, system, workspace)
    at_high = guard_at(high, index, time, step, system, workspace)
    width, kept = time_width(time) / step, 0
    for turn in range(MOST_TURNS):
        if high - low <= width:
            break
        if at_low > 0.0 and at_high < 0.0 and (turn < FALSI_ALONE or turn % 2 == 0):
            theta = low + (high - low) * at_low / (at_low - at_high)
            # Aim a little beyond the zero, to close the bracket from both sides.
            theta = min(max(theta + 0.25 * width, low + 0.25 * width), high - 0.25 * width)
        else:
            theta = 0.5 * (low + high)
        guard = guard_at(theta, index, time, step, system, workspace)
        if guard > 0.0:
            if kept > 0:  # the same end twice: it counts for less
                at_high *= anderson_bjorck_weight(guard, at_low)
            low, at_low, kept = theta, guard, 1
        else:
            if kept < 0:
                at_low *= anderson_bjorck_weight(guard, at_high)
            high, at_high, kept = theta, guard, -1
    return high


@compiled
def event_between(before: float, theta: float, time: float, step: float, features: tuple[int, int],
                  system: System, workspace: Workspace) -> float:
    """
    Return the first theta up to a given one at which the mode ends, NO_EVENT if it does not.

    An earlier violation may precede the located one: a ball lands on
    a segment and rolls over its end.  So the located event is checked again, from just
    before it.
    """
    (first, behind), event = features, NO_EVENT
    for _ in range(MOST_EVENTS):
        if theta <= before:
            break
        motion_at(theta, workspace.work)
        found = violated_guards(time + theta * step, workspace.work[values.PROBE:], system,
                                workspace.mode, first, behind, workspace.violated)
        if found == 0:
            break
        event = theta
        for index in range(found):
            event = min(event, locate(index, before, theta, time, step, system, workspace))
        theta = event - 4.0 * time_width(time) / step
    return event


@compiled
def most_acceleration(step: float, work: Array) -> float:
    """Return a bound of the acceleration of the centre within the last step [m/s2]."""
    change_x = change_y = 0.0
    for row in range(1, 5):
        # Steepest slopes of the basis functions of the coefficients, see `dense`.
        steepest = 0.2 if row == 4 else 1.0
        at = values.DENSE + WIDTH * row
        change_x += steepest * abs(work[at + VELOCITY_X])
        change_y += steepest * abs(work[at + VELOCITY_Y])
    return (change_x + change_y) / step + 1e-9


@outlined
def touch_within(time: float, step: float, first: int, behind: int, system: System,
                 workspace: Workspace) -> float:
    """Return theta of the last step where a ball in the air touches, infinity if it does not."""
    work, radius = workspace.work, system.parameters.radius
    probe = work[values.PROBE:]
    bend, done = most_acceleration(step, work), 0.0
    for _ in range(STEP_LOOKS):
        motion_at(done, work)
        if done > 0.0 and violated_guards(time + done * step, probe, system, workspace.mode,
                                          first, behind, workspace.violated) > 0:
            return done
        left = (1.0 - done) * step
        speed = abs(probe[VELOCITY_X]) + abs(probe[VELOCITY_Y])
        wait = clear_time(probe[X], probe[Y], probe[VELOCITY_X], probe[VELOCITY_Y], bend,
                          radius + (speed + bend * left) * left, radius, system.ground)
        done += max(wait / step, SHORTEST)
        if done >= 1.0:
            break
    return math.inf


@compiled
def first_event(time: float, step: float, first: int, behind: int, system: System,
                workspace: Workspace) -> float:
    """Return theta at which the mode ends, NO_EVENT if not; see `modes.violated_guards`."""
    if holds_throughout(time, step, workspace.work, first, behind, system, workspace.mode):
        return NO_EVENT
    touch = NO_EVENT
    if contact_count(workspace.mode) == 0:  # it may touch, and roll off again, between two checks
        touch = touch_within(time, step, first, behind, system, workspace)
    for look in range(LOOKS):
        before, theta = look / LOOKS, (look + 1) / LOOKS
        if before < touch < theta:
            theta = touch
        event = event_between(before, theta, time, step, (first, behind), system, workspace)
        if event < NO_EVENT:
            return event
    return NO_EVENT


@compiled
def rated(rate: EventRate, theta: float, time: float, step: float) -> tuple[EventRate, float]:
    """
    Return the rate of events after a step, and theta where it ends.

    A guard that changes by less than its rounding chatters: after some events, steps skip it.
    """
    chattering = rate.chattering + 1 if theta * step < CHATTER else 0
    if chattering > CHATTERING and theta <= 1.0:
        push = time_width(time) * (1 << min(chattering - CHATTERING, 40))
        theta = max(theta, min(1.0, push / step))
    return EventRate(chattering, rate.crowded + 1 if theta < SOON else 0,
                     rate.stuck + 1 if min(theta, 1.0) * step <= smallest_step(time) else 0), theta
