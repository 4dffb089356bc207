# SPDX-License-Identifier: Apache-2.0
"""
Tell whether the ball gets over a step, and how high a step it gets over.

The ball starts a hair before it touches the step, rolling without slip at the given speed:
the *collision speed* is the speed of the centre at first touch.  It is *over* once its
centre has passed the edge with the contact below it, and has *failed* once it rolls back
past its start.  The first attempt counts.
"""
from dataclasses import replace
import math
from typing import Any

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import contact, dynamics, integrators
from ballbot_ros.physics.actuation import Actuation
from ballbot_ros.physics.model import failure, Model, Solver
from ballbot_ros.physics.options import ContactOptions
from ballbot_ros.physics.robot import Robot
from ballbot_ros.physics.terrain import Terrain

# The ball starts this far before the touch [m]; too short for a driven ball to speed up.
LEAD = 0.002


def touch_distance(radius: float, height: float, penetration: float = 0.0) -> float:
    """
    Return how far before the face the centre is when the ball touches the step [m].

    Parameters
    ----------
    radius, height : float
        Of the ball and of the step [m].
    penetration : float
        How deep the ball sits in the floor [m]; it meets the edge that much earlier.

    """
    below = min(max(height + penetration, 0.0), radius)
    return math.sqrt(2.0 * radius * below - below * below)


OVER, BACK, UNDECIDED = range(3)


@compiled
def run_crossing(method: int, time: float, state: Any, step: float, steps: int, face_x: float,
                 upper_y: float, back_x: float, robot: Any, ground: Any, drive: Any, table: Any,
                 work: Any) -> tuple:
    """
    Advance `state` in place until the ball is over the step, or back, or time is up.

    Returns
    -------
    done : int
        Steps taken.
    verdict : int
        OVER, BACK or UNDECIDED.
    ending : int
        See `integrators.advance`.

    """
    for done in range(steps):
        _, ending = integrators.advance(
            method, time + done * step, state, step, 1, robot, ground, drive, table, work)
        if ending != integrators.FINISHED:
            return done + 1, UNDECIDED, ending
        x = state[dynamics.X]
        if x > face_x and state[dynamics.Y] > upper_y:
            return done + 1, OVER, ending
        if x < back_x and state[dynamics.VELOCITY_X] < 0.0:
            return done + 1, BACK, ending
    return steps, UNDECIDED, integrators.FINISHED


def crosses(robot: Robot, speed: float, height: float, actuation: Actuation = Actuation(),
            pendulum_angle: float = 0.0, options: ContactOptions = ContactOptions(),
            solver: Solver = Solver(), time_limit: float = 5.0) -> bool:
    """
    Tell whether the ball gets over a step at the first attempt.

    Parameters
    ----------
    robot : Robot
    speed : float
        Collision speed [m/s], above 0.
    height : float
        Of the step [m], above 0.
    actuation : Actuation
    pendulum_angle : float
        Absolute angle at the start [rad].
    options, solver
        See `Model`.
    time_limit : float
        After which a ball that is neither over nor back has failed [s].

    Raises
    ------
    ConfigurationError
        If speed or height is not above 0.
    SimulationError
        If the run cannot go on.

    """
    for name, value in (('speed', speed), ('height', height)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ConfigurationError(f'{name} must be above 0 and finite, got {value!r}')
    model = Model(robot, Terrain.step(height), options, solver)
    begin = -LEAD - touch_distance(robot.ball_radius, height, robot.static_penetration)
    start = model.at_rest(begin, speed, pendulum_angle)
    if solver.method == 'adaptive':
        raise ConfigurationError(
            'the search for the highest step takes steps of one length so far: use rk4')
    vector = np.array(start[1:])
    done, verdict, ending = run_crossing(
        integrators.METHODS.index(solver.method), 0.0, vector, solver.step,
        int(time_limit / solver.step), 0.0, height + 0.5 * robot.ball_radius, begin - LEAD,
        model.numbers, model.profile, actuation.drive(robot, 0.0, start.joint_angle),
        contact.contact_table(len(model.profile)), integrators.workspace())
    if ending != integrators.FINISHED:
        raise failure(ending, done * solver.step, vector, model)
    return bool(verdict == OVER)


def highest_step(robot: Robot, speed: float, actuation: Actuation = Actuation(),
                 pendulum_angle: float = 0.0, tolerance: float = 5e-5,
                 options: ContactOptions = ContactOptions(),
                 solver: Solver = Solver()) -> float:
    """
    Return the highest step that the ball gets over at a collision speed [m].

    The paper's ascending bracketing: the height doubles until the ball fails, then the
    bracket is halved.

    Parameters
    ----------
    tolerance : float
        Width of the last bracket [m]; its lower end, which is passed, is returned.
    robot, speed, actuation, pendulum_angle, options, solver
        See `crosses`.

    """
    if not tolerance > 0.0:
        raise ConfigurationError(f'tolerance must be above 0 m, got {tolerance!r}')
    if robot.gravity == 0.0:
        raise ConfigurationError(
            f'robot {robot.name!r} has no gravity: there is no highest step')

    def passes(height: float) -> bool:
        return crosses(robot, speed, height, actuation, pendulum_angle, options, solver)

    low, high = 0.0, max(tolerance, 0.25 * speed * speed / (2.0 * robot.gravity))
    while passes(high):
        low, high = high, 2.0 * high
        if high > 4.0 * robot.ball_radius:
            raise ConfigurationError(
                f'no step up to {low:g} m stops {robot.name!r} at {speed:g} m/s: this speed is '
                'outside what the search is made for')
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if passes(middle):
            low = middle
        else:
            high = middle
    return low


def held_at(angle: float, actuation: Actuation = Actuation()) -> Actuation:
    """Return law (11) holding the pendulum at an absolute angle [rad]."""
    return replace(actuation, law='position', set_angle=angle)
