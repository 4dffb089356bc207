# SPDX-License-Identifier: Apache-2.0
"""
Measure steps at an angle in MuJoCo, and write config/oblique: about a minute.

    .venv/bin/python scripts/oblique_steps.py
"""
from pathlib import Path
import sys

import numpy as np
import yaml

from ballbot_ros.physics import load_robot
from ballbot_ros.studies.oblique import ANGLES, measure, SET_ANGLES, SHARES, SPEEDS

FOLDER = Path(__file__).resolve().parent.parent / 'config' / 'oblique'
HEADER = """\
# Steps that GimBall meets at an angle: maximum height over that at right angles to the edge, and
# by how much course and heading turn away from the normal of the edge: the course, which is the
# direction of travel, behind the edge; the heading after the steering law has damped the motion.
#
# Lowest and highest of {count} cases: speeds of {speeds} m/s, each with the pendulum free, held
# down and held level.  The ranges are those of the cases, with the numbers of the robot file.
#
# Written by scripts/oblique_steps.py: a free ball in MuJoCo with the contact of eqs. (7) to (9).
"""


def main():
    """Write the table of GimBall."""
    robot = load_robot('gimball')
    found = []
    for speed in SPEEDS:
        for set_angle in SET_ANGLES:
            found.append(measure(robot, speed, set_angle))
            print(f'{len(found)} of {len(SPEEDS) * len(SET_ANGLES)}', file=sys.stderr)
    heights = np.array([item.heights for item in found])
    factors = heights / heights[:, :1]
    courses = np.degrees([item.course_changes for item in found])
    headings = np.degrees([item.heading_changes for item in found])
    table = {
        'robot': robot.name, 'source': 'derived', 'angles_deg': list(ANGLES),
        'lowest_factor': rounded(factors.min(axis=0), 3),
        'highest_factor': rounded(factors.max(axis=0), 3), 'height_shares': list(SHARES),
        'lowest_course_change_deg': rounded(courses.min(axis=0), 1),
        'highest_course_change_deg': rounded(courses.max(axis=0), 1),
        'lowest_heading_change_deg': rounded(headings.min(axis=0), 1),
        'highest_heading_change_deg': rounded(headings.max(axis=0), 1)}
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f'{robot.name}.yaml').write_text(
        HEADER.format(count=len(found), speeds=', '.join(f'{speed:g}' for speed in SPEEDS))
        + yaml.safe_dump(table, sort_keys=False, default_flow_style=None))


def rounded(values, digits):
    """Return numbers for a file; no negative zero."""
    return (np.round(values, digits) + 0.0).tolist()


if __name__ == '__main__':
    main()
