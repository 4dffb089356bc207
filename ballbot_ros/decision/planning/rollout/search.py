# SPDX-License-Identifier: Apache-2.0
"""
Plan search by successive halving: few rollouts for many candidates, many for few.

All candidates are simulated in the mean world with a step slightly higher than estimated, then
the successful ones with a higher step, and the others with the estimated step.  The best of each
level are compared in the same few worlds, and the selected one is confirmed in worlds that were
not used for the selection, so that the predicted probability has no selection bias.

A search is a generator: it yields after each batch of rollouts, so that the budget of a decision
is counted in rollouts, not in time.

If no candidate from here is sufficient, slower ones are searched, fastest first: after a descent,
the ball stops in less room.

A candidate is an approach under the speed law up to a speed, and a swing of the pendulum to an
angle at a distance before the touch, held until the edge is passed.  Plans with these three
parameters come within 2 mm of the highest steps that any plan was found to cross, and the same
regions are best for all sampled robots.  An early swing is a run-up with full lean.
"""
from dataclasses import dataclass, field, replace
import math
from typing import Generator, List, Optional, Sequence, Tuple

import numpy as np

from ballbot_ros.decision.planning.ahead import Ahead, Candidate
from ballbot_ros.decision.planning.rollout.rollout import (
    CONTINUES, EDGE, EDGE_AT, FALLS, NEXT_AT, OVER, PASSED_SPEED, PLAN, SPEED, START, Start,
    SWING_ANGLE, SWING_AT, TOUCH_SPEED, VERDICT)
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import After, Strategy
from ballbot_ros.physics.model.terrain import Array

SPEEDS = (0.1, 0.2, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1)  # [m/s]
SWINGS = (0.1, 0.2, 0.3, 0.42, 0.6, 0.9)  # before the touch [m]
ANGLES = (1.5, 2.2)  # [rad]
# Minimum speed gain of an acceleration [m/s].
SPEED_GAIN_MIN = 0.05
# Approximate acceleration with full lean [m/s2], and maximum speed gain of a swing [m/s].
LEAN_ACCELERATION, SWING_GAIN_MAX = 0.75, 0.15


def plan_row(candidate: Candidate, ahead: Ahead) -> Array:
    """Return the plan row of a candidate, (PLAN,)."""
    row = np.zeros(PLAN)
    end = candidate.end(ahead)
    row[SPEED] = candidate.speed
    row[SWING_AT] = ahead.touch - candidate.swing
    row[SWING_ANGLE] = candidate.angle
    row[START] = ahead.touch - candidate.back if candidate.back > 0.0 else math.inf
    row[EDGE] = end.passed
    row[EDGE_AT], row[NEXT_AT] = end.vertex, end.following
    row[CONTINUES] = end.after is After.CRUISE
    return row


def candidates(ahead: Ahead, position: float, speed: float, tuning: DecisionTuning
               ) -> List[Candidate]:
    """Return plans from a position [m] and speed [m/s] of the ball."""
    run_up = ahead.touch - position
    cruise = min(max(tuning.cruise_speed, speed), tuning.highest_speed)
    speeds = [cruise] + [item for item in SPEEDS
                         if cruise + SPEED_GAIN_MIN < item <= tuning.highest_speed]
    # No approach from here is faster; one unreachable speed is sufficient.
    reachable = SWING_GAIN_MAX + math.sqrt(
        max(speed, 0.0)**2 + 2.0 * LEAN_ACCELERATION * max(run_up, 0.0))
    beyond = [item for item in speeds if item > reachable]
    speeds = [item for item in speeds if item <= reachable] + beyond[:1]
    found = []
    for end in ahead.ends:
        for item in speeds:
            gentle = Strategy.CRUISE if item <= cruise + SPEED_GAIN_MIN else Strategy.ACCELERATE
            found.append(Candidate(gentle, item, length=ahead.length(end)))
        for item in speeds:
            found += swings(Candidate(Strategy.SWING, item, length=ahead.length(end)), run_up,
                            tuning)
    return [replace(item, strategy=Strategy.CARRY) if item.end(ahead).faces > 1 else item
            for item in found]


def slower(ahead: Ahead, tuning: DecisionTuning) -> List[List[Candidate]]:
    """Return plans below cruise speed, after which the ball stops in less room, fastest first."""
    return [[Candidate(Strategy.CARRY if end.faces > 1 else Strategy.CRUISE, speed,
                       length=ahead.length(end)) for end in ahead.ends]
            for speed in reversed(SPEEDS) if speed < tuning.cruise_speed - SPEED_GAIN_MIN]


def swings(plain: Candidate, run_up: float, tuning: DecisionTuning) -> List[Candidate]:
    """Return a candidate with the swings that fit into its run-up [m]."""
    # A swing that would start behind the ball starts immediately.
    near = [item for item in SWINGS if item < run_up]
    fitting = near if len(near) == len(SWINGS) else [*near, max(run_up, 0.02)]
    return [replace(plain, swing=swing, angle=angle) for swing in fitting for angle in ANGLES
            if angle <= tuning.largest_swing]


def from_farther_back(ahead: Ahead, position: float, room: float, tuning: DecisionTuning,
                      backs: Sequence[float] = (0.5, 0.8, 1.2, 1.8)) -> List[Candidate]:
    """Return plans that start at rest, up to `room` [m] behind the ball, nearest first."""
    run_up = ahead.touch - position
    most = run_up + room
    fitting = [back for back in backs if run_up + 0.1 < back < most]
    if most > run_up + 0.1 and most < backs[-1]:
        fitting.append(most)
    found = []
    for back in fitting:
        for end in ahead.ends:
            plain = [Candidate(Strategy.BACK_OFF, item, back=back, length=ahead.length(end))
                     for item in (0.7, 0.9, 1.0, 1.1) if item <= tuning.highest_speed]
            for item in plain:
                found.append(item)
                found += [one for one in swings(item, back, tuning)
                          if one.angle < 2.2 and (one.swing > 0.2 or back < 0.6)]
    return found


# Passes that rank candidates: the level of the trials, the levels that a crossing adds, and the
# multiple of its height deviation by which the step is raised.
PASSES = (0, 2, 1.3), (2, 1, 2.3), (0, 1, 0.0)
LEVEL_MAX = 3
# Number of finalists, and of common worlds for comparing them.
FINALISTS_MAX, COMPARISON_WORLDS = 8, 16
# Worlds for confirming a plan, and before the first check.
CONFIRMATION_ROLLOUTS, ROLLOUTS_BEFORE_CHECK = 200, 40
# Rollouts between two yields, and sufficient number of candidates at the highest level.
ROLLOUTS_PER_BATCH, SUFFICIENT_COUNT = 20, 6
# A candidate this far below the required probability at a check is rejected.
REJECTION_MARGIN = 0.12
CONFIRMED_MAX = 3
# The limit of the step height is searched up to this much above the step [m], in this number of
# worlds.
LIMIT_ABOVE_MAX, LIMIT_WORLDS = 0.04, 24
# Maximum fraction of rollouts of a permitted plan that end beyond the stop line behind the edge.
OVERRUN_FRACTION_MAX = 0.02


@dataclass
class Trial:
    """A candidate and its evaluation."""

    candidate: Candidate
    level: int = 0  # highest step that it crosses: 0 none, 1 as estimated, 2 and 3 raised
    speed: float = math.nan  # at the touch in the mean world [m/s]
    behind: float = math.inf  # speed behind the last edge in the mean world [m/s]
    falls: bool = False
    few: Tally = field(default_factory=Tally)
    many: Tally = field(default_factory=Tally)

    @property
    def tally(self) -> Tally:
        """Return the results with the most rollouts."""
        return self.many if self.many.attempts else self.few


@dataclass
class Task:
    """
    Start, terrain, worlds and requirements of a search.

    `start`, `ahead` and `too_late` are updated while a search continues over several decisions.
    """

    start: Start
    ahead: Ahead
    worlds: Worlds
    required: float
    highest_speed: float  # at touch [m/s]
    # The weakest robot is past its last braking point: the best plan is selected if it succeeds
    # more often than an emergency stop.
    too_late: bool = False

    def attempt(self, plans: Sequence[Candidate], worlds: Array, raised: float = 0.0) -> Array:
        """Return the results of each plan in each world, see `Worlds.attempt`."""
        return self.worlds.attempt(
            self.start, [plan_row(plan, self.ahead) for plan in plans], worlds, self.ahead, raised)

    def tally(self, candidate: Candidate, worlds: Array, raised: float = 0.0) -> Tally:
        """Return the results of a plan in some worlds."""
        return Tally.of(self.attempt([candidate], worlds, raised)[0], self.ahead.room_to)

    def continued(self, candidate: Candidate, tally: Tally, count: int) -> Tally:
        """Return a tally extended by more worlds, which are not those of the comparison."""
        worlds = self.worlds.sample(count, COMPARISON_WORLDS + int(tally.attempts))
        return tally + self.tally(candidate, worlds)

    def braking(self, number: int) -> float:
        """Return the probability that an emergency stop ends before the first face."""
        results = self.attempt([Candidate(Strategy.STOP, 0.0)], self.worlds.sample(number))
        return float(np.mean(np.isnan(results[0, :, TOUCH_SPEED])))


def search(plans: Sequence[Candidate], task: Task, trials: List[Trial]
           ) -> Generator[None, None, Optional[Trial]]:
    """
    Search among candidates; the generator returns the first sufficient trial, or None.

    All evaluations are appended to `trials`, for reporting why candidates were rejected.
    """
    trials += [Trial(plan) for plan in plans]
    yield from _sort(trials, task)
    finalists = _finalists(trials, task.highest_speed)
    # The gentlest finalist is not compared if it is already sufficient.
    if finalists and finalists[0].level == LEVEL_MAX:
        yield from confirm(finalists[0], task, CONFIRMATION_ROLLOUTS)
        if good(finalists[0].many, 0.5 * (task.required + 1.0)):
            return finalists[0]
    few = task.worlds.sample(COMPARISON_WORLDS)
    for trial in finalists:
        trial.few = task.tally(trial.candidate, few)
        yield
    best = max((trial.few.probability for trial in finalists), default=0.0)
    goal = task.required + 0.5 * max(best - task.required, 0.0)
    # The gentlest sufficient candidates first, then by probability.
    order = sorted(finalists, key=lambda item: (
        item.few.harm > 0.0, item.few.probability < goal, item.level < LEVEL_MAX,
        item.behind if item.few.probability >= goal else -item.few.probability))
    for trial in order[:CONFIRMED_MAX]:
        if trial.few.probability < task.required - REJECTION_MARGIN:
            continue
        yield from confirm(trial, task, CONFIRMATION_ROLLOUTS)
        if good(trial.many, task.required):
            return trial
    return None


def _sort(trials: List[Trial], task: Task) -> Generator[None, None, None]:
    """Evaluate the levels of trials, gentlest first, until enough have the highest level."""
    middle, spread = task.worlds.middle(), task.worlds.spread()
    # By the approximate touch speed.
    trials.sort(key=lambda trial: math.sqrt(
        trial.candidate.speed**2 + 2.0 * LEAN_ACCELERATION * max(trial.candidate.swing, 0.0)))
    for begin in range(0, len(trials), ROLLOUTS_PER_BATCH):
        bundle = trials[begin:begin + ROLLOUTS_PER_BATCH]
        for number, (level, added, raised) in enumerate(PASSES):
            chosen = [trial for trial in bundle if trial.level == level and not trial.falls]
            if chosen:
                results = task.attempt(
                    [trial.candidate for trial in chosen], middle, raised * spread)
                for trial, result in zip(chosen, results[:, 0]):
                    trial.falls = result[VERDICT] == FALLS
                    if number == 0:
                        trial.speed = float(result[TOUCH_SPEED])
                    if result[VERDICT] == OVER:
                        trial.level += added
                        trial.behind = float(result[PASSED_SPEED])
            yield
        if sum(trial.level == LEVEL_MAX for trial in trials) >= SUFFICIENT_COUNT:
            # The remaining ones are less gentle.
            break


def passing(trials: Sequence[Trial], highest_speed: float) -> List[Trial]:
    """Return the trials that cross the estimated step, with a touch no faster than permitted."""
    return [trial for trial in trials if trial.level > 0 and trial.speed <= highest_speed]


def _finalists(trials: Sequence[Trial], highest_speed: float) -> List[Trial]:
    """Return the trials of the highest level, gentlest first, then the others, fastest first."""
    return sorted(passing(trials, highest_speed), key=lambda trial: (
        -trial.level, trial.behind if trial.level == LEVEL_MAX else -trial.behind))[:FINALISTS_MAX]


def confirm(trial: Trial, task: Task, number: int) -> Generator[None, None, None]:
    """Simulate a plan in `number` worlds, or until it can no longer be `good`."""
    while trial.many.attempts < number:
        trial.many = task.continued(trial.candidate, trial.many, ROLLOUTS_PER_BATCH)
        yield
        if trial.many.attempts >= ROLLOUTS_BEFORE_CHECK and (
                trial.many.probability < task.required - REJECTION_MARGIN
                or trial.many.falls or trial.many.harm > OVERRUN_FRACTION_MAX * number):
            break


def good(tally: Tally, required: float, sigmas: float = 0.0) -> bool:
    """
    Return whether a plan is permitted: likely enough, with little harm and without falls.

    For a plan already permitted, harm, falls included, may exceed the limit by some `sigmas`.
    """
    most = OVERRUN_FRACTION_MAX * tally.attempts
    return tally.probability >= required and tally.harm <= most + sigmas * math.sqrt(most) \
        and (tally.falls == 0.0 or sigmas > 0.0)


def height_limit(candidate: Candidate, task: Task) -> Generator[None, None, float]:
    """Return the highest first face that a plan crosses with the required probability [m]."""
    height = task.ahead.faces[0].height
    worlds = task.worlds.sample(LIMIT_WORLDS)
    low, high = -abs(height), LIMIT_ABOVE_MAX
    for _ in range(7):
        middle = 0.5 * (low + high)
        tally = task.tally(candidate, worlds, middle)
        if tally.over >= task.required * tally.attempts:
            low = middle
        else:
            high = middle
        yield
    return height + low


def highest_step(plans: Sequence[Candidate], task: Task) -> Generator[None, None, float]:
    """Return the `height_limit` of the plan that crosses the highest step; NaN without plans."""
    low, high, middle = -task.ahead.faces[0].height, LIMIT_ABOVE_MAX, task.worlds.middle()
    for _ in range(6):
        raised, passing = 0.5 * (low + high), []
        for begin in range(0, len(plans), ROLLOUTS_PER_BATCH):
            bundle = plans[begin:begin + ROLLOUTS_PER_BATCH]
            results = task.attempt(bundle, middle, raised)[:, 0]
            passing += [plan for plan, result in zip(bundle, results) if result[VERDICT] == OVER
                        and result[TOUCH_SPEED] <= task.highest_speed]
            yield
        low, high = (raised, high) if passing else (low, raised)
        plans = passing or plans
    if not plans:
        return math.nan
    return (yield from height_limit(plans[0], task))


def why_not(trials: Sequence[Trial], chosen: Optional[Trial]) -> Tuple[str, ...]:
    """Return a sentence for the best of each strategy that was not chosen."""
    sentences = []
    for strategy in dict.fromkeys(trial.candidate.strategy for trial in trials):
        if chosen is not None and strategy is chosen.candidate.strategy:
            continue
        own = [trial for trial in trials if trial.candidate.strategy is strategy]
        best = max(own, key=lambda item: (item.many.attempts > 0, item.few.probability
                                          if item.few.attempts else 0.0, item.level,
                                          -item.speed if item.speed == item.speed else -9.0))
        sentences.append(f'{strategy.value}: {_sentence(best)}')
    return tuple(sentences)


def _sentence(trial: Trial) -> str:
    """Return the result of the best trial of a strategy as text."""
    tally = trial.tally
    touch = '' if math.isnan(trial.speed) else f', touching at {trial.speed:.2f} m/s'
    if tally.attempts:
        return (f'over in {tally.over:.0f} of {tally.attempts:.0f} attempts, '
                f'{tally.falls:.0f} falls{touch}')
    if trial.falls:
        return f'cannot be stopped behind the edge{touch}'
    if trial.level == 0:
        return f'does not cross it{touch}' if touch else 'not gentler than the selected plan'
    return f'crosses it, but not as gently{touch}'
