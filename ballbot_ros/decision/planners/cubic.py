# SPDX-License-Identifier: Apache-2.0
"""
The planner ``cubic``: section 8 of the paper, with margins.

The ball touches a step when its centre is sqrt(2 R h - h^2) before the face; what lies
before that is the run-up.  The curve says which speed at touch the step asks for, with the
pendulum hanging down; so the ball lets it hang before the touch.  What counts is the speed that
will be driven, and the band of the curve says how likely it is enough.
"""
from dataclasses import replace
import math
from typing import Any, Dict, List, Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.beyond import Beyond, beyond
from ballbot_ros.decision.guard import stop
from ballbot_ros.decision.halts import Halts
from ballbot_ros.decision.plan import Plan, Strategy
from ballbot_ros.decision.planners.reach import Reach, Reckoning
from ballbot_ros.decision.profile import Face, Profile
from ballbot_ros.decision.situation import Failure, Knowledge, Planner, Situation
from ballbot_ros.decision.values import Decision, Kind, Motion, Outlook, Reason

# A ball that leans against a step for this long is not going to make it [s].
LONGEST_CONTACT = 1.5

# In contact the ball bounces; this far off the step it still is in contact [m].  A step that is
# higher than it seems is touched this much earlier.
CONTACT_SLACK = 0.04

# The far edge of a sill is where it was seen, within this [m].
SILL = 0.1

# The pendulum is let down so long before the touch [s].
HANGING = 0.3

# Parts of the margins that a crossing keeps that was begun with all of them, and that one must
# have which was given up before, as long as the ball rolls: no change of mind without news.
BEGUN, GIVEN_UP = 0.5, 1.25
BEGUN_LANDING = 0.8  # of the way to a stop behind the edge
ROLLING = 0.05  # [m/s]

# After a failure the ball must be this much faster than it was, and than it was to be; after so
# many it gives up.
FASTER, FASTER_PLAN, MOST_FAILURES = 1.1, 1.05, 3

# Not about the step itself.
DOUBTFUL = (Reason.STALE, Reason.CONTRADICTORY, Reason.BAD_OBSERVATION)

# News of a step that was refused: so much in height, or in room behind it [m].
HEIGHT_NEWS, ROOM_NEWS = 0.003, 0.1

# Too late to stop, a step is taken where this is as likely as not.
HOPE = 0.5

# Where backing off ends [m], and steps that are taken with any speed behind another one [m].
ARRIVED, PASSABLE = 0.03, 0.002


def planner(knowledge: Knowledge) -> Planner:
    """Return the planner for a robot, its curve and a tuning."""
    return Cubic(knowledge)


class Cubic:
    """See `situation.Planner`; keeps what a refusal was made for."""

    def __init__(self, knowledge: Knowledge):
        """Work the constants out once."""
        self._radius = knowledge.robot.ball_radius
        self._curve, self._tuning = knowledge.curve, knowledge.tuning
        self._halts = Halts(knowledge)
        self._reckoning = Reckoning(knowledge, self._halts.braking)
        # Number, height and room behind of the step that was refused last, and failures at it.
        self._refused: Optional[Tuple[int, float, float, int]] = None

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide; what was begun keeps half the margins, in contact it goes on."""
        profile, motion = situation.profile, situation.motion
        if profile is None:
            return stop(Reason.STALE, 'Stopping: nothing has been observed yet')
        step = next((face for face in profile.faces if face.position > motion.position), None)
        pushing = self._push(previous, step, profile, motion)
        if pushing is not None:
            return pushing
        slope = profile.slope if math.isfinite(profile.slope) else motion.slope
        steep = self._halts.steep(profile, situation, slope, previous)
        if steep is not None and (step is None or steep.distance < step.position
                                  - motion.position):
            return steep
        if step is None:
            return self._halts.cruise(profile, motion, slope)
        drop = self._halts.drop(step, situation, slope, previous)
        if drop is not None:
            return drop
        return self._settled(self._weigh(step, profile, situation, slope, previous), step,
                             profile, situation, previous)

    def _settled(self, answer: Decision, step: Face, profile: Profile, situation: Situation,
                 previous: Optional[Decision]) -> Decision:
        """Return an answer, or the refusal so far where there is no news."""
        deviation = math.hypot(step.height_sd, self._tuning.height_bias_sd)
        news = (step.number, step.height + self._tuning.sigma_margin * deviation,
                beyond(profile, step, self._radius, PASSABLE, self._tuning).room,
                len(situation.failures))
        refusal = answer.kind in (Kind.STOP, Kind.GO_ROUND)
        known, standing = self._refused, abs(situation.motion.speed) < ROLLING
        if known is None or previous is None or previous.kind not in (Kind.STOP, Kind.GO_ROUND) \
                or previous.step != step.number or previous.reason in DOUBTFUL \
                or known[0] != step.number or known[3] != news[3] \
                or abs(known[1] - news[1]) > HEIGHT_NEWS or abs(known[2] - news[2]) > ROOM_NEWS \
                or (standing and previous.kind is Kind.STOP) \
                or (refusal and previous.kind is answer.kind):
            self._refused = news if refusal else None
            return answer
        return replace(previous, distance=answer.distance, outlook=answer.outlook)

    def _push(self, previous: Optional[Decision], step: Optional[Face], profile: Profile,
              motion: Motion) -> Optional[Decision]:
        """
        Return the decision of a crossing ball in contact: on, unless it lasts too long.

        Observations do not matter here.  The face is below the ball, the odometry slips, and
        there is nothing better to do than to push.
        """
        if previous is None or previous.kind is not Kind.CROSS or previous.plan is None:
            return None
        since = previous.contact_since
        if step is None or step.number != previous.step:
            # On top of a sill, before its far edge; what else comes there is judged anew.
            edge = previous.plan.edge
            if since is None or not motion.position < edge or (
                    step is not None and step.position < edge - SILL):
                return None
            distance = -math.inf
        else:
            distance = step.position - motion.position
            run_up = distance - touch_distance(self._radius, step.height)
            late = since is not None or previous.reason is Reason.COMMITTED
            if run_up > (CONTACT_SLACK if late else 0.0):
                return None
        since = motion.stamp if since is None else since
        if not 0.0 <= motion.stamp - since <= LONGEST_CONTACT:
            return replace(stop(
                Reason.STUCK, 'Stopping: still not over the step after '
                f'{LONGEST_CONTACT:g} s of pushing', height=previous.height,
                distance=previous.distance, step=previous.step), outlook=previous.outlook)
        return replace(
            previous, reason=Reason.COMMITTED, contact_since=since,
            distance=previous.distance if distance == -math.inf else distance,
            explanation='On the step: going on')

    def _margins(self, step: Face, motion: Motion, previous: Optional[Decision],
                 room: float) -> float:
        """Return the part of the margins that a crossing must keep."""
        # What cannot be avoided any more is better crossed than hit.
        if room < 0.0 and motion.speed > ROLLING:
            return BEGUN
        if previous is None or previous.step != step.number:
            return 1.0
        if previous.kind is Kind.CROSS:
            return BEGUN
        given_up = previous.kind in (Kind.STOP, Kind.GO_ROUND) \
            and previous.reason not in DOUBTFUL
        rolling = abs(motion.speed) > ROLLING or previous.kind is Kind.GO_ROUND
        return GIVEN_UP if given_up and rolling else 1.0

    def _weigh(self, step: Face, profile: Profile, situation: Situation, slope: float,
               previous: Optional[Decision]) -> Decision:
        """Return the decision on a step that does not drop."""
        motion = situation.motion
        distance = step.position - motion.position
        room = self._halts.braking_room(step, motion, slope)
        margins = self._margins(step, motion, previous, room)
        before = previous if previous is not None and previous.step == step.number else None
        begun = before if before is not None and before.kind is Kind.CROSS else None
        failed = [one for one in situation.failures if one.face == step.number]
        found = self._reckoning.reach(
            step, distance, motion.speed, slope, margins=margins, faster_than=faster(failed),
            kept=begun.set_speed if begun is not None else 0.0)
        outlook = Outlook(
            found.probability, 1.0 - found.probability, 0.0, self._tuning.required_probability,
            found.driven, self._reckoning.height_limit(found.driven), room)
        late = begun is not None and room < 0.0
        answer = Decision(
            Kind.CROSS, Reason.COMMITTED if room < 0.0 else Reason.WITHIN_CURVE,
            found.set_speed, '', math.nan if found.required is None else found.required,
            found.reachable, step.height, found.spare, distance, step.number, outlook=outlook)
        where = f'{1e3 * step.height:.0f} mm at {distance:.2f} m: '
        if found.slowest > self._curve.highest_speed:
            return replace(
                stop(Reason.TOO_FAST, f'{where}touched at {found.slowest:.2f} m/s even when '
                     f'braking, the curve ends at {self._curve.highest_speed:.2f} m/s'),
                **numbers(answer))
        # Late for a crossing that was begun, or for any as the brakes of the robot file are.
        hopeful = found.probability >= HOPE and step.height < self._radius and (
            late or found.run_up < self._halts.braking.expected_distance(motion.speed, slope))
        around = None if hopeful else self._forbidden(step, found, failed)
        land = beyond(profile, step, self._radius, PASSABLE, self._tuning)
        if around is None and not late:
            around = self._landing(step, found, land, slope, begun is not None, failed)
        if around is not None:
            reason, why = around
            return self._halts.stand(
                replace(answer, kind=Kind.GO_ROUND, reason=reason,
                        explanation=f'{where}{why}; find another way'),
                step.position, situation, slope)
        backing = before.plan if before is not None and before.kind is Kind.BACK_OFF else None
        on_the_way = backing is not None and (
            motion.position > backing.start + ARRIVED or motion.speed < -ROLLING)
        if on_the_way or not (hopeful or answer.required_speed <= found.driven):
            return self._longer_run_up(answer, where, step, situation, slope,
                                       backing if on_the_way else None, failed)
        plan = self._plan(step, found, land, begun, motion)
        return replace(
            answer, plan=plan, start_distance=motion.position - plan.start,
            swing_distance=plan.swing_position - motion.position,
            explanation=f'{where}needs {answer.required_speed:.2f} m/s, {found.driven:.2f} m/s '
            f'will be driven, {1e3 * found.spare - 0.5:.0f} mm to spare, probability '
            f'{found.probability:.2f}')

    def _plan(self, step: Face, found: Reach, land: Beyond, begun: Optional[Decision],
              motion: Motion) -> Plan:
        """Return the plan of a crossing."""
        touch = step.position - touch_distance(self._radius, step.height)
        start = begun.plan.start if begun is not None and begun.plan is not None \
            else motion.position
        cruising = found.set_speed <= self._tuning.cruise_speed
        return Plan(Strategy.CRUISE if cruising else Strategy.ACCELERATE, start, found.set_speed,
                    touch - HANGING * found.driven, 0.0, land.edge)

    def _forbidden(self, step: Face, found: Reach,
                   failed: List[Failure]) -> Optional[Tuple[Reason, str]]:
        """Return why a step is not crossed from anywhere, if so."""
        if step.height >= self._radius:
            return Reason.WALL, 'a wall'
        if len(failed) >= MOST_FAILURES:
            return Reason.FAILED_BEFORE, f'tried {len(failed)} times'
        if found.required is not None and found.required <= found.top:
            return None
        if failed and found.conservative <= self._curve.height(found.top):
            return Reason.FAILED_BEFORE, 'tried already, and no faster way is allowed'
        if found.required is None and found.conservative <= self._curve.height(found.top):
            return Reason.NOT_LIKELY, (f'at {found.top:.2f} m/s not as likely as '
                                       f'{self._tuning.required_probability:g}')
        wish = 'more than the curve knows' if found.required is None \
            else f'{found.required:.2f} m/s'
        return Reason.TOO_HIGH, f'needs {wish}, {found.top:.2f} m/s is the most'

    def _landing(self, step: Face, found: Reach, land: Beyond, slope: float, begun: bool,
                 failed: List[Failure]) -> Optional[Tuple[Reason, str]]:
        """Return why what lies behind a step forbids to cross it, if so."""
        driven = max(found.driven, found.required or 0.0)
        sigmas = self._tuning.sigma_margin if land.known else 0.0
        fastest = self._reckoning.speed_behind(
            step, driven, sigmas, max((one.touch_speed for one in failed), default=0.0))
        downhill = min(0.0, slope)
        needed = self._halts.braking.distance(fastest, downhill, emergency=True) if land.known \
            else self._halts.braking.expected_distance(fastest, downhill)
        if needed * (BEGUN_LANDING if begun else 1.0) <= land.room:
            return None
        return Reason.LANDING, (f'behind it {land.room:.2f} m until {land.trouble}, '
                                f'{needed:.2f} m to stop from {fastest:.2f} m/s')

    def _longer_run_up(self, answer: Decision, where: str, step: Face, situation: Situation,
                       slope: float, backing: Optional[Plan], failed: List[Failure]) -> Decision:
        """Return BACK_OFF to where the run-up is long enough, or that there is no room."""
        position, needed = situation.motion.position, answer.required_speed
        touch = step.position - touch_distance(self._radius, step.height)
        start = touch - self._reckoning.run_up_for(needed, slope)
        if backing is not None and backing.start >= situation.free_from:
            start = min(start, backing.start) if start >= situation.free_from else backing.start
        reached = answer.outlook.touch_speed if answer.outlook is not None else math.nan
        short = f'needs {needed:.2f} m/s, only {reached:.2f} m/s reachable from here'
        if start >= situation.free_from:
            return replace(
                answer, kind=Kind.BACK_OFF, reason=Reason.RUN_UP, set_speed=0.0,
                plan=Plan(Strategy.BACK_OFF, start), start_distance=position - start,
                explanation=f'{where}{short}; backing off by {position - start:.2f} m')
        if failed:
            return self._halts.stand(
                replace(answer, kind=Kind.GO_ROUND, reason=Reason.FAILED_BEFORE,
                        explanation=f'{where}tried already; {short}; find another way'),
                step.position, situation, slope)
        return replace(stop(Reason.NO_ROOM, f'{where}{short}; a longer run-up would do'),
                       **numbers(answer))


def numbers(answer: Decision) -> Dict[str, Any]:
    """Return what a decision says of the step."""
    return {name: getattr(answer, name) for name in (
        'required_speed', 'reachable_speed', 'height', 'height_margin', 'distance', 'step',
        'outlook')}


def faster(failed: List[Failure]) -> float:
    """Return the speed at touch below which a plan is one that failed already [m/s]."""
    return max((max(FASTER * one.touch_speed, FASTER_PLAN * one.plan.speed) for one in failed),
               default=0.0)
