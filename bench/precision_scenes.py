# SPDX-License-Identifier: Apache-2.0
"""The scenes of the work-precision benchmark: each is hard for solvers in a different way."""
from dataclasses import replace
import math
from typing import NamedTuple

from ballbot_ros.crossing import held_at
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.physics import Actuation, load_robot, load_scene, Model, Solver, Terrain
from ballbot_ros.physics.model.state import State
from ballbot_ros.physics.model.terrain import read_terrain

# Lead of the start before the touch [m]; too short for a free ball to change its speed.
START_LEAD = 0.002

# Constant, so that the scene does not depend on the search [m].
NEAR_CRITICAL = 0.01983297


class Case(NamedTuple):
    """A run whose end position is compared."""

    name: str
    model: Model
    start: State
    actuation: Actuation
    duration: float  # [s]


def shipped(name):
    """Return a scene that the package ships."""
    scene = load_scene(name)
    return Case(name, scene.model, scene.start, scene.actuation, scene.run.duration)


def _collision(name, robot, speed, height, actuation=Actuation(), angle=0.0, duration=1.0):
    """Return a ball that starts just before it touches a step."""
    model = Model(robot, Terrain.step(height))
    x = -START_LEAD - touch_distance(robot.ball_radius, height, robot.static_penetration)
    return Case(name, model, model.at_rest(x, speed, angle), actuation, duration)


def near_critical():
    """Return the crossing of a step 0.2 mm below the maximum height, at 0.6 m/s."""
    return _collision('near_critical', load_robot('gimball'), 0.6, NEAR_CRITICAL)


def cases():
    """Return all scenes."""
    gimball, shellball = load_robot('gimball'), load_robot('shellball')
    flat = Model(gimball, Terrain.flat())
    threshold = Model(gimball, read_terrain(
        [{'flat': {'length': 0.6}}, {'threshold': {'height': 0.01, 'width': 0.06,
                                                   'bevel': 0.015}},
         {'flat': {'length': 1.0}}], 'threshold'))
    cliff = Model(gimball, Terrain.step(-0.05, at=0.3))
    # The damping scales with the root of the stiffness, which keeps the height of bounces.
    stiff = replace(gimball, contact_stiffness=100.0 * gimball.contact_stiffness,
                    contact_damping=10.0 * gimball.contact_damping)
    return [
        shipped('fig7_top'), shipped('fig7_middle'), shipped('fig7_bottom'),
        near_critical(),
        _collision('crossing_25_mm', gimball, 0.8, 0.025),
        _collision('shellball_step', shellball, 1.2, 0.03),
        shipped('shellball_drop'),
        Case('sliding_to_rolling', flat, flat.at_rest(0.0)._replace(velocity_x=1.0),
             Actuation(), 1.5),
        Case('threshold', threshold, threshold.at_rest(0.3, 0.8), Actuation(), 1.5),
        Case('cliff', cliff, cliff.at_rest(0.0, 0.8), Actuation(), 1.0),
        Case('roll_60_s', flat, flat.at_rest(0.0, 1.0), Actuation(), 60.0),
        _collision('stiff_x100', stiff, 0.8, 0.02),
        _collision('pd_held', gimball, 0.8, 0.031, held_at(math.pi / 2), math.pi / 2),
    ]


def with_solver(model, method, step=1e-4, tolerance=1e-9, models='full'):
    """Return a model with another solver."""
    return replace(model, solver=Solver(method, step, tolerance, models))
