# SPDX-License-Identifier: Apache-2.0
"""From what lies ahead to a choice: a plan from here, from farther back, or a reason for none."""
from dataclasses import dataclass, replace
import math
from typing import Generator, List, Optional, Sequence, Tuple

from ballbot_ros.decision.plan import Strategy
from ballbot_ros.decision.rollout.candidates import (
    BRISK, Candidate, candidates, from_farther_back)
from ballbot_ros.decision.rollout.layout import TOUCH_SPEED
from ballbot_ros.decision.rollout.search import (
    BEYOND, confirm, FALLING, good, height_limit, search, Task, Trial, why_not)
from ballbot_ros.decision.rollout.worlds import Tally
from ballbot_ros.decision.situation import Failure
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Reason

# Speed that a swing adds at most [m/s].
KICK = 0.15
# A plan that was chosen before stays if it is no worse than this below what is required.
LOYALTY = 0.03
CHECKED = 80  # attempts that it gets for that
# A run-up of this room is imagined to tell "no room" from "too high" [m].
IMAGINED = 2.5
# A plan promises more than one that failed if it touches faster by this [m/s] or swings further.
FASTER, FURTHER = 0.04, 0.3


@dataclass
class Choice:
    """
    What is to be done about the faces ahead.

    Attributes
    ----------
    trial : Trial or None
        The plan, None for none.
    reason : Reason
        Why, or why not.
    others : tuple of str
    tally : Tally
        Attempts behind the answer; of the best plan that was not good enough, where none is.
    limit : float
        See `Outlook.height_limit` [m].

    """

    trial: Optional[Trial]
    reason: Reason
    others: Tuple[str, ...] = ()
    tally: Tally = Tally()
    limit: float = math.nan

    @property
    def candidate(self) -> Optional[Candidate]:
        """Return the plan."""
        return self.trial.candidate if self.trial is not None else None


Deliberation = Generator[Optional[Choice], None, Choice]


def deliberate(task: Task, tuning: DecisionTuning, room_behind: float,
               kept: Optional[Candidate], failures: Sequence[Failure],
               too_late: bool = False) -> Deliberation:
    """
    Choose; a generator that yields after each bundle of attempts.

    Parameters
    ----------
    task : Task
        Whose ahead has an end.
    tuning : DecisionTuning
    room_behind : float
        Free ground behind the ball [m].
    kept : Candidate or None
        The plan so far: it stays if it still does.
    failures : sequence of Failure
        At this face.
    too_late : bool
        Whether the ball cannot be stopped before the face any more: then the best plan is
        better than to brake.

    """
    position, speed = task.start[:2]
    if kept is not None:
        trial = Trial(kept, kept.row(task.ahead))
        yield from confirm(trial, task, CHECKED)
        if good(trial.many, task.ahead, task.required - LOYALTY):
            return Choice(trial, Reason.RUN_UP if kept.back > 0.0 else Reason.LIKELY,
                          tally=trial.many)
    run_up = max(task.ahead.touch - position, 0.0)
    reachable = math.sqrt(max(speed, 0.0)**2 + 2.0 * BRISK * run_up) + KICK
    trials: List[Trial] = []
    here = candidates(task.ahead, position, speed, tuning, reachable)
    chosen = yield from search(_promising(here, failures), task, trials)
    if chosen is None and too_late:
        chosen = _best(trials)
        if chosen is not None:
            yield from confirm(chosen, replace(task, required=0.0), CHECKED)
            return Choice(chosen, Reason.COMMITTED, why_not(trials, chosen), chosen.many)
    if chosen is None and room_behind > 0.1:
        back = from_farther_back(task.ahead, position, room_behind, tuning)
        # Apart from those that were not good enough from here.
        farther: List[Trial] = []
        chosen = yield from search(_promising(back, failures), task, farther)
        trials += farther
    others = why_not(trials, chosen)
    if chosen is not None:
        choice = Choice(chosen, Reason.RUN_UP if chosen.candidate.back > 0.0 else Reason.LIKELY,
                        others, chosen.many)
        yield choice
        choice.limit = yield from height_limit(chosen, task)
        return choice
    best = _best(trials)
    tally = Tally() if best is None else best.many if best.many.attempts else best.few
    reason = yield from _reason(task, trials, tuning, failures)
    return Choice(None, reason, others, tally)


def _best(trials: Sequence[Trial]) -> Optional[Trial]:
    """Return the trial that gets over most often, None where none was tried in earnest."""
    return max((trial for trial in trials if trial.few.attempts), default=None, key=lambda item: (
        item.many.probability if item.many.attempts else item.few.probability))


def _promising(found: Sequence[Candidate], failures: Sequence[Failure]) -> List[Candidate]:
    """Return the candidates that promise more than each plan that failed."""
    return [item for item in found if all(_more(item, failure) for failure in failures)]


def _more(item: Candidate, failure: Failure) -> bool:
    """Return whether a candidate does more than a plan that failed."""
    swung = failure.plan.swing_angle if math.isfinite(failure.plan.swing_position) else 0.0
    faster = item.speed > failure.plan.speed + FASTER
    return (faster and item.angle >= swung - 0.01) or item.angle > swung + FURTHER or (
        failure.plan.strategy is not Strategy.BACK_OFF and item.back > 0.0
        and item.angle >= swung - 0.01)


def _reason(task: Task, trials: Sequence[Trial], tuning: DecisionTuning,
            failures: Sequence[Failure]) -> Generator[None, None, Reason]:
    """Return why no plan will do."""
    if not trials:
        return Reason.FAILED_BEFORE if failures else Reason.NOT_LIKELY
    tallies = [trial.many if trial.many.attempts else trial.few for trial in trials
               if trial.few.attempts]
    if any(trial.falls for trial in trials) or any(
            tally.falls + tally.beyond > (FALLING if task.ahead.known else BEYOND)
            * tally.attempts for tally in tallies):
        return Reason.LANDING
    far = from_farther_back(task.ahead, task.ahead.touch - 0.01, IMAGINED, tuning,
                            (1.2, IMAGINED))
    rows = [item.row(task.ahead) for item in _promising(far, failures)]
    if not rows:
        return Reason.FAILED_BEFORE if failures else Reason.TOO_HIGH
    results = task.worlds.attempt(task.start, rows, task.worlds.middle(), task.ahead)[:, 0]
    yield
    tally = Tally.of(results[results[:, TOUCH_SPEED] <= task.highest_speed])
    if failures and tally.over:
        return Reason.FAILED_BEFORE
    return Reason.NO_ROOM if tally.over else Reason.TOO_HIGH


def from_here(candidate: Candidate) -> Candidate:
    """Return a plan whose start is reached."""
    return replace(candidate, back=0.0, strategy=Strategy.SWING if math.isfinite(candidate.swing)
                   else Strategy.ACCELERATE)
