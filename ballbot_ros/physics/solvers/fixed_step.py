# SPDX-License-Identifier: Apache-2.0
"""
Fixed-step integrators of the equations of motion.

``rk4``
    The classical Runge-Kutta scheme: order 4 between the kinks of the contact law,
    order 1 through them.
``semi_implicit``
    Semi-implicit Euler, the choice of game engines: order 1, one evaluation per step,
    keeps the energy of an undamped spring within a bound.
"""
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.physics.mechanics.contact import first_segment
from ballbot_ros.physics.mechanics.equations import (
    COORDINATES, derivative, drive_torque, is_finite, SIZE, X, Y)
from ballbot_ros.physics.model.terrain import TANGENT_X, TANGENT_Y, VERTEX_X, VERTEX_Y

METHODS = ('semi_implicit', 'rk4')
SEMI_IMPLICIT, RK4 = range(2)
ORDER = {'semi_implicit': 1, 'rk4': 4}

# How a run can end.
FINISHED, NOT_FINITE, SUNK = range(3)


@compiled
def ground_height(ground: Any, x: float) -> float:
    """Return the height of the ground at `x` [m]."""
    segment = first_segment(ground, x)
    slope = ground[segment, TANGENT_Y] / ground[segment, TANGENT_X]
    return ground[segment, VERTEX_Y] + slope * (x - ground[segment, VERTEX_X])


@compiled
def rk4_step(time: float, state: Any, step: float, robot: Any, ground: Any, drive: Any,
             table: Any, work: Any) -> None:
    """Advance `state` in place by one step of the classical Runge-Kutta scheme."""
    k1, k2, k3, k4, probe = work[0], work[1], work[2], work[3], work[4]
    derivative(time, state, robot, ground, drive, table, k1)
    for i in range(SIZE):
        probe[i] = state[i] + 0.5 * step * k1[i]
    derivative(time + 0.5 * step, probe, robot, ground, drive, table, k2)
    for i in range(SIZE):
        probe[i] = state[i] + 0.5 * step * k2[i]
    derivative(time + 0.5 * step, probe, robot, ground, drive, table, k3)
    for i in range(SIZE):
        probe[i] = state[i] + step * k3[i]
    derivative(time + step, probe, robot, ground, drive, table, k4)
    for i in range(SIZE):
        state[i] += step / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])


@compiled
def semi_implicit_step(time: float, state: Any, step: float, robot: Any, ground: Any,
                       drive: Any, table: Any, work: Any) -> None:
    """Advance `state` in place by one step of semi-implicit Euler."""
    rates = work[0]
    derivative(time, state, robot, ground, drive, table, rates)
    for i in range(COORDINATES, SIZE):
        state[i] += step * rates[i]
    # The coordinates follow with the new velocities; this is what keeps springs bounded.
    for i in range(COORDINATES):
        state[i] += step * state[COORDINATES + i]


@compiled
def advance(method: int, time: float, state: Any, step: float, steps: int, robot: Any,
            ground: Any, drive: Any, table: Any, work: Any) -> tuple:
    """
    Advance `state` in place by a number of equal steps.

    Returns
    -------
    done : int
        Steps taken; fewer than asked for when the run cannot go on.
    ending : int
        FINISHED, NOT_FINITE or SUNK (the centre of the ball is under the ground).

    """
    for done in range(steps):
        now = time + done * step
        if method == RK4:
            rk4_step(now, state, step, robot, ground, drive, table, work)
        else:
            semi_implicit_step(now, state, step, robot, ground, drive, table, work)
        if not is_finite(state):
            return done + 1, NOT_FINITE
        if state[Y] <= ground_height(ground, state[X]):
            return done + 1, SUNK
    return steps, FINISHED


@compiled
def record_run(method: int, time: float, state: Any, step: float, every: int, robot: Any,
               ground: Any, drive: Any, table: Any, work: Any, rows: Any) -> tuple:
    """
    Advance `state` in place and fill `rows`, one every `every` steps.

    Each row holds the time, the state and the torque of the motor, after its steps.

    Returns
    -------
    filled : int
        Rows filled; fewer than there are when the run cannot go on.
    ending : int
        See `advance`.

    """
    for row in range(len(rows)):
        begin = time + row * every * step
        _, ending = advance(
            method, begin, state, step, every, robot, ground, drive, table, work)
        if ending != FINISHED:
            return row, ending
        rows[row, 0] = begin + every * step
        for i in range(SIZE):
            rows[row, 1 + i] = state[i]
        rows[row, 1 + SIZE] = drive_torque(rows[row, 0], state, drive)
    return len(rows), FINISHED


def workspace() -> Any:
    """Return the scratch array that the integrators need."""
    return np.zeros((5, SIZE))
