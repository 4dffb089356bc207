# SPDX-License-Identifier: Apache-2.0
"""
The planner ``cubic``: section 8 of the paper, with margins.

The ball touches a step when its centre is sqrt(2 R h - h^2) before the face; the distance up to
that position is the run-up.  The curve gives the touch speed that the step requires with a
hanging pendulum; so the pendulum is lowered before the touch.  The band of the curve gives the
success probability at the predicted touch speed.  The curve does not cover steps down: they are
not crossed.
"""
import math
from typing import NamedTuple, Optional

from ballbot_ros.decision.planning.ahead import Ahead, Candidate, End
from ballbot_ros.decision.planning.curve import bisected, HeightCurve
from ballbot_ros.decision.planning.face_planner import Choice, Selector
from ballbot_ros.decision.planning.situation import Knowledge, Situation
from ballbot_ros.decision.planning.stop_line import StopLines
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, Outlook, Reason, Strategy

# The set speed exceeds the required speed by this [m/s], or by the second value if it is otherwise
# not reached in time: the remaining error at the touch must not use up the margin.
SPEED_RESERVES = (0.05, 0.1)
# Nodes and weights of a mean over a normal distribution (Gauss-Hermite quadrature).
NODES = ((0.0, 0.53333333), (1.3556262, 0.22207592), (-1.3556262, 0.22207592),
         (2.8569700, 0.01125741), (-2.8569700, 0.01125741))
# Longest searched run-up [m].
RUN_UP_MAX = 6.0
# The pendulum is lowered this long before the touch [s].
HANGING_TIME = 0.3
# After a failure, the touch speed must exceed the failed and the planned speed by these factors.
TOUCH_SPEED_RATIO_MIN, PLAN_SPEED_RATIO_MIN = 1.1, 1.05
# Minimum probability of a crossing past the last braking point of the nominal robot.
PROBABILITY_MIN = 0.5
# Maximum height of a step up behind another one that is crossed at any speed [m].
PASSABLE_HEIGHT_MAX = 0.002


class CurveRule:
    """Required speed and success probability from the curve and its band."""

    def __init__(self, curve: HeightCurve, tuning: DecisionTuning):
        self._curve, self._tuning = curve, tuning
        self.highest_speed = min(tuning.highest_speed, curve.highest_speed)

    def conservative_height(self, face: Face) -> float:
        """Return the height of a face with its margins [m]."""
        return face.height + self._tuning.sigma_margin * self._deviation(face) \
            + self._tuning.height_margin

    def required_speed(self, face: Face, faster_than: float = 0.0) -> Optional[float]:
        """
        Return the touch speed with margins and the required success probability [m/s].

        It is at least `faster_than` [m/s]; None if no speed of the curve is sufficient.
        """
        required = self._curve.required_speed(self.conservative_height(face))
        if required is None:
            return None
        near = max(required * (1.0 + self._tuning.speed_margin), faster_than)
        if self._is_likely(near, face):
            return near
        far = self.highest_speed
        if near >= far or not self._is_likely(far, face):
            return None
        return bisected(lambda speed: self._is_likely(speed, face), near, far, 8)

    def probability(self, speed: float, face: Face) -> float:
        """
        Return the success probability at a touch speed [m/s].

        It is the mean over the estimated height, and over a touch speed whose standard deviation
        is half the speed margin.
        """
        curve = self._curve
        low, high = curve.lowest_speed, curve.highest_speed
        inside = min(max(speed, low), high)
        # Below the speeds of the curve, the height is proportional to the squared speed.
        height = face.height if speed >= low else face.height * (low / max(speed, 1e-3))**2
        below, above = max(inside - 0.01, low), min(inside + 0.01, high)
        steepness = (curve.height(above) - curve.height(below)) / (above - below)
        sd = math.hypot(self._deviation(face),
                        0.5 * self._tuning.speed_margin * inside * steepness)
        return sum(weight * self._fraction(inside, height + sd * node) for node, weight in NODES)

    def height_limit(self, speed: float) -> float:
        """Return the maximum step height at a speed with the required probability [m]."""
        curve, band = self._curve, self._curve.band
        if not curve.lowest_speed <= speed:
            return math.nan
        speed = min(speed, curve.highest_speed)
        if band is None:
            return curve.height(speed) - curve.residual
        return band.quantile(min(max(speed, band.speeds[0]), band.speeds[-1]),
                             1.0 - self._tuning.required_probability)

    def speed_behind(self, face: Face, driven: float, too_slow: float) -> float:
        """
        Return the highest probable speed when the centre passes the edge [m/s].

        A crossing reduces the squared speed by that of the minimum crossing speed; the full model
        keeps slightly less.  `driven` is the predicted touch speed [m/s], `too_slow` a touch speed
        at which the ball did not cross the face [m/s].
        """
        sigmas, curve = self._tuning.sigma_margin, self._curve
        lower = max(0.0, face.height - sigmas * self._deviation(face))
        fastest = driven * (1.0 + 0.25 * sigmas * self._tuning.speed_margin)
        needed = 0.0 if lower < curve.height(curve.lowest_speed) \
            else curve.required_speed(lower) or curve.highest_speed
        return math.sqrt(max(0.0, fastest**2 - max(needed, too_slow)**2))

    def _is_likely(self, speed: float, face: Face) -> bool:
        return self.probability(speed, face) >= self._tuning.required_probability

    def _deviation(self, face: Face) -> float:
        """Return the standard deviation of a height, sensor bias included [m]."""
        return math.hypot(face.height_sd, self._tuning.height_bias_sd)

    def _fraction(self, speed: float, height: float) -> float:
        """Return the fraction of the robots that cross a step at a speed within the curve."""
        band = self._curve.band
        if band is None:
            above = self._curve.height(speed) - height
            return 0.5 * (1.0 + math.erf(above / max(self._curve.residual, 1e-6)))
        return band.probability_of_passing(
            min(max(speed, band.speeds[0]), band.speeds[-1]), height)


class Prediction(NamedTuple):
    """A candidate, its predicted outcome, and whether the ball can stop behind the edge."""

    candidate: Candidate
    outlook: Outlook
    lands: bool


class CurveSelector(Selector):
    """Selects the gentlest approach that the rule permits, or a longer run-up."""

    def __init__(self, knowledge: Knowledge):
        super().__init__()
        self._curve, self._tuning = knowledge.curve, knowledge.tuning
        self._rule = CurveRule(knowledge.curve, knowledge.tuning)
        self._lines = StopLines(knowledge)

    def update(self, ahead: Ahead, situation: Situation, braking_room: float) -> None:
        """Select or re-evaluate the plan."""
        now, choice = self._begin(ahead, situation, braking_room), self.choice
        if choice is not None and choice.candidate is not None:
            kept = choice.candidate
            found = self._predict(kept.speed, kept.back, ahead, situation, kept=True)
            choice.outlook = found.outlook
            if not self._is_fixed(braking_room) and not (
                    found.lands and found.outlook.probability
                    >= self._tuning.required_probability - self._hysteresis):
                self.basis = None
        if self._must_select(now, braking_room):
            self.basis = now
            self._adopt(self._select(ahead, situation))

    def _select(self, ahead: Ahead, situation: Situation) -> Choice:
        """Return the plan, or the reason why there is none."""
        face, motion, tuning = ahead.faces[0], situation.motion, self._tuning
        if face.height < 0.0:
            return Choice(None, Reason.DROP)
        failed = situation.failures_at(face)
        required = self._rule.required_speed(face, max((
            max(TOUCH_SPEED_RATIO_MIN * one.touch_speed, PLAN_SPEED_RATIO_MIN * one.plan.speed)
            for one in failed),
            default=0.0))
        top = self._rule.highest_speed
        set_speeds = [top] if required is None else [
            min(top, max(required + more, tuning.cruise_speed)) for more in SPEED_RESERVES] + [top]
        here = [self._predict(speed, 0.0, ahead, situation) for speed in set_speeds]
        fastest, selected = here[-1], None
        if required is not None:
            selected = next((item for item in here if item.outlook.touch_speed >= required), None)
            if selected is None:
                back = self._run_up_for(required, ahead.slope)
                if ahead.touch - back >= situation.free_from:
                    selected = self._predict(top, back, ahead, situation)
        # The nominal robot cannot stop before the touch.
        late = ahead.touch - motion.position < self._lines.braking.expected_distance(
            motion.speed, ahead.slope)
        if here[0].outlook.touch_speed > self._curve.highest_speed:
            selected, reason = None, Reason.TOO_FAST
        elif selected is not None and selected.lands:
            reason = Reason.WITHIN_CURVE
        elif late and fastest.outlook.probability >= PROBABILITY_MIN:
            selected, reason = fastest, Reason.COMMITTED
        elif selected is not None:
            selected, reason = None, Reason.LANDING
        elif failed:
            reason = Reason.FAILED_BEFORE
        elif required is not None:
            reason = Reason.NO_ROOM
        elif self._rule.conservative_height(face) > self._curve.height(top):
            reason = Reason.TOO_HIGH
        else:
            reason = Reason.NOT_LIKELY
        found = selected or fastest
        return Choice(
            None if selected is None else selected.candidate, reason, found.outlook,
            required_speed=math.nan if required is None else required,
            reachable_speed=fastest.outlook.touch_speed)

    def _predict(self, set_speed: float, back: float, ahead: Ahead, situation: Situation,
                 kept: bool = False) -> Prediction:
        """
        Predict the approach from here, or from rest at `back` before the touch [m].

        A plan is selected if the weakest robot can stop behind the edge, and kept if the nominal
        one can.
        """
        face, motion, braking = ahead.faces[0], situation.motion, self._lines.braking
        speed, run_up = (0.0, back) if back > 0.0 else (
            motion.speed, max(0.0, ahead.touch - motion.position))
        touch = braking.touch_speed(speed, set_speed, run_up, ahead.slope)
        behind = self._rule.speed_behind(face, touch, max(
            (one.touch_speed for one in situation.failures_at(face)), default=0.0))
        downhill = min(0.0, ahead.slope)
        needed = braking.expected_distance(behind, downhill) if kept \
            else braking.distance(behind, downhill, emergency=True)
        fitting = [end for end in ahead.ends
                   if all(other.height <= PASSABLE_HEIGHT_MAX
                          for other in ahead.faces[1:end.faces])
                   and end.passed + needed <= self._room_to(ahead, end)]
        end = (fitting or ahead.ends)[0]
        strategy = Strategy.BACK_OFF if back > 0.0 else Strategy.CARRY if end.faces > 1 else \
            Strategy.CRUISE if set_speed <= self._tuning.cruise_speed else Strategy.ACCELERATE
        probability = self._rule.probability(touch, face)
        return Prediction(
            Candidate(strategy, set_speed, HANGING_TIME * touch, back=back,
                      length=ahead.length(end)),
            Outlook(probability, 1.0 - probability, 0.0, touch_speed=touch,
                    height_limit=self._rule.height_limit(touch)), bool(fitting))

    def _room_to(self, ahead: Ahead, end: End) -> float:
        """Return the stop limit of the centre behind an end [m]."""
        return min([ahead.room_to, *(
            self._lines.before_face(face).position for face in ahead.faces[end.faces:]
            if not 0.0 <= face.height <= PASSABLE_HEIGHT_MAX)])

    def _run_up_for(self, required: float, slope: float) -> float:
        """Return the run-up from rest that reaches a touch speed with a reserve [m]."""
        def driven(run_up: float) -> float:
            return self._lines.braking.touch_speed(0.0, self._rule.highest_speed, run_up, slope)
        if driven(RUN_UP_MAX) < required:
            return math.inf
        return 1.1 * bisected(
            lambda run_up: driven(run_up) >= required, 0.0, RUN_UP_MAX, 20) + 0.05
