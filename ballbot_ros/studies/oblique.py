# SPDX-License-Identifier: Apache-2.0
"""Steps that the ball meets at an angle: maximum height and heading afterwards, in MuJoCo."""
import math
from typing import NamedTuple, Optional, Sequence

from ballbot_ros.crossing.attempt import RETREAT
from ballbot_ros.crossing.rules import is_over, touch_distance
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.steering import law
from ballbot_ros.studies.comparators import highest_passed
from ballbot_ros.studies.free_ball import FreeBall, FreeBallState

BLOCK = 0.02  # simulated between two checks of the result [s]
TIME_LIMIT = 5.0  # of an attempt [s]
TOLERANCE = 5e-5  # of heights [m]
SETTLING = 2.0  # time for the steering law after a crossing [s]


class ObliqueApproach(NamedTuple):
    """How the ball meets the step."""

    robot: Robot
    speed: float  # along the heading at the touch [m/s]
    angle: float = 0.0  # between heading and normal of the edge [rad]
    set_angle: Optional[float] = None  # that law (11) holds [rad]; None for a free pendulum


def cross(approach: ObliqueApproach, height: float) -> Optional[FreeBall]:
    """
    Return the ball as it gets over a step, None where it fails.

    Parameters
    ----------
    height : float
        Of the step [m].

    Raises
    ------
    ConfigurationError
        If MuJoCo is not installed.

    """
    robot = approach.robot
    begin = -touch_distance(robot.ball_radius, height, robot.static_penetration)
    ball = FreeBall(robot, approach.speed, approach.angle, height, begin, approach.set_angle)
    state = ball.state()
    while state.time < TIME_LIMIT:
        ball.advance(BLOCK)
        last, state = state, ball.state()
        if is_over(state.x, state.z, 0.0, height, robot.ball_radius):
            return ball
        if state.x < begin - RETREAT and state.x < last.x:
            return None
    return None


def maximum_height(approach: ObliqueApproach, tolerance: float = TOLERANCE) -> float:
    """Return the highest step that the ball gets over [m]; see `cross`."""
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


ANGLES = (0, 15, 30, 45)  # [deg]
SPEEDS = (0.5, 0.8, 1.1)  # [m/s]
SET_ANGLES = (None, 0.0, 0.5 * math.pi)  # free, down and level
SHARES = (0.5, 0.8, 0.97)  # of the maximum height, at which the course afterwards is measured


class ObliqueResult(NamedTuple):
    """What came of one approach at all angles."""

    speed: float  # [m/s]
    set_angle: Optional[float]  # [rad]
    heights: list[float]  # by angle [m]
    course_changes: list[list[float]]  # by angle and `SHARES` [rad]
    heading_changes: list[list[float]]


def measure(robot: Robot, speed: float, set_angle: Optional[float],
            tolerance: float = TOLERANCE, angles: Sequence[float] = ANGLES) -> ObliqueResult:
    """Return maximum heights, courses and headings of a robot at a speed, for angles [deg]."""
    heights, courses, headings = [], [], []
    for degrees in angles:
        approach = ObliqueApproach(robot, speed, math.radians(degrees), set_angle)
        heights.append(maximum_height(approach, tolerance))
        crossed = []
        for share in SHARES:
            after = cross(approach, share * heights[-1])
            assert after is not None  # a lower step is crossed
            crossed.append((course(after.state()) - approach.angle,
                            settle(after) - approach.angle))
        courses.append([pair[0] for pair in crossed])
        headings.append([pair[1] for pair in crossed])
    return ObliqueResult(speed, set_angle, heights, courses, headings)
