# SPDX-License-Identifier: Apache-2.0
"""What is allowed but was hardly meant: millimetres for metres, a pendulum over the top."""
import math
from typing import Iterator

from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.simulation.scene import Scene
from ballbot_ros.results.faces import rising_faces

FASTEST = 20.0  # that anybody means [m/s]
TOP, LEVEL = 180.0, 90.0  # of the pendulum [degrees]


def questions(scene: Scene) -> Iterator[str]:
    """Yield a sentence for each number of a scene that was hardly meant."""
    robot, start = scene.model.robot, scene.initial
    for face in rising_faces(scene.model.terrain, robot.ball_radius):
        yield from ask_height(robot, float(face[-1, 1] - face[0, 1]),
                              f'at x = {face[0, 0]:g} m')
    for name in ('speed', 'velocity_x', 'velocity_y'):
        yield from ask_speed(getattr(start, name) or 0.0, f'initial {name}')
    if abs(start.pendulum_angle_deg) > TOP:
        yield (f'initial pendulum_angle_deg is {start.pendulum_angle_deg:g}, over the top of the '
               f'ball: {math.remainder(start.pendulum_angle_deg, 360.0):g} is the same place')
    if scene.actuation.law == 'position':
        yield from ask_angle(math.degrees(scene.actuation.set_angle))


def ask_speed(speed: float, name: str) -> Iterator[str]:
    """Yield what is odd about a speed [m/s]."""
    if abs(speed) > FASTEST:
        yield (f'{name} is {speed:g} m/s, {3.6 * abs(speed):.0f} km/h: were other units meant?')


def ask_height(robot: Robot, height: float, where: str) -> Iterator[str]:
    """Yield what is odd about the height of a step [m]."""
    diameter = 2.0 * robot.ball_radius
    if height > diameter:
        yield (f'the step of {height:g} m {where} is higher than the ball ({diameter:g} m), which '
               'cannot get over it' + (
                   f': {height:g} mm are {1e-3 * height:g}' if height >= 1.0 else ''))


def ask_angle(degrees: float) -> Iterator[str]:
    """Yield what is odd about the angle that a pendulum is held at."""
    if abs(degrees) > LEVEL + 1e-9:
        yield (f'the pendulum is held at {degrees:g} degrees, above the middle of the ball, where '
               'more angle gives less torque: 90 is level')
