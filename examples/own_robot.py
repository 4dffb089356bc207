# SPDX-License-Identifier: Apache-2.0
"""
Describe a custom robot and a scene in two files, and simulate the scene.

    python examples/own_robot.py
"""
from pathlib import Path
from tempfile import TemporaryDirectory

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import load_scene

ROBOT = """
name: marble
ball_mass: 0.9                # kg
ball_inertia: 0.0035          # kg m2
ball_radius: 0.08             # m
pendulum_mass: 0.5
pendulum_inertia: 0.0004
pendulum_length: 0.03
rolling_friction: 0.001       # N m s/rad
joint_friction: 0.01
contact_stiffness: 20000.0    # N/m
contact_damping: 20.0         # N s/m
surface_friction: {value: 0.5, unit: '1', source: assumed, range: [0.3, 0.7]}
edge_friction: 0.3
slip_threshold: 0.01          # m/s
gravity: 9.81                 # m/s2
"""
SCENE = """
robot: marble.yaml
terrain:
  - flat: {length: 0.5}
  - step: {height: 0.006}
  - slope: {length: 1.0, angle_deg: 3}
initial: {x: 0.2, speed: 0.5}
actuation: {law: torque, torque: 0.06}
duration: 2.0
"""


def main() -> None:
    """Simulate the robot, then print the error of a misspelt key."""
    with TemporaryDirectory() as folder:
        robot, scene = Path(folder, 'marble.yaml'), Path(folder, 'ramp.yaml')
        robot.write_text(ROBOT)
        scene.write_text(SCENE)
        trajectory = load_scene(str(scene)).simulate()
        print(f'The ball starts at x = {trajectory["x"][0]:.2f} m and ends at '
              f'{trajectory["x"][-1]:.2f} m, {1e3 * trajectory["y"][-1]:.0f} mm high.')

        robot.write_text(ROBOT.replace('ball_radius', 'ball_radios'))
        try:
            load_scene(str(scene))
        except ConfigurationError as error:
            print(f'With a misspelt key:\n{error}')


if __name__ == '__main__':
    main()
