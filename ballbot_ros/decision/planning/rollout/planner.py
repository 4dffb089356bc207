# SPDX-License-Identifier: Apache-2.0
"""
The planner ``rollout``: plans tried out with the physics in the worlds that may be the real one.

`PlanSelector` selects the plan and its probability; here is what the ball does meanwhile, on the
step, where nothing is ahead, and before what it does not cross.
"""
from dataclasses import replace
import math
from typing import List, Optional, Sequence

from ballbot_ros.decision.planning.rollout.ahead import (
    Ahead, faces_ahead, HIGHEST_DESCENT, look_ahead, TOGETHER, touch_distance_on)
from ballbot_ros.decision.planning.rollout.candidates import Candidate
from ballbot_ros.decision.planning.rollout.layout import TIGHT
from ballbot_ros.decision.planning.rollout.plan_selector import (
    Choice, PlanSelector, STANDING, TOO_LATE)
from ballbot_ros.decision.planning.safety_filter import stop
from ballbot_ros.decision.planning.situation import Knowledge, Planner, Situation
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    After, Decision, Face, Kind, Motion, Outlook, Plan, Profile, Reason, Strategy)

WHY = {
    Reason.NOT_LIKELY: 'no plan gets over with the required probability',
    Reason.LANDING: 'the ball could not be stopped behind the edge',
    Reason.TOO_HIGH: 'no plan gets over from any start; find another way',
    Reason.NO_ROOM: 'only a longer run-up would do',
    Reason.FAILED_BEFORE: 'it was tried, and no plan that promises more is left',
    Reason.DROP: 'the floor falls away',
    Reason.WALL: 'a wall; find another way',
    Reason.TOO_FAST: 'the ball cannot be stopped before it any more',
    Reason.STUCK: 'the ball does not get on',
}
# Where waiting or looking again does not help.
HOPELESS = (Reason.TOO_HIGH, Reason.WALL, Reason.LANDING, Reason.FAILED_BEFORE)


def outlook(choice: Choice, required: float, braking_room: float) -> Outlook:
    """Return what is expected of a choice."""
    tally = choice.tally
    number = max(tally.attempts, 1.0)
    known = tally.attempts > 0.0
    return Outlook(
        tally.probability if known else math.nan, tally.stuck / number if known else math.nan,
        tally.falling if known else math.nan, required, tally.speed, choice.limit, braking_room,
        int(round(tally.attempts)), choice.others)


def plan_of(candidate: Candidate, ahead: Ahead, next_at: float) -> Plan:
    """
    Return the plan of a candidate.

    Parameters
    ----------
    candidate : Candidate
    ahead : Ahead
    next_at : float
        Where the centre meets what comes behind the plan's last edge [m].

    """
    end = candidate.end(ahead)
    after = After.STOP if next_at - end.position < TIGHT else After.CRUISE
    return Plan(
        candidate.strategy, ahead.touch - candidate.back if candidate.back > 0.0 else -math.inf,
        candidate.speed, ahead.touch - candidate.swing, candidate.angle, end.passed, after)


def go(choice: Choice, candidate: Candidate, ahead: Ahead, motion: Motion, next_at: float,
       braking_room: float, tuning: DecisionTuning) -> Decision:
    """Return the decision to carry out a plan."""
    plan = plan_of(candidate, ahead, next_at)
    face = ahead.faces[0]
    back = candidate.back > 0.0
    # Where it backs off to, it will be asked again: until then nothing is crossed at any speed.
    speed = min(candidate.speed, tuning.cruise_speed) if back else candidate.speed
    plan = replace(plan, speed=speed)
    seen = outlook(choice, tuning.required_probability, braking_room)
    where = f'{1e3 * face.height:.0f} mm at {face.position - motion.position:.2f} m'
    how = f'{candidate.strategy.value} at up to {candidate.speed:.2f} m/s'
    if math.isfinite(plan.swing_position):
        how += (f', pendulum to {math.degrees(candidate.angle):.0f} deg '
                f'{candidate.swing:.2f} m before the touch')
    reason = Reason.RUN_UP if back else Reason.COMMITTED if braking_room < 0.0 else Reason.LIKELY
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
    """Return the decision not to cross the first face; it does not say yet where to stand."""
    face = ahead.faces[0]
    seen = outlook(choice, tuning.required_probability, braking_room)
    hopeless = choice.reason in HOPELESS
    what = f'drops by {-1e3 * face.height:.0f} mm' if face.height < 0.0 else \
        f'{1e3 * face.height:.0f} mm'
    searching = choice.reason is Reason.NOT_LIKELY and not seen.attempts
    why = 'evaluating plans' if searching else WHY.get(choice.reason, 'no plan is good enough')
    said = f'{what} at {face.position - motion.position:.2f} m: {why}'
    if choice.reason is Reason.LANDING and not ahead.known:
        said += (f'; the floor behind it is not seen, and unseen_room grants '
                 f'{tuning.unseen_room:g} m: set unseen_room to the floor that this site has '
                 'behind each edge, 1 m or more for a stop, or use a terrain sensor')
    if seen.attempts:
        said += (f'; at best over with {100 * seen.probability:.0f} %, '
                 f'{100 * tuning.required_probability:.0f} % are required')
    return Decision(
        Kind.GO_ROUND if hopeless else Kind.STOP, choice.reason, tuning.cruise_speed, said,
        height=face.height, distance=face.position - motion.position, step=face.number,
        outlook=seen)


def weighing(ahead: Ahead, motion: Motion, tuning: DecisionTuning) -> Decision:
    """Return the decision of a ball that rolls on while plans are weighed."""
    face = ahead.faces[0]
    distance = face.position - motion.position
    return Decision(
        Kind.CLEAR, Reason.NOT_LIKELY, tuning.cruise_speed,
        f'{1e3 * face.height:.0f} mm at {distance:.2f} m: evaluating plans on the way',
        height=face.height,
        step=face.number, distance=distance)


# Faces beyond this distance are not evaluated yet [m].
FAR = 3.5
# The ball counts as on the step from this distance before the touch [m], for at most this [s].
CONTACT, LONGEST_CONTACT = 0.005, 3.0
# Clearance of a stop before a touch [m].
GAP = 0.03
# A face within this distance of the ball counts as a slope [m].
NEAR = 0.35
# Margin for announcing a stop, and distance kept from unobserved terrain [m].
AT_EASE = 0.2
# Reasons that further rollouts do not change.
DEFINITE = (Reason.TOO_HIGH, Reason.FAILED_BEFORE, Reason.STUCK)
# Of the slope, where it is not seen [rad].
SLOPE_SD = 0.01


def planner(knowledge: Knowledge) -> Planner:
    """Return the planner for a robot and a tuning."""
    return RolloutPlanner(knowledge)


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
        self._slope, self._disturbed = 0.0, False

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide on the ground ahead; see `situation.Planner`."""
        motion, profile = situation.motion, situation.profile
        if profile is None:
            return stop(Reason.STALE, 'Stopping: nothing has been observed yet')
        climbed = self._climbed(motion)
        pushing = self._push(situation, previous) or self._brake(motion, previous)
        if pushing is not None:
            return pushing
        faces = faces_ahead(profile, motion.position)
        slope = self._slope_below(profile, faces, motion)
        steep = self._lines.steep(situation, slope, previous, self._disturbed)
        if steep is not None and not (
                faces and faces[0].position - motion.position < steep.distance):
            return steep
        if not faces or faces[0].position - motion.position > FAR:
            self._selector.forget()
            return self._alone(situation, slope, previous)
        deviation = profile.slope_sd if math.isfinite(profile.slope_sd) else SLOPE_SD
        line = self._lines.before_slope(profile, faces[0].position, slope, None)
        behind = math.inf if line is None else line.position
        ahead = look_ahead(profile, faces, motion.position, slope, deviation,
                           self._robot.ball_radius, self._tuning.unseen_room, climbed, behind)
        if not ahead.ends and -HIGHEST_DESCENT < faces[0].height \
                and self._braking_room(ahead, motion) < TOO_LATE:
            # To go down a small drop on purpose is better than to slide down it.
            ahead = look_ahead(profile, faces, motion.position, slope, deviation,
                               self._robot.ball_radius, self._tuning.unseen_room,
                               HIGHEST_DESCENT, behind)
        return self._face(ahead, situation, previous)

    def _alone(self, situation: Situation, slope: float,
               previous: Optional[Decision]) -> Decision:
        """Decide where no face is ahead: on, but not beyond the stop line."""
        motion, lines = situation.motion, self._lines
        clear = lines.cruise(situation, slope, previous)
        line = lines.nearest(situation, slope, (), previous)
        if line is None:
            return clear
        way = lines.braking.distance(motion.speed, lines.slope_to(
            situation.profile, motion.position, line.position, slope), emergency=True)
        room = line.obstacle - motion.position - self._robot.ball_radius
        if room > way + self._tuning.stop_gap + AT_EASE:
            return clear
        return lines.stand(
            replace(clear, kind=Kind.STOP, reason=line.reason, distance=room,
                    explanation=f'Stopping before {line.explanation} at {room:.2f} m'),
            line.obstacle, situation, slope)

    def _slope_below(self, profile: Profile, faces: Sequence[Face], motion: Motion) -> float:
        """Return the slope below the ball, as it was before faces came so near to hide it."""
        near = [face for face in (*faces, *self._passed)
                if -NEAR < face.position - motion.position < NEAR]
        self._disturbed = bool(near)
        if not near:
            self._slope = profile.slope if math.isfinite(profile.slope) else motion.slope
        return self._slope

    def _face(self, ahead: Ahead, situation: Situation,
              previous: Optional[Decision]) -> Decision:
        """Decide on the faces ahead."""
        motion, face, selector = situation.motion, ahead.faces[0], self._selector
        room = self._braking_room(ahead, motion)
        if not ahead.ends or face.height > self._robot.ball_radius:
            selector.forget()
            choice = Choice(None, Reason.DROP if face.height < 0.0 else Reason.WALL)
            return self._lines.stand(
                refuse(choice, ahead, motion, room, self._tuning), face.position, situation,
                ahead.slope)
        started = selector.choice is not None and selector.choice.trial is not None
        # A plan in execution is aborted only if the ball certainly stops before the face.
        sure = ahead.touch - motion.position - self._lines.braking.distance(
            motion.speed, ahead.slope - 2.0 * ahead.slope_sd, emergency=True)
        selector.update(ahead, situation, min(room, sure) if started else room)
        choice = selector.choice or Choice(None, Reason.NOT_LIKELY)
        if choice.trial is None:
            # There is time to look closer, and no need to say no yet.
            stand = face.position - self._robot.ball_radius - self._tuning.stop_gap
            way = self._lines.braking.distance(motion.speed, ahead.slope)
            refused = (previous is not None and previous.step == face.number
                       and previous.kind in (Kind.STOP, Kind.GO_ROUND))
            if choice.reason not in DEFINITE and abs(motion.speed) > STANDING \
                    and stand - motion.position > way + AT_EASE and not refused:
                return weighing(ahead, motion, self._tuning)
            no = refuse(choice, ahead, motion, room, self._tuning)
            if refused and previous is not None and no.kind in (Kind.STOP, Kind.GO_ROUND):
                # The label alone does not change.
                no = replace(no, kind=previous.kind)
            return self._lines.stand(no, face.position, situation, ahead.slope)
        end = choice.trial.candidate.end(ahead)
        later = [item.position - self._robot.ball_radius for item in ahead.faces
                 if item.position > end.position + 1e-3]
        return go(choice, choice.trial.candidate, ahead, motion, min(later, default=math.inf),
                  room, self._tuning)

    def _climbed(self, motion: Motion) -> float:
        """Return what the ball has climbed just before, of faces that it left behind [m]."""
        face = self._selector.basis.face if self._selector.basis is not None else None
        if face is not None and face.position < motion.position and face not in self._passed:
            self._passed.append(face)
        self._passed = [one for one in self._passed
                        if 0.0 < motion.position - one.position < TOGETHER]
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
            # The map has lost the face of a crossing that nothing stops any more.
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
        """Return the stop behind the last edge of a plan, as rollouts have tried it."""
        plan = previous.plan if previous is not None else None
        if previous is None or plan is None or not (
                0.0 <= motion.position - plan.edge < self._robot.ball_radius) \
                or motion.speed < STANDING or previous.kind is Kind.CROSS \
                and plan.after is not After.STOP:
            return None
        return replace(stop(Reason.LANDING, 'Stopping behind the edge'),
                       plan=Plan(Strategy.STOP, edge=plan.edge))

    def _braking_room(self, ahead: Ahead, motion: Motion) -> float:
        """Return how far it is to the last point where braking still works [m]."""
        way = self._lines.braking.expected_distance(motion.speed, ahead.slope)
        return ahead.touch - GAP - motion.position - way
