# SPDX-License-Identifier: Apache-2.0
"""Warnings about the results of a run."""
import math
from typing import Iterator, Optional

import numpy as np

from ballbot_ros.physics.model.robot import (
    angle_warnings, height_warnings, implausible, speed_warnings)
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.physics.simulation.solver import METHODS
from ballbot_ros.physics.simulation.trajectory import Trajectory
from ballbot_ros.results.faces import rising_faces

# Relative energy balance error above which a smaller step is needed.
RESIDUAL_MAX = 1e-5

TOP_DEG = 180.0  # pendulum angle above the centre of the ball

# Part of the time in contact with full sliding above which the ball never rolled.
SLIDING_MAX = 0.9

# Penetration, as part of the radius, above which a shell is not a stiff spring.
PENETRATION_MAX = 0.1


def find_warnings(trajectory: Trajectory, expected: int, residual: Optional[float], depth: float,
                  sliding: float) -> Iterator[str]:
    """
    Yield one sentence for each result that needs attention.

    A complete run has the `expected` samples.  `residual` is the energy balance error relative to
    the reference energy, `depth` the largest penetration [m], `sliding` the part of the time in
    contact with full sliding.
    """
    model, assured = trajectory.model, trajectory.assurance
    robot, solver = model.robot, model.solver_in_use
    if trajectory.scene is not None:
        yield from scene_warnings(trajectory.scene)
    finer = (f'a smaller step than {solver.step:g} s' if METHODS[solver.method].fixed
             else f'a smaller tolerance than {solver.tolerance:g} m')
    if assured is not None:
        finer = 'a smaller accuracy'
        if not assured.complete:
            yield (f'the motion is chaotic: the accuracy of {assured.accuracy:g} m holds up to '
                   f'{assured.horizon:.4g} s, and no tolerance takes it further')
    if len(trajectory) < expected:
        yield (f'the run ended early: {len(trajectory)} of {expected} samples, up to '
               f'{trajectory["time"][-1]:g} s')
    if not np.isfinite(trajectory.rows).all():
        yield f'some numbers are not finite; use {finer}'
    elif residual is not None and not residual <= RESIDUAL_MAX:
        yield (f'the energy balance error is {residual:.1e} relative to the reference energy '
               f'(good: at most {RESIDUAL_MAX:.0e}); use {finer}')
    if depth > PENETRATION_MAX * robot.ball_radius:
        yield (f'the ball sank {1e3 * depth:.3g} mm into the ground, more than '
               f'{PENETRATION_MAX:.0%} of its radius; contact_stiffness is too low for this '
               'impact')
    if sliding > SLIDING_MAX:
        yield (f'the ball slid for {sliding:.0%} of its time in contact, so it never '
               'rolled; start it without slip (initial: speed), drive it less or raise '
               'surface_friction')
    still = np.ptp(trajectory.rows[:, 1:9], axis=0).max() < 1e-6
    if still and len(trajectory) > 1:
        yield 'nothing moved: give the scene an initial speed (initial) or an actuation'


def scene_warnings(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each implausible value of a scene or its robot."""
    robot, start = scene.model.robot, scene.initial
    yield from implausible(robot)
    for face in rising_faces(scene.model.terrain, robot.ball_radius):
        yield from height_warnings(robot, float(face[-1, 1] - face[0, 1]),
                                   f'at x = {face[0, 0]:g} m')
    for name in ('speed', 'velocity_x', 'velocity_y'):
        yield from speed_warnings(getattr(start, name) or 0.0, f'initial {name}')
    if abs(start.pendulum_angle_deg) > TOP_DEG:
        yield (f'initial pendulum_angle_deg is {start.pendulum_angle_deg:g}, above the top of '
               f'the ball: {math.remainder(start.pendulum_angle_deg, 360.0):g} is the same angle')
    if scene.actuation.law == 'position':
        yield from angle_warnings(math.degrees(scene.actuation.set_angle))
