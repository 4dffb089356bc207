# SPDX-License-Identifier: Apache-2.0
"""
The planner ``cubic``: section 8 of the paper, with margins.

The ball touches a step when its centre is sqrt(2 R h - h^2) before the face; the distance up to
that position is the run-up.  The curve gives the touch speed that the step requires with a
hanging pendulum; so the pendulum is lowered before the touch.  The band of the curve gives the
success probability at the speed that will be driven.
"""
from dataclasses import dataclass, replace
import math
from typing import Any, Dict, List, Optional, Tuple

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.planning.safety_filter import stop
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.planning.stop_line import LINE_MARGIN, StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import (
    Decision, Face, Failure, Kind, Motion, Outlook, Plan, Profile, Reason, Strategy)

# Aim above the required speed by this [m/s], or by more if it is not reached in time: the
# remaining error at the touch must not use up the margin.
HEADROOM = (0.05, 0.1)

# A previous set speed is kept up to this much above the required one [m/s].
KEPT = 0.15

# Nodes and weights of a mean over a normal distribution (Gauss and Hermite).
NODES = ((0.0, 0.53333333), (1.3556262, 0.22207592), (-1.3556262, 0.22207592),
         (2.8569700, 0.01125741), (-2.8569700, 0.01125741))

# Longest searched run-up [m].
LONGEST_RUN_UP = 6.0


# Least depth of a drop, less is an uneven floor [m].
SMALLEST_DROP = 0.005

# A drop this close behind a face is the far edge of a sill: a stop needs more room [m].
SILL_LENGTH = 0.65

# Least observed ground behind an edge [m].
LANDING_OBSERVED_MIN = 0.1


@dataclass(frozen=True)
class Beyond:
    """
    The ground behind a face.

    Attributes
    ----------
    edge : float
        The last edge of faces that are crossed together [m]: those that lead back to the floor
        before the first one.
    room : float
        For the centre, behind that edge [m].
    known : bool
        Whether a known obstacle ends the room; otherwise the observed terrain ends.
    trouble : str
        Name of the obstacle that ends the room.

    """

    edge: float
    room: float
    known: bool
    trouble: str


def beyond(profile: Profile, face: Face, radius: float, passable: float,
           tuning: DecisionTuning) -> Beyond:
    """
    Return the ground behind a face.

    Parameters
    ----------
    profile : Profile
    face : Face
        That is to be crossed.
    radius : float
        Of the ball [m].
    passable : float
        Height of steps that are crossed with the remaining speed [m].
    tuning : DecisionTuning
        Its `unseen_room` is assumed.

    """
    edge, level = face.position + max(0.0, face.run), face.height
    known = profile.seen_to if profile.points else -math.inf
    # If a part is observed, an obstacle ends the observed part.
    taken = edge + tuning.unseen_room if known < edge + LANDING_OBSERVED_MIN else known
    end, trouble = taken, ''
    for other in profile.faces:
        if other.position <= face.position or other.number == face.number:
            continue
        at = other.position - LINE_MARGIN - tuning.sigma_margin * other.position_sd
        if other.height > passable:
            at -= touch_distance(radius, other.height)
            what = 'a wall' if other.height >= radius else f'{1e3 * other.height:.0f} mm more'
        elif level + other.height < -SMALLEST_DROP:
            what = f'a drop of {-1e3 * other.height:.0f} mm'
        else:
            level += other.height
            # A drop directly behind, as at a sill: cross both as one obstacle.
            if other.height < -SMALLEST_DROP and other.position - edge < SILL_LENGTH:
                edge = other.position + touch_distance(radius, -other.height)
                end = known if known >= edge + LANDING_OBSERVED_MIN else edge + tuning.unseen_room
            continue
        if at < end:
            end, trouble = at, what
        break
    return Beyond(edge, max(0.0, end - edge), bool(trouble), trouble or 'what is not seen')


@dataclass(frozen=True)
class Reach:
    """
    Required and reachable speeds of a step; all are touch speeds.

    Attributes
    ----------
    conservative : float
        Height with its margins [m].
    run_up : float
        Distance until touch [m].
    required : float or None
        With its margin; None above the end of the curve [m/s].
    set_speed : float
        To drive at [m/s].
    driven : float
        Resulting touch speed, from here [m/s].
    reachable : float
        At the highest set speed, from here [m/s].
    slowest : float
        Braking from here [m/s].
    spare : float
        Height reserve at `driven`, negative if it is insufficient;
        NaN if `driven` is below the curve [m].
    probability : float
        Of a success at `driven`.

    """

    conservative: float
    run_up: float
    required: Optional[float]
    set_speed: float
    driven: float
    reachable: float
    slowest: float
    spare: float
    probability: float


# Timeout of a contact with a step [s].
LONGEST_CONTACT = 1.5

# In contact the ball bounces; this far off the step it still is in contact [m].  A step that is
# higher than it seems is touched this much earlier.
CONTACT_SLACK = 0.04

# The far edge of a sill is where it was seen, within this [m].
SILL = 0.1

# The pendulum is lowered this long before the touch [s].
HANGING = 0.3

# Hysteresis: fraction of the margins required to continue a crossing, and to resume a rejected one
# while the ball rolls.
STARTED, GIVEN_UP = 0.5, 1.25
STARTED_LANDING = 0.8  # fraction of the stopping distance behind the edge
ROLLING = 0.05  # [m/s]

# After a failure, the ball must be faster than its actual and planned speed by this; after this
# number of failures the step is refused.
FASTER, FASTER_PLAN, MOST_FAILURES = 1.1, 1.05, 3

# Not about the step itself.
DOUBTFUL = (Reason.STALE, Reason.CONTRADICTORY, Reason.BAD_OBSERVATION)

# Changes that cause a rejected step to be re-evaluated: height, and clearance behind it [m].
HEIGHT_CHANGE, ROOM_CHANGE = 0.003, 0.1

# Past the last braking point, a step is crossed at this success probability.
PROBABILITY_MIN = 0.5

# Where backing off ends [m], and steps that are taken with any speed behind another one [m].
ARRIVED, PASSABLE = 0.03, 0.002


class CubicPlanner:
    """See `situation.Planner`; stores the conditions of the last refusal."""

    def __init__(self, knowledge: Knowledge):
        """Work the constants out once."""
        self._radius = knowledge.robot.ball_radius
        self._curve, self._tuning = knowledge.curve, knowledge.tuning
        self._lines = StopLines(knowledge)
        self._top = min(knowledge.tuning.highest_speed, knowledge.curve.highest_speed)
        # Number, height and room behind of the step that was refused last, and failures at it.
        self._refused: Optional[Tuple[int, float, float, int]] = None

    def __call__(self, situation: Situation, previous: Optional[Decision]) -> Decision:
        """Decide; a crossing continues with reduced margins, and always in contact."""
        profile, motion = situation.profile, situation.motion
        if profile is None:
            return stop(Reason.STALE, 'Stopping: nothing has been observed yet')
        step = next((face for face in profile.faces if face.position > motion.position), None)
        pushing = self._push(previous, step, profile, motion)
        if pushing is not None:
            return pushing
        slope = situation.slope
        steep = self._lines.steep(situation)
        if steep is not None and (
                step is None or not self._lines.face_is_nearer(step, steep, motion.position)):
            return steep
        if step is None:
            return self._lines.cruise(situation)
        if step.height < 0.0:
            distance = step.position - motion.position
            return self._lines.stop_before(
                Decision(Kind.STOP, Reason.DROP, 0.0, 'Stopping: the floor drops by '
                         f'{-1e3 * step.height:.0f} mm at {distance:.2f} m', height=step.height,
                         distance=distance, step=step.number, outlook=Outlook(
                             required=self._tuning.required_probability,
                             braking_room=self._lines.braking_room(step, motion, slope))),
                step.position, situation)
        return self._settled(self._weigh(step, profile, situation, slope, previous), step,
                             profile, situation, previous)

    def _settled(self, answer: Decision, step: Face, profile: Profile, situation: Situation,
                 previous: Optional[Decision]) -> Decision:
        """Return an answer, or the refusal so far where there is no news."""
        news = (step.number, step.height + self._tuning.sigma_margin * self._deviation(step),
                beyond(profile, step, self._radius, PASSABLE, self._tuning).room,
                len(situation.failures))
        refusal = answer.kind in (Kind.STOP, Kind.GO_ROUND)
        known, standing = self._refused, abs(situation.motion.speed) < ROLLING
        if known is None or previous is None or previous.kind not in (Kind.STOP, Kind.GO_ROUND) \
                or previous.step != step.number or previous.reason in DOUBTFUL \
                or known[0] != step.number or known[3] != news[3] \
                or abs(known[1] - news[1]) > HEIGHT_CHANGE \
                or abs(known[2] - news[2]) > ROOM_CHANGE \
                or (standing and previous.kind is Kind.STOP) \
                or (refusal and previous.kind is answer.kind):
            self._refused = news if refusal else None
            return answer
        return replace(previous, distance=answer.distance, outlook=answer.outlook)

    def _push(self, previous: Optional[Decision], step: Optional[Face], profile: Profile,
              motion: Motion) -> Optional[Decision]:
        """
        Return the decision of a crossing ball in contact: on, unless it lasts too long.

        Observations are not used here: the face is below the ball, and the odometry slips.
        The best action is to continue.
        """
        if previous is None or previous.kind is not Kind.CROSS or previous.plan is None:
            return None
        since = previous.contact_since
        if step is None or step.number != previous.step:
            # On top of a sill, before its far edge; other faces there are evaluated again.
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
        # Beyond the last braking point, crossing is better than a collision.
        if room < 0.0 and motion.speed > ROLLING:
            return STARTED
        if previous is None or previous.step != step.number:
            return 1.0
        if previous.kind is Kind.CROSS:
            return STARTED
        given_up = previous.kind in (Kind.STOP, Kind.GO_ROUND) \
            and previous.reason not in DOUBTFUL
        rolling = abs(motion.speed) > ROLLING or previous.kind is Kind.GO_ROUND
        return GIVEN_UP if given_up and rolling else 1.0

    def _weigh(self, step: Face, profile: Profile, situation: Situation, slope: float,
               previous: Optional[Decision]) -> Decision:
        """Return the decision on a step that does not drop."""
        motion = situation.motion
        distance = step.position - motion.position
        room = self._lines.braking_room(step, motion, slope)
        margins = self._margins(step, motion, previous, room)
        before = previous if previous is not None and previous.step == step.number else None
        started = before if before is not None and before.kind is Kind.CROSS else None
        failed = situation.failures_at(step)
        found = self.reach(
            step, distance, motion.speed, slope, margins=margins, faster_than=faster(failed),
            kept=started.set_speed if started is not None else 0.0)
        outlook = Outlook(
            found.probability, 1.0 - found.probability, 0.0, self._tuning.required_probability,
            found.driven, self._height_limit(found.driven), room)
        late = started is not None and room < 0.0
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
        # Too late to stop: during a crossing, or within the expected braking distance.
        hopeful = found.probability >= PROBABILITY_MIN and step.height < self._radius and (
            late or found.run_up < self._lines.braking.expected_distance(motion.speed, slope))
        around = None if hopeful else self._forbidden(step, found, failed)
        land = beyond(profile, step, self._radius, PASSABLE, self._tuning)
        if around is None and not late:
            around = self._landing(step, found, land, slope, started is not None, failed)
        if around is not None:
            reason, why = around
            return self._lines.stop_before(
                replace(answer, kind=Kind.GO_ROUND, reason=reason,
                        explanation=f'{where}{why}; find another way'),
                step.position, situation)
        backing = before.plan if before is not None and before.kind is Kind.BACK_OFF else None
        on_the_way = backing is not None and (
            motion.position > backing.start + ARRIVED or motion.speed < -ROLLING)
        if on_the_way or not (hopeful or answer.required_speed <= found.driven):
            return self._longer_run_up(answer, where, step, situation, slope,
                                       backing if on_the_way else None, failed)
        plan = self._plan(step, found, land, started, motion)
        return replace(
            answer, plan=plan, start_distance=motion.position - plan.start,
            swing_distance=plan.swing_position - motion.position,
            explanation=f'{where}needs {answer.required_speed:.2f} m/s, {found.driven:.2f} m/s '
            f'will be driven, {max(1e3 * found.spare - 0.5, 0.0):.0f} mm to spare, probability '
            f'{found.probability:.2f}')

    def _plan(self, step: Face, found: Reach, land: Beyond, started: Optional[Decision],
              motion: Motion) -> Plan:
        """Return the plan of a crossing."""
        touch = step.position - touch_distance(self._radius, step.height)
        start = started.plan.start if started is not None and started.plan is not None \
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
        if found.required is not None and found.required <= self._top:
            return None
        if failed and found.conservative <= self._curve.height(self._top):
            return Reason.FAILED_BEFORE, 'tried already, and no faster way is allowed'
        if found.required is None and found.conservative <= self._curve.height(self._top):
            return Reason.NOT_LIKELY, (f'at {self._top:.2f} m/s not as likely as '
                                       f'{self._tuning.required_probability:g}')
        wish = 'more than the curve covers' if found.required is None \
            else f'{found.required:.2f} m/s'
        return Reason.TOO_HIGH, f'needs {wish}, {self._top:.2f} m/s is the most'

    def _landing(self, step: Face, found: Reach, land: Beyond, slope: float, started: bool,
                 failed: List[Failure]) -> Optional[Tuple[Reason, str]]:
        """Return the reason why the ground behind a step prevents a crossing, if so."""
        driven = max(found.driven, found.required or 0.0)
        sigmas = self._tuning.sigma_margin if land.known else 0.0
        fastest = self._speed_behind(
            step, driven, sigmas, max((one.touch_speed for one in failed), default=0.0))
        downhill = min(0.0, slope)
        needed = self._lines.braking.distance(fastest, downhill, emergency=True) if land.known \
            else self._lines.braking.expected_distance(fastest, downhill)
        if needed * (STARTED_LANDING if started else 1.0) <= land.room:
            return None
        return Reason.LANDING, (f'behind it {land.room:.2f} m until {land.trouble}, '
                                f'{needed:.2f} m to stop from {fastest:.2f} m/s')

    def _longer_run_up(self, answer: Decision, where: str, step: Face, situation: Situation,
                       slope: float, backing: Optional[Plan], failed: List[Failure]) -> Decision:
        """Return BACK_OFF to where the run-up is long enough, or that there is no room."""
        position, needed = situation.motion.position, answer.required_speed
        touch = step.position - touch_distance(self._radius, step.height)
        start = touch - self._run_up_for(needed, slope)
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
            return self._lines.stop_before(
                replace(answer, kind=Kind.GO_ROUND, reason=Reason.FAILED_BEFORE,
                        explanation=f'{where}tried already; {short}; find another way'),
                step.position, situation)
        return replace(stop(Reason.NO_ROOM, f'{where}{short}; a longer run-up is required'),
                       **numbers(answer))

    def reach(self, face: Face, distance: float, speed: float, slope: float, *,
              margins: float = 1.0, faster_than: float = 0.0, kept: float = 0.0) -> Reach:
        """
        Return the required and the reachable speed at a step.

        Parameters
        ----------
        face : Face
        distance : float
            Ball's centre to the face [m].
        speed : float
            Now [m/s].
        slope : float
            Of the ground before the step, positive uphill [rad].
        margins : float
            Part of the margins of the tuning that must be kept [1].
        faster_than : float
            A touch speed that has failed [m/s].
        kept : float
            Present set speed, which is kept if it is still valid [m/s].

        """
        tuning, braking = self._tuning, self._lines.braking
        deviation = self._deviation(face)
        conservative = self._conservative(face, margins)
        run_up = max(0.0, distance - touch_distance(self._radius, face.height))
        required = self._required(face, margins, faster_than)
        # Reduced margins apply to the continuation only; the aim includes all of them.
        aim = required if margins >= 1.0 else self._required(face, 1.0, faster_than) or self._top
        least, slow = aim or 0.0, tuning.cruise_speed
        reachable = self._driven(speed, self._top, run_up, slope)
        chosen = [min(self._top, max(least + more, slow)) for more in HEADROOM] + [self._top]
        if required is not None and required <= kept <= max(least, slow) + KEPT \
                and self._driven(speed, kept, run_up, slope) >= required:
            chosen = [kept]
        set_speed, driven = chosen[-1], reachable
        for set_speed in chosen:
            driven = self._driven(speed, set_speed, run_up, slope)
            if driven >= least:
                break
        clean = min(driven / (1.0 + margins * tuning.speed_margin), self._curve.highest_speed)
        slowest = math.sqrt(max(0.0, max(0.0, speed) * speed - 2.0 * run_up * max(
            0.0, braking.deceleration(slope))))
        return Reach(
            conservative, run_up, required, set_speed, driven, reachable, slowest,
            self._curve.height(clean) - conservative if clean >= self._curve.lowest_speed
            else math.nan, self.probability(driven, face.height, deviation))

    def _run_up_for(self, required: float, slope: float) -> float:
        """Return the run-up from rest that reaches a touch speed with a reserve [m]."""
        near, far = 0.0, LONGEST_RUN_UP
        if self._driven(0.0, self._top, far, slope) < required:
            return math.inf
        for _ in range(20):
            middle = 0.5 * (near + far)
            if self._driven(0.0, self._top, middle, slope) < required:
                near = middle
            else:
                far = middle
        return 1.1 * far + 0.05

    def probability(self, speed: float, height: float, deviation: float) -> float:
        """
        Return the success probability.

        The mean over the estimated height, and over a touch speed whose standard deviation is
        half the speed margin.

        Parameters
        ----------
        speed : float
            Expected at touch [m/s].
        height, deviation : float
            Of the step [m].

        """
        curve = self._curve
        low, high = curve.lowest_speed, curve.highest_speed
        inside = min(max(speed, low), high)
        # Below the speeds of the curve, the height is proportional to the squared speed.
        height = height if speed >= low else height * (low / max(speed, 1e-3))**2
        steepness = (curve.height(min(inside + 0.01, high))
                     - curve.height(max(inside - 0.01, low))) / (
                         min(inside + 0.01, high) - max(inside - 0.01, low))
        sd = math.hypot(deviation, 0.5 * self._tuning.speed_margin * inside * steepness)
        return sum(weight * self._part(inside, height + sd * node) for node, weight in NODES)

    def _height_limit(self, speed: float) -> float:
        """Return the step that is crossed at a speed with the required probability [m]."""
        curve, band = self._curve, self._curve.band
        if not curve.lowest_speed <= speed:
            return math.nan
        speed = min(speed, curve.highest_speed)
        if band is None:
            return curve.height(speed) - curve.residual
        return band.quantile(min(max(speed, band.speeds[0]), band.speeds[-1]),
                             1.0 - self._tuning.required_probability)

    def _speed_behind(self, face: Face, driven: float, sigmas: float,
                      not_enough: float = 0.0) -> float:
        """
        Return the speed when the centre passes the edge, from a touch speed [m/s].

        A crossing consumes the square of the minimum crossing speed; runs of the full model
        keep slightly less.

        Parameters
        ----------
        face : Face
        driven : float
            At touch [m/s].
        sigmas : float
            Standard deviations by which the step is lower, and the ball faster, than expected.
        not_enough : float
            A touch speed at which the ball did not cross it [m/s].

        """
        tuning = self._tuning
        lower = max(0.0, face.height - sigmas * self._deviation(face))
        fastest = driven * (1.0 + 0.25 * sigmas * tuning.speed_margin)
        needed = self._curve.required_speed(lower) or self._curve.highest_speed
        if lower < self._curve.height(self._curve.lowest_speed):
            needed = 0.0
        needed = max(needed, not_enough)
        return math.sqrt(max(0.0, fastest * fastest - needed * needed))

    def _conservative(self, face: Face, margins: float) -> float:
        """Return a height with a part of its margins [m]."""
        tuning = self._tuning
        return face.height + margins * (
            tuning.sigma_margin * self._deviation(face) + tuning.height_margin)

    def _deviation(self, face: Face) -> float:
        """Return the standard deviation of a height [m]."""
        return math.hypot(face.height_sd, self._tuning.height_bias_sd)

    def _required(self, face: Face, margins: float, faster_than: float) -> Optional[float]:
        """Return the speed that keeps the margins and is likely enough [m/s]."""
        tuning = self._tuning
        required = self._curve.required_speed(self._conservative(face, margins))
        if required is None:
            return None
        required = max(required * (1.0 + margins * tuning.speed_margin), faster_than)
        likely = 1.0 - (1.0 - tuning.required_probability) / margins
        deviation = self._deviation(face)
        if self.probability(required, face.height, deviation) >= likely:
            return required
        near, far = required, self._top
        if near >= far or self.probability(far, face.height, deviation) < likely:
            return None
        for _ in range(8):
            middle = 0.5 * (near + far)
            if self.probability(middle, face.height, deviation) < likely:
                near = middle
            else:
                far = middle
        return far

    def _driven(self, speed: float, set_speed: float, run_up: float, slope: float) -> float:
        """Return the touch speed for a set speed [m/s]."""
        return self._lines.braking.touch_speed(speed, set_speed, run_up, slope)

    def _part(self, speed: float, height: float) -> float:
        """Return the fraction of the robots that cross a step at a speed within the curve."""
        band = self._curve.band
        if band is None:
            above = self._curve.height(speed) - height
            return 0.5 * (1.0 + math.erf(above / max(self._curve.residual, 1e-6)))
        return band.probability_of_passing(
            min(max(speed, band.speeds[0]), band.speeds[-1]), height)


def numbers(answer: Decision) -> Dict[str, Any]:
    """Return the description of the step for a decision."""
    return {name: getattr(answer, name) for name in (
        'required_speed', 'reachable_speed', 'height', 'height_margin', 'distance', 'step',
        'outlook')}


def faster(failed: List[Failure]) -> float:
    """Return the touch speed below which a plan has already failed [m/s]."""
    return max((max(FASTER * one.touch_speed, FASTER_PLAN * one.plan.speed) for one in failed),
               default=0.0)
