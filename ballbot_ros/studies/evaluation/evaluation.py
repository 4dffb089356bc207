# SPDX-License-Identifier: Apache-2.0
"""
Run thousands of approaches on many cores or a cluster; an interrupted run resumes.

Results are stored in blocks of JSON files, see `parallel_map`.
"""
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
import math
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision import (
    Decision, Kind, Knowledge, Motion, nominal_knowledge, Pilot, Plan, Reason, Strategy)
from ballbot_ros.results.digests import digest
from ballbot_ros.studies.evaluation.approaches import Approach, crossable_approach, draw_approach
from ballbot_ros.studies.evaluation.closed_loop import ClosedLoop
from ballbot_ros.studies.evaluation.run import heading, ODOMETRY_PERIODS, run_approach
from ballbot_ros.studies.evaluation.search import (
    best_start, crosses, CROSSING_TIME_MAX, height_limit, highest, lay_step, MANOEUVRES, possible)
from ballbot_ros.studies.evaluation.terrains import true_faces
from ballbot_ros.studies.parallel_map import checkpointed_rows, source_digest
from ballbot_ros.studies.progress import ignore, Progress

BLOCK = 10  # approaches in a file
FOLDER = 'approaches'
# Range of run-ups of a manoeuvre for the margin of a refused step [m].
RUN_UPS = (0.05, 3.0)

# Exceptions of a decision that are defects, not refused input; they are counted.
DEFECTS = (ArithmeticError, AssertionError, AttributeError, LookupError, RuntimeError,
           TypeError, ValueError)

Row = Dict[str, Any]


@dataclass(frozen=True)
class Evaluation:
    """The approaches to run and their planners; equal evaluations have equal approaches."""

    # Planner, group (``drawn`` or ``crossable``), and number of approaches, from the first on.
    parts: Tuple[Tuple[str, str, int], ...]
    seed: int = 0
    # Kind of all terrains and sensors, if given; see `terrains.KINDS` and `sensors.KINDS`.
    kind: Optional[str] = None
    sensor: Optional[str] = None
    # Run-ups, and heights of the steps that most robots cross with them [m], see
    # `search.limit_of_most`; only needed for the group ``crossable``.
    limits: Tuple[Tuple[float, float], ...] = ()
    # Number of approaches of the first planner, in each group, for which a search with the true
    # robot determines whether a crossing exists, and the true margin of each attempt at a step.
    searched: int = 0

    @property
    def size(self) -> int:
        return sum(count for _, _, count in self.parts)

    @property
    def digest(self) -> str:
        """Return a digest of all inputs of the rows, except their numbers."""
        same = {name: value for name, value in asdict(self).items()
                if name not in ('parts', 'limits', 'searched')}
        nominal = nominal_knowledge()
        return digest((source_digest(), nominal.robot.digest, nominal.curve, nominal.tuning,
                       nominal.control, same))

    def approach(self, group: str, number: int) -> Approach:
        nominal = nominal_knowledge()
        if group == 'crossable':
            return crossable_approach(nominal.robot, self.limits, self.seed, number)
        return draw_approach(nominal, self.seed, number, self.kind, self.sensor)


def run_block(evaluation: Evaluation, planner: str, group: str, first: int, stop: int,
              search: bool) -> List[Row]:
    """Run a range of approaches; a defect of the decision only fails its own approach."""
    return [_run(evaluation, planner, group, number, search) for number in range(first, stop)]


def _run(evaluation: Evaluation, planner: str, group: str, number: int, search: bool) -> Row:
    nominal = nominal_knowledge()
    approach = evaluation.approach(group, number)
    try:
        row = run_approach(approach, planner, nominal)
    except DEFECTS as error:
        row = {**heading(approach, planner), 'outcome': 'raised', 'attempts': [], 'changes': 0,
               'failure': f'{type(error).__name__}: {error}'}
    row['group'] = group
    if not search:
        return row
    obstacle = row['crossable'] and row['kind'] not in ('nothing', 'crossable')
    if obstacle and may_cross(approach, nominal):
        row['possible'] = row['outcome'] == 'over' or possible(
            approach.robot, approach.ground, approach.room_behind, nominal.robot, nominal.control)
    if row['kind'] in ('step', 'crossable'):
        for attempt in row['attempts']:
            attempt['true_margin'] = true_margin(approach, attempt, nominal)
        if row.get('height_margin') is not None:
            row['true_margin'] = refused_margin(approach, nominal)
    return row


def may_cross(approach: Approach, nominal: Knowledge) -> bool:
    """Return whether the decision may cross the obstacle, given what its sensor can observe."""
    faces = [face for face in true_faces(approach.ground.terrain) if face[0] > 0.0]
    # A step sensor detects no ramp, and its floor behind a step must be granted.
    seen = approach.sensor.kind != 'step' or approach.unseen_room > 0.0 and len(faces) > 0
    drop = len(faces) > 0 and faces[-1][3] < -nominal.tuning.highest_descent
    # A frozen sensor stops the ball.
    return seen and not drop and approach.sensor.condition != 'frozen'


def refused_margin(approach: Approach, nominal: Knowledge) -> float:
    """Return the maximum step height of the true robot minus that of the refused step [m]."""
    height = true_faces(approach.ground.terrain)[-1][3]
    touch = approach.ground.foot - touch_distance(approach.robot.ball_radius, height)
    run_up = min(max(touch - best_start(approach.room_behind), RUN_UPS[0]), RUN_UPS[1])
    return height_limit(approach.robot, nominal.robot, nominal.control, run_up, MANOEUVRES,
                        approach.ground.slope, trial=height) - height


def true_margin(approach: Approach, attempt: Dict[str, Any], nominal: Knowledge) -> float:
    """
    Return the maximum step height of the true robot with a plan minus that of its step [m].

    The pilot executes the plan of an attempt again, from the same state, at other heights.
    """
    robot, slope = approach.robot, approach.ground.slope
    face: float = attempt['face']
    height = float(approach.ground.terrain.height(face + 1e-6)) - math.tan(slope) * face
    _, speed, swing, angle = attempt['plan']
    order = Decision(Kind.CROSS, Reason.COMMITTED, speed, '', plan=Plan(
        Strategy.CRUISE, speed=speed, swing_position=math.inf if swing is None else swing,
        swing_angle=angle, edge=attempt['edge']))

    def passes(trial: float) -> bool:
        ground, pilot = lay_step(robot, trial, face, slope), Pilot(nominal)
        x, start_speed, pendulum_angle = attempt['before']
        loop = ClosedLoop(robot, ground.terrain, nominal.robot, nominal.control, start_speed,
                          pendulum_angle, x)

        def advance() -> None:
            state = loop.state
            loop.advance(pilot.angle(order, Motion(
                loop.time, state.x, state.velocity_x, state.pendulum_angle, slope=slope)),
                ODOMETRY_PERIODS)
        return crosses(loop, advance, ground.goal, CROSSING_TIME_MAX)
    return highest(passes, height) - height


def run_evaluation(evaluation: Evaluation, folder: Path, pool: Executor, workers: int,
                   progress: Progress = ignore) -> List[Row]:
    """
    Run an evaluation, resuming an interrupted one, and return the row of each run.

    The blocks are in the subfolder `FOLDER` of the folder; `pool` is one of processes or of a
    cluster.  `progress` receives the number of finished runs.  Raises `ConfigurationError` if the
    folder belongs to another evaluation, or cannot be written.
    """
    blocks = {}
    for planner, group, count in evaluation.parts:
        for first in range(0, count, BLOCK):
            stop = min(first + BLOCK, count)
            search = planner == evaluation.parts[0][0] and first < evaluation.searched
            blocks[f'{planner}-{group}-{first:07d}-{stop:07d}{"-searched" * search}.json'] = (
                stop - first, (evaluation, planner, group, first, stop, search))
    return checkpointed_rows(
        run_block, blocks, folder / FOLDER, evaluation.digest, pool, workers, progress)
