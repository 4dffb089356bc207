# SPDX-License-Identifier: Apache-2.0
"""
Motion of the ball under the plans of a `Selector`.

`FacePlanner` decides the motion while plans are evaluated, on the step, without obstacles ahead,
and before obstacles that are not crossed.  A selector keeps its plan, or its refusal, until the
obstacle estimate changes.
"""
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
import math
from typing import Callable, NamedTuple, Optional

from ballbot_ros.decision.planning.ahead import (
    Ahead, Candidate, CONTACT_TIME_MAX, faces_ahead, look_ahead, passed)
from ballbot_ros.decision.planning.safety_filter import past_braking, stop
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.planning.stop_line import LINE_MARGIN, StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    After, Decision, Face, Kind, Motion, Outlook, Plan, Reason, REST_SPEED_MAX, Strategy)

# Relevant change of the height, and increase of the clearance behind an edge [m].
HEIGHT_CHANGE, ROOM_CHANGE = 0.002, 0.1
# A plan is dropped when its probability is this far below the required one.
PROBABILITY_HYSTERESIS = 0.05
# Tolerance of the start of a plan [m].
POSITION_TOLERANCE = 0.05


@dataclass
class Choice:
    """Selected plan for the faces ahead, or the reason why none was selected."""

    candidate: Optional[Candidate]  # None if every candidate was rejected
    reason: Reason  # of the selection or rejection
    outlook: Outlook = Outlook()  # of the selected plan, or of the best rejected one
    required_speed: float = math.nan  # see `Decision` [m/s]
    reachable_speed: float = math.nan


class Basis(NamedTuple):
    """Inputs of a selection, for detecting changes."""

    face: Face
    faces: int
    standing: bool
    failures: int
    free_from: float
    room_to: float
    slope_sd: float


class Selector(ABC):
    """Selects and keeps a plan for the faces ahead."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Discard the plan."""
        self.choice: Optional[Choice] = None  # None before the first result
        self.basis: Optional[Basis] = None  # inputs of the selection
        self._changes = 0

    @abstractmethod
    def update(self, ahead: Ahead, situation: Situation, braking_room: float) -> None:
        """
        Select or re-evaluate the plan for the faces ahead, with at least one end.

        `braking_room`: distance to the last braking point of the weakest robot [m].
        """

    @property
    def plan(self) -> Optional[Candidate]:
        """Return the selected plan."""
        return self.choice.candidate if self.choice is not None else None

    def evaluates(self, face: Face) -> bool:
        """Return whether plans for a face are being evaluated, or have been."""
        return self.basis is not None and self.basis.face.number == face.number

    def _begin(self, ahead: Ahead, situation: Situation, braking_room: float) -> Basis:
        """Return the inputs of a selection; a plan that they invalidate is discarded."""
        motion, face = situation.motion, ahead.faces[0]
        if self.basis is not None and self.basis.face.number != face.number:
            self.forget()
        elif self.choice is not None and self.choice.reason is Reason.COMMITTED \
                and braking_room > 0.0:
            self.forget()  # a plan that was selected past the last braking point
        now = Basis(face, len(ahead.faces), abs(motion.speed) < REST_SPEED_MAX,
                    len(situation.failures_at(face)), situation.free_from, ahead.room_to,
                    ahead.slope_sd)
        kept = self.plan
        if self.choice is not None and kept is not None:
            # Edges too close to stop between remain so when their estimates change.
            end = kept.end(ahead)
            kept = replace(kept, length=ahead.length(end))
            # The start moves with the estimate of the face, within the ground that is free.
            start = max(ahead.touch - kept.back, situation.free_from)
            if kept.back > 0.0 and now.standing and motion.position < start + POSITION_TOLERANCE:
                # It was confirmed from this start before the ball backed off.
                kept = replace(kept, back=0.0, strategy=Strategy.CARRY if end.faces > 1 else
                               Strategy.SWING if kept.angle > 0.0 else Strategy.ACCELERATE)
            self.choice.candidate = kept
        return now

    def _adopt(self, choice: Choice) -> None:
        """Adopt the result of a selection."""
        if self.choice is not None:
            self._changes += (self.plan is None) != (choice.candidate is None)
            if self.choice.reason in PERMANENT_REASONS and choice.candidate is None:
                choice.reason = self.choice.reason
        self.choice = choice

    @property
    def _hysteresis(self) -> float:
        """Return how far the probability of a kept plan may be below the required one."""
        return PROBABILITY_HYSTERESIS * (1 + self._changes)

    def _is_fixed(self, braking_room: float) -> bool:
        """
        Return whether the present plan is not compared with others.

        Beyond the last braking point, no other plan is safer.  A plan with a longer run-up is
        compared again at rest at its start, not while the ball backs off.
        """
        return self.plan is not None and (braking_room < 0.0 or self.plan.back > 0.0)

    def _must_select(self, now: Basis, braking_room: float) -> bool:
        """Return whether a new selection is required."""
        then, choice = self.basis, self.choice
        if then is None or choice is None:
            return True
        if self._is_fixed(braking_room):
            return False
        if now.failures != then.failures or now.faces != then.faces:
            return True
        if choice.candidate is None:
            freed = now.free_from < then.free_from - 0.3
            if now.standing and (not then.standing or freed) \
                    or now.slope_sd < 0.75 * then.slope_sd:
                return True
            if choice.reason is Reason.LANDING and now.room_to > then.room_to + ROOM_CHANGE:
                return True
            if not now.standing and self._changes:
                return False
        return abs(now.face.height - then.face.height) > max(HEIGHT_CHANGE, then.face.height_sd)


WHY = {
    Reason.NOT_LIKELY: 'no plan crosses it with the required probability',
    Reason.LANDING: 'the ball could not be stopped behind the edge',
    Reason.TOO_HIGH: 'no plan crosses it from any start; find another way',
    Reason.NO_ROOM: 'a longer run-up is required',
    Reason.FAILED_BEFORE: 'it failed before, and no faster plan or larger swing is left',
    Reason.DROP: 'the ball does not descend it',
    Reason.WALL: 'a wall; find another way',
    Reason.TOO_FAST: 'even if the ball brakes, it touches faster than the curve covers',
    Reason.EVALUATING: 'evaluating plans',
}
# Reasons to find another way, which further observations do not change.
PERMANENT_REASONS = (Reason.TOO_HIGH, Reason.FAILED_BEFORE, Reason.WALL)


def go(choice: Choice, candidate: Candidate, ahead: Ahead, motion: Motion,
       tuning: DecisionTuning) -> Decision:
    """Return the decision to execute a plan."""
    face, end, back = ahead.faces[0], candidate.end(ahead), candidate.back > 0.0
    seen = choice.outlook
    # The decision is repeated after backing off: until then, the speed of the approach is limited.
    speed = min(candidate.speed, tuning.cruise_speed) if back else candidate.speed
    plan = Plan(
        candidate.strategy, ahead.touch - candidate.back if back else -math.inf, speed,
        ahead.touch - candidate.swing, candidate.angle, end.passed, end.after)
    where = f'{1e3 * face.height:.0f} mm at {face.position - motion.position:.2f} m'
    how = f'{candidate.strategy.value} at up to {candidate.speed:.2f} m/s'
    if math.isfinite(plan.swing_position):
        how += (f', pendulum to {math.degrees(candidate.angle):.0f} deg '
                f'{candidate.swing:.2f} m before the touch')
    started = choice.reason is Reason.COMMITTED or seen.braking_room < 0.0
    reason = Reason.RUN_UP if back else Reason.COMMITTED if started else choice.reason
    text = f'{where}: {how}'
    if math.isfinite(seen.probability):
        text += f', over with {100 * seen.probability:.0f} %{_basis(choice)}'
    if back:
        text = f'{where}: back off by {motion.position - plan.start:.2f} m first; {text}'
    return Decision(
        Kind.BACK_OFF if back else Kind.CROSS, reason, speed, text,
        choice.required_speed, choice.reachable_speed, face.height,
        distance=face.position - motion.position, step=face.number,
        plan=plan, outlook=seen)


def _basis(choice: Choice) -> str:
    """Return the basis of a probability as text."""
    if choice.outlook.attempts:
        return f' ({choice.outlook.attempts} attempts)'
    if math.isfinite(choice.required_speed):
        return (f' ({choice.required_speed:.2f} m/s required, '
                f'{choice.outlook.touch_speed:.2f} m/s at the touch)')
    return ''


def refuse(choice: Choice, ahead: Ahead, motion: Motion, tuning: DecisionTuning) -> Decision:
    """Return the decision not to cross the first face, without a stop position."""
    face, seen = ahead.faces[0], choice.outlook
    hopeless = choice.reason in PERMANENT_REASONS
    what = f'drop of {-1e3 * face.height:.0f} mm' if face.height < 0.0 else \
        f'{1e3 * face.height:.0f} mm'
    why = WHY.get(choice.reason, 'no plan is good enough')
    text = f'{what} at {face.position - motion.position:.2f} m: {why}'
    if choice.reason is Reason.LANDING and not ahead.known:
        text += (f'; the floor behind it is not observed, and unseen_room is '
                 f'{tuning.unseen_room:g} m: set unseen_room to the length of the floor '
                 'behind each edge, 1 m or more for a stop, or use a terrain sensor')
    if seen.probability < tuning.required_probability:
        text += (f'; at best over with {100 * seen.probability:.0f} %, but '
                 f'{100 * tuning.required_probability:.0f} % are required')
    text += _basis(choice)
    if seen.height_limit < face.height:
        text += f'; from here at most {1e3 * max(seen.height_limit, 0.0):.0f} mm'
    return Decision(
        Kind.GO_ROUND if hopeless else Kind.STOP, choice.reason, tuning.cruise_speed, text,
        choice.required_speed, choice.reachable_speed, face.height,
        face.position - motion.position, face.number, outlook=seen)


# The ball counts as on the step from this distance before the touch [m].
CONTACT_DISTANCE = 0.005


class FacePlanner:
    """Decides the motion for the plans of a selector; see `situation.Planner`."""

    def __init__(self, selector: Callable[[Knowledge], Selector], knowledge: Knowledge):
        self._tuning, self._robot = knowledge.tuning, knowledge.robot
        self._lines, self._selector = StopLines(knowledge), selector(knowledge)

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Return the decision on the ground ahead."""
        pushing = self._push(situation, previous)
        if pushing is not None:
            return pushing
        # The selection for the next faces continues during the stop behind an edge.
        decision = self._decide(situation, previous)
        return self._brake(situation.motion, previous) or decision

    def _decide(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide on the ground ahead of a ball that is clear of the last edge."""
        motion, profile = situation.motion, situation.profile
        faces = faces_ahead(profile, motion.position)
        committed = past_braking(previous, situation)
        steep = self._lines.steep(situation)
        if steep is not None and not committed:
            face_is_nearer = faces and steep.distance > 0.0 \
                and self._lines.before_face(faces[0]).position - motion.position \
                <= steep.distance - LINE_MARGIN
            if not face_is_nearer:
                return steep
        if not faces:
            self._selector.forget()
            return self._alone(situation, previous)
        line = self._lines.before_slope(profile, faces[0].position)
        behind = math.inf if line is None else line.position
        ahead = look_ahead(situation, faces, self._robot.ball_radius, self._tuning, behind,
                           committed or self._selector.evaluates(faces[0]))
        return self._face(ahead, situation, previous if committed else None)

    def _alone(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide without a face ahead: continue up to the stop line."""
        position, speed = situation.motion.position, self._tuning.cruise_speed
        line = self._lines.nearest(situation, ())
        if line is not None:
            room = line.obstacle - position - self._robot.ball_radius
            stop = self._lines.stop_before(Decision(
                Kind.STOP, line.reason, 0.0, f'Stopping before {line.explanation} at {room:.2f} m',
                distance=room), line.obstacle, situation)
            # STOP below half the cruise speed, CLEAR again at the full cruise speed.
            stopping = previous is not None and previous.kind in (Kind.STOP, Kind.GO_ROUND)
            if stop.set_speed < speed * (1.0 if stopping else 0.5):
                return stop
            speed = stop.set_speed
        return Decision(Kind.CLEAR, Reason.NOTHING_AHEAD, speed,
                        f'Nothing ahead: cruising at {speed:.2f} m/s',
                        plan=Plan(Strategy.CRUISE, position, speed))

    def _face(self, ahead: Ahead, situation: Situation, crossing: Optional[Decision]) -> Decision:
        """Decide on the faces ahead; `crossing`: a crossing past its last braking point."""
        motion, face, selector = situation.motion, ahead.faces[0], self._selector
        # The distance to the last braking point.
        room = ahead.touch - LINE_MARGIN - motion.position - self._lines.braking.distance(
            motion.speed, ahead.slope, emergency=True)
        if not ahead.ends or face.height > self._robot.ball_radius:
            selector.forget()
            # A face whose height is uncertain may also be a drop.
            choice = Choice(None, Reason.DROP if face.height < 0.0 else
                            Reason.WALL if face.height > self._robot.ball_radius else
                            Reason.NOT_LIKELY)
        else:
            selector.update(ahead, situation, room)
            choice = selector.choice or Choice(None, Reason.EVALUATING)
            if selector.choice is None and crossing is not None \
                    and crossing.contact_since is None:
                # The crossing continues until a plan for a newly detected face is selected.
                own = next((one for one in ahead.faces if one.number == crossing.step), face)
                return replace(crossing, distance=own.position - motion.position)
            if selector.choice is None and -self._tuning.highest_descent <= face.height < 0.0 \
                    and motion.speed > REST_SPEED_MAX and room < 0.0:
                # The descent is certain before its plan is evaluated.
                choice = Choice(Candidate(Strategy.CRUISE, min(
                    motion.speed, self._tuning.cruise_speed)), Reason.COMMITTED)
        choice = replace(choice, outlook=replace(
            choice.outlook, required=self._tuning.required_probability, braking_room=room))
        if choice.candidate is None:
            answer = refuse(choice, ahead, motion, self._tuning)
            if choice.reason is Reason.EVALUATING and abs(motion.speed) < REST_SPEED_MAX:
                # Keep the run-up of a ball at rest.
                return replace(answer, set_speed=0.0)
            return self._lines.stop_before(answer, face.position, situation)
        return go(choice, choice.candidate, ahead, motion, self._tuning)

    def _push(self, situation: Situation, previous: Optional[Decision]) -> Optional[Decision]:
        """Return the decision on the step: continue, unless the contact lasts too long."""
        motion, basis = situation.motion, self._selector.basis
        if previous is None or previous.kind is not Kind.CROSS or basis is None \
                or not motion.position < previous.plan.edge:
            return None
        faces = situation.profile.faces
        own = [face for face in faces if face.number == previous.step]
        face = own[0] if own else basis.face
        touch = face.touch(self._robot.ball_radius)
        if previous.contact_since is None and motion.position < touch - CONTACT_DISTANCE:
            if own or previous.reason is not Reason.COMMITTED:
                return None
            # The map no longer has the face of a crossing past its last braking point.
            return replace(previous, distance=face.position - motion.position)
        since = motion.stamp if previous.contact_since is None else previous.contact_since
        if not 0.0 <= motion.stamp - since <= CONTACT_TIME_MAX \
                or motion.position < touch - LINE_MARGIN and motion.speed < 0.0:
            self._selector.forget()
            return None
        edge = previous.plan.edge
        for face in faces:
            # Steps down behind a crest are observed late, and then farther away; a ball cannot
            # stop between closer edges.
            down = -self._tuning.highest_descent <= face.height < 0.0
            if motion.position < face.position < edge + self._robot.ball_radius * down:
                edge = max(edge, passed(face))
        # After the first of two edges, the second one remains.
        left = own or [face for face in faces if motion.position < face.position < edge]
        distance = left[0].position - motion.position if left else 0.0
        return replace(
            previous, reason=Reason.COMMITTED, distance=distance, contact_since=since,
            plan=replace(previous.plan, edge=edge),
            explanation=f'On the step, {distance:.2f} m to its face: continuing')

    def _brake(self, motion: Motion, previous: Optional[Decision]) -> Optional[Decision]:
        """Return the stop behind the last edge of a plan, until the ball is clear of the edge."""
        if previous is None or not (
                0.0 <= motion.position - previous.plan.edge < 0.5 * self._robot.ball_radius) \
                or motion.speed < REST_SPEED_MAX or previous.kind is Kind.CROSS \
                and previous.plan.after is not After.STOP:
            return None
        return replace(stop(Reason.LANDING, 'Stopping behind the edge'),
                       plan=Plan(Strategy.STOP, edge=previous.plan.edge))
