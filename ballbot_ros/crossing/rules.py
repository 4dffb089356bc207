# SPDX-License-Identifier: Apache-2.0
"""
Tell whether the ball gets over a step, and how high a step it gets over: the reference method.

The words, which `max_step_height` shares:

*Collision speed* is the speed of the centre when the ball first touches the step.  It rolls
without slip then, and its pendulum turns only if the law of actuation makes it.

*Over* is a ball whose centre has passed the edge with the contact below it.  What it does
behind the edge does not count: on a slope up it may come back.

*Back* is a ball that has rolled 4 mm behind where it touched, and that ends its first attempt.
Where any attempt counts, it may come again as long as the time lasts.  A ball that is neither
over nor back when the time is up, such as one whose motor presses it against the step for
ever, has failed.
"""
from dataclasses import dataclass, replace
from functools import lru_cache
import math
from typing import Any, Optional

import numpy as np

from ballbot_ros.compiled import compiled
from ballbot_ros.config.fields import check_value, Checked, quantity, text
from ballbot_ros.crossing.attempt import BACK, Course, OVER, place, RETREAT, UNDECIDED
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.mechanics import contact, equations
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.contact_options import ContactOptions
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.physics.simulation.model import failure, Model, Solver
from ballbot_ros.physics.solvers import fixed_step

# Of the start before the touch, in programs that cannot start with the touch itself [m]; too
# short for a free ball to change its speed, and for a driven one to change it much.
LEAD = 0.002

STEEPEST = math.radians(80.0)


@dataclass(frozen=True)
class Site(Checked):
    """The ground around a step whose foot is the origin; without friction, the robot's own."""

    slope_before: float = quantity(
        'rad', 'slope of the ground before the step, positive uphill', default=0.0,
        minimum=-STEEPEST, maximum=STEEPEST)
    slope_behind: float = quantity(
        'rad', 'slope of the ground behind the step, positive uphill', default=0.0,
        minimum=-STEEPEST, maximum=STEEPEST)
    friction_before: Optional[float] = quantity(
        '1', 'coefficient of friction of the ground before the step', minimum=0.0,
        optional=True)
    friction_edge: Optional[float] = quantity(
        '1', 'coefficient of friction of the edge', minimum=0.0, optional=True)
    friction_behind: Optional[float] = quantity(
        '1', 'coefficient of friction of the ground behind the step', minimum=0.0,
        optional=True)

    def terrain(self, height: float) -> Terrain:
        """Return the ground with a step of some height [m]."""
        before, behind = self.slope_before, self.slope_behind
        floor, edge, upper = (math.nan if value is None else value for value in (
            self.friction_before, self.friction_edge, self.friction_behind))
        return Terrain(
            [[-math.cos(before), -math.sin(before)], [0.0, 0.0], [0.0, height],
             [math.cos(behind), height + math.sin(behind)]],
            [floor, math.nan, upper], [math.nan, math.nan, edge, math.nan])

    def profile(self, robot: Robot, height: float = 1.0) -> Array:
        """Return the ground as the kernels read it; read-only, for it is kept for others."""
        return _profile(self, height, robot.surface_friction, robot.edge_friction)


@lru_cache(maxsize=64)
def _profile(site: Site, height: float, surface_friction: float, edge_friction: float) -> Array:
    profile = site.terrain(height).profile(surface_friction, edge_friction)
    profile.setflags(write=False)
    return profile


@dataclass(frozen=True)
class Rules(Checked):
    """Where an attempt starts and ends, and which count; see the module."""

    attempts: str = text('attempts that count', default='first', choices=('first', 'any'))
    time_limit: float = quantity(
        's', 'time after which the ball has failed', default=5.0, above=0.0, maximum=3600.0)
    lead: float = quantity(
        'm', 'way that the ball rolls before it touches; it starts with the collision speed',
        default=0.0, minimum=0.0, maximum=10.0)

    def course(self, speed: float, pendulum_angle: float) -> Course:
        """Return the rules for one run, as the kernels read them."""
        return Course(speed, pendulum_angle, self.lead, float(self.attempts == 'first'),
                      self.time_limit)


# What the numbers of a crossing may be; also for those that are no field of anything.
SPEED = quantity('m/s', 'collision speed', above=0.0).metadata
HEIGHT = quantity('m', 'height of the step', above=0.0).metadata


def touch_distance(radius: float, height: float, penetration: float = 0.0) -> float:
    """
    Return how far before the face the centre is when the ball touches the step [m].

    Parameters
    ----------
    radius, height : float
        Of the ball and of the step [m]; the floor before it is level.
    penetration : float
        How deep the ball sits in the floor [m]; it meets the edge that much earlier.

    """
    below = min(max(height + penetration, 0.0), radius)
    return math.sqrt(2.0 * radius * below - below * below)


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
        See `fixed_step.advance`.

    """
    for done in range(steps):
        _, ending = fixed_step.advance(
            method, time + done * step, state, step, 1, robot, ground, drive, table, work)
        if ending != fixed_step.FINISHED:
            return done + 1, UNDECIDED, ending
        x = state[equations.X]
        if x > face_x and state[equations.Y] > upper_y:
            return done + 1, OVER, ending
        if x < back_x and state[equations.VELOCITY_X] < 0.0:
            return done + 1, BACK, ending
    return steps, UNDECIDED, fixed_step.FINISHED


def crosses(robot: Robot, speed: float, height: float, actuation: Actuation = Actuation(),
            pendulum_angle: float = 0.0, options: ContactOptions = ContactOptions(),
            solver: Solver = Solver(), site: Site = Site(), rules: Rules = Rules()) -> bool:
    """
    Tell whether the ball gets over a step.

    Parameters
    ----------
    robot : Robot
    speed : float
        Collision speed [m/s], above 0.
    height : float
        Of the step [m], above 0.
    actuation : Actuation
        Set when the attempt begins.
    pendulum_angle : float
        Absolute angle at the start [rad].
    options, solver
        See `Model`; steps of one length only.
    site, rules
        The ground, and what counts.

    Raises
    ------
    ConfigurationError
        If speed or height is not above 0, or the solver chooses its steps.
    SimulationError
        If the run cannot go on.

    """
    speed = check_value('speed', speed, SPEED, 'crossing')
    height = check_value('height', height, HEIGHT, 'crossing')
    if solver.method not in fixed_step.METHODS:
        raise ConfigurationError(
            'the reference search takes steps of one length: use rk4, or max_step_height, which '
            f'is adaptive; got {solver.method}')
    model = Model(robot, site.terrain(height), options, solver)
    vector = np.zeros(equations.SIZE)
    touch_x = place(vector, rules.course(speed, pendulum_angle), model.numbers, model.profile)
    back_x = touch_x - RETREAT if rules.attempts == 'first' else -math.inf
    done, verdict, ending = run_crossing(
        fixed_step.METHODS.index(solver.method), 0.0, vector, solver.step,
        int(rules.time_limit / solver.step), 0.0, height + 0.5 * robot.ball_radius, back_x,
        model.numbers, model.profile, actuation.drive(robot, 0.0, pendulum_angle),
        contact.contact_table(len(model.profile)), fixed_step.workspace())
    if ending != fixed_step.FINISHED:
        raise failure(ending, done * solver.step, vector, model)
    return bool(verdict == OVER)


def highest_step(robot: Robot, speed: float, actuation: Actuation = Actuation(),
                 pendulum_angle: float = 0.0, tolerance: float = 5e-5,
                 options: ContactOptions = ContactOptions(), solver: Solver = Solver(),
                 site: Site = Site(), rules: Rules = Rules()) -> float:
    """
    Return the highest step that the ball gets over at a collision speed [m].

    The paper's ascending bracketing: the height doubles until the ball fails, then the
    bracket is halved.  `max_step_height` gives the same answers, with an error, much faster.

    Parameters
    ----------
    tolerance : float
        Width of the last bracket [m]; its lower end, which is passed, is returned.
    robot, speed, actuation, pendulum_angle, options, solver, site, rules
        See `crosses`.

    """
    if not tolerance > 0.0:
        raise ConfigurationError(f'tolerance must be above 0 m, got {tolerance!r}')
    check_gravity(robot)

    def passes(height: float) -> bool:
        return crosses(robot, speed, height, actuation, pendulum_angle, options, solver, site,
                       rules)

    low, high = 0.0, max(tolerance, 0.25 * speed * speed / (2.0 * robot.gravity))
    while passes(high):
        low, high = high, 2.0 * high
        if high > 4.0 * robot.ball_radius:
            raise too_fast(robot, speed, low)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if passes(middle):
            low = middle
        else:
            high = middle
    return low


def check_gravity(robot: Robot) -> None:
    """Refuse a robot that no step can stop."""
    if robot.gravity == 0.0:
        raise ConfigurationError(
            f'robot {robot.name!r} has no gravity: there is no highest step')


def too_fast(robot: Robot, speed: float, passed: float) -> ConfigurationError:
    """Return the error of a speed [m/s] at which no step is too high, up to one passed [m]."""
    return ConfigurationError(
        f'no step up to {passed:g} m stops {robot.name!r} at {speed:g} m/s: this speed is '
        'outside what the search is made for')


def held_at(angle: float, actuation: Actuation = Actuation()) -> Actuation:
    """Return law (11) holding the pendulum at an absolute angle [rad]."""
    return replace(actuation, law='position', set_angle=angle)
