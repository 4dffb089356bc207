# SPDX-License-Identifier: Apache-2.0
"""
Steps that a robot crosses from rest: maps run-up and room to speed, probability and time.

The entries come from the rollouts of the obstacle decision, in the worlds that its robot file,
tuning and learned particles imply; so a route contains no crossing that the decision would refuse.
They are computed on demand, for heights rounded away from 0, and cached in
``$XDG_CACHE_HOME/ballbot_ros/capability``, one file for each robot, tuning and code version.
"""
from contextlib import suppress
from dataclasses import replace
import hashlib
import json
import math
import os
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.decision import Face, Knowledge, Motion, Profile, Situation
from ballbot_ros.decision.learning.particles import SURFACE_FRICTION
from ballbot_ros.decision.planning.ahead import GROUND_EXTENSION, look_ahead
from ballbot_ros.decision.planning.rollout.planner import exceeds
from ballbot_ros.decision.planning.rollout.rollout import OVER, REST, STUCK, VERDICT
from ballbot_ros.decision.planning.rollout.search import (
    candidates, CONFIRMATION_ROLLOUTS, OVERRUN_FRACTION_MAX, search, Task, Trial)
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds

# Candidate run-ups from rest to the touch, and largest room used behind the last edge [m].
RUN_UPS = (0.2, 0.35, 0.5, 0.75, 1.0, 1.4, 1.8, 2.4)
ROOM_MAX = 2.5
# Heights, their standard deviations and widths are rounded up to multiples of these values;
# searches use rooms that are multiples of the last one [m].
HEIGHT, HEIGHT_SD, WIDTH, ROOM = 0.0025, 0.001, 0.01, 0.1
# Standard deviations of a step's position at its crossing [m], and of a level floor's slope [rad].
PLACE_SD, SLOPE_SD = 0.01, 0.003


class CrossingPlan(NamedTuple):
    """
    A crossing from rest.

    Attributes
    ----------
    run_up : float
        Distance that the centre travels until the touch [m].
    speed : float
        Approach speed [m/s].
    probability : float
        Probability of crossing and stopping in the room behind the step.
    time : float
        Time from rest before the step to rest behind it [s].
    room : float
        Room required behind the last edge [m].
    again : float
        Probability that a failed attempt ends before the step and the next one succeeds.

    """

    run_up: float
    speed: float
    probability: float
    time: float
    room: float = 0.0
    again: float = 0.0

    @property
    def eventual(self) -> float:
        """Return the probability with one further attempt."""
        return self.probability + (1.0 - self.probability) * self.again


class Capability:
    """
    Computes and caches crossings on demand.

    Parameters
    ----------
    knowledge : Knowledge
        Robot, curve, tuning and particles of the obstacle decision.

    Attributes
    ----------
    least_friction : float
        Lowest coefficient of friction of the floors in its worlds [1].

    """

    def __init__(self, knowledge: Knowledge):
        particles = knowledge.initial_particles
        self._knowledge = replace(knowledge, particles=particles)
        self.least_friction = float(particles.lows[particles.names.index(SURFACE_FRICTION)])
        self._file = _folder() / f'{_digest(knowledge)}.json'
        self._known: Dict[str, Optional[CrossingPlan]] = {}
        self._read()
        self._kept = len(self._known)

    def _read(self) -> None:
        """Add the entries of the file, if it exists."""
        with suppress(OSError, ValueError, TypeError):
            for key, value in json.loads(self._file.read_text(encoding='utf-8')).items():
                self._known[key] = None if value is None else CrossingPlan(*value)

    def keep(self) -> None:
        """Write the cache; if it is not writable, the next run computes the results again."""
        if len(self._known) == self._kept:
            return
        with suppress(OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            self._read()  # results of other processes
            temporary = self._file.with_suffix(f'.{os.getpid()}')
            temporary.write_text(json.dumps(self._known), encoding='utf-8')
            temporary.replace(self._file)
            self._kept = len(self._known)

    def crossing(self, faces: Sequence[Tuple[float, float]], height_sd: float, run_up: float,
                 room: float) -> Optional[CrossingPlan]:
        """
        Return the crossing with a run-up, or None if none has the required probability.

        Parameters
        ----------
        faces : sequence of (float, float)
            Distance from the first face and height of each face, negative if it leads down [m].
        height_sd : float
            Standard deviation of the heights [m].
        run_up : float
            One of `RUN_UPS` [m]; a crossing downwards uses the shortest.
        room : float
            Room for the centre behind the last edge [m].

        """
        if room < ROOM:
            return None
        steps = tuple((_rounded(at, WIDTH), _rounded(height, HEIGHT)) for at, height in faces)
        height_sd = _rounded(height_sd, HEIGHT_SD)
        if max(height for _, height in steps) < 0.0:
            run_up = RUN_UPS[0]  # a step down needs no speed
        longest = ROOM_MAX
        while longest > 0.0:
            key = f'{(steps, height_sd)} {run_up} {longest}'
            if key not in self._known:
                self._known[key] = self._search(steps, height_sd, run_up, longest)
            found = self._known[key]
            if found is None or found.room <= room:
                return found
            # The largest room that excludes this plan.
            longest = round(math.ceil(found.room / ROOM - 1.0 - 1e-6) * ROOM, 6)
        return None

    def _search(self, steps: Tuple[Tuple[float, float], ...], height_sd: float, run_up: float,
                room: float) -> Optional[CrossingPlan]:
        tuning, radius = self._knowledge.tuning, self._knowledge.robot.ball_radius
        faces = tuple(Face(number, at, height, PLACE_SD, height_sd)
                      for number, (at, height) in enumerate(steps))
        last = steps[-1][0]
        seen_to = last + room + radius
        points = [(-run_up - GROUND_EXTENSION, 0.0)]
        for at, height in steps:
            points += [(at, points[-1][1]), (at, points[-1][1] + height)]
        points.append((seen_to, points[-1][1]))
        profile = Profile(
            0.0, faces, tuple(points), seen_to=seen_to, slope=0.0, slope_sd=SLOPE_SD)
        ahead = look_ahead(Situation(Motion(0.0, -run_up - radius, 0.0), profile), faces, radius,
                           replace(tuning, unseen_room=0.0))
        if not ahead.ends or ahead.ends[-1].faces < len(faces):
            return None
        start = (ahead.touch - run_up, 0.0, 0.0, 0.0)
        # Each entry starts with the first world, and therefore depends on its key only.
        worlds = Worlds(self._knowledge)
        worlds.see(ahead)
        task = Task(start, ahead, worlds, tuning.required_probability, tuning.highest_speed)
        plans = [plan for plan in candidates(ahead, start[0], 0.0, tuning)
                 if plan.end(ahead).faces == len(faces)]
        trials: List[Trial] = []
        steps_of_search = search(plans, task, trials)
        try:
            while True:
                next(steps_of_search)
        except StopIteration as end:
            chosen = end.value
        if chosen is None:
            return None
        speed = max(chosen.many.speed, 0.1)
        # Uniform acceleration to the touch, then to the last edge, then a stop.
        time = 2.0 * run_up / speed + (last + radius) / speed \
            + speed / tuning.deceleration
        draws = worlds.sample(CONFIRMATION_ROLLOUTS)
        results = task.attempt([chosen.candidate], draws)[0]
        beyond = float(np.quantile(np.nan_to_num(results[:, REST], nan=-math.inf),
                                   1.0 - OVERRUN_FRACTION_MAX, method='higher'))
        # The same plan would fail again; the decision selects one that exceeds it.
        stuck = results[:, VERDICT] == STUCK
        further = [plan for plan in plans
                   if exceeds(plan, chosen.candidate.speed, chosen.candidate.angle)]
        again = 0.0
        if stuck.any() and further:
            tallies = [Tally.of(item, ahead.room_to)
                       for item in task.attempt(further, draws[stuck])]
            again = max((item.probability for item in tallies if not item.harm), default=0.0) \
                * float(stuck.sum() / (results[:, VERDICT] != OVER).sum())
        # At most the room of the search, which allows the same fraction of overruns.
        return CrossingPlan(
            run_up, chosen.candidate.speed, chosen.many.probability, time,
            min(room, beyond + room - ahead.room_to), again)


def _rounded(value: float, unit: float) -> float:
    """Round away from 0 to a multiple of a unit."""
    return math.copysign(round(math.ceil(abs(value) / unit - 1e-6) * unit, 6), value)


def _folder() -> Path:
    """Return the folder of the cache files."""
    base = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    return base / 'ballbot_ros' / 'capability'


def _digest(knowledge: Knowledge) -> str:
    """Return a digest of all data on which the entries depend."""
    code = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256(repr((
        knowledge.robot.digest, knowledge.tuning, knowledge.control, knowledge.seed)).encode())
    for source in (Path(__file__), *sorted((code / 'decision').rglob('*.py'))):
        digest.update(source.read_bytes())
    if knowledge.particles is not None:
        for array in (knowledge.particles.values, knowledge.particles.weights):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]
