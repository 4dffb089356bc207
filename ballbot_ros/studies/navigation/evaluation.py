# SPDX-License-Identifier: Apache-2.0
"""
Drives to goals in random houses, on many cores; an interrupted run resumes.

The planner is compared with two planners without run-ups: one treats each step as a wall, the
other as free floor.
"""
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache
import math
from pathlib import Path
from time import thread_time
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.decision import nominal_knowledge
from ballbot_ros.errors import RefusedError, SimulationError
from ballbot_ros.floors.floor import inside
from ballbot_ros.navigation import Capability, CrossingPlan, RoutePlanner
from ballbot_ros.navigation.execution import Navigator
from ballbot_ros.results.digests import digest
from ballbot_ros.studies.navigation import houses
from ballbot_ros.studies.navigation.closed_loop import FloorLoop
from ballbot_ros.studies.navigation.houses import draw_house, House
from ballbot_ros.studies.parallel_map import checkpointed_rows, source_digest
from ballbot_ros.studies.progress import ignore, Progress
from ballbot_ros.studies.targets import table_of_targets, target
from ballbot_ros.table import markdown

PLANNERS = ('run_up', 'wall', 'free')
BLOCK, FOLDER = 2, 'goals'
DRIVE_TIME_MAX = 400.0  # of a drive [s]
CONTACT = 0.003  # distance at which the ball touches a wall [m]
HIT = 0.1  # slowest contact with a wall that is counted [m/s]
GOAL_DISTANCE = 0.3  # largest distance from the goal at the end [m]
RIGHT, HITS, RATIO = 0.99, 1e-3, 1.25  # targets; hits per goal

INTRODUCTION = """\
# Evaluation of the navigation in closed loop

This command writes the page and resumes an interrupted run; do not edit the page:

```
{command}
```

A goal took {cpu:.1f} s of processor time on average. `--planners {first} --seed {seed} --only n`
drives to goal number n and prints its result.

Each goal is in a random house: a hall with rooms on both sides, whose doors have a step, a
threshold or nothing. Of the rooms, {furnished:g} % have a carpet, a cord, a platform, a ramp to
a platform, or a lower level; {stairs:g} % of the houses have stairs without a guard. The map has
wrong heights (standard deviation {0.HEIGHT_SD:g} m, and {gross:g} % of them up to
{0.GROSS_ERROR:g} m), and lacks an obstacle in {obstacles:g} % of the rooms. The robot is drawn
from the ranges of its file. The localisation drifts by up to {1.place_sd:g} m and
{1.heading_sd:g} rad, and terrain heights and laser ranges have noise of up to {1.height_sd:g} m
and {1.laser_sd:g} m (standard deviations). The navigator assumes the nominal robot file. The
planner `run_up` is that of the navigator; `wall` treats each step as a wall, and `free` as free
floor. A result is right if the ball arrives, or if it does not arrive and a plan with perfect
knowledge of the floor does not exist.
"""

Row = Dict[str, Any]


class _Fixed(Capability):
    """Offers the same crossings for each step."""

    def __init__(self, *offered: CrossingPlan):
        super().__init__(nominal_knowledge())
        self._offered = offered

    def crossing(self, faces: Sequence[Tuple[float, float]], height_sd: float, run_up: float,
                 room: float) -> Optional[CrossingPlan]:
        return next((item for item in self._offered if item.run_up == run_up), None)


@lru_cache(maxsize=1)
def _capabilities() -> Dict[str, Capability]:
    return {'run_up': Capability(nominal_knowledge()), 'wall': _Fixed(),
            'free': _Fixed(CrossingPlan(0.2, 0.4, 1.0, 2.0))}


@dataclass(frozen=True)
class NavigationEvaluation:
    """The goals to drive to."""

    parts: Tuple[Tuple[str, int], ...]  # planner and number of goals, from the first on
    seed: int = 0

    @property
    def size(self) -> int:
        return sum(count for _, count in self.parts)

    @property
    def digest(self) -> str:
        """Return a digest of all inputs of the rows, except their numbers."""
        return digest((source_digest(), self.seed, nominal_knowledge().robot.digest))


def run_block(evaluation: NavigationEvaluation, planner: str, first: int, stop: int
              ) -> List[Row]:
    """Drive to a range of goals."""
    return [drive(draw_house(nominal_knowledge().robot, evaluation.seed, number), planner)
            for number in range(first, stop)]


def drive(house: House, planner: str) -> Row:
    """Drive to the goal of a house, and return a row of JSON values."""
    begin = thread_time()
    row: Row = {'number': house.number, 'planner': planner, 'hit': 0.0, 'fell': False,
                'failure': '', 'time': math.nan, 'expected': None, 'crossings': 0, 'replans': 0}
    known = nominal_knowledge()
    try:
        row['expected'] = RoutePlanner(
            house.truth, known, capability=_capabilities()['run_up']).route(
                house.start, house.goal).time
    except RefusedError as error:
        row['impossible'] = error.reason
    navigator = Navigator(RoutePlanner(
        house.map, known, capability=_capabilities()[planner]), known)
    loop = FloorLoop(navigator, known, house.robot, house.truth, house.start, house.errors,
                     house.number)
    stairs = [item.polygon for item in house.truth.features if item.kind == 'stairs']
    velocity = 0.0, 0.0

    def watch(loop: FloorLoop) -> None:
        nonlocal velocity
        x, y, heading = loop.plant.pose
        distance, offset = house.truth.nearest_wall((x, y))
        before, speed = velocity, loop.plant.state.velocity_x
        velocity = speed * math.cos(heading), speed * math.sin(heading)
        if 0.0 < distance <= known.robot.ball_radius + CONTACT:
            row['hit'] = max(row['hit'], float(np.dot(before, offset)) / distance)
        row['fell'] = row['fell'] or any(bool(inside(x, y, polygon)) for polygon in stairs)
    try:
        loop.begin(house.goal)
        loop.run(DRIVE_TIME_MAX, watch)
    except RefusedError as error:
        row.update(outcome='refused', reason=error.reason, message=str(error))
    except (SimulationError, ArithmeticError, AssertionError, LookupError, TypeError,
            ValueError) as error:
        row.update(outcome='raised', reason='raised', message=f'{type(error).__name__}: {error}')
    else:
        state = loop.state
        row.update(outcome=state.status.value, reason=state.reason, message=state.message,
                   replans=state.recoveries, time=loop.plant.time,
                   crossings=sum(item[3] * item[4] for item in state.learned.outcomes),
                   away=math.dist(loop.plant.pose[:2], house.goal))
        if not state.status.ended:
            row['outcome'] = 'late'
    row['cpu_s'] = thread_time() - begin
    return row


def run_evaluation(evaluation: NavigationEvaluation, folder: Path, pool: Executor, workers: int,
                   progress: Progress = ignore) -> List[Row]:
    """Run an evaluation, resuming an interrupted one; see `parallel_map.checkpointed_rows`."""
    blocks = {}
    for planner, count in evaluation.parts:
        for first in range(0, count, BLOCK):
            stop = min(first + BLOCK, count)
            blocks[f'{planner}-{first:06d}-{stop:06d}.json'] = (
                stop - first, (evaluation, planner, first, stop))
    return checkpointed_rows(
        run_block, blocks, folder / FOLDER, evaluation.digest, pool, workers, progress)


def report(rows: Sequence[Row]) -> Dict[str, Dict[str, Any]]:
    """
    Return the figures of each planner.

    ``right`` counts arrivals, and failures to arrive at goals to which no route exists even with
    perfect knowledge of the floor.
    """
    found = {}
    for planner in dict.fromkeys(row['planner'] for row in rows):
        mine = [row for row in rows if row['planner'] == planner]
        arrived = [row for row in mine
                   if row['outcome'] == 'succeeded' and row['away'] <= GOAL_DISTANCE]
        impossible = [row for row in mine if row['expected'] is None
                      and row['outcome'] in ('failed', 'refused')]
        ratios = [row['time'] / row['expected'] for row in arrived if row['expected']]
        found[planner] = {
            'goals': len(mine), 'arrived': len(arrived), 'impossible': len(impossible),
            'right': len(arrived) + len(impossible),
            'falls': sum(row['fell'] for row in mine),
            'hits': sum(row['hit'] > HIT for row in mine),
            'crossings': sum(row['crossings'] for row in mine),
            'time_ratio': float(np.median(ratios)) if ratios else None,
            'wrong': [[row['number'], row['outcome'], row['reason'], row['message'][:160]]
                      for row in mine if row not in arrived and row not in impossible],
            'cpu_s': sum(row['cpu_s'] for row in mine)}
    return found


def page(figures: Dict[str, Dict[str, Any]], seed: int, command: str) -> str:
    """Return the report as Markdown, with the targets for the first planner, and the command."""
    titles = ('planner', 'goals', 'arrived', 'no route, reported', 'right', 'falls',
              f'hits above {HIT:g} m/s', 'crossings', 'median time / plan')
    first, one = next(iter(figures.items()))
    part, ratio = one['right'] / one['goals'], one['time_ratio']
    lines = [
        target('arrives, or correctly reports that it cannot', f'{100.0 * RIGHT:g} %',
               f'{100.0 * part:.1f} %, {one["right"]} of {one["goals"]}', part >= RIGHT),
        target('falls', '0', str(one['falls']), not one['falls']),
        target(f'hits above {HIT:g} m/s', '1 in 1,000', f'{one["hits"]} of {one["goals"]}',
               one['hits'] <= HITS * one['goals']),
        target('median time over that of the plan with perfect knowledge', f'{RATIO:g}',
               'not measured' if ratio is None else f'{ratio:.2f}',
               None if ratio is None else ratio <= RATIO)]
    return '\n'.join([
        INTRODUCTION.format(
            houses, houses.ERRORS_MAX, command=command, first=first, seed=seed,
            cpu=one['cpu_s'] / one['goals'], furnished=100.0 * houses.FURNISHED,
            stairs=100.0 * houses.STAIRS, gross=100.0 * houses.GROSS,
            obstacles=100.0 * houses.OBSTACLES),
        f'## Targets, with `{first}`\n', *table_of_targets(lines), '',
        '## Planners\n', *markdown(titles, (
            (planner, one['goals'], one['arrived'], one['impossible'],
             f'{100.0 * one["right"] / one["goals"]:.1f} %', one['falls'], one['hits'],
             one['crossings'], '-' if one['time_ratio'] is None else f'{one["time_ratio"]:.2f}')
            for planner, one in figures.items())), '',
        f'## Wrong results of `{first}`\n', *([
            f'* {number}: {outcome}: {message}' for number, outcome, _, message in one['wrong']]
            or ['None.']), ''])
