# SPDX-License-Identifier: Apache-2.0
"""
The planner ``rollout``: plans simulated with the physics in sampled worlds.

`PlanSelector` keeps the selected plan between decisions, and replans when the obstacle estimate
changes.  The first observation of a face starts a search with hundreds of rollouts, spread over
several decisions so that each one takes a bounded time.  Later decisions keep the plan and
re-evaluate it periodically with a few rollouts.  A new search starts only after a relevant change
of the estimated height, or when the success probability has dropped; the plan stays until that
search ends, and beyond the last braking point no search replaces it.  All budgets count rollouts,
not time, so that a run is reproducible bit by bit.

`RolloutPlanner` decides the motion during a search, on the step, without obstacles ahead, and
before obstacles that are not crossed.
"""
from dataclasses import dataclass, replace
import math
from typing import Generator, List, NamedTuple, Optional, Sequence, Tuple

from ballbot_ros.decision.planning.rollout.ahead import (
    Ahead, FACE_SEPARATION, faces_ahead, HIGHEST_DESCENT, look_ahead, touch_distance_on)
from ballbot_ros.decision.planning.rollout.rollout import BRAKING_DISTANCE, TOUCH_SPEED
from ballbot_ros.decision.planning.rollout.search import (
    Candidate, candidates, confirm, from_farther_back, good, height_limit, search, Task,
    Trial, why_not)
from ballbot_ros.decision.planning.rollout.worlds import Tally, Worlds
from ballbot_ros.decision.planning.safety_filter import past_braking, stop
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    After, Decision, Face, Failure, Kind, Motion, Outlook, Plan, Profile, Reason, REST_SPEED_MAX,
    Strategy)

KEPT_PLAN_ROLLOUTS = 80  # rollouts for checking the present plan
# Hypothetical run-up that separates "too little run-up" from "too high" [m].
HYPOTHETICAL_RUN_UP = 2.5
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
    Select a plan; a generator that yields after each batch of rollouts.

    Parameters
    ----------
    task : Task
        With at least one end ahead.
    tuning : DecisionTuning
    room_behind : float
        Free ground behind the ball [m].
    kept : Candidate or None
        The present plan, kept while it is sufficient.
    failures : sequence of Failure
        At this face.
    too_late : bool
        Whether the weakest robot is past its last braking point: then the best plan is
        selected if it succeeds more often than an emergency stop.

    """
    position, speed = task.start[:2]
    if kept is not None and _promising([kept], failures):
        trial = Trial(kept)
        yield from confirm(trial, task, KEPT_PLAN_ROLLOUTS)
        if good(trial.many, task.required):
            return Choice(trial, Reason.RUN_UP if kept.back > 0.0 else Reason.LIKELY,
                          tally=trial.many)
    trials: List[Trial] = []
    here = candidates(task.ahead, position, speed, tuning)
    chosen = yield from search(_promising(here, failures), task, trials)
    if chosen is None and too_late:
        chosen = _best(trials)
        if chosen is not None:
            yield from confirm(chosen, replace(task, required=0.0), KEPT_PLAN_ROLLOUTS)
            if chosen.many.probability > task.braking(KEPT_PLAN_ROLLOUTS):
                return Choice(chosen, Reason.COMMITTED, why_not(trials, chosen), chosen.many)
            chosen = None
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
    """Return the trial with the least harm, then the highest probability; None without trials."""
    def merit(trial: Trial) -> Tuple[float, float]:
        tally = trial.many if trial.many.attempts else trial.few
        return -tally.harm / tally.attempts, tally.probability
    return max((trial for trial in trials if trial.few.attempts), default=None, key=merit)


def _promising(found: Sequence[Candidate], failures: Sequence[Failure]) -> List[Candidate]:
    """Return the candidates that exceed each failed plan in touch speed or swing."""
    return [item for item in found if all(_more(item, failure) for failure in failures)]


def _more(item: Candidate, failure: Failure) -> bool:
    """Return whether a candidate exceeds a failed plan."""
    swung = failure.plan.swing_angle if math.isfinite(failure.plan.swing_position) else 0.0
    faster = item.speed > failure.plan.speed + FASTER
    return (faster and item.angle >= swung - 0.01) or item.angle > swung + FURTHER or (
        failure.plan.strategy is not Strategy.BACK_OFF and item.back > 0.0
        and item.angle >= swung - 0.01)


def _reason(task: Task, trials: Sequence[Trial], tuning: DecisionTuning,
            failures: Sequence[Failure]) -> Generator[None, None, Reason]:
    """Return the reason why no plan is sufficient."""
    if not trials:
        return Reason.FAILED_BEFORE if failures else Reason.NOT_LIKELY
    tallies = [trial.many if trial.many.attempts else trial.few for trial in trials
               if trial.few.attempts]
    if any(trial.falls for trial in trials) or any(
            tally.harm > 0.0 for tally in tallies):
        return Reason.LANDING
    far = from_farther_back(task.ahead, task.ahead.touch - 0.01, HYPOTHETICAL_RUN_UP, tuning,
                            (1.2, HYPOTHETICAL_RUN_UP))
    rows = [item.row(task.ahead) for item in _promising(far, failures)]
    if not rows:
        return Reason.FAILED_BEFORE if failures else Reason.TOO_HIGH
    results = task.worlds.attempt(task.start, rows, task.worlds.middle(), task.ahead)[:, 0]
    yield
    tally = Tally.of(results[results[:, TOUCH_SPEED] <= task.highest_speed])
    if failures and tally.over:
        return Reason.FAILED_BEFORE
    return Reason.NO_ROOM if tally.over else Reason.TOO_HIGH


# Rollouts of a search in each decision.
ROLLOUTS_PER_DECISION = 20
# Relevant change of the height [m].
HEIGHT_CHANGE = 0.002
# Relevant increase of the clearance behind an edge [m].
ROOM_CHANGE = 0.1
# Re-evaluation: period in decisions, and rollouts.
EVERY, ATTEMPTS = 10, 24
# A plan is dropped when its probability is this far below the required one.
PROBABILITY_HYSTERESIS = 0.05
# Tolerance of the start of a plan [m].
POSITION_TOLERANCE = 0.05


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
        self.forget()

    def forget(self) -> None:
        """Discard the plan."""
        self.choice: Optional[Choice] = None
        self.basis: Optional[Basis] = None
        self._deliberation: Optional[Deliberation] = None
        self._task: Optional[Task] = None
        self._answers = self._changes = 0

    def has_plan_for(self, face: Face) -> bool:
        """Return whether a plan for a face has been selected."""
        return self.choice is not None and self.choice.trial is not None \
            and self.basis is not None and self.basis.face.number == face.number

    def update(self, ahead: Ahead, situation: Situation, braking_room: float) -> None:
        """Continue the search, or re-evaluate the plan, within the budget of one decision."""
        motion, face = situation.motion, ahead.faces[0]
        if self.basis is not None and self.basis.face.number != face.number:
            self.forget()
        elif self.choice is not None and self.choice.reason is Reason.COMMITTED \
                and braking_room > 0.0:
            self.forget()  # plan with the least harm, past the last braking point
        failures = situation.failures_at(face)
        if situation.particles is not None:
            self.worlds.set_particles(situation.particles)
        self.worlds.see(ahead)
        task = Task(
            (motion.position, motion.speed, motion.pendulum_angle, motion.pendulum_rate),
            ahead, self.worlds, self._tuning.required_probability, self._tuning.highest_speed)
        now = Basis(face, len(ahead.faces), abs(motion.speed) < REST_SPEED_MAX, len(failures),
                    situation.free_from, ahead.room_to)
        kept = None
        if self.choice is not None and self.choice.trial is not None:
            # Two edges that were too close to stand between remain so while they are measured.
            trial = self.choice.trial
            kept = trial.candidate = replace(trial.candidate, faces=max(
                trial.candidate.faces, trial.candidate.end(ahead).faces))
            if kept.back > 0.0 and now.standing \
                    and motion.position < ahead.touch - kept.back + POSITION_TOLERANCE:
                # It was confirmed from this start before the ball backed off.
                kept = trial.candidate = replace(
                    kept, back=0.0, strategy=Strategy.CARRY if kept.faces > 1 else
                    Strategy.SWING if math.isfinite(kept.swing) else Strategy.ACCELERATE)
        if kept is not None and braking_room < 0.0:
            self._deliberation = None
        if self._deliberation is None and self._is_news(now, braking_room):
            self._task, self.basis = task, now
            self._deliberation = deliberate(
                task, self._tuning, max(0.0, motion.position - situation.free_from), kept,
                failures, braking_room < 0.0)
        if self._deliberation is None or self._task is None:
            self._reevaluate(task, braking_room)
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
            if choice.reason is Reason.LANDING and now.room_to > then.room_to + ROOM_CHANGE:
                return True
            if not now.standing and self._changes:
                return False
        return abs(now.face.height - then.face.height) > max(HEIGHT_CHANGE, then.face.height_sd)

    def _reevaluate(self, task: Task, braking_room: float) -> None:
        """Re-evaluate the plan periodically with a few rollouts."""
        choice = self.choice
        self._answers += 1
        # Beyond the last braking point the result is only reported.
        every = EVERY if braking_room > 0.0 else 4 * EVERY
        if choice is None or choice.trial is None or self._answers % every:
            return
        trial = choice.trial
        choice.tally = choice.tally + task.tally(trial, task.worlds.take(ATTEMPTS))
        lost = PROBABILITY_HYSTERESIS * (1 + self._changes)
        if braking_room > 0.0 and not good(
                choice.tally, task.required - lost):
            self.basis = None


WHY = {
    Reason.NOT_LIKELY: 'no plan crosses it with the required probability',
    Reason.LANDING: 'the ball could not be stopped behind the edge',
    Reason.TOO_HIGH: 'no plan crosses it from any start; find another way',
    Reason.NO_ROOM: 'a longer run-up is required',
    Reason.FAILED_BEFORE: 'it failed before, and no faster plan or larger swing is left',
    Reason.DROP: 'the floor falls away',
    Reason.WALL: 'a wall; find another way',
    Reason.EVALUATING: 'evaluating plans',
}
# Reasons to find another way, which further observations do not change.
PERMANENT_REASONS = (Reason.TOO_HIGH, Reason.FAILED_BEFORE, Reason.WALL)


def outlook(choice: Choice, required: float, braking_room: float) -> Outlook:
    """Return the predicted outcome of a choice."""
    tally = choice.tally
    number = max(tally.attempts, 1.0)
    known = tally.attempts > 0.0
    return Outlook(
        tally.probability if known else math.nan, tally.stuck / number if known else math.nan,
        tally.falls / number if known else math.nan, required, tally.speed, choice.limit,
        braking_room, int(round(tally.attempts)), choice.others)


def go(choice: Choice, candidate: Candidate, ahead: Ahead, motion: Motion, next_at: float,
       braking_room: float, tuning: DecisionTuning) -> Decision:
    """Return the decision to carry out a plan; `next_at`: of the centre at the next obstacle."""
    face, end, back = ahead.faces[0], candidate.end(ahead), candidate.back > 0.0
    # The decision is repeated after backing off: until then no step is crossed at any speed.
    speed = min(candidate.speed, tuning.cruise_speed) if back else candidate.speed
    plan = Plan(
        candidate.strategy, ahead.touch - candidate.back if back else -math.inf, speed,
        ahead.touch - candidate.swing, candidate.angle, end.passed,
        After.STOP if next_at - end.position < BRAKING_DISTANCE else After.CRUISE)
    seen = outlook(choice, tuning.required_probability, braking_room)
    where = f'{1e3 * face.height:.0f} mm at {face.position - motion.position:.2f} m'
    how = f'{candidate.strategy.value} at up to {candidate.speed:.2f} m/s'
    if math.isfinite(plan.swing_position):
        how += (f', pendulum to {math.degrees(candidate.angle):.0f} deg '
                f'{candidate.swing:.2f} m before the touch')
    started = choice.reason is Reason.COMMITTED or braking_room < 0.0
    reason = Reason.RUN_UP if back else Reason.COMMITTED if started else Reason.LIKELY
    said = f'{where}: {how}, over with {100 * seen.probability:.0f} % ({seen.attempts} attempts)'
    if back:
        said = f'{where}: back to {motion.position - plan.start:.2f} m behind here first; {said}'
    return Decision(
        Kind.BACK_OFF if back else Kind.CROSS, reason, speed, said,
        height=face.height, height_margin=choice.limit - face.height,
        distance=face.position - motion.position, step=face.number,
        start_distance=motion.position - plan.start if back else 0.0,
        swing_distance=plan.swing_position - motion.position, plan=plan, outlook=seen)


def refuse(choice: Choice, ahead: Ahead, motion: Motion, braking_room: float,
           tuning: DecisionTuning) -> Decision:
    """Return the decision not to cross the first face, without a stop position."""
    face = ahead.faces[0]
    seen = outlook(choice, tuning.required_probability, braking_room)
    hopeless = choice.reason in PERMANENT_REASONS
    what = f'drops by {-1e3 * face.height:.0f} mm' if face.height < 0.0 else \
        f'{1e3 * face.height:.0f} mm'
    why = WHY.get(choice.reason, 'no plan is good enough')
    said = f'{what} at {face.position - motion.position:.2f} m: {why}'
    if choice.reason is Reason.LANDING and not ahead.known:
        said += (f'; the floor behind it is not seen, and unseen_room grants '
                 f'{tuning.unseen_room:g} m: set unseen_room to the floor that this site has '
                 'behind each edge, 1 m or more for a stop, or use a terrain sensor')
    if seen.probability < tuning.required_probability:
        said += (f'; at best over with {100 * seen.probability:.0f} %, '
                 f'{100 * tuning.required_probability:.0f} % are required')
    return Decision(
        Kind.GO_ROUND if hopeless else Kind.STOP, choice.reason, tuning.cruise_speed, said,
        height=face.height, distance=face.position - motion.position, step=face.number,
        outlook=seen)


# The ball counts as on the step from this distance before the touch [m], for at most this [s].
CONTACT, LONGEST_CONTACT = 0.005, 3.0
# Clearance of a stop before a touch [m].
GAP = 0.03
# Of the slope, where it is not seen [rad].
SLOPE_SD = 0.01


class RolloutPlanner:
    """
    See the module.

    Parameters
    ----------
    knowledge : Knowledge

    """

    def __init__(self, knowledge: Knowledge):
        """Draw the worlds."""
        self._tuning, self._robot = knowledge.tuning, knowledge.robot
        self._lines, self._selector = StopLines(knowledge), PlanSelector(knowledge)
        self._passed: List[Face] = []

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide on the ground ahead; see `situation.Planner`."""
        motion, profile = situation.motion, situation.profile
        if profile is None:
            return stop(Reason.STALE, 'Stopping: nothing has been observed yet')
        climbed = self._climbed(motion)
        pushing = self._push(situation, previous)
        if pushing is not None:
            return pushing
        # The search for the next faces continues during the stop behind an edge.
        decision = self._decide(profile, climbed, situation, previous)
        return self._brake(motion, previous) or decision

    def _decide(self, profile: Profile, climbed: float, situation: Situation,
                previous: Optional[Decision]) -> Decision:
        """Decide on the ground ahead of a ball that is clear of the last edge."""
        motion = situation.motion
        faces = faces_ahead(profile, motion.position)
        slope = situation.slope
        steep = self._lines.steep(situation)
        if steep is not None and not past_braking(previous, situation) and not (
                faces and self._lines.face_is_nearer(faces[0], steep, motion.position)):
            return steep
        if not faces:
            self._selector.forget()
            return self._alone(situation, previous)
        deviation = profile.slope_sd if math.isfinite(profile.slope_sd) else SLOPE_SD
        line = self._lines.before_slope(profile, faces[0].position)
        behind = math.inf if line is None else line.position
        ahead = look_ahead(profile, faces, motion.position, slope, deviation,
                           self._robot.ball_radius, self._tuning.unseen_room, climbed, behind,
                           self._selector.has_plan_for(faces[0]))
        if not ahead.ends and -HIGHEST_DESCENT < faces[0].height and (
                past_braking(previous, situation)
                or self._braking_room(ahead, motion) < 0.0):
            # A planned descent of a small drop is better than an unplanned one.
            ahead = look_ahead(profile, faces, motion.position, slope, deviation,
                               self._robot.ball_radius, self._tuning.unseen_room,
                               HIGHEST_DESCENT, behind)
        return self._face(ahead, situation, previous)

    def _alone(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide without a face ahead: continue up to the stop line."""
        lines = self._lines
        clear, line = lines.cruise(situation), lines.nearest(situation, ())
        if line is None:
            return clear
        room = line.obstacle - situation.motion.position - self._robot.ball_radius
        stop = lines.stop_before(
            replace(clear, kind=Kind.STOP, reason=line.reason, distance=room,
                    explanation=f'Stopping before {line.explanation} at {room:.2f} m'),
            line.obstacle, situation)
        # STOP below half of the cruise speed, CLEAR again at all of it.
        stopping = previous is not None and previous.kind in (Kind.STOP, Kind.GO_ROUND)
        if stop.set_speed < self._tuning.cruise_speed * (1.0 if stopping else 0.5):
            return stop
        return replace(clear, set_speed=stop.set_speed)

    def _face(self, ahead: Ahead, situation: Situation,
              previous: Optional[Decision]) -> Decision:
        """Decide on the faces ahead."""
        motion, face, selector = situation.motion, ahead.faces[0], self._selector
        room = self._braking_room(ahead, motion)
        if not ahead.ends or face.height > self._robot.ball_radius:
            selector.forget()
            choice = Choice(None, Reason.DROP if face.height < 0.0 else Reason.WALL)
        else:
            selector.update(ahead, situation, room)
            choice = selector.choice or Choice(None, Reason.EVALUATING)
            if choice.trial is None and face.height < 0.0 and motion.speed > REST_SPEED_MAX and (
                    past_braking(previous, situation) or room < 0.0):
                # The descent is certain and needs neither a search nor more speed.
                choice = Choice(Trial(Candidate(Strategy.CRUISE, min(
                    motion.speed, self._tuning.cruise_speed))), Reason.COMMITTED)
        if choice.trial is None:
            answer = refuse(choice, ahead, motion, room, self._tuning)
            if choice.reason is Reason.EVALUATING and abs(motion.speed) < REST_SPEED_MAX:
                # Keep the run-up of a ball at rest.
                return replace(answer, set_speed=0.0, plan=Plan(Strategy.STOP))
            return self._lines.stop_before(answer, face.position, situation)
        end = choice.trial.candidate.end(ahead)
        later = [item.position - self._robot.ball_radius for item in ahead.faces
                 if item.position > end.position + 1e-3]
        return go(choice, choice.trial.candidate, ahead, motion, min(later, default=math.inf),
                  room, self._tuning)

    def _climbed(self, motion: Motion) -> float:
        """Return the height of faces that the ball has just climbed [m]."""
        face = self._selector.basis.face if self._selector.basis is not None else None
        if face is not None and face.position < motion.position and face not in self._passed:
            self._passed.append(face)
        self._passed = [one for one in self._passed
                        if 0.0 < motion.position - one.position < FACE_SEPARATION]
        return sum({one.number: one.height for one in self._passed}.values())

    def _push(self, situation: Situation, previous: Optional[Decision]) -> Optional[Decision]:
        """Return the decision of a ball on the step: on, unless it lasts too long."""
        motion, basis = situation.motion, self._selector.basis
        if previous is None or previous.kind is not Kind.CROSS or previous.plan is None \
                or basis is None or not motion.position < previous.plan.edge:
            return None
        faces = situation.profile.faces if situation.profile is not None else ()
        own = [face for face in faces if face.number == previous.step]
        face = own[0] if own else basis.face
        touch = face.position - touch_distance_on(0.0, self._robot.ball_radius, face.height)
        if previous.contact_since is None and motion.position < touch - CONTACT:
            if own or previous.reason is not Reason.COMMITTED:
                return None
            # The map has lost the face of a crossing past its last braking point.
            return replace(previous, distance=face.position - motion.position)
        since = motion.stamp if previous.contact_since is None else previous.contact_since
        if not 0.0 <= motion.stamp - since <= LONGEST_CONTACT \
                or motion.position < touch - GAP and motion.speed < 0.0:
            self._selector.forget()
            return None
        # With two edges the second one is left when the first is passed.
        left = own or [face for face in faces
                       if motion.position < face.position < previous.plan.edge]
        distance = left[0].position - motion.position if left else 0.0
        return replace(
            previous, reason=Reason.COMMITTED, distance=distance, contact_since=since,
            step=left[0].number if left else previous.step,
            explanation=f'On the step, {distance:.2f} m to its face: pushing on')

    def _brake(self, motion: Motion, previous: Optional[Decision]) -> Optional[Decision]:
        """Return the stop behind the last edge of a plan, until the ball is clear of the edge."""
        plan = previous.plan if previous is not None else None
        if previous is None or plan is None or not (
                0.0 <= motion.position - plan.edge < 0.5 * self._robot.ball_radius) \
                or motion.speed < REST_SPEED_MAX or previous.kind is Kind.CROSS \
                and plan.after is not After.STOP:
            return None
        return replace(stop(Reason.LANDING, 'Stopping behind the edge'),
                       plan=Plan(Strategy.STOP, edge=plan.edge))

    def _braking_room(self, ahead: Ahead, motion: Motion) -> float:
        """Return the distance to the last braking point [m]."""
        way = self._lines.braking.distance(motion.speed, ahead.slope, emergency=True)
        return ahead.touch - GAP - motion.position - way
