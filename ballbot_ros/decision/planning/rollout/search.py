# SPDX-License-Identifier: Apache-2.0
"""
Which plan: few attempts with many candidates, many with few (successive halving).

All candidates are tried in the middle of all worlds with steps somewhat higher than seen, those
that pass with higher ones, and the others with the step as it is.  The best of each level then
meet the same few worlds, and the chosen one as many as an answer needs, which no choice has seen:
so the probability that is promised is not that of the luckiest.

A search is a generator: it yields after each bundle of attempts, so that an answer may take as
many of them as its time allows, counted in attempts and not by a clock.
"""
from dataclasses import dataclass, field
import math
from typing import Generator, List, Optional, Sequence, Tuple

from ballbot_ros.decision.planning.rollout.ahead import Ahead
from ballbot_ros.decision.planning.rollout.candidates import Candidate
from ballbot_ros.decision.planning.rollout.layout import (
    FALLS, OVER, PASSED_SPEED, TOUCH_SPEED, VERDICT)
from ballbot_ros.decision.planning.rollout.rollout import Start
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds
from ballbot_ros.physics.model.terrain import Array

# Steps are raised by these multiples of their height deviation, to rank candidates.
RAISED, MORE = 1.3, 2.3
HIGHEST = 3
# Spread between robots relative to the step height, added to the height deviation.
ROBOTS = 0.04
# Number of finalists, and of common worlds for comparing them.
FINALISTS, FEW = 8, 16
# Worlds for confirming a plan, and worlds before the first check.
MANY, LOOK = 200, 40
# Candidates per batch, and sufficient number at the highest level.
HANDFUL, ENOUGH = 20, 6
BUNDLE = 20  # rollouts between two yields
# A candidate this far below the required probability at a check is rejected.
HOPELESS = 0.12
CHOICES = 3
# Maximum fraction of rollouts that end beyond the stop line behind the edge, to keep a plan: to
# choose one, none may.
BEYOND = 0.02


@dataclass
class Trial:
    """A candidate and its evaluation."""

    candidate: Candidate
    level: int = 0  # how much higher a step it passes
    speed: float = math.nan  # at touch, in the middle of all worlds [m/s]
    behind: float = math.inf  # when it has passed the last edge there [m/s]
    falls: bool = False
    few: Tally = field(default_factory=Tally)
    many: Tally = field(default_factory=Tally)


@dataclass
class Task:
    """
    Start, terrain, worlds and requirements of a search.

    `start` and `ahead` are updated while a search goes on over several decisions.
    """

    start: Start
    ahead: Ahead
    worlds: Worlds
    required: float
    highest_speed: float  # at touch [m/s]

    def tally(self, trial: Trial, worlds: Array, raised: float = 0.0) -> Tally:
        """Return the results of a plan in some worlds."""
        results = self.worlds.attempt(
            self.start, [trial.candidate.row(self.ahead)], worlds, self.ahead, raised)
        return Tally.of(results[0], self.ahead.room_to)


Steps = Generator[None, None, Optional[Trial]]


def search(plans: Sequence[Candidate], task: Task, trials: List[Trial]) -> Steps:
    """
    Search among candidates; the generator returns the first sufficient trial, or None.

    Parameters
    ----------
    plans : sequence of Candidate
    task : Task
    trials : list
        Output: all evaluations, for reporting why candidates were rejected.

    """
    ahead, worlds = task.ahead, task.worlds
    trials += [Trial(plan) for plan in plans]
    spread = math.hypot(worlds.spread(), ROBOTS * abs(ahead.faces[0].height))
    yield from _sort(trials, task, spread)
    finalists = _finalists(trials, task.highest_speed)
    few = worlds.first(FEW)
    for trial in finalists:
        trial.few = task.tally(trial, few)
        yield
    best = max((trial.few.probability for trial in finalists), default=0.0)
    goal = task.required + 0.5 * max(best - task.required, 0.0)
    # The gentlest sufficient candidates first, then by probability.
    order = sorted(finalists, key=lambda item: (
        item.few.harm > 0.0, item.few.probability < goal, item.level < HIGHEST,
        item.behind if item.few.probability >= goal else -item.few.probability))
    for trial in order[:CHOICES]:
        if trial.few.probability < task.required - HOPELESS:
            continue
        yield from confirm(trial, task, MANY)
        if good(trial.many, task.required):
            return trial
    return None


def _sort(trials: List[Trial], task: Task, spread: float) -> Generator[None, None, None]:
    """Rank trials by the raised steps they cross, from gentle to brisk, until enough do."""
    middle = task.worlds.middle()
    trials.sort(key=lambda trial: trial.candidate.briskness)
    for begin in range(0, len(trials), HANDFUL):
        bundle = trials[begin:begin + HANDFUL]
        rows = [trial.candidate.row(task.ahead) for trial in bundle]
        first = task.worlds.attempt(
            task.start, rows, middle, task.ahead, RAISED * spread)[:, 0]
        yield
        for trial, result in zip(bundle, first):
            trial.level = 2 if result[VERDICT] == OVER else 0
            trial.speed, trial.falls = float(result[TOUCH_SPEED]), result[VERDICT] == FALLS
            if result[VERDICT] == OVER:
                trial.behind = float(result[PASSED_SPEED])
        for level, raised in ((2, MORE * spread), (0, 0.0)):
            chosen = [trial for trial in bundle if trial.level == level and not trial.falls]
            yield
            if chosen:
                results = task.worlds.attempt(
                    task.start, [trial.candidate.row(task.ahead) for trial in chosen], middle,
                    task.ahead, raised)
                for trial, result in zip(chosen, results[:, 0]):
                    trial.level += int(result[VERDICT] == OVER)
                    if result[VERDICT] == OVER:
                        trial.behind = float(result[PASSED_SPEED])
                    trial.falls = trial.falls or result[VERDICT] == FALLS
        yield
        if sum(trial.level == HIGHEST for trial in trials) >= ENOUGH:
            # What comes is less gentle.
            break


def _finalists(trials: Sequence[Trial], highest_speed: float) -> List[Trial]:
    """Return the gentlest trials of each level, and of each strategy the gentlest."""
    passing = sorted((trial for trial in trials if trial.level > 0
                      and trial.speed <= highest_speed), key=lambda trial: trial.behind)
    chosen: List[Trial] = []
    for level, number in ((HIGHEST, 5), (2, 2), (1, FINALISTS)):
        for trial in [item for item in passing if item.level == level][:number]:
            chosen.append(trial)
    return chosen[:FINALISTS]


def confirm(trial: Trial, task: Task, number: int) -> Generator[None, None, None]:
    """Try a plan in worlds that it has not met, until it is hopeless or has met enough."""
    while trial.many.attempts < number:
        trial.many = trial.many + task.tally(trial, task.worlds.take(BUNDLE))
        yield
        if trial.many.attempts >= LOOK and (
                trial.many.probability < task.required - HOPELESS or trial.many.harm > 0.0):
            break


def good(tally: Tally, required: float, harm: float = 0.0) -> bool:
    """Return whether a plan may be carried out, with a fraction of rollouts that do harm."""
    return tally.probability >= required and tally.harm <= harm * tally.attempts


def height_limit(trial: Trial, task: Task, number: int = 24,
                 steps: int = 6) -> Generator[None, None, float]:
    """Return the highest first face that a plan crosses as surely as required [m]."""
    height = task.ahead.faces[0].height
    worlds = task.worlds.first(number)
    low, high = -0.5 * abs(height), 0.04
    for _ in range(steps):
        middle = 0.5 * (low + high)
        tally = task.tally(trial, worlds, middle)
        if tally.over >= task.required * tally.attempts:
            low = middle
        else:
            high = middle
        yield
    return height + low


def why_not(trials: Sequence[Trial], chosen: Optional[Trial]) -> Tuple[str, ...]:
    """Return a sentence for the best of each strategy that was not chosen."""
    said = []
    for strategy in dict.fromkeys(trial.candidate.strategy for trial in trials):
        if chosen is not None and strategy is chosen.candidate.strategy:
            continue
        own = [trial for trial in trials if trial.candidate.strategy is strategy]
        best = max(own, key=lambda item: (item.many.attempts > 0, item.few.probability
                                          if item.few.attempts else 0.0, item.level,
                                          -item.speed if item.speed == item.speed else -9.0))
        said.append(f'{strategy.value}: {_sentence(best)}')
    return tuple(said)


def _sentence(trial: Trial) -> str:
    """Return how the best trial of a strategy did."""
    tally = trial.many if trial.many.attempts else trial.few
    touch = '' if math.isnan(trial.speed) else f', touching at {trial.speed:.2f} m/s'
    if tally.attempts:
        return (f'over in {tally.over:.0f} of {tally.attempts:.0f} attempts, '
                f'{tally.falls:.0f} falls{touch}')
    if trial.falls:
        return f'cannot be stopped behind the edge{touch}'
    if trial.level == 0:
        return f'does not get over{touch}' if touch else 'not gentler than what was chosen'
    return f'gets over, but not as gently{touch}'
