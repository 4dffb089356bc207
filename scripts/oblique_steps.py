# SPDX-License-Identifier: Apache-2.0
"""
Measure steps at an angle in MuJoCo, and write config/oblique: about a minute.

    .venv/bin/python scripts/oblique_steps.py
"""
import math
from pathlib import Path
import sys
from typing import NamedTuple, Optional, Sequence

import numpy as np
import yaml

from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import is_over, touch_distance
from ballbot_ros.physics import load_robot, Robot
from ballbot_ros.steering import law
from ballbot_ros.studies.comparators import highest_passed
from ballbot_ros.studies.free_ball import FreeBall, FreeBallState

FOLDER = Path(__file__).resolve().parent.parent / 'config' / 'oblique'
HEADER = """\
# Steps at an angle to the path of GimBall: maximum height relative to that at right angles to the
# edge, and changes of course and heading away from the normal of the edge.  The course is the
# direction of travel behind the edge; the heading is that after the steering law has damped the
# motion.
#
# Lowest and highest of {count} cases: speeds of {speeds} m/s, each with the pendulum free, held
# down and held level.  The ranges are those of the cases, with the parameters of the robot file.
#
# Written by scripts/oblique_steps.py: a free ball in MuJoCo with the contact of eqs. (7) to (9).
"""

BLOCK = 0.02  # simulated between two checks of the result [s]
ATTEMPT_TIME_MAX = 5.0  # of an attempt [s]
HEIGHT_TOLERANCE = 5e-5  # of heights [m]
SETTLING = 2.0  # duration of the steering law after a crossing [s]
ANGLES = (0, 15, 30, 45)  # [deg]
SPEEDS = (0.5, 0.8, 1.1)  # [m/s]
SET_ANGLES = (None, 0.0, 0.5 * math.pi)  # free, down and horizontal
HEIGHT_FRACTIONS = (0.5, 0.8, 0.97)  # of the maximum height, for the course changes


class ObliqueApproach(NamedTuple):
    """State of the ball at its first contact with the step."""

    robot: Robot
    speed: float  # along the heading at the touch [m/s]
    angle: float = 0.0  # between heading and normal of the edge [rad]
    set_angle: Optional[float] = None  # held by law (11) [rad]; None for a free pendulum


def cross(approach: ObliqueApproach, height: float) -> Optional[FreeBall]:
    """
    Return the ball after it has crossed a step of a height [m], None if it fails.

    Raises `ConfigurationError` if MuJoCo is not installed.
    """
    robot = approach.robot
    begin = -touch_distance(robot.ball_radius, height, robot.static_penetration)
    ball = FreeBall(robot, approach.speed, approach.angle, height, begin, approach.set_angle)
    state = ball.state()
    while state.time < ATTEMPT_TIME_MAX:
        ball.advance(BLOCK)
        last, state = state, ball.state()
        if is_over(state.x, state.z, 0.0, height, robot.ball_radius):
            return ball
        if state.x < begin - RETREAT and state.x < last.x:
            return None
    return None


def maximum_height(approach: ObliqueApproach, tolerance: float = HEIGHT_TOLERANCE) -> float:
    """Return the maximum step height [m]; see `cross`."""
    return highest_passed(lambda height: cross(approach, height) is not None, approach.robot,
                          approach.speed, tolerance)


def settle(ball: FreeBall) -> float:
    """Return the heading after the steering law has damped the motion of a crossing [rad]."""
    if ball.set_angle is not None:
        ball.set_angle = 0.0
    for _ in range(round(SETTLING / BLOCK)):
        state = ball.state()
        ball.lean_command = law(ball.robot, state.lateral, state.speed, 0.0)
        ball.advance(BLOCK)
    return ball.state().lateral.heading


def course(ball: FreeBallState) -> float:
    """Return the direction of travel, 0 at right angles to the edge [rad]."""
    return ball.lateral.heading + math.atan2(ball.lateral_speed, ball.speed)


class ObliqueResult(NamedTuple):
    """Results of one speed and set angle at all approach angles."""

    speed: float  # [m/s]
    set_angle: Optional[float]  # [rad]
    heights: list[float]  # by angle [m]
    course_changes: list[list[float]]  # by angle and `HEIGHT_FRACTIONS` [rad]
    heading_changes: list[list[float]]


def measure(robot: Robot, speed: float, set_angle: Optional[float],
            tolerance: float = HEIGHT_TOLERANCE, angles: Sequence[float] = ANGLES
            ) -> ObliqueResult:
    """Return maximum heights, courses and headings of a robot at a speed, for angles [deg]."""
    heights, courses, headings = [], [], []
    for degrees in angles:
        approach = ObliqueApproach(robot, speed, math.radians(degrees), set_angle)
        heights.append(maximum_height(approach, tolerance))
        crossed = []
        for share in HEIGHT_FRACTIONS:
            after = cross(approach, share * heights[-1])
            assert after is not None  # below the maximum height
            crossed.append((course(after.state()) - approach.angle,
                            settle(after) - approach.angle))
        courses.append([pair[0] for pair in crossed])
        headings.append([pair[1] for pair in crossed])
    return ObliqueResult(speed, set_angle, heights, courses, headings)


def main():
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
        'highest_factor': rounded(factors.max(axis=0), 3), 'height_shares': list(HEIGHT_FRACTIONS),
        'lowest_course_change_deg': rounded(courses.min(axis=0), 1),
        'highest_course_change_deg': rounded(courses.max(axis=0), 1),
        'lowest_heading_change_deg': rounded(headings.min(axis=0), 1),
        'highest_heading_change_deg': rounded(headings.max(axis=0), 1)}
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f'{robot.name}.yaml').write_text(
        HEADER.format(count=len(found), speeds=', '.join(f'{speed:g}' for speed in SPEEDS))
        + yaml.safe_dump(table, sort_keys=False, default_flow_style=None))


def rounded(values, digits):
    """Return rounded numbers without negative zero."""
    return (np.round(values, digits) + 0.0).tolist()


if __name__ == '__main__':
    main()
