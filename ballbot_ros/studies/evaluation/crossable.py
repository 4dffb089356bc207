# SPDX-License-Identifier: Apache-2.0
"""
Approaches to steps that most robots can cross, to see how many of them a decision crosses.

A single step on level ground, a sensor without flaws, room behind that is known to be free.  The
robot is one of those that the limit of most is for, see `search.limit_of_most`.
"""
from concurrent.futures import Executor
import json
import math
from pathlib import Path
from typing import Sequence, Tuple

import numpy as np

from ballbot_ros.control.tuning import load_tuning
from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.physics.model.robot import load_robot, Robot
from ballbot_ros.results.files import write_text
from ballbot_ros.studies.evaluation.approaches import Approach, BRINK
from ballbot_ros.studies.evaluation.grounds import lay, Shape
from ballbot_ros.studies.evaluation.search import KNOTS, limit_at, limit_of_most, set_robots
from ballbot_ros.studies.evaluation.sensors import Flaws
from ballbot_ros.studies.progress import ignore, Progress

Limits = Tuple[Tuple[float, float], ...]

SIZE = 160
FILE = 'crossable.json'
ROOM = (0.15, 2.5)     # front of the ball to the step [m]
HEIGHT = (0.008, 0.06)  # [m]


def named_limit(robot: str, gains: str, run_up: float) -> float:
    """Return the limit of most at a run-up [m]; robot and tuning by name, for other processes."""
    return limit_of_most(load_robot(robot), load_tuning(gains), run_up)


def limits_of_most(robot: str, gains: str, folder: Path, pool: Executor,
                   progress: Progress = ignore) -> Limits:
    """
    Return the highest steps that most robots cross, by run-up; kept in a file of the folder.

    Progress is reported as the part of them that is known.
    """
    path, key = folder / FILE, load_robot(robot).digest
    try:
        known = json.loads(path.read_text(encoding='utf-8'))
        if known['robot'] == key:
            return tuple((float(knot), float(limit)) for knot, limit in known['limits'])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    parts = [pool.submit(named_limit, robot, gains, knot) for knot in reversed(KNOTS)]
    found = []
    for number, part in enumerate(parts, 1):
        found.append(part.result())
        progress(number / len(parts))
    limits = tuple(zip(KNOTS, reversed(found)))
    write_text(json.dumps({'robot': key, 'limits': limits}), path)
    return limits


def crossable_approach(nominal: Robot, limits: Sequence[Tuple[float, float]], seed: int,
                       number: int) -> Approach:
    """Return approach `number` of a seed to a step that most robots cross."""
    random = np.random.default_rng([seed, number, 2])
    robots = set_robots(nominal)
    radius = nominal.ball_radius
    while True:
        room, behind = float(random.uniform(*ROOM)), round(float(random.uniform(0.0, 1.5)), 2)
        height = round(float(random.uniform(*HEIGHT)), 4)
        robot = robots[int(random.integers(len(robots)))]
        run_up = room + radius + behind - touch_distance(radius, height)
        if height <= limit_at(limits, run_up):
            break
    shape = Shape(f'step of {1e3 * height:.1f} mm', [(0.0, height)], 0.0)
    ground = lay('crossable', shape, round(radius + room, 4), 0.0,
                 behind + radius + BRINK, math.nan)
    return Approach(seed, number, robot, ground,
                    Flaws(kind=('terrain', 'step')[number % 2]), 0.0, behind)
