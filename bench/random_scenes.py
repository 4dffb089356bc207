# SPDX-License-Identifier: Apache-2.0
"""Random scenes that together use every feature, as a function of a seed."""
from dataclasses import fields, replace
import math

import numpy as np

from ballbot_ros.physics import Actuation, ContactOptions, load_robot, Model, Solver, State
from ballbot_ros.physics.model.actuation import LAWS
from ballbot_ros.physics.model.terrain import read_terrain

DURATION = 1.5


def random_scene(seed):
    """Return a model, a start and an actuation."""
    draw = np.random.default_rng([2014, seed])
    robot = load_robot(str(draw.choice(['gimball', 'shellball'])))
    # Numbers within a factor of two of the published ones; masses that share a pendulum stay.
    robot = replace(robot, **{
        item.name: getattr(robot, item.name) * 2.0**draw.uniform(-1, 1)
        for item in fields(robot)
        if item.metadata.get('unit') in ('N/m', 'N s/m', 'N m s/rad', '1')})
    options = ContactOptions(
        pulling=bool(draw.random() < 0.2), friction_ramp=str(draw.choice(['linear', 'smooth'])),
        slip_lever=str(draw.choice(['contact', 'radius'])))
    model = Model(robot, _terrain(draw), options, Solver('adaptive'))
    return model, _start(draw, model), _actuation(draw, robot)


def _terrain(draw):
    pieces = [{'flat': {'length': 0.5}}]
    for _ in range(draw.integers(1, 4)):
        kind = draw.choice(['step', 'slope', 'threshold', 'cord', 'carpet'])
        pieces.append({str(kind): {
            'step': {'height': float(draw.uniform(-0.05, 0.05)) or 0.01},
            'slope': {'length': 0.5, 'angle_deg': float(draw.uniform(-8, 8))},
            'threshold': {'height': float(draw.uniform(0.003, 0.03)), 'width': 0.08,
                          'bevel': float(draw.uniform(0, 0.03))},
            'cord': {'diameter': float(draw.uniform(0.004, 0.012))},
            'carpet': {'thickness': float(draw.uniform(0.002, 0.01)), 'length': 0.4},
        }[str(kind)]})
        pieces.append({'flat': {'length': float(draw.uniform(0.1, 0.5))}})
    return read_terrain(pieces, 'random terrain')


def _start(draw, model):
    angle = draw.uniform(-2, 2) if model.robot.has_pendulum else 0.0
    start = model.at_rest(draw.uniform(0.0, 0.3), draw.uniform(0.2, 1.5), angle)
    if draw.random() < 0.3:  # falling, with spin
        start = State(x=start.x, y=start.y + draw.uniform(0.0, 0.2), pendulum_angle=angle,
                      velocity_x=start.velocity_x, ball_rate=draw.uniform(-15, 15))
    return start


def _actuation(draw, robot):
    if not robot.has_pendulum:
        return Actuation()
    return Actuation(
        law=str(draw.choice(LAWS)), set_angle=draw.uniform(-math.pi / 2, math.pi / 2),
        set_rate=draw.uniform(0, 6), voltage=draw.uniform(0, 10), torque=draw.uniform(-1, 1),
        velocity_ki=float(draw.choice([0.0, 5.0])),
        torque_limit=float(draw.choice([1.0, 4.0, 1e9])))
