# SPDX-License-Identifier: Apache-2.0
"""What a step asks for and what the ball can give from where it is."""
from dataclasses import dataclass
import math
from typing import Optional

from ballbot_ros.crossing.rules import touch_distance
from ballbot_ros.decision.braking import Braking
from ballbot_ros.decision.profile import Face
from ballbot_ros.decision.situation import Knowledge

# Aim above the required speed by this [m/s], or by more where that is not reached in time: what
# is left of the error when the ball touches must not eat the margin.
HEADROOM = (0.05, 0.1)

# A previous set speed is kept up to this much above the required one [m/s].
KEPT = 0.15

# Nodes and weights of a mean over a normal distribution (Gauss and Hermite).
NODES = ((0.0, 0.53333333), (1.3556262, 0.22207592), (-1.3556262, 0.22207592),
         (2.8569700, 0.01125741), (-2.8569700, 0.01125741))

# No way back for a run-up is looked for beyond this [m].
LONGEST_RUN_UP = 6.0


@dataclass(frozen=True)
class Reach:
    """
    What a step asks for and what can be had; all speeds are those at touch.

    Attributes
    ----------
    conservative : float
        Height with its margins [m].
    run_up : float
        Distance until touch [m].
    top : float
        What is allowed and still on the curve [m/s].
    required : float or None
        With its margin; None above the end of the curve [m/s].
    set_speed : float
        To drive at [m/s].
    driven : float
        What comes of that, from here [m/s].
    reachable : float
        At the highest set speed, from here [m/s].
    slowest : float
        Braking from here [m/s].
    spare : float
        What could be added to the height until `driven` is not enough, negative where it
        is not; NaN where `driven` lies below the curve [m].
    probability : float
        Of getting over at `driven`.

    """

    conservative: float
    run_up: float
    top: float
    required: Optional[float]
    set_speed: float
    driven: float
    reachable: float
    slowest: float
    spare: float
    probability: float


class Reckoning:
    """Reckons what can be had with what is known of robot, curve and tuning."""

    def __init__(self, knowledge: Knowledge, braking: Braking):
        """Work the constants out once."""
        self._radius = knowledge.robot.ball_radius
        self._curve, self._tuning = knowledge.curve, knowledge.tuning
        self.braking = braking
        self.top = min(knowledge.tuning.highest_speed, knowledge.curve.highest_speed)

    def reach(self, face: Face, distance: float, speed: float, slope: float, *,
              margins: float = 1.0, faster_than: float = 0.0, kept: float = 0.0) -> Reach:
        """
        Return what the step asks for and what can be had.

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
            A speed at touch that is known not to be enough [m/s].
        kept : float
            Set speed so far, which is kept where it still fits [m/s].

        """
        tuning, braking = self._tuning, self.braking
        deviation = math.hypot(face.height_sd, tuning.height_bias_sd)
        conservative = self._conservative(face, margins)
        run_up = max(0.0, distance - touch_distance(self._radius, face.height))
        required = self._required(face, margins, faster_than)
        # Fewer margins are for going on; it aims at all of them.
        aim = required if margins >= 1.0 else self._required(face, 1.0, faster_than) or self.top
        least, slow = aim or 0.0, tuning.cruise_speed
        reachable = self._driven(speed, self.top, run_up, slope)
        chosen = [min(self.top, max(least + more, slow)) for more in HEADROOM] + [self.top]
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
            conservative, run_up, self.top, required, set_speed, driven, reachable, slowest,
            self._curve.height(clean) - conservative if clean >= self._curve.lowest_speed
            else math.nan, self.probability(driven, face.height, deviation))

    def run_up_for(self, required: float, slope: float) -> float:
        """Return the run-up from rest that reaches a speed at touch with some to spare [m]."""
        near, far = 0.0, LONGEST_RUN_UP
        if self._driven(0.0, self.top, far, slope) < required:
            return math.inf
        for _ in range(20):
            middle = 0.5 * (near + far)
            if self._driven(0.0, self.top, middle, slope) < required:
                near = middle
            else:
                far = middle
        return 1.1 * far + 0.05

    def probability(self, speed: float, height: float, deviation: float) -> float:
        """
        Return the probability of getting over.

        The mean over the height as it is believed to be, and over a speed at touch whose
        deviation is half the speed margin.

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
        # A slower ball than the curve knows climbs less, as the square of its speed.
        height = height if speed >= low else height * (low / max(speed, 1e-3))**2
        steepness = (curve.height(min(inside + 0.01, high))
                     - curve.height(max(inside - 0.01, low))) / (
                         min(inside + 0.01, high) - max(inside - 0.01, low))
        sd = math.hypot(deviation, 0.5 * self._tuning.speed_margin * inside * steepness)
        return sum(weight * self._part(inside, height + sd * node) for node, weight in NODES)

    def height_limit(self, speed: float) -> float:
        """Return the step that is crossed at a speed with the required probability [m]."""
        curve, band = self._curve, self._curve.band
        if not curve.lowest_speed <= speed:
            return math.nan
        speed = min(speed, curve.highest_speed)
        if band is None:
            return curve.height(speed) - curve.residual
        return band.quantile(min(max(speed, band.speeds[0]), band.speeds[-1]),
                             1.0 - self._tuning.required_probability)

    def speed_behind(self, face: Face, driven: float, sigmas: float,
                     not_enough: float = 0.0) -> float:
        """
        Return what is left of a speed at touch when the centre passes the edge [m/s].

        Getting over a step takes, in squares of speeds, that which is needed to get over it
        just so; runs of the full model keep a little less.

        Parameters
        ----------
        face : Face
        driven : float
            At touch [m/s].
        sigmas : float
            Standard deviations by which the step is lower, and the ball faster, than expected.
        not_enough : float
            A speed at touch that did not get over it [m/s].

        """
        tuning = self._tuning
        lower = max(0.0, face.height - sigmas * math.hypot(
            face.height_sd, tuning.height_bias_sd))
        fastest = driven * (1.0 + 0.25 * sigmas * tuning.speed_margin)
        needed = self._curve.required_speed(lower) or self._curve.highest_speed
        if lower < self._curve.height(self._curve.lowest_speed):
            needed = 0.0
        needed = max(needed, not_enough)
        return math.sqrt(max(0.0, fastest * fastest - needed * needed))

    def _conservative(self, face: Face, margins: float) -> float:
        """Return a height with a part of its margins [m]."""
        tuning = self._tuning
        deviation = math.hypot(face.height_sd, tuning.height_bias_sd)
        return face.height + margins * (tuning.sigma_margin * deviation + tuning.height_margin)

    def _required(self, face: Face, margins: float, faster_than: float) -> Optional[float]:
        """Return the speed that keeps the margins and is likely enough [m/s]."""
        tuning = self._tuning
        required = self._curve.required_speed(self._conservative(face, margins))
        if required is None:
            return None
        required = max(required * (1.0 + margins * tuning.speed_margin), faster_than)
        likely = 1.0 - (1.0 - tuning.required_probability) / margins
        deviation = math.hypot(face.height_sd, tuning.height_bias_sd)
        if self.probability(required, face.height, deviation) >= likely:
            return required
        near, far = required, self.top
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
        """Return what a set speed comes to at touch [m/s]."""
        return self.braking.touch_speed(speed, set_speed, run_up, slope)

    def _part(self, speed: float, height: float) -> float:
        """Return the part of the robots that get over a step at a speed within the curve."""
        band = self._curve.band
        if band is None:
            above = self._curve.height(speed) - height
            return 0.5 * (1.0 + math.erf(above / max(self._curve.residual, 1e-6)))
        return band.probability_of_passing(
            min(max(speed, band.speeds[0]), band.speeds[-1]), height)
