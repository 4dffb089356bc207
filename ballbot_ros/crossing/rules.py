# SPDX-License-Identifier: Apache-2.0
"""
The crossing of a step: its terrain, its initial state, and its success criterion.

*Collision speed* is the speed of the centre when the ball first touches the step.  At that time
it rolls without slip, and its pendulum rotates only if the actuation requires it.

*Over*: the contact is below the ball and, by the rule `edge`, the centre has passed the edge.
Later motion does not count, so on an upward slope the ball may roll back.  By the rule `clear`
the centre moves farther, by default a quarter of the radius, before it returns to its start.
The curves of the paper use `edge`, decisions use `clear`.

*Back*: the ball has rolled 4 mm back from the point of first contact, which ends the first
attempt.  Where any attempt counts, it may try again until the time limit.  A ball that is neither
over nor back at the time limit has failed, for example one that its motor continues to press
against the step.
"""
from dataclasses import dataclass, replace
import math
from typing import Any, Callable, Optional, Sequence

import numpy as np

from ballbot_ros.config.fields import Checked, quantity, text
from ballbot_ros.crossing.attempt import Course, VERTICES
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.jit import in_python
from ballbot_ros.physics.mechanics.contact import touching_at
from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array, friction_coefficient

SLOPE_MAX = math.radians(80.0)

# Distance of the centre beyond the edge from which a ball is clear of it, over the radius.
CLEARANCE = 0.25


def table(values: Sequence[Any], number: int) -> Array:
    """Return values, some of which may be columns, as a table with a row for each case."""
    rows = np.empty((number, len(values)))
    for column, value in enumerate(values):
        rows[:, column] = value
    return rows


@dataclass(frozen=True)
class Site(Checked):
    """The ground around a step with its foot at the origin; default frictions: the robot's."""

    slope_before: float = quantity(
        'rad', 'slope of the ground before the step, positive uphill', default=0.0,
        minimum=-SLOPE_MAX, maximum=SLOPE_MAX)
    slope_behind: float = quantity(
        'rad', 'slope of the ground behind the step, positive uphill', default=0.0,
        minimum=-SLOPE_MAX, maximum=SLOPE_MAX)
    friction_before: Optional[float] = friction_coefficient(
        'coefficient of friction of the ground before the step', optional=True)
    friction_edge: Optional[float] = friction_coefficient(
        'coefficient of friction of the edge', optional=True)
    friction_behind: Optional[float] = friction_coefficient(
        'coefficient of friction of the ground behind the step', optional=True)

    def grounds(self, robot: Robot, number: int) -> Array:
        """
        Return terrain profiles for the kernels, (number, 4, 7); see `Terrain.profile`.

        The step is 1 m high; an attempt sets its height.  The values of site and robot may be
        columns.
        """
        ahead_x, ahead_y = _each(math.cos, self.slope_before), _each(math.sin, self.slope_before)
        behind_x, behind_y = _each(math.cos, self.slope_behind), _each(math.sin, self.slope_behind)
        surface, edge = robot.surface_friction, robot.edge_friction
        floor, corner, upper = (own if given is None else given for own, given in (
            (surface, self.friction_before), (edge, self.friction_edge),
            (surface, self.friction_behind)))
        # A metre of ground, the foot, the edge one metre above it, and a metre of ground.
        numbers = (
            -ahead_x, -ahead_y, ahead_x, ahead_y, 0.0, floor, edge,
            0.0, 0.0, 0.0, 1.0, ahead_x, surface, edge,
            0.0, 1.0, behind_x, behind_y, -behind_x, upper, corner,
            behind_x, 1.0 + behind_y, 0.0, 0.0, 0.0, 0.0, edge)
        return table(numbers, number).reshape(number, VERTICES, 7)


def _each(function: Callable[[float], float], values: Any) -> Any:
    """Apply a function to a number, or to each in a column: numpy's may round differently."""
    if isinstance(values, np.ndarray):
        return np.array([function(value) for value in values.tolist()])
    return function(values)


@dataclass(frozen=True)
class Rules(Checked):
    """Start and end of an attempt, and which attempts count; see the module."""

    attempts: str = text('attempts that count', default='first', choices=('first', 'any'))
    time_limit: float = quantity(
        's', 'time after which the ball has failed', default=5.0, above=0.0, maximum=3600.0)
    lead: float = quantity(
        'm', 'distance that the ball rolls before it touches; it starts at the collision speed',
        default=0.0, minimum=0.0, maximum=10.0)
    over: str = text(
        'where the ball is over: its centre past the edge, or clear of it', default='edge',
        choices=('edge', 'clear'))
    clearance: float = quantity(
        '1', 'distance of the centre beyond the edge by the rule clear, over the radius',
        default=CLEARANCE, above=0.0, maximum=4.0)

    def course(self, speed: float, pendulum_angle: float) -> Course:
        """Return the rules for one run, in the format of the kernels."""
        return Course(speed, pendulum_angle, self.lead, float(self.attempts == 'first'),
                      self.time_limit, self.beyond)

    @property
    def beyond(self) -> float:
        """Return the required distance of the centre beyond the edge, over the radius."""
        return self.clearance if self.over == 'clear' else 0.0


# Ranges of the parameters of a crossing, including those that are not fields of a class.
SPEED = quantity('m/s', 'collision speed', above=0.0).metadata
HEIGHT = quantity('m', 'height of the step', above=0.0).metadata


def sink_depth(radius: float, width: float) -> float:
    """Return how far a ball can sink into a gap between two edges of equal height [m]."""
    return radius - math.sqrt(max(radius**2 - 0.25 * width**2, 0.0))


def touch_distance(radius: float, height: float, penetration: float = 0.0,
                   slope: float = 0.0) -> float:
    """
    Return the distance of the centre before the face when the ball touches the step [m].

    The ball rolls with a `penetration` of the ground [m]; the slope of the ground before the step
    is positive uphill [rad].
    """
    distance, cosine, sine = radius - penetration, math.cos(slope), math.sin(slope)
    return distance * sine - cosine * in_python(touching_at)(
        radius, distance, max(height, 0.0), cosine, sine)


def is_over(x: Any, y: Any, edge_x: float, edge_y: float, radius: float) -> Any:
    """
    Return whether the centre of a ball is past an edge, with the contact below it.

    All in m; `x` and `y`, the centre, may be arrays.
    """
    return (x > edge_x) & (y > edge_y + 0.5 * radius)


def check_gravity(robot: Robot) -> None:
    """Refuse a robot without gravity, which no step can stop."""
    if robot.gravity == 0.0:
        raise ConfigurationError(
            f'robot {robot.name!r} has no gravity: there is no maximum step height',
            'out_of_range', 'gravity')


def held_at(angle: float, actuation: Actuation = Actuation()) -> Actuation:
    """
    Return law (11) holding the pendulum at an absolute angle [rad].

    Raises `ConfigurationError` beyond half a turn, which suggests an angle in degrees.
    """
    return replace(actuation, law='position', set_angle=angle)
