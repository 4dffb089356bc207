# SPDX-License-Identifier: Apache-2.0
"""Vary the mass of the ball on all cores, and read the crossing at one mass in detail."""
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

from ballbot_ros import load_robot, load_scene, max_step_height, Robot, Scene, Trajectory


def highest(robot: Robot) -> float:
    """Return the maximum step height at 0.6 m/s [m]."""
    return max_step_height(robot, speed=0.6).height


def crossing(scene: Scene, robot: Robot) -> Trajectory:
    """Run a scene with another robot."""
    return replace(scene, model=replace(scene.model, robot=robot)).simulate(accuracy=1e-5)


if __name__ == '__main__':
    robots = [load_robot('gimball').replace(ball_mass=mass) for mass in (3.4, 3.8, 4.2)]
    with ProcessPoolExecutor(2) as pool:
        for robot, height in zip(robots, pool.map(highest, robots)):
            print(f'{robot.ball_mass} kg: {1e3 * height:.2f} mm')
    run = crossing(load_scene('fig7_top'), robots[0])
    face = run.summary().faces[0]
    print(f'crossed: {run.crossed}, first contact at {face.touch_time:.3f} s')
    for name, column in run.items():
        print(f'{name:24}{abs(column).max():10.3g} {run.units[name]}')
