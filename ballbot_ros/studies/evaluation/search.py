# SPDX-License-Identifier: Apache-2.0
"""
What a robot could have crossed: ways over an obstacle, tried one by one with the full model.

A *way* is a run-up from rest to a speed, and a swing of the pendulum some time before the touch.
The decision does not know which robot it has; this search does.
"""
import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from ballbot_ros.control.periods import Script, TOUCH_PERIOD, TOUCH_SPEED
from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.physics.model.uncertainty import draw
from ballbot_ros.studies.evaluation.approaches import Approach, balanced_angle
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop, true_faces

FASTEST = 1.15         # touch [m/s]
GAIN, LEAN = 4.0, 1.2  # of the run-up [rad s/m], [rad]
CHUNK, LONGEST = 50, 8.0  # control periods between two looks, [s]
ROBOTS, MOST = 24, 23
KNOTS = (0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.8)  # run-ups [m]
LOWEST, HIGHEST, FINE = 0.006, 0.09, 0.0005  # heights that are searched [m]


class Way(NamedTuple):
    """A run-up and a swing."""

    speed: float  # of the run-up [m/s]
    lead: float   # from the swing to the touch at that speed [s]; negative for no swing
    angle: float  # of the swing [rad]


WAYS: Tuple[Way, ...] = tuple(
    Way(speed, lead, angle) for speed in (0.3, 0.5, 0.7, 0.9, 1.0, 1.1)
    for lead, angle in [(-1.0, 0.0), *((lead, angle) for lead in (0.0, 0.15, 0.3, 0.45, 0.6)
                                       for angle in (1.57, 2.1, 2.6))])


def gets_over(loop: ClosedLoop, way: Way, touch: float, goal: float, level_angle: float) -> bool:
    """
    Return whether a ball gets over in a way, without touching a face faster than allowed.

    Parameters
    ----------
    loop : ClosedLoop
        At the begin of the run-up.
    way : Way
    touch, goal : float
        Where the centre is at the first touch, and where the ball is over [m].
    level_angle : float
        Pendulum angle at which the ball keeps its speed [rad].

    """
    swing = touch - way.lead * way.speed if way.lead >= 0.0 else math.inf
    script: Script = (level_angle, GAIN, way.speed, LEAN, swing, way.angle)
    best, since = -math.inf, 0.0
    try:
        while loop.time < LONGEST:
            loop.follow(script, CHUNK)
            x = loop.state.x
            if any(loop.watched[:, TOUCH_SPEED] > FASTEST):
                return False
            if x > goal:
                return True
            if x > best + 1e-3:
                best, since = x, loop.time
            elif loop.time > since + (0.6 if any(loop.watched[:, TOUCH_PERIOD] > 0.0) else 1.5):
                return False
    except SimulationError:
        pass
    return False


def possible(approach: Approach, nominal: Robot, gains: ControlTuning) -> bool:
    """Return whether some way of `WAYS` gets the true robot over, from its best start."""
    ground, robot = approach.ground, approach.robot
    faces = [face for face in true_faces(ground.terrain) if face[0] > 0.0]
    height = max(faces[0][3], 0.0) if faces else 0.0
    touch = ground.foot - touch_distance(robot.ball_radius, height)
    angle = balanced_angle(robot, ground.slope)
    return any(gets_over(
        ClosedLoop(robot, ground.terrain, nominal, gains, 0.0, angle, -approach.room_behind),
        way, touch, ground.goal + 0.5 * robot.ball_radius, angle) for way in WAYS)


def height_limit(robot: Robot, nominal: Robot, gains: ControlTuning, run_up: float,
                 way: Way) -> float:
    """Return the highest step that a robot crosses in a way from rest at a run-up [m]."""
    low, high = 0.0, HIGHEST
    trial = LOWEST
    while high - low > FINE:
        touch = -touch_distance(robot.ball_radius, trial)
        loop = ClosedLoop(robot, Terrain.step(trial), nominal, gains, 0.0, 0.0, touch - run_up)
        if gets_over(loop, way, touch, 0.5 * robot.ball_radius, 0.0):
            low = trial
        else:
            high = trial
        trial = 0.5 * (low + high)
    return low


def set_robots(nominal: Robot) -> List[Robot]:
    """Return the robots that the limit of most is for."""
    return draw(nominal, ROBOTS, seed=0)


def limit_of_most(nominal: Robot, gains: ControlTuning, run_up: float) -> float:
    """
    Return the highest step that `MOST` of `ROBOTS` drawn robots cross, all in the same way [m].

    From rest at a run-up [m]; of the ways with one speed, the one is tried with all that is best
    for the nominal robot.
    """
    of_nominal = {way: height_limit(nominal, nominal, gains, run_up, way) for way in WAYS}
    best = [max((way for way in WAYS if way.speed == speed), key=of_nominal.__getitem__)
            for speed in {way.speed for way in WAYS}]
    return max(sorted(height_limit(robot, nominal, gains, run_up, way)
                      for robot in set_robots(nominal))[ROBOTS - MOST] for way in best)


def limit_at(limits: Sequence[Tuple[float, float]], run_up: float) -> float:
    """Return the limit of most at a run-up, from that at the `KNOTS` [m]; 0 below the first."""
    if run_up < limits[0][0]:
        return 0.0
    knots, heights = np.array(limits).T
    # Whoever has more room may begin with less.
    return float(np.interp(run_up, knots, np.maximum.accumulate(heights)))
