# SPDX-License-Identifier: Apache-2.0
"""
One attempt at a step, from the first touch to its verdict, in compiled code.

Only two vertices of the ground depend on the height of the step, so the ground and the start
are set up inside the kernel.  The adaptive method runs in blocks; after each block, the kernel
checks whether the ball is over or back, as defined in `rules`.

The verdict of an attempt is the sign of its *score*: the square of the speed with which the centre
of mass passes above the edge, or else minus the square of its smallest distance before the edge,
times the square of the rate at which a ball falls off an edge.  Where the ball must get clear of
the edge on rising ground, it is the square of the speed with which it does, or else minus the
square of the speed that it lacked for the climb from its turning point.  The score approaches zero
where the ball just gets over, so that a search can interpolate instead of bisect.
"""
import math
from typing import NamedTuple

from ballbot_ros.jit import compiled, outlined
from ballbot_ros.physics.mechanics.contact import IntArray, slip_lever, touching_at
from ballbot_ros.physics.mechanics.equations import energies, System
from ballbot_ros.physics.model.actuation import FREE
from ballbot_ros.physics.model.robot import Parameters
from ballbot_ros.physics.model.state import (
    BALL_RATE, PENDULUM_ANGLE, SIZE, VELOCITY_X, VELOCITY_Y, X, Y)
from ballbot_ros.physics.model.terrain import Array, TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y
from ballbot_ros.physics.solvers.integrate import integrate
from ballbot_ros.physics.solvers.values import (
    AUTOMATIC, EVALUATIONS, FINISHED, NOTHING, Options, Output, Status, status_at, Workspace)

# A ball this far behind its touch position has rolled back [m].
RETREAT = 0.004
# Simulated time between two checks of the ball [s]; a doubtful block is repeated in halves.
BLOCK_TIME = 0.04
SHORTEST_BLOCK = 1e-6
# Loss of a ball on level ground, as an equivalent slope; for scores only.
SCORE_SLOPE = 0.02
LEAST = 1e-12  # minimum magnitude of a score [m2/s2]
# Vertices of the ground of a step: its foot and its edge, and an end on either side.
VERTICES, EDGE_VERTEX, END_VERTEX = 4, 2, 3


class Course(NamedTuple):
    """Conditions of a crossing besides robot, motor, height and ground; for the kernels."""

    speed: float  # of the centre at first touch [m/s]
    pendulum_angle: float  # absolute, at the start [rad]
    lead: float  # distance of the start before the touch, along the ground [m]
    first: float  # 1 where the first attempt counts, 0 for any within the time
    time_limit: float  # [s]
    clearance: float  # of the centre beyond the edge, over the radius; 0: just past it


class Crossing(NamedTuple):
    """Data and work arrays shared by attempts at steps of any height; one for each thread."""

    course: Course
    system: System  # with the ground of the step, in which each attempt sets the height
    budget: int  # function evaluations of one attempt
    state: Array  # (13,)
    before: Array  # (13,): state at the start of a block
    output: Output  # without rows
    workspace: Workspace
    spent: IntArray  # attempts and function evaluations
    last: Array  # (1,): end time of the last attempt [s]


@compiled
def set_height(ground: Array, height: float) -> None:
    """Move the edge of the step, and the end of the ground behind it, to a height [m]."""
    slope = ground[EDGE_VERTEX, TANGENT_Y] / ground[EDGE_VERTEX, TANGENT_X]
    ground[EDGE_VERTEX, VERTEX_Y] = height
    ground[END_VERTEX, VERTEX_Y] = height + slope * (
        ground[END_VERTEX, VERTEX_X] - ground[EDGE_VERTEX, VERTEX_X])


@compiled
def place(state: Array, course: Course, parameters: Parameters, ground: Array) -> float:
    """
    Place the ball at the start of its attempt, rolling without slip; return its x at the touch.

    The foot of the step is the origin; its edge is the vertex EDGE_VERTEX.
    """
    cosine, sine = ground[0, TANGENT_X], ground[0, TANGENT_Y]
    height = ground[EDGE_VERTEX, VERTEX_Y]
    # A ball that rolls along a slope is pressed into it by the normal component of its weight.
    penetration = min(parameters.mass * parameters.gravity * cosine / parameters.stiffness,
                      0.5 * parameters.radius)
    distance = parameters.radius - penetration
    along = touching_at(parameters.radius, distance, height, cosine, sine)
    begin = along - course.lead
    for i in range(SIZE):
        state[i] = 0.0
    state[X] = begin * cosine - distance * sine
    state[Y] = begin * sine + distance * cosine
    state[PENDULUM_ANGLE] = course.pendulum_angle
    state[VELOCITY_X] = course.speed * cosine
    state[VELOCITY_Y] = course.speed * sine
    state[BALL_RATE] = -course.speed / slip_lever(distance, parameters)
    return along * cosine - distance * sine


@compiled
def energy_to_spare(state: Array, parameters: Parameters, ground: Array,
                    contacts: Array, goal: float) -> float:
    """
    Return the energy of the ball minus the least that it needs to get over [J].

    The least is that of a ball at rest with its pendulum hanging down: on the edge, or `goal` [m]
    farther on where the ground rises behind it.
    """
    weight = parameters.mass * parameters.gravity
    least = (weight * (ground[EDGE_VERTEX, VERTEX_Y] + parameters.radius
                       - 0.5 * weight / parameters.stiffness)
             - parameters.pendulum_moment * parameters.gravity)
    cosine, sine = ground[EDGE_VERTEX, TANGENT_X], ground[EDGE_VERTEX, TANGENT_Y]
    if goal > 0.0 and sine > 0.0:
        least += weight * ((goal * sine + parameters.radius * (1.0 - cosine)) / cosine
                           - 0.5 * weight / parameters.stiffness * (1.0 / cosine**2 - 1.0))
    kinetic, potential, stored = energies(state, parameters, ground, contacts)
    return kinetic + potential + stored - least


@compiled
def shortfall(nearest: float, farthest: float, falling: float, goal: float,
              crossing: Crossing) -> float:
    """
    Return the score of a ball that did not get over, below 0 [m2/s2].

    `nearest` and `farthest` are the largest distances of its centre of mass and of its centre
    beyond the edge, and `goal` is the required one [m]; `falling` is the square of the rate at
    which it falls off the edge [1/s2].
    """
    if goal <= 0.0:
        return min(-falling * nearest**2, -LEAST)
    ground = crossing.system.ground
    steep = max(ground[EDGE_VERTEX, TANGENT_Y] / ground[EDGE_VERTEX, TANGENT_X], 0.0) + SCORE_SLOPE
    missing = goal - min(max(farthest, 0.0), goal)
    before = falling * min(nearest, 0.0)**2 if farthest <= 0.0 else 0.0
    if farthest <= 0.0 and steep == SCORE_SLOPE:
        missing = 0.0  # behind the edge, the ball is driven on
    return min(-before - 2.0 * falling * crossing.system.parameters.radius * steep * missing,
               -LEAST)


@compiled
def peak(x: float, speed: float, later_x: float, later_speed: float, duration: float) -> float:
    """Return the greatest x on the cubic through two positions with their speeds [m]."""
    greatest = max(x, later_x)
    # x + s t + b t^2 + c t^3 with t from 0 to 1
    start, end = speed * duration, later_speed * duration
    distance = later_x - x
    square, cube = 3.0 * distance - 2.0 * start - end, start + end - 2.0 * distance
    root = square * square - 3.0 * cube * start
    if root > 0.0:
        # The zero of larger magnitude first, to avoid a difference of nearly equal numbers.
        larger = -(square + math.copysign(math.sqrt(root), square))
        for theta in (start / larger if larger != 0.0 else 0.0,
                      larger / (3.0 * cube) if cube != 0.0 else 0.0):
            if 0.0 < theta < 1.0:
                greatest = max(greatest, x + theta * (start + theta * (square + theta * cube)))
    return greatest


@compiled
def weight_ahead(state: Array, parameters: Parameters) -> float:
    """Return the distance of the centre of mass beyond the edge [m]."""
    arm = parameters.pendulum_moment / parameters.mass
    ahead: float = state[X] + arm * math.sin(state[PENDULUM_ANGLE])
    return ahead


@compiled
def speed_between(before: Array, after: Array, theta: float) -> float:
    """Return the speed towards +x at `theta` (0 to 1) between two states [m/s]."""
    speed: float = before[VELOCITY_X] + theta * (after[VELOCITY_X] - before[VELOCITY_X])
    return speed


@compiled
def run_to_verdict(height: float, tolerance: float,
                   crossing: Crossing) -> tuple[float, float, int]:
    """Return score, time of the verdict [s], and outcome; see `attempt`."""
    course, system, workspace = crossing.course, crossing.system, crossing.workspace
    state, before = crossing.state, crossing.before
    parameters, ground = system.parameters, system.ground
    set_height(ground, height)
    touch_x = place(state, course, parameters, ground)
    falling = parameters.gravity * parameters.radius / (
        parameters.radius**2 + parameters.ball_inertia / parameters.mass)
    # Without a motor, the energy only decreases, also at an edge below the centre, unless the
    # friction acts with the printed lever.
    dwindling = (system.actuator.law == FREE and height < parameters.radius
                 and parameters.radius_lever == 0.0)
    goal = course.clearance * parameters.radius
    steep = ground[EDGE_VERTEX, TANGENT_Y] / ground[EDGE_VERTEX, TANGENT_X] if goal > 0.0 else 0.0
    doubt = 10.0 * tolerance * parameters.mass * parameters.gravity
    options = Options(tolerance, 0.0, AUTOMATIC, crossing.budget, False, False)
    status = status_at(0.0, FINISHED, 0)
    nearest, farthest, passed, block = -math.inf, -math.inf, 0.0, BLOCK_TIME
    while status.time < course.time_limit:
        for i in range(SIZE):
            before[i] = state[i]
        later = integrate(status, min(status.time + block, course.time_limit), state, system,
                          options, crossing.output, workspace)
        if later.outcome != FINISHED:
            return 0.0, later.time, later.outcome
        top = peak(before[X], before[VELOCITY_X], state[X], state[VELOCITY_X],
                   later.time - status.time)
        turned = before[VELOCITY_X] > 0.0 > state[VELOCITY_X]
        if (turned and state[X] <= goal and block > SHORTEST_BLOCK
                and top > goal - 0.1 * parameters.gravity * block * block):
            # The ball may have been over within the block: repeat it with a shorter one.
            block *= 0.5
            for i in range(SIZE):
                state[i] = before[i]
            status = Status(FINISHED, status.time, 0, status.controller, status.rate, False,
                            NOTHING, True, 0.0)
            continue
        status, block = later, BLOCK_TIME
        early, late = weight_ahead(before, parameters), weight_ahead(state, parameters)
        nearest, farthest = max(nearest, late), max(farthest, top)
        if steep > 0.0:
            early, late = before[X] - goal, state[X] - goal
        if early < 0.0 <= late:
            passed = speed_between(before, state, early / (early - late))
        if top > goal and state[Y] > height + max(
                state[X], 0.0) * steep + 0.5 * parameters.radius:
            if passed == 0.0:
                passed = speed_between(before, state, 1.0)
            return max(passed * passed, LEAST), status.time, FINISHED
        if state[VELOCITY_X] < 0.0:
            back = course.first > 0.0 and state[X] < touch_x - RETREAT
            if back or (dwindling and (state[X] <= 0.0 or steep >= 0.0) and energy_to_spare(
                    state, parameters, ground, workspace.mode.contacts, goal) < -doubt):
                break
    return shortfall(nearest, farthest, falling, goal, crossing), status.time, FINISHED


@outlined
def attempt(height: float, tolerance: float, crossing: Crossing) -> tuple[float, int]:
    """
    Run one attempt at a step of a height [m]; return score and outcome.

    The score is above 0 if the ball gets over, else below [m2/s2], see the module; the outcome is
    FINISHED, or the reason of a failure, see `solvers.values`.  The tolerance is the local error
    per step of the adaptive method [m].
    """
    statistics = crossing.workspace.statistics
    statistics[:] = 0
    score, time, outcome = run_to_verdict(height, tolerance, crossing)
    crossing.spent[0] += 1
    crossing.spent[1] += statistics[EVALUATIONS]
    crossing.last[0] = time
    return score, outcome


# Ends of a bracket, their scores, and the outcome.
Bracket = tuple[float, float, float, float, int]

# Width of the bracket over the error, and local errors per step over that width.
WIDTH = 0.5
COARSE, FINE = 1e-1, 1e-2
REFINEMENT = 0.03  # factor on the tolerances if their results do not agree
FINEST = 1e-13  # finest meaningful tolerance [m]

# Factor on the step extrapolated from the scores, to find a height that just fails.
EXTRAPOLATION_FACTOR = 1.02
TRIED_HEIGHT_MAX = 4.0  # maximum height that is tried, over the radius
TOO_FAST = -1  # outcome of a search without a step that is too high; others are those of a run


@compiled
def narrow(low: float, high: float, above: float, below: float, width: float,
           tolerance: float, crossing: Crossing) -> tuple[float, float, int]:
    """
    Narrow a bracket to a width [m]; return its ends and the outcome.

    Regula falsi, Illinois variant, with longer steps where it converges slowly.  `low` is a height
    that is crossed and `high` one that is not [m], `above` and `below` are their scores; the
    outcome is FINISHED, or the reason of a failed run.
    """
    side, reach = 0, 0.9 * width
    while high - low > width:
        gap = high - low
        trial = low + 0.5 * gap
        if gap > 2.0 * reach:
            aimed = low + gap * above / (above - below)
            trial = min(max(aimed, low + reach), high - reach)
        score, outcome = attempt(trial, tolerance, crossing)
        if outcome != FINISHED:
            return low, high, outcome
        now = 1 if score > 0.0 else -1
        # On the same side again: the score of the other end weighs less.  If the trial was limited
        # to the minimum step from its end, the next step is longer.
        again, side = now == side, now
        short = trial == low + reach if now > 0 else trial == high - reach
        reach = 4.0 * reach if short else 0.9 * width
        if now > 0:
            low, above = trial, score
            below *= 0.5 if again else 1.0
        else:
            high, below = trial, score
            above *= 0.5 if again else 1.0
    return low, high, FINISHED


@compiled
def climb(low: float, above: float, stride: float, tolerance: float,
          crossing: Crossing) -> Bracket:
    """
    Raise the step from a height that is crossed until it is too high.

    `stride` is the first increase [m]; the scores determine the next ones.  Returns low, high,
    above, below and outcome, see `narrow`; the outcome may be TOO_FAST.
    """
    least, highest = 0.02 * stride, TRIED_HEIGHT_MAX * crossing.system.parameters.radius
    while True:
        high = min(low + stride, highest)
        score, outcome = attempt(high, tolerance, crossing)
        if outcome != FINISHED or score <= 0.0:
            return low, high, above, score, outcome
        if high >= highest:
            return low, high, above, score, TOO_FAST
        aimed = EXTRAPOLATION_FACTOR * stride * score / max(above - score, LEAST)
        low, above = high, score
        stride = max(min(aimed, 4.0 * stride), least)
        least *= 4.0


@compiled
def descend(high: float, below: float, stride: float, tolerance: float,
            crossing: Crossing) -> Bracket:
    """Lower the step from a height that is too high until it is crossed; see `climb`."""
    while True:
        low = max(high - stride, 0.0)
        if low == 0.0:
            return low, high, crossing.course.speed**2, below, FINISHED
        score, outcome = attempt(low, tolerance, crossing)
        if outcome != FINISHED or score > 0.0:
            return low, high, score, below, outcome
        high, below, stride = low, score, 2.0 * stride


@outlined
def search(width: float, coarse: float, fine: float, guess: float,
           crossing: Crossing) -> Bracket:
    """
    Bracket the maximum step height with a coarse tolerance and confirm both ends with a fine one.

    Returns a height that is crossed with the fine tolerance, and one that is not, bounds that also
    enclose the result of the coarse tolerance [m], and the outcome of `narrow` or `climb`.
    """
    low, high, above, below, outcome = climb(
        0.0, crossing.course.speed**2, guess, coarse, crossing)
    if outcome == FINISHED:
        low, high, outcome = narrow(low, high, above, below, width, coarse, crossing)
    lowest, highest = low, high
    if outcome != FINISHED:
        return low, high, lowest, highest, outcome
    # A fine tolerance may move the maximum step height out of the bracket: then follow it.
    above = crossing.course.speed**2
    if low > 0.0:
        above, outcome = attempt(low, fine, crossing)
    if outcome == FINISHED and above > 0.0:
        low, high, above, below, outcome = climb(low, above, high - low, fine, crossing)
    elif outcome == FINISHED:
        low, high, above, below, outcome = descend(low, above, width, fine, crossing)
    if outcome == FINISHED:
        low, high, outcome = narrow(low, high, above, below, width, fine, crossing)
    return low, high, min(low, lowest), max(high, highest), outcome


@outlined
def find(accuracy: float, crossing: Crossing) -> Bracket:
    """
    Bracket the maximum step height to an accuracy [m], with tolerances as fine as required.

    Returns low, high, error and finest tolerance [m], and the outcome, see `search`; the error
    exceeds the accuracy if even the finest tolerances do not agree.
    """
    width = WIDTH * accuracy
    coarse, fine = COARSE * width, FINE * width
    robot, speed = crossing.system.parameters, crossing.course.speed
    # All energy is converted to height; a step higher than the centre is a wall.
    guess = min(speed * speed / (2.0 * robot.gravity), 0.5 * robot.radius)
    while True:
        low, high, lowest, highest, outcome = search(width, coarse, fine, guess, crossing)
        error = (high - low) + (highest - lowest)
        if outcome != FINISHED or error <= accuracy or fine <= FINEST:
            return low, high, error, fine, outcome
        coarse, fine = fine, max(REFINEMENT * fine, FINEST)
