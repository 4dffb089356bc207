# SPDX-License-Identifier: Apache-2.0
"""
Re-simulate the height curves in config/curves and fit the cubic of the paper's section 8.

    .venv/bin/python scripts/fit_curves.py            # write the files
    .venv/bin/python scripts/fit_curves.py --check    # fail if they differ from the simulation

Each curve is the maximum step height of a first attempt, to 0.002 mm, at 21 speeds from 0.2 to
1.2 m/s; `ballbot fit-curve` makes one for any robot.
"""
import argparse
import math
from pathlib import Path
import sys

import numpy as np
import yaml

from ballbot_ros.crossing import held_at
from ballbot_ros.physics import Actuation, load_robot
from ballbot_ros.studies.curve_fit import curve_text, fit_curve, heights_for, Request

FOLDER = Path(__file__).resolve().parent.parent / 'config' / 'curves'
SPEEDS = np.linspace(0.2, 1.2, 21)
# Tolerance of heights between machines [m]; the conservative cubic passes through few of the
# heights, and these may differ between machines.
DRIFT = {'coefficients': 2e-5, 'conservative': 5e-5}

CURVES = {
    'gimball_down': ('GimBall with its pendulum held down', 'gimball',
                     'pendulum held down by law (11), set angle 0', held_at(0.0)),
    'gimball_free': ('GimBall with a free pendulum', 'gimball',
                     'pendulum free, motor detached', Actuation()),
    'gimball_horizontal': (
        'GimBall with its pendulum held level', 'gimball',
        'pendulum held level ahead by law (11), set angle 90 degrees', held_at(math.pi / 2)),
    'shellball_free': ('ShellBall, which has no pendulum', 'shellball',
                       'none, there is no pendulum', Actuation()),
}


def fit(name):
    """Return the content of a curve file."""
    title, robot_name, wording, actuation = CURVES[name]
    robot = load_robot(robot_name)
    total = heights_for(robot, Request())

    def show(done):
        if sys.stderr.isatty():
            print(f'\r{name}: {done} of {total} heights', end='', file=sys.stderr)
    curve = fit_curve(name, robot, actuation, wording, progress=show)
    print(f'\r{name}: {total} heights, largest residual {1e3 * curve.residual:.2f} mm',
          file=sys.stderr)
    return curve_text(curve, title, 'scripts/fit_curves.py: re-simulated, the paper prints its '
                      'cubic in a figure only')


def differs(old, new):
    """Return whether two files give heights that differ by more than rounding."""
    contents = [yaml.safe_load(text) for text in (old, new)]
    if contents[0].get('made') != contents[1].get('made'):
        return True
    return any(
        np.max(np.abs(np.subtract(*(np.polynomial.Polynomial(content[key])(SPEEDS)
                                    for content in contents)))) > drift
        for key, drift in DRIFT.items())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--check', action='store_true', help='write nothing, fail if different')
    check = parser.parse_args().check
    changed = []
    for name in CURVES:
        path, content = FOLDER / f'{name}.yaml', fit(name)
        if check and differs(path.read_text(), content):
            changed.append(name)
        elif not check:
            path.write_text(content)
    if changed:
        sys.exit(f'different from the simulation: {", ".join(changed)}')


if __name__ == '__main__':
    main()
