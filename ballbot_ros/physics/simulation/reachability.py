# SPDX-License-Identifier: Apache-2.0
"""
What a run can meet, known before it, from bounds: how far the ball gets and what may happen.

Energy bounds the speed, speed and time bound the distance, and so does ground that is too high.
Each answer errs on the side of "possible": what is said to be impossible does not happen.
"""
from dataclasses import dataclass
import math
from typing import Optional

import numpy as np

from ballbot_ros.physics.model.actuation import Actuation
from ballbot_ros.physics.model.parameters import Actuator, FREE, TORQUE, VELOCITY, VOLTAGE
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import (
    Array, SURFACE_FRICTION, TANGENT_X, TANGENT_Y, TURN, VERTEX_X, VERTEX_Y)
from ballbot_ros.physics.simulation.model import Model
from ballbot_ros.physics.solvers.flight import has_closed_form

STRAIGHT = 1e-9  # sine of a turn that is none
ROUNDS = 200     # of energy, speed and distance bounding each other
QUIET = 1.05     # at a penetration that differs by no more from that at rest contact stays


@dataclass(frozen=True)
class Analysis:
    """
    What a run can meet at most.

    Attributes
    ----------
    energy : float
        Kinetic energy, at most [J]; infinite where nothing bounds it.
    speed : float
        Of the centre, at most [m/s].
    leftmost, rightmost : float
        Of the centre [m].
    segments, edges, corners : int
        Parts of the ground within reach: flat pieces, convex and concave vertices.
    several_contacts, sliding, flight : bool
        Whether that is possible.
    closed_form : bool
        Whether a flight has one: the motor's law is linear.
    pendulum : float or None
        How far the pendulum may move the centre from where it would be without [m], at most;
        None for a robot that has none.

    """

    energy: float
    speed: float
    leftmost: float
    rightmost: float
    segments: int
    edges: int
    corners: int
    several_contacts: bool
    sliding: bool
    flight: bool
    closed_form: bool
    pendulum: Optional[float]


def analyse(model: Model, start: State, actuation: Actuation, duration: float) -> Analysis:
    """
    Return what a run can meet, without simulating it.

    Parameters
    ----------
    model, start, actuation, duration
        See `simulate`.

    """
    actuator = actuation.actuator(model.robot, start.time, start.joint_angle)
    profile = model.profile
    energy, speed, left, right = _reach(model, start, actuator, duration)
    radius = model.robot.ball_radius
    inner = np.flatnonzero((profile[1:-1, VERTEX_X] >= left - radius)
                           & (profile[1:-1, VERTEX_X] <= right + radius)) + 1
    turns = profile[inner, TURN]
    edges, corners = int(np.sum(turns < -STRAIGHT)), int(np.sum(turns > STRAIGHT))
    # Of the segments those that begin before the end and end behind the beginning.
    begins = np.concatenate([[-np.inf], profile[1:-1, VERTEX_X]])
    ends = np.concatenate([profile[1:-1, VERTEX_X], [np.inf]])
    segments = np.flatnonzero((begins <= right + radius) & (ends >= left - radius))
    lonely = len(segments) == 1 and math.isfinite(energy) and _at_rest(model, start)
    segment = profile[segments[0]]
    return Analysis(
        energy, speed, left, right, len(segments), edges, corners, corners > 0,
        not (lonely and _grip(model, actuator, energy, speed, segment) > 0.0),
        not (lonely and _pressed(model, actuator, energy, segment) > 0.0),
        bool(has_closed_form(model.parameters, actuator)),
        _influence(model, actuator, energy, duration, lonely))


def _reach(model: Model, start: State, actuator: Actuator,
           duration: float) -> tuple[float, float, float, float]:
    """
    Return bounds of kinetic energy, speed, and of x to the left and to the right.

    Above ground of height h the centre has a potential and contact energy of at least
    M g (h + R) - (M g)^2 / (2 k), that of a ball at rest.
    """
    robot, parameters = model.robot, model.parameters
    energies = model.energies(start)
    # The pendulum may come to hang down.
    own = (energies.kinetic
           + robot.largest_gravity_torque * (1.0 - math.cos(start.pendulum_angle)))
    height = start.y - robot.ball_radius
    if robot.weight > 0.0:
        height += energies.contact / robot.weight + 0.5 * robot.static_penetration
    else:
        own += energies.contact
    mass = parameters.mass
    if robot.has_pendulum:
        mass -= parameters.pendulum_moment**2 / parameters.pendulum_inertia
    speed, corners = math.sqrt(2.0 * own / mass), model.profile[:, VERTEX_X]
    for _ in range(ROUNDS):
        left, right = start.x - speed * duration, start.x + speed * duration
        if not math.isfinite(right - left):
            break
        places = [*corners[(corners > left) & (corners < right)], left, right, start.x]
        fall = max(0.0, height - float(np.min(model.terrain.height(places))))
        energy = own + robot.weight * fall
        work = _work(model, actuator, energy, duration)
        faster = math.sqrt(2.0 * (energy + work) / mass)
        if faster <= speed * (1.0 + 1e-9):
            if robot.weight > 0.0:
                left, right = _walls(
                    model, start.x, left, right, height + (own + work) / robot.weight)
            return energy + work, speed, left, right
        speed = faster
    return math.inf, math.inf, -math.inf, math.inf


def _walls(model: Model, x: float, left: float, right: float,
           top: float) -> tuple[float, float]:
    """Return the bounds of x where ground that is higher than `top` [m] is in between."""
    for corner in model.profile:
        if corner[VERTEX_Y] > top:
            if x < corner[VERTEX_X] < right:
                right = float(corner[VERTEX_X])
            elif left < corner[VERTEX_X] < x:
                left = float(corner[VERTEX_X])
    return left, right


def _torque(model: Model, actuator: Actuator, energy: float) -> float:
    """Return the largest torque of the motor at a kinetic energy [N m]."""
    if actuator.law == FREE:
        return 0.0
    if actuator.law == TORQUE:
        return min(abs(actuator.set_value), actuator.limit)
    joint = _joint_rate(model, energy)
    if actuator.law == VOLTAGE:
        return min(actuator.limit,
                   actuator.kp * (abs(actuator.set_value) + actuator.kd_or_ki * joint))
    return actuator.limit


def _joint_rate(model: Model, energy: float) -> float:
    """Return the largest rate of the joint at a kinetic energy [rad/s]."""
    parameters = model.parameters
    if parameters.swing_inertia <= 0.0:
        return math.sqrt(2.0 * energy / parameters.ball_inertia)
    return math.sqrt(
        2.0 * energy * (1.0 / parameters.ball_inertia + 1.0 / parameters.swing_inertia))


def _work(model: Model, actuator: Actuator, energy: float, duration: float) -> float:
    """Return what the motor can add to an energy within a time, at most [J]."""
    if actuator.law == FREE:
        return 0.0
    if actuator.law == VOLTAGE and actuator.kd_or_ki > 0.0:
        # k (V - b j) j is largest at j = V / (2 b).
        return duration * actuator.kp * actuator.set_value**2 / (4.0 * actuator.kd_or_ki)
    if actuator.law == VELOCITY and actuator.kp > 0.0 and actuator.kd_or_ki == 0.0:
        return duration * (actuator.kp * abs(actuator.set_value) + actuator.gravity_torque)**2 / (
            4.0 * actuator.kp)
    # E' <= torque * joint rate <= torque * c sqrt(E), so sqrt(E) grows by torque * c * t / 2.
    torque = _torque(model, actuator, energy)
    root = math.sqrt(energy) + 0.5 * torque * _joint_rate(model, 1.0) * duration
    return root * root - energy


def _at_rest(model: Model, start: State) -> bool:
    """Return whether the start lies on its ground, rolling, without ringing."""
    touches = model.touches(start)
    if len(touches) != 1:
        return False
    touch, robot = touches[0], model.robot
    rest = robot.static_penetration * touch.normal_y
    rise = start.velocity_x * touch.normal_x + start.velocity_y * touch.normal_y
    away = math.hypot(touch.penetration - rest, rise * math.sqrt(
        robot.total_mass / robot.contact_stiffness))
    return (away <= (QUIET - 1.0) * rest
            and abs(touch.slip_velocity) < 0.5 * robot.slip_threshold)


def _swinging(model: Model, energy: float) -> float:
    """Return the largest force by which a swinging pendulum may lift the ball [N]."""
    parameters = model.parameters
    if parameters.swing_inertia <= 0.0:
        return 0.0
    # m (phi'^2 + phi''), with phi'' from its weight and its joint.
    rate = math.sqrt(2.0 * energy / parameters.swing_inertia)
    joint = parameters.joint_friction * _joint_rate(model, energy)
    turning = (parameters.pendulum_moment * parameters.gravity + joint) / parameters.swing_inertia
    return parameters.pendulum_moment * (rate * rate + turning)


def _pressed(model: Model, actuator: Actuator, energy: float, segment: Array) -> float:
    """Return the least force between the ball and one segment of the ground [N]."""
    parameters = model.parameters
    lift = _swinging(model, energy)
    if parameters.swing_inertia > 0.0:
        lift += (parameters.pendulum_moment * _torque(model, actuator, energy)
                 / parameters.swing_inertia)
    return float(parameters.mass * parameters.gravity * segment[TANGENT_X] / QUIET - lift)


def _grip(model: Model, actuator: Actuator, energy: float, speed: float,
          segment: Array) -> float:
    """Return the friction that is there beyond what rolling can ask for, at least [N]."""
    parameters, radius = model.parameters, model.parameters.radius
    torque = (_torque(model, actuator, energy)
              + parameters.joint_friction * _joint_rate(model, energy)
              + parameters.rolling_friction * speed / radius)
    share = parameters.ball_inertia / (parameters.ball_inertia + parameters.mass * radius * radius)
    asked = (torque / radius + _swinging(model, energy)
             + share * parameters.mass * parameters.gravity * abs(segment[TANGENT_Y]))
    return float(segment[SURFACE_FRICTION] * _pressed(model, actuator, energy, segment) - asked)


def _influence(model: Model, actuator: Actuator, energy: float, duration: float,
               lonely: bool) -> Optional[float]:
    """
    Return how far the pendulum may move the centre, at most [m].

    Rolling on one straight piece of ground, K of `rolling` changes by the torque of the joint
    alone.  So the pendulum shifts the centre by its own displacement, 2 m / M at most, and by
    what that torque does in the time.  Elsewhere it may decide over an obstacle: no bound.
    """
    parameters = model.parameters
    if parameters.swing_inertia <= 0.0:
        return None
    if not lonely:
        return math.inf
    torque = (_torque(model, actuator, energy)
              + parameters.joint_friction * _joint_rate(model, energy))
    inertia = parameters.ball_inertia + parameters.mass * parameters.radius**2
    return float(2.0 * parameters.pendulum_moment / parameters.mass
                 + 0.5 * torque * parameters.radius / inertia * duration**2)
