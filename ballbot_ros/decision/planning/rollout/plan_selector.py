# SPDX-License-Identifier: Apache-2.0
"""
Keeps the selected plan between decisions, and replans when the obstacle estimate changes.

The first observation of a face starts a search with hundreds of rollouts, spread over several
decisions so that each one takes a bounded time.  Later decisions keep the plan and re-evaluate it
periodically with a few rollouts.  A new search starts only after a relevant change (estimated
height, much smaller uncertainty), or when the success probability has dropped; the plan stays
until that search ends, and beyond the last braking point no search replaces it.  All budgets count
rollouts, not time, so that a run is reproducible bit by bit.
"""
from dataclasses import dataclass, replace
import math
from typing import Generator, List, NamedTuple, Optional, Sequence, Tuple

from ballbot_ros.decision.learning.particles import Particles
from ballbot_ros.decision.planning.rollout.ahead import Ahead
from ballbot_ros.decision.planning.rollout.candidates import (
    BRISK, Candidate, candidates, from_farther_back)
from ballbot_ros.decision.planning.rollout.layout import TOUCH_SPEED
from ballbot_ros.decision.planning.rollout.search import (
    BEYOND, confirm, good, height_limit, search, Task, Trial, why_not)
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, Failure, Motion, Reason, Strategy

# Maximum speed gain of a swing [m/s].
KICK = 0.15
# Hysteresis: the previous plan is kept down to this below the required probability.
LOYALTY = 0.03
CHECKED = 80  # rollouts for checking that
# Hypothetical run-up that separates "too little run-up" from "too high" [m].
IMAGINED = 2.5
# After a failure, a plan must touch faster by this [m/s] or swing further by this [rad].
FASTER, FURTHER = 0.04, 0.3


@dataclass
class Choice:
    """
    Result of a search for the faces ahead.

    Attributes
    ----------
    trial : Trial or None
        Selected plan, None if every candidate was rejected.
    reason : Reason
        Reason of the selection or rejection.
    others : tuple of str
    tally : Tally
        Rollouts of the selected plan, or of the best rejected one.
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
        trial = Trial(kept)
        yield from confirm(trial, task, CHECKED)
        if good(trial.many, task.required - LOYALTY, BEYOND):
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
    """Return the trial with the least harm, then the best chance; None where none was tried."""
    def merit(trial: Trial) -> Tuple[float, float]:
        tally = trial.many if trial.many.attempts else trial.few
        return -tally.harm / tally.attempts, tally.probability
    return max((trial for trial in trials if trial.few.attempts), default=None, key=merit)


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
            tally.harm > 0.0 for tally in tallies):
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


# Rollouts of a search in each decision.
ROLLOUTS_PER_DECISION = 20
# Relevant change: of the height [m], or reduction of its deviation to this fraction.
HEIGHT_NEWS, SHRUNK = 0.002, 0.6
# Maximum distance for associating a face that has changed its number [m].
SAME_PLACE = 0.06
# Relevant increase of the clearance behind an edge [m].
ROOM_NEWS = 0.1
# Re-evaluation: period in decisions, rollouts, forgetting factor, and tally that it applies to.
EVERY, ATTEMPTS, FADE, MEMORABLE = 10, 24, 0.9, 300
# A plan is dropped when its probability is this far below the required one.
LOST = 0.05
# Maximum plan switches per face while the ball rolls.
CHANGES = 2
# Maximum speed of a standing ball [m/s], and position tolerance [m].
STANDING, THERE = 0.03, 0.05
# A ball with less braking room touches faster than 0.1 m/s [m].
TOO_LATE = -0.01


class Basis(NamedTuple):
    """Inputs of a selection, for detecting changes."""

    face: Face
    faces: int
    standing: bool
    failures: int
    free_from: float
    room_to: float


class PlanSelector:
    """
    Selects and keeps a plan for the faces ahead.

    Parameters
    ----------
    knowledge : Knowledge

    Attributes
    ----------
    choice : Choice or None
        None before the first search has a result.
    basis : Basis or None
        Inputs of the selection.

    """

    def __init__(self, knowledge: Knowledge):
        """Draw the worlds."""
        self._tuning = knowledge.tuning
        self.worlds = Worlds(knowledge)
        self.worlds.set_particles(knowledge.particles or Particles.of(
            knowledge.robot, knowledge.tuning.height_bias_sd))
        self.forget()

    def forget(self) -> None:
        """Discard the plan."""
        self.choice: Optional[Choice] = None
        self.basis: Optional[Basis] = None
        self._deliberation: Optional[Deliberation] = None
        self._task: Optional[Task] = None
        self._answers = self._changes = 0

    def update(self, ahead: Ahead, situation: Situation, braking_room: float) -> None:
        """Continue the search, or re-evaluate the plan, within the budget of one decision."""
        motion, face = situation.motion, ahead.faces[0]
        if self.basis is not None and not _is_same(self.basis.face, face):
            self.forget()
        failures = failures_at(face, situation)
        if situation.particles is not None:
            self.worlds.set_particles(situation.particles)
        self.worlds.see(ahead)
        task = Task(
            (motion.position, motion.speed, motion.pendulum_angle, motion.pendulum_rate),
            ahead, self.worlds, self._tuning.required_probability, self._tuning.highest_speed)
        now = Basis(face, len(ahead.faces), abs(motion.speed) < STANDING, len(failures),
                     situation.free_from, ahead.room_to)
        kept = self.choice.candidate if self.choice is not None else None
        if kept is not None and braking_room < 0.0:
            self._deliberation = None
        if self._deliberation is None:
            room = max(0.0, motion.position - situation.free_from)
            arrived = kept is not None and _arrived(kept, ahead, motion)
            if kept is not None and arrived:
                kept, room = from_here(kept), 0.0
            if arrived or self._is_news(now, braking_room):
                self._task, self.basis = task, now
                self._deliberation = deliberate(
                    task, self._tuning, room, kept, failures, braking_room < TOO_LATE)
        if self._deliberation is None or self._task is None:
            self._look_again(task, braking_room)
            return
        self._task.start, self._task.ahead = task.start, task.ahead
        spent = self.worlds.attempts
        try:
            while self.worlds.attempts - spent < ROLLOUTS_PER_DECISION:
                found = next(self._deliberation)
                if found is not None:
                    self._adopt(found)
        except StopIteration as end:
            self._adopt(end.value)
            self._deliberation = None

    def _adopt(self, choice: Choice) -> None:
        """Adopt the result of a search."""
        before = self.choice
        if before is not None:
            if before.candidate == choice.candidate and not choice.others:
                choice.limit, choice.others = before.limit, before.others
            self._changes += (before.trial is None) != (choice.trial is None)
        self.choice, self._answers = choice, 0

    def _is_news(self, now: Basis, braking_room: float) -> bool:
        """Return whether a new search is required."""
        then, choice = self.basis, self.choice
        if then is None or choice is None:
            return True
        if choice.trial is not None and braking_room < 0.0:
            # Beyond the last braking point, no other plan is safer than the present one.
            return False
        if now.failures != then.failures or now.faces != then.faces:
            return True
        if choice.trial is None:
            freed = now.free_from < then.free_from - 0.3
            if now.standing and (not then.standing or freed):
                return True
            if choice.reason is Reason.LANDING and now.room_to > then.room_to + ROOM_NEWS:
                return True
            if not now.standing and self._changes >= CHANGES - 1:
                return False
            known = now.face.height_sd < SHRUNK * then.face.height_sd
            # Less uncertainty gives no more room behind an edge.
            if known and choice.reason not in (Reason.TOO_HIGH, Reason.LANDING):
                return True
        return abs(now.face.height - then.face.height) > max(HEIGHT_NEWS, then.face.height_sd)

    def _look_again(self, task: Task, braking_room: float) -> None:
        """Re-evaluate the plan periodically with a few rollouts."""
        choice = self.choice
        self._answers += 1
        # Beyond the last braking point the result is only reported.
        every = EVERY if braking_room > 0.0 else 4 * EVERY
        if choice is None or choice.trial is None or self._answers % every:
            return
        trial = choice.trial
        new = task.tally(trial, task.worlds.take(ATTEMPTS))
        fade = FADE if choice.tally.attempts > MEMORABLE else 1.0
        choice.tally = choice.tally.faded(fade) + new
        lost = LOST * (1 + self._changes)
        if braking_room > 0.0 and not good(
                choice.tally, task.required - lost, BEYOND):
            self.basis = None


def failures_at(face: Face, situation: Situation) -> Sequence[Failure]:
    """Return the failures at a face."""
    return [failure for failure in situation.failures
            if failure.face == face.number or abs(failure.position - face.position) < 0.15]


def _is_same(one: Face, other: Face) -> bool:
    """Return whether two faces are one, whose number may have changed."""
    return one.number == other.number or (
        abs(one.position - other.position) < SAME_PLACE
        and abs(one.height - other.height) < HEIGHT_NEWS)


def _arrived(kept: Candidate, ahead: Ahead, motion: Motion) -> bool:
    """Return whether the ball has backed off to where its plan begins."""
    return (kept.back > 0.0 and motion.position < ahead.touch - kept.back + THERE
            and abs(motion.speed) < STANDING)
