# SPDX-License-Identifier: Apache-2.0
"""
Simulate a ball that rolls over a step, print a summary, and draw the run.

    python examples/simulate_and_plot.py [FOLDER]
"""
from pathlib import Path
import sys

from ballbot_ros.figures.run import save, strip, time_series
from ballbot_ros.physics import load_scene
from ballbot_ros.results import report


def main() -> None:
    """Write crossing.png and time_series.png into a folder, here by default."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else '.')
    scene = load_scene('fig7_top')
    trajectory = scene.simulate()
    print(report(trajectory.summary()))

    # A trajectory is a table: columns by name, one row for each 1 ms.
    highest = trajectory['y'].argmax()
    print(f'\nThe centre is highest at t = {trajectory["time"][highest]:.2f} s: '
          f'{trajectory["y"][highest]:.3f} m above the floor.')

    save(strip(trajectory, scene.name), folder / 'crossing.png')
    save(time_series(trajectory, scene.name), folder / 'time_series.png')
    print(f'See crossing.png and time_series.png in {folder.resolve().name}/.')


if __name__ == '__main__':
    main()
