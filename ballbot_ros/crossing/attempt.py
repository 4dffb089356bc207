# SPDX-License-Identifier: Apache-2.0
"""
One attempt at a step, from the first touch to its verdict, in compiled code.

Only two vertices of the ground depend on the height of the step, so the ground and the start
are set up inside the kernel.  The adaptive method runs in blocks; after each the kernel looks
whether the ball is over or back.  See `crossing` for what these words mean.

Besides the verdict an attempt gives a *score*: the square of the speed with which the centre
of mass passes above the edge, or else minus the square of how far it stayed away, times the
square of the rate at which a ball falls off an edge.  Where the ball just gets over, the score
goes through zero, so that a search can aim instead of halving.  It decides nothing.
"""
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.compiled import compiled, unlocked
from ballbot_ros.physics.mechanics.contact import contact_table, spring_energy
from ballbot_ros.physics.mechanics.equations import (
    BALL_RATE, FREE, kinetic_energy, PENDULUM_ANGLE, potential_energy, SIZE, VELOCITY_X,
    VELOCITY_Y, X, Y)
from ballbot_ros.physics.mechanics.modes import mode_table
from ballbot_ros.physics.model.terrain import TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y
from ballbot_ros.physics.solvers.adaptive import advance_adaptive, NO_ROWS
from ballbot_ros.physics.solvers.embedded import ROWS
from ballbot_ros.physics.solvers.fixed_step import FINISHED

OVER, BACK, UNDECIDED = range(3)

# A ball that is this much farther from the step than where it touched has rolled back [m].
RETREAT = 0.004
# Simulated between two looks at the ball [s]; a doubtful block is run again in halves.
BLOCK = 0.04
SHORTEST_BLOCK = 1e-6
LEAST = 1e-12  # size of a score: none is 0 [m2/s2]
# Vertices of the ground of a step: its foot and its edge, and an end each way.
VERTICES, EDGE_VERTEX, END_VERTEX = 4, 2, 3


class Course(NamedTuple):
    """What a crossing is, apart from robot, motor, height and ground; for the kernels."""

    speed: float  # of the centre at first touch [m/s]
    pendulum_angle: float  # absolute, at the start [rad]
    lead: float  # of the start before the touch, along the ground [m]
    first: float  # 1 where the first attempt counts, 0 for any within the time
    time_limit: float  # [s]


class Room(NamedTuple):
    """
    The arrays that attempts work in; one set for each thread.

    ``spent`` counts attempts and right-hand sides, ``last`` holds the height of the last
    attempt [m] and when it ended [s].
    """

    ground: Any
    spent: Any
    last: Any
    state: Any
    before: Any
    table: Any
    work: Any
    probe: Any
    mode: Any
    broken: Any
    rows: Any
    tally: Any

    @classmethod
    def of(cls, profile: NDArray[np.float64]) -> 'Room':
        """Return the room for steps in a ground, whose height is changed there."""
        return cls(profile.copy(), np.zeros(2, dtype=np.int64), np.zeros(2), np.zeros(SIZE),
                   np.zeros(SIZE), contact_table(VERTICES), np.zeros((ROWS, SIZE)),
                   np.zeros(SIZE), mode_table(VERTICES),
                   np.zeros((2, 4 * VERTICES + 8), dtype=np.int64), NO_ROWS,
                   np.zeros(5, dtype=np.int64))


@compiled
def set_height(ground: Any, height: float) -> None:
    """Move the edge of the step, and the end of the ground behind it, to a height [m]."""
    slope = ground[EDGE_VERTEX, TANGENT_Y] / ground[EDGE_VERTEX, TANGENT_X]
    ground[EDGE_VERTEX, VERTEX_Y] = height
    ground[END_VERTEX, VERTEX_Y] = height + slope * (
        ground[END_VERTEX, VERTEX_X] - ground[EDGE_VERTEX, VERTEX_X])


@compiled
def place(state: Any, course: Any, robot: Any, ground: Any) -> float:
    """
    Put the ball where its attempt begins, rolling without slip, and return its x at touch.

    The foot of the step is the origin; its edge is the vertex EDGE_VERTEX.
    """
    cosine, sine = ground[0, TANGENT_X], ground[0, TANGENT_Y]
    height = ground[EDGE_VERTEX, VERTEX_Y]
    # A ball that rolls along a slope is pressed into it by that part of its weight.
    penetration = min(robot.mass * robot.gravity * cosine / robot.stiffness,
                      0.5 * robot.radius)
    distance = robot.radius - penetration
    # Along the ground before the step: where the ball would touch an endless wall.
    along = (distance * sine - robot.radius) / cosine
    if along * sine + distance * cosine > height:
        rise = distance - height * cosine
        along = height * sine - math.sqrt(max(robot.radius**2 - rise * rise, 0.0))
    begin = along - course.lead
    for i in range(SIZE):
        state[i] = 0.0
    state[X] = begin * cosine - distance * sine
    state[Y] = begin * sine + distance * cosine
    state[PENDULUM_ANGLE] = course.pendulum_angle
    state[VELOCITY_X] = course.speed * cosine
    state[VELOCITY_Y] = course.speed * sine
    lever = robot.radius if robot.radius_lever > 0.0 else distance
    state[BALL_RATE] = -course.speed / lever
    return along * cosine - distance * sine


@compiled
def energy_to_spare(state: Any, robot: Any, ground: Any, table: Any) -> float:
    """
    Return the energy of the ball beyond the least that it has above the edge [J].

    The least is that of a ball at rest on the edge with its pendulum hanging down.
    """
    weight = robot.mass * robot.gravity
    least = (weight * (ground[EDGE_VERTEX, VERTEX_Y] + robot.radius
                       - 0.5 * weight / robot.stiffness)
             - robot.pendulum_moment * robot.gravity)
    return (kinetic_energy(state, robot) + potential_energy(state, robot)
            + spring_energy(robot, ground, table, state[X], state[Y]) - least)


@compiled
def peak(x: float, speed: float, later_x: float, later_speed: float, duration: float) -> float:
    """Return the greatest x on the cubic through two positions with their speeds [m]."""
    greatest = max(x, later_x)
    # x + s t + b t^2 + c t^3 with t from 0 to 1
    start, end = speed * duration, later_speed * duration
    way = later_x - x
    square, cube = 3.0 * way - 2.0 * start - end, start + end - 2.0 * way
    root = square * square - 3.0 * cube * start
    if root > 0.0:
        # The larger of both zeros in size first: no difference of nearly equal numbers.
        larger = -(square + math.copysign(math.sqrt(root), square))
        for part in (start / larger if larger != 0.0 else 0.0,
                     larger / (3.0 * cube) if cube != 0.0 else 0.0):
            if 0.0 < part < 1.0:
                greatest = max(greatest, x + part * (start + part * (square + part * cube)))
    return greatest


@compiled
def weight_ahead(state: Any, robot: Any) -> float:
    """Return how far the centre of mass is ahead of the edge [m]."""
    return state[X] + robot.pendulum_moment / robot.mass * math.sin(state[PENDULUM_ANGLE])


@compiled
def speed_between(before: Any, after: Any, part: float) -> float:
    """Return the speed towards +x at a part of the way between two states [m/s]."""
    return before[VELOCITY_X] + part * (after[VELOCITY_X] - before[VELOCITY_X])


@compiled
def run_to_verdict(height: float, tolerance: float, course: Any, robot: Any, drive: Any,
                   room: Any, budget: int) -> tuple:
    """Return verdict, score, the time at which it was given [s], and ending; see `attempt`."""
    ground, state, before = room.ground, room.state, room.before
    set_height(ground, height)
    touch_x = place(state, course, robot, ground)
    falling = robot.gravity * robot.radius / (
        robot.radius**2 + robot.ball_inertia / robot.mass)
    # Energy only goes where no motor gives any; an edge below the centre only takes it, unless
    # friction works with the printed lever.
    dwindling = drive.law == FREE and height < robot.radius and robot.radius_lever == 0.0
    doubt = 10.0 * tolerance * robot.mass * robot.gravity
    time = step = 0.0
    nearest, passed = -math.inf, 0.0
    block = BLOCK
    while time < course.time_limit:
        for i in range(SIZE):
            before[i] = state[i]
        reached, next_step, _, ending = advance_adaptive(
            time, state, min(time + block, course.time_limit), tolerance, step, robot, ground,
            drive, room.table, room.work, room.probe, room.mode, room.broken[0],
            room.broken[1], room.rows, 1.0, room.tally, budget)
        if ending != FINISHED:
            return UNDECIDED, 0.0, reached, ending
        top = peak(before[X], before[VELOCITY_X], state[X], state[VELOCITY_X], reached - time)
        turned = before[VELOCITY_X] > 0.0 > state[VELOCITY_X]
        if (turned and state[X] <= 0.0 and block > SHORTEST_BLOCK
                and top > -0.1 * robot.gravity * block * block):
            # It may have been above the edge within the block: look closer.
            block *= 0.5
            for i in range(SIZE):
                state[i] = before[i]
            continue
        time, step, block = reached, next_step, BLOCK
        early, late = weight_ahead(before, robot), weight_ahead(state, robot)
        nearest = max(nearest, late)
        if early < 0.0 <= late:
            passed = speed_between(before, state, early / (early - late))
        if top > 0.0 and state[Y] > height + 0.5 * robot.radius:
            if passed == 0.0:
                passed = speed_between(before, state, 1.0)
            return OVER, max(passed * passed, LEAST), time, ending
        if state[VELOCITY_X] < 0.0:
            back = course.first > 0.0 and state[X] < touch_x - RETREAT
            if back or (dwindling and energy_to_spare(
                    state, robot, ground, room.table) < -doubt):
                return BACK, min(-falling * nearest**2, -LEAST), time, ending
    return UNDECIDED, min(-falling * nearest**2, -LEAST), time, FINISHED


@unlocked
def attempt(height: float, tolerance: float, course: Any, robot: Any, drive: Any, room: Any,
            budget: int) -> tuple:
    """
    Run one attempt at a step.

    Parameters
    ----------
    height : float
        Of the step [m].
    tolerance : float
        Local error per step of the adaptive method [m].
    course : Course
    robot : Numbers
    drive : Drive
    room : Room
        Its ground is that of the step, of any height.
    budget : int
        Of right-hand sides, see `advance_adaptive`.

    Returns
    -------
    verdict : int
        OVER, BACK or UNDECIDED (the time is up).
    score : float
        Above 0 for OVER, below for others [m2/s2]; see the module.
    ending : int
        See `advance_adaptive`.

    """
    room.tally[:] = 0
    verdict, score, time, ending = run_to_verdict(
        height, tolerance, course, robot, drive, room, budget)
    room.spent[0] += 1
    room.spent[1] += room.tally[3]
    room.last[0], room.last[1] = height, time
    return verdict, score, ending
