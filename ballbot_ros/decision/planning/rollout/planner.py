# SPDX-License-Identifier: Apache-2.0
"""
The planner ``rollout``: plans simulated with the physics in sampled worlds.

`PlanSelector` keeps the selected plan between decisions, and replans when the obstacle estimate
changes.  The first observation of a face starts a search with hundreds of rollouts, spread over
several decisions so that each one takes a bounded time.  Later decisions keep the plan and
re-evaluate it periodically with a few rollouts.  A new search starts only after a relevant change
of the estimated height, or when the success probability has dropped.  It evaluates the plan first;
one that is no longer sufficient stays until the search ends, but not beyond the last braking
point.  There, no search replaces a sufficient plan.  All budgets count rollouts, not time, so that
a run is reproducible bit by bit.
"""
from dataclasses import replace
import math
from typing import Generator, List, NamedTuple, Optional, Sequence, Tuple

from ballbot_ros.decision.planning.ahead import Ahead, Candidate
from ballbot_ros.decision.planning.face_planner import Choice, POSITION_TOLERANCE, Selector
from ballbot_ros.decision.planning.rollout.rollout import TOUCH_SPEED
from ballbot_ros.decision.planning.rollout.search import (
    candidates, confirm, from_farther_back, good, height_limit, highest_step, passing, search,
    slower, Task, Trial, why_not)
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Failure, Reason

KEPT_PLAN_ROLLOUTS = 80  # rollouts for checking the present plan
# A kept plan is rejected if its harm exceeds the permitted one by this many standard deviations.
HARM_SIGMAS = 2.0
# Hypothetical run-up that separates "too little run-up" from "too high" [m].
HYPOTHETICAL_RUN_UP = 2.5
# After a failure, a plan must touch faster by this [m/s] or swing further by this [rad].
SPEED_INCREASE_MIN, SWING_INCREASE_MIN = 0.04, 0.3


class Found(NamedTuple):
    """A choice, and the rollouts of its plan."""

    choice: Choice
    tally: Tally


Deliberation = Generator[Optional[Found], None, Found]


def deliberate(task: Task, tuning: DecisionTuning, room_behind: float,
               kept: Optional[Candidate], failures: Sequence[Failure],
               hysteresis: float) -> Deliberation:
    """
    Select a plan for a task with an end ahead; a generator that yields after batches of rollouts.

    The ground behind the ball is free over `room_behind` [m].  The present plan, `kept`, remains
    while it is sufficient; without a better plan from here, its probability may be below the
    required one by `hysteresis`.  Below that, its choice has the reason EVALUATING during the
    search.
    """
    position, speed = task.start[:2]
    present = Trial(kept) if kept is not None and _promising([kept], failures) else None
    if present is not None:
        yield from confirm(present, task, KEPT_PLAN_ROLLOUTS)
        if good(present.many, task.required):
            return _found(present.candidate, Reason.LIKELY, present.many)
        if not good(present.many, task.required - hysteresis, HARM_SIGMAS):
            yield _found(present.candidate, Reason.EVALUATING, present.many)
            present = None
    trials: List[Trial] = []
    here = candidates(task.ahead, position, speed, tuning)
    chosen = yield from search(_promising(here, failures), task, trials)
    if chosen is None:
        chosen = present
    further = slower(task.ahead, tuning)
    if room_behind > 0.1:
        further.append(from_farther_back(task.ahead, position, room_behind, tuning))
    for plans in further:
        if chosen is None and not task.too_late:
            # Separate from the trials that were not sufficient before.
            own: List[Trial] = []
            chosen = yield from search(_promising(plans, failures), task, own)
            trials += own
    if task.too_late and (chosen is None or chosen.candidate.back > 0.0):
        chosen = _best([trial for trial in trials if trial.candidate.back == 0.0])
        if chosen is not None:
            yield from confirm(chosen, replace(task, required=0.0), KEPT_PLAN_ROLLOUTS)
            if chosen.many.probability > task.braking(KEPT_PLAN_ROLLOUTS):
                return _found(chosen.candidate, Reason.COMMITTED, chosen.many,
                              why_not(trials, chosen))
            chosen = None
    others = why_not(trials, chosen)
    if chosen is not None:
        found = _found(chosen.candidate, Reason.LIKELY, chosen.many, others)
        yield found
        limit = yield from height_limit(chosen.candidate, task)
        found.choice.outlook = replace(found.choice.outlook, height_limit=limit)
        return found
    best = _best(trials)
    reason = yield from _reason(task, trials, tuning, failures)
    found = _found(None, reason, Tally() if best is None else best.tally, others)
    if task.ahead.faces[0].height > 0.0:
        yield found
        limit = yield from highest_step([trial.candidate for trial in trials], task)
        found.choice.outlook = replace(found.choice.outlook, height_limit=limit)
    return found


def _found(candidate: Optional[Candidate], reason: Reason, tally: Tally,
           others: Tuple[str, ...] = ()) -> Found:
    return Found(Choice(candidate, reason, replace(tally.outlook, others=others)), tally)


def _best(trials: Sequence[Trial]) -> Optional[Trial]:
    """Return the trial with the least harm, then the highest probability; None without trials."""
    def merit(trial: Trial) -> Tuple[float, float]:
        return -trial.tally.harm / trial.tally.attempts, trial.tally.probability
    return max((trial for trial in trials if trial.few.attempts), default=None, key=merit)


def _promising(found: Sequence[Candidate], failures: Sequence[Failure]) -> List[Candidate]:
    """Return the candidates that exceed each failed plan in touch speed or swing."""
    return [item for item in found if all(_more(item, failure) for failure in failures)]


def _more(item: Candidate, failure: Failure) -> bool:
    """Return whether a candidate exceeds a failed plan."""
    swung = failure.plan.swing_angle if math.isfinite(failure.plan.swing_position) else 0.0
    return exceeds(item, failure.plan.speed, swung) \
        or item.back > failure.run_up + POSITION_TOLERANCE


def exceeds(item: Candidate, speed: float, angle: float) -> bool:
    """Return whether a candidate touches faster than at a speed, or swings past an angle."""
    return item.speed > speed + SPEED_INCREASE_MIN or item.angle > angle + SWING_INCREASE_MIN


def _reason(task: Task, trials: Sequence[Trial], tuning: DecisionTuning,
            failures: Sequence[Failure]) -> Generator[None, None, Reason]:
    """Return the reason why no plan is sufficient."""
    if not trials:
        return Reason.FAILED_BEFORE if failures else Reason.NOT_LIKELY
    if any(trial.falls or trial.tally.attempts
           and trial.tally.over >= task.required * trial.tally.attempts for trial in trials):
        return Reason.LANDING
    if task.ahead.faces[0].height < 0.0:
        return Reason.DROP
    far = from_farther_back(task.ahead, task.ahead.touch - 0.01, HYPOTHETICAL_RUN_UP, tuning,
                            (1.2, HYPOTHETICAL_RUN_UP))
    plans = _promising(far, failures)
    if not plans:
        return Reason.FAILED_BEFORE if failures else Reason.TOO_HIGH
    results = task.attempt(plans, task.worlds.middle())[:, 0]
    yield
    tally = Tally.of(results[results[:, TOUCH_SPEED] <= task.highest_speed])
    if failures and tally.over:
        return Reason.FAILED_BEFORE
    if not tally.over:
        return Reason.TOO_HIGH
    return Reason.NOT_LIKELY if passing(trials, task.highest_speed) else Reason.NO_ROOM


# Rollouts of a search in each decision.
ROLLOUTS_PER_DECISION = 20
# Re-evaluation: period in decisions, and rollouts.
REEVALUATION_PERIOD, REEVALUATION_ROLLOUTS = 10, 24


class PlanSelector(Selector):
    """Selects plans by rollouts; see the module."""

    def __init__(self, knowledge: Knowledge):
        self._tuning = knowledge.tuning
        self.worlds = Worlds(knowledge)
        super().__init__()

    def forget(self) -> None:
        """Discard the plan, and the search."""
        super().forget()
        self._deliberation: Optional[Deliberation] = None
        self._is_selected = False  # the deliberation computes the height limit only
        self._task: Optional[Task] = None
        self._tally, self._answers = Tally(), 0

    def update(self, ahead: Ahead, situation: Situation, braking_room: float) -> None:
        """Continue the search, or re-evaluate the plan, within the budget of one decision."""
        now, motion = self._begin(ahead, situation, braking_room), situation.motion
        kept = self.plan
        if situation.particles is not None:
            self.worlds.set_particles(situation.particles)
        task = Task(
            (motion.position, motion.speed, motion.pendulum_angle, motion.pendulum_rate),
            ahead, self.worlds, self._tuning.required_probability, self._tuning.highest_speed,
            braking_room < 0.0)
        if self.choice is not None and kept is not None and braking_room < 0.0:
            if self.choice.reason is Reason.EVALUATING:
                self.choice = None
            else:
                self._deliberation = None
        if (self._deliberation is None or self._is_selected) \
                and self._must_select(now, braking_room):
            self._task, self.basis, self._is_selected = task, now, False
            self._deliberation = deliberate(
                task, self._tuning, max(0.0, motion.position - situation.free_from), kept,
                situation.failures_at(now.face), self._hysteresis)
        if self._deliberation is None or self._task is None:
            self._reevaluate(task, braking_room)
            return
        self._task.start, self._task.ahead = task.start, ahead
        self._task.too_late = task.too_late
        self.worlds.see(ahead)
        spent = self.worlds.attempts
        try:
            while self.worlds.attempts - spent < ROLLOUTS_PER_DECISION:
                found = next(self._deliberation)
                if found is not None:
                    self._take(found)
                    self._is_selected = found.choice.reason is not Reason.EVALUATING
        except StopIteration as end:
            self._take(end.value)
            self._deliberation = None

    def _take(self, found: Found) -> None:
        """Adopt the result of a search."""
        before, choice = self.choice, found.choice
        if before is not None and before.candidate == choice.candidate \
                and not choice.outlook.others:
            choice.outlook = replace(choice.outlook, others=before.outlook.others,
                                     height_limit=before.outlook.height_limit)
        self._adopt(choice)
        self._tally, self._answers = found.tally, 0

    def _reevaluate(self, task: Task, braking_room: float) -> None:
        """Re-evaluate the plan periodically with a few rollouts."""
        choice = self.choice
        self._answers += 1
        # Beyond the last braking point the result is only reported.
        every = REEVALUATION_PERIOD if braking_room > 0.0 else 4 * REEVALUATION_PERIOD
        if choice is None or choice.candidate is None or self._answers % every:
            return
        self.worlds.see(task.ahead)
        self._tally = task.continued(choice.candidate, self._tally, REEVALUATION_ROLLOUTS)
        choice.outlook = replace(self._tally.outlook, others=choice.outlook.others,
                                 height_limit=choice.outlook.height_limit)
        if not self._is_fixed(braking_room) \
                and not good(self._tally, task.required - self._hysteresis, HARM_SIGMAS):
            self.basis = None
