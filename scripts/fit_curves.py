# SPDX-License-Identifier: Apache-2.0
"""
Re-simulate the height curves in config/curves and fit the cubic of the paper's section 8.

    .venv/bin/python scripts/fit_curves.py            # write the files
    .venv/bin/python scripts/fit_curves.py --check    # fail if they are not what comes out

Each curve is the highest step crossed at the first attempt, bracketed to 0.02 mm at 21 speeds
from 0.2 to 1.2 m/s, and the least-squares cubic through those points.
"""
import argparse
import math
from pathlib import Path
import sys

import numpy as np
import yaml

from ballbot_ros.physics import Actuation, held_at, highest_step, load_robot

FOLDER = Path(__file__).resolve().parent.parent / 'config' / 'curves'
SPEEDS = np.linspace(0.2, 1.2, 21)
TOLERANCE = 2e-5
DRIFT = 2e-5  # heights may differ by this between machines [m]

HEADER = """\
# How high a step {what}, as a cubic of the speed at
# touch: height = a0 + a1 v + a2 v^2 + a3 v^3, in m and m/s.  Valid between the two speeds
# only: outside, the cubic means nothing and may even come down again.
#
# Written by scripts/fit_curves.py: re-simulated, the paper prints its cubic in a figure only.
"""

CURVES = {
    'gimball_down': ('GimBall crosses with its pendulum held down', 'gimball',
                     'pendulum held down by law (11), set angle 0', held_at(0.0), 0.0),
    'gimball_free': ('GimBall crosses with a free pendulum', 'gimball',
                     'pendulum free, motor detached', Actuation(), 0.0),
    'gimball_horizontal': (
        'GimBall crosses with its pendulum held level', 'gimball',
        'pendulum held level ahead by law (11), set angle 90 degrees', held_at(math.pi / 2),
        math.pi / 2),
    'shellball_free': ('ShellBall, which has no pendulum, crosses', 'shellball',
                       'none, there is no pendulum', Actuation(), 0.0),
}


def fit(name):
    """Return the content of a curve file."""
    what, robot, text, actuation, angle = CURVES[name]
    heights = []
    for speed in SPEEDS:
        heights.append(highest_step(load_robot(robot), speed, actuation, angle, TOLERANCE))
        if sys.stderr.isatty():
            print(f'\r{name}: {len(heights)} of {len(SPEEDS)} speeds', end='', file=sys.stderr)
    cubic = np.polynomial.Polynomial.fit(SPEEDS, heights, 3).convert()
    residual = float(np.max(np.abs(cubic(SPEEDS) - heights)))
    print(f'\r{name}: {len(heights)} speeds, largest residual {1e3 * residual:.2f} mm',
          file=sys.stderr)
    return HEADER.format(what=what) + yaml.safe_dump({
        'name': name, 'robot': robot, 'actuation': text,
        'source': f're-simulated, eqs. (4) to (13); {len(SPEEDS)} points',
        'lowest_speed': float(SPEEDS[0]), 'highest_speed': float(SPEEDS[-1]),
        'coefficients': [round(float(number), 6) for number in cubic.coef],
        'residual': round(residual + 5e-6, 5)}, sort_keys=False, default_flow_style=None)


def differs(old, new):
    """Tell whether two files give heights that differ by more than rounding."""
    curves = [np.polynomial.Polynomial(yaml.safe_load(text)['coefficients'])(SPEEDS)
              for text in (old, new)]
    return bool(np.max(np.abs(curves[0] - curves[1])) > DRIFT)


def main():
    """Write or check all curves."""
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
        sys.exit(f'not what the simulation gives: {", ".join(changed)}')


if __name__ == '__main__':
    main()
