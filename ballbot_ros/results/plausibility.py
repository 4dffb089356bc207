# SPDX-License-Identifier: Apache-2.0
"""Plausibility checks of a scene: millimetres for metres, a pendulum above the top."""
import math
from typing import Iterator

from ballbot_ros.physics.model.plausibility import implausible
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.results.faces import rising_faces

SPEED_MAX = 20.0  # plausible [m/s]
TOP, LEVEL = 180.0, 90.0  # of the pendulum [degrees]


def scene_warnings(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each implausible value of a scene or its robot."""
    robot, start = scene.model.robot, scene.initial
    yield from implausible(robot)
    for face in rising_faces(scene.model.terrain, robot.ball_radius):
        yield from height_warnings(robot, float(face[-1, 1] - face[0, 1]),
                              f'at x = {face[0, 0]:g} m')
    for name in ('speed', 'velocity_x', 'velocity_y'):
        yield from speed_warnings(getattr(start, name) or 0.0, f'initial {name}')
    if abs(start.pendulum_angle_deg) > TOP:
        yield (f'initial pendulum_angle_deg is {start.pendulum_angle_deg:g}, above the top of '
               f'the ball: {math.remainder(start.pendulum_angle_deg, 360.0):g} is the same angle')
    if scene.actuation.law == 'position':
        yield from angle_warnings(math.degrees(scene.actuation.set_angle))


def speed_warnings(speed: float, name: str) -> Iterator[str]:
    """Yield a warning about an implausible speed [m/s]."""
    if abs(speed) > SPEED_MAX:
        yield (f'{name} is {speed:g} m/s, {3.6 * abs(speed):.0f} km/h: check the unit')


def height_warnings(robot: Robot, height: float, where: str) -> Iterator[str]:
    """Yield a warning about a step [m] that no ball of this size can cross."""
    diameter = 2.0 * robot.ball_radius
    if height > diameter:
        yield (f'the step of {height:g} m {where} is higher than the ball ({diameter:g} m), which '
               'cannot get over it' + (
                   f': {height:g} mm are {1e-3 * height:g}' if height >= 1.0 else ''))


def angle_warnings(degrees: float) -> Iterator[str]:
    """Yield a warning about a set angle of the pendulum above the horizontal."""
    if abs(degrees) > LEVEL + 1e-9:
        yield (f'the pendulum is held at {degrees:g} degrees, above the horizontal, where a '
               'larger angle gives less torque: 90 is horizontal')
