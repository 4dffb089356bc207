# SPDX-License-Identifier: Apache-2.0
"""
Compute the maximum step height by speed and actuation of the pendulum.

    python examples/maximum_step_height.py
"""
import math

from ballbot_ros.crossing import held_at, max_step_height
from ballbot_ros.physics import Actuation, load_robot

SPEEDS = (0.4, 0.8, 1.2)
ACTUATIONS = {
    'hangs freely': Actuation(),
    'held down': held_at(0.0),
    'held level': held_at(math.pi / 2),
}


def main() -> None:
    """Print a table of heights."""
    robot = load_robot('gimball')
    print(f'Maximum step height of {robot.name} (radius {1e3 * robot.ball_radius:.0f} mm), '
          'in mm:\n')
    print(f'{"pendulum":14}' + ''.join(f'{speed:>8} m/s' for speed in SPEEDS))
    for name, actuation in ACTUATIONS.items():
        found = [max_step_height(robot, speed, actuation) for speed in SPEEDS]
        print(f'{name:14}' + ''.join(f'{1e3 * one.height:12.1f}' for one in found))
    print(f'\nEach to {1e6 * found[0].error:.0f} micrometres; the last took '
          f'{found[-1].attempts} simulated attempts.')


if __name__ == '__main__':
    main()
