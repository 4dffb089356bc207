# SPDX-License-Identifier: Apache-2.0
"""
Maximum step of the true robot: exhaustive search over manoeuvres with the full model.

A *manoeuvre* is a run-up from rest to a speed, and a swing of the pendulum some time before the
touch.  The search uses the true robot parameters, unlike the decision.
"""
from concurrent.futures import Executor
import math
from pathlib import Path
from typing import Callable, List, NamedTuple, Sequence, Tuple

import numpy as np

from ballbot_ros.control.tuning import ControlTuning
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.errors import SimulationError
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.uncertainty import draw
from ballbot_ros.results.digests import digest
from ballbot_ros.studies.evaluation.closed_loop import (
    balanced_angle, ClosedLoop, Script, TOUCH_PERIOD, TOUCH_SPEED)
from ballbot_ros.studies.evaluation.terrains import Ground, lay, Shape, true_faces
from ballbot_ros.studies.parallel_map import checkpointed_rows, source_digest
from ballbot_ros.studies.progress import ignore, Progress

Limits = Tuple[Tuple[float, float], ...]

FOLDER = 'limits'
TOUCH_SPEED_MAX = 1.15         # touch [m/s]
RUN_UP_GAIN, RUN_UP_LEAN = 4.0, 1.2  # of the run-up [rad s/m], [rad]
CHUNK, CROSSING_TIME_MAX = 50, 8.0  # control periods between two checks, [s]
EDGE_GAP = 0.05        # from the end of the room behind to the start [m]
ROBOTS, ROBOTS_CROSSING = 24, 23
KNOTS = (0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 1.8)  # run-ups [m]
HEIGHT_MIN, HEIGHT_MAX, HEIGHT_RESOLUTION = 0.006, 0.09, 0.0005  # heights that are searched [m]


class Manoeuvre(NamedTuple):
    """A run-up and a swing."""

    speed: float  # of the run-up [m/s]
    lead: float   # from the swing to the touch at that speed [s]; negative for no swing
    angle: float  # of the swing [rad]


MANOEUVRES: Tuple[Manoeuvre, ...] = tuple(
    Manoeuvre(speed, lead, angle) for speed in (0.3, 0.5, 0.7, 0.9, 1.0, 1.1)
    for lead, angle in [(-1.0, 0.0), *((lead, angle) for lead in (0.0, 0.15, 0.3, 0.45, 0.6)
                                       for angle in (1.57, 2.1, 2.6))])


def manoeuvre_crosses(loop: ClosedLoop, manoeuvre: Manoeuvre, touch: float, goal: float,
                      level_angle: float) -> bool:
    """
    Return whether a ball crosses with a manoeuvre, without a touch above `TOUCH_SPEED_MAX`.

    The loop is at the start of the run-up; `touch` and `goal` are the positions of the centre at
    the first touch, and beyond which the ball is over [m]; at the level angle of the pendulum, the
    ball keeps its speed [rad].
    """
    swing = touch - manoeuvre.lead * manoeuvre.speed if manoeuvre.lead >= 0.0 else math.inf
    script: Script = (
        level_angle, RUN_UP_GAIN, manoeuvre.speed, RUN_UP_LEAN, swing, manoeuvre.angle)
    return crosses(loop, lambda: loop.follow(script, CHUNK), goal,
                   CROSSING_TIME_MAX + (goal - touch) / manoeuvre.speed, TOUCH_SPEED_MAX)


def crosses(loop: ClosedLoop, advance: Callable[[], None], goal: float, time_limit: float,
            fastest: float = math.inf) -> bool:
    """
    Return whether a ball crosses, without a touch faster than permitted [m/s].

    `advance` is called until the ball is beyond the goal [m], makes no progress, or the simulated
    time limit [s] has passed.
    """
    best, since = -math.inf, 0.0
    try:
        while loop.time < time_limit:
            advance()
            x = loop.state.x
            if any(loop.watched[:, TOUCH_SPEED] > fastest):
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


def best_start(room_behind: float) -> float:
    """Return the start of the longest run-up, with free ground behind the ball at 0 [m]."""
    return min(0.0, EDGE_GAP - room_behind)


def possible(robot: Robot, ground: Ground, room_behind: float, nominal: Robot,
             gains: ControlTuning) -> bool:
    """Return whether the true robot crosses with one of `MANOEUVRES`, from its best start."""
    faces = [face for face in true_faces(ground.terrain) if face[0] > 0.0]
    height = max(faces[0][3], 0.0) if faces else 0.0
    touch = ground.foot - touch_distance(robot.ball_radius, height)
    angle = balanced_angle(robot, ground.slope)
    return any(manoeuvre_crosses(
        ClosedLoop(robot, ground.terrain, nominal, gains, 0.0, angle, best_start(room_behind)),
        manoeuvre, touch, ground.goal + 0.5 * robot.ball_radius, angle)
        for manoeuvre in MANOEUVRES)


def height_limit(robot: Robot, nominal: Robot, gains: ControlTuning, run_up: float,
                 manoeuvres: Sequence[Manoeuvre], slope: float = 0.0,
                 trial: float = HEIGHT_MIN) -> float:
    """
    Return the maximum step height that a robot crosses with one of some manoeuvres [m].

    From rest at a run-up [m] before the touch, on a slope [rad].  See `highest` for `trial` [m].
    """
    angle = balanced_angle(robot, slope)

    def passes(height: float) -> bool:
        touch, ground = -touch_distance(robot.ball_radius, height), lay_step(
            robot, height, 0.0, slope)
        return any(manoeuvre_crosses(
            ClosedLoop(robot, ground.terrain, nominal, gains, 0.0, angle, touch - run_up),
            manoeuvre, touch, ground.goal, angle) for manoeuvre in manoeuvres)
    return highest(passes, trial)


def lay_step(robot: Robot, height: float, foot: float, slope: float) -> Ground:
    """Return a step; the ball is over when its centre is half a radius beyond the edge."""
    return lay('step', Shape('', [(0.0, height)], 0.5 * robot.ball_radius), foot, slope, None,
               robot.surface_friction)


def highest(passes: Callable[[float], bool], trial: float) -> float:
    """
    Return the maximum step height that passes [m].

    The bisection begins at the height `trial` [m]: a manoeuvre that crosses a step may fail at a
    much lower one, where its swing is too early or too strong.
    """
    low, high = 0.0, HEIGHT_MAX
    while high - low > HEIGHT_RESOLUTION:
        low, high = (trial, high) if passes(trial) else (low, trial)
        trial = 0.5 * (low + high)
    return low


def set_robots(nominal: Robot) -> List[Robot]:
    """Return the robots of `limit_of_most`."""
    return draw(nominal, ROBOTS, seed=0)


def limit_of_most(nominal: Robot, tuning: ControlTuning, run_up: float) -> float:
    """
    Return the maximum step height that `ROBOTS_CROSSING` of `ROBOTS` drawn robots cross [m].

    All with the same manoeuvre, from rest at a run-up [m]; for each speed, only the best
    manoeuvre of the nominal robot is tried.
    """
    heights = {one: height_limit(nominal, nominal, tuning, run_up, (one,)) for one in MANOEUVRES}
    best = [max((one for one in MANOEUVRES if one.speed == speed), key=heights.__getitem__)
            for speed in sorted({one.speed for one in MANOEUVRES})]
    return max(sorted(height_limit(drawn, nominal, tuning, run_up, (one,))
                      for drawn in set_robots(nominal))[ROBOTS - ROBOTS_CROSSING] for one in best)


def limits_of_most(nominal: Robot, tuning: ControlTuning, folder: Path, pool: Executor,
                   workers: int, progress: Progress = ignore) -> Limits:
    """
    Return the limit of most by run-up; see `parallel_map.checkpointed_rows`.

    The blocks are in the subfolder `FOLDER` of the folder.  `progress` receives the number of
    finished run-ups, of `KNOTS`.
    """
    # The longest run-ups take the longest.
    blocks = {f'{knot:g}.json': (1, (nominal, tuning, knot)) for knot in reversed(KNOTS)}
    found = checkpointed_rows(
        limit_row, blocks, folder / FOLDER, digest((source_digest(), nominal.digest, tuning)),
        pool, workers, progress)
    return tuple(zip(KNOTS, reversed(found)))


def limit_row(nominal: Robot, tuning: ControlTuning, run_up: float) -> List[float]:
    """Return the limit of most at a run-up, as the row of a block."""
    return [limit_of_most(nominal, tuning, run_up)]


def limit_at(limits: Sequence[Tuple[float, float]], run_up: float) -> float:
    """Return the limit of most at a run-up, interpolated [m]; 0 below the first of `KNOTS`."""
    if run_up < limits[0][0]:
        return 0.0
    knots, heights = np.array(limits).T
    # With more room the run-up may still be short.
    return float(np.interp(run_up, knots, np.maximum.accumulate(heights)))
