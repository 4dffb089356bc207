# SPDX-License-Identifier: Apache-2.0
"""Fuse observations of the next step with odometry into one step, or reject them."""
from collections import deque
from dataclasses import replace
import math
from statistics import median
from typing import Deque, Optional, Tuple

from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, FARTHEST, Profile, Reason, StepObservation
from ballbot_ros.physics.model.robot import Robot

# Minimum number of observations for estimating the scatter; default noise before.
ENOUGH = 5

# Window of the scatter estimate, and its minimum number of observations.
KEPT, LEAST_KEPT = 25, 10

# Minimum range of distances for a trend [m].
LEAST_BASE = 0.1

# Significance threshold of a trend, in standard deviations.
SIGNIFICANT = 4.0


class Trend:
    """Recursive linear regression of heights on distances."""

    def __init__(self) -> None:
        """Start without a look."""
        self.count = 0
        self._distance = self._height = 0.0
        self._dd = self._dh = self._hh = 0.0

    def add(self, distance: float, height: float) -> None:
        """Add an observation: distance [m] and height [m]."""
        self.count += 1
        far, high = distance - self._distance, height - self._height
        self._distance += far / self.count
        self._height += high / self.count
        # Welford: the second factor is the deviation from the new mean.
        self._dd += far * (distance - self._distance)
        self._dh += far * (height - self._height)
        self._hh += high * (height - self._height)

    @property
    def scatter(self) -> float:
        """Return the standard deviation about the trend [m]; NaN for too few observations."""
        if self.count < ENOUGH:
            return math.nan
        explained = self._dh**2 / self._dd if self._dd > 0.0 else 0.0
        return math.sqrt(max(0.0, self._hh - explained) / (self.count - 2))

    @property
    def growth(self) -> float:
        """
        Return the extrapolated height at distance 0 minus the mean observed height [m].

        0 without a significant trend; negative if the height decreases on approach.
        """
        scatter = self.scatter
        if not (scatter >= 0.0 and self._dd > self.count * LEAST_BASE**2 / 12.0):
            return 0.0
        slope = self._dh / self._dd
        if abs(slope) * math.sqrt(self._dd) <= SIGNIFICANT * scatter:
            return 0.0
        return -slope * self._distance


class Scatter:
    """
    Scatter of repeated observations, from the median of their successive differences.

    The median ignores a single jump.
    """

    def __init__(self) -> None:
        """Start without a look."""
        self._last = math.nan
        self._steps: Deque[float] = deque(maxlen=KEPT)

    def add(self, value: float) -> None:
        """Add an observation [m]."""
        if not math.isnan(self._last):
            self._steps.append(abs(value - self._last))
        self._last = value

    @property
    def sd(self) -> float:
        """Return the standard deviation of an observation [m]; NaN for too few."""
        if len(self._steps) < LEAST_KEPT:
            return math.nan
        # Of Gaussian values, half of the differences are within 0.6745 sqrt(2) deviations.
        return median(self._steps) / 0.9539


# Minimum standard deviations: odometry and observation are never exactly simultaneous, and
# odometry drifts during the approach.
DISTANCE_FLOOR = 0.010   # [m]
HEIGHT_FLOOR = 0.0001    # [m]

# Default standard deviations where the sensor reports none, before an estimate exists [m].
DEFAULT_DISTANCE, DEFAULT_HEIGHT = 0.020, 0.005

# Maximum scatter of observations; above it they contradict each other [m].
NOISE = 0.010

# Maximum ratio of observed scatter to reported deviation; above it the scatter counts.
TRUSTED_RATIO = 1.5

# A step may appear this far ahead of the centre when the ball has passed it.
PASSED_SLACK = 0.02      # [m]

# After a step is passed, a face at least this far beyond it is the next one.  A nearer face is the
# same one, displaced by odometry slip; treads are longer.
NEXT_FACE = 0.1          # [m]


class StepTracker:
    """
    Tracks the next step ahead.

    Observations of one step are averaged with weights 1 / variance at a fixed position on the
    odometry axis.  A standard deviation of 0 means unknown; the scatter of the observations
    replaces it.  The deviation of the average has a constant error as lower bound.  A trend of
    the height with distance adds its expected remaining change to the uncertainty.

    The first observation gives a step immediately, later ones when a second detection agrees.
    Once the centre has passed that position, the next detection is another step.  A detection that
    contradicts the step by more than `contradiction_sigma` deviations is reported, not averaged
    in; after `forget_after` consecutive contradictions the latest one replaces the step.  After as
    many observations without a step, the step is dropped, except within 1.5 radii, where a sensor
    may miss it.
    """

    def __init__(self, robot: Robot, tuning: DecisionTuning):
        """Start with nothing seen."""
        self._radius = robot.ball_radius
        self._sigmas = tuning.contradiction_sigma
        self._forget_after = tuning.forget_after
        self._bias = tuning.height_bias_sd
        self._unreported_bias = max(tuning.height_bias_sd, tuning.unreported_bias_sd)
        self._number = 0
        self.reset()

    def reset(self) -> None:
        """Forget all, for a jump of time or place; the numbers of steps go on counting."""
        self._step: Optional[Face] = None
        self._confirmed, self._first = False, True
        self._trend, self._heights, self._places = Trend(), Scatter(), Scatter()
        self._strikes = 0
        self._misses = 0

    def update(self, observation: StepObservation, position: float) -> Profile:
        """
        Take in one observation.

        Parameters
        ----------
        observation : StepObservation
        position : float
            Odometry of the ball's centre when it was made [m].

        Returns
        -------
        Profile
            With the reason of a rejection, if any; sensor data never raise an exception.

        """
        fault = _fault(observation, position)
        if fault:
            return self._reject(observation, Reason.BAD_OBSERVATION, fault)
        if not observation.detected and observation.height != 0.0:
            return self._reject(
                observation, Reason.CONTRADICTORY, 'no step is detected, but its height is '
                f'{1e3 * observation.height:.0f} mm')
        if observation.detected:
            # Rejected observations count for the scatter, too.
            self._heights.add(observation.height)
            self._places.add(position + observation.distance)
        contradiction = self._contradiction(observation, position)
        if contradiction and not self._confirmed:
            self._step, contradiction = None, ''
        if contradiction:
            self._strikes += 1
            if self._strikes < self._forget_after:
                return self._reject(observation, Reason.CONTRADICTORY, contradiction)
            self._replace(observation, position)
        self._strikes = 0
        seen_to = math.inf
        if observation.detected:
            self._take(observation, position)
        else:
            self._miss(position)
            if observation.distance > 0.0:
                seen_to = position + observation.distance
        self._first = False
        return Profile(observation.stamp, self._faces, seen_to=seen_to)

    def _bias_of(self, observation: StepObservation) -> float:
        """Return the standard deviation that averaging does not reduce [m]."""
        return self._bias if observation.height_sd > 0.0 else self._unreported_bias

    @property
    def _faces(self) -> Tuple[Face, ...]:
        """Return the step, if any, with all uncertainties."""
        return self._estimates if self._confirmed else ()

    @property
    def _estimates(self) -> Tuple[Face, ...]:
        """Return the step, confirmed or not."""
        step = self._step
        if step is None:
            return ()
        height_sd = max(step.height_sd, self._shown)
        return (replace(step, height_sd=math.hypot(height_sd, self._trend.growth)),)

    @property
    def _shown(self) -> float:
        """Return the deviation of the mean height from the scatter of observations, or 0 [m]."""
        found = [scatter / math.sqrt(max(1, self._trend.count))
                 for scatter in (self._trend.scatter, self._heights.sd)]
        return max((sd for sd in found if sd > 0.0), default=0.0)

    def _reject(self, observation: StepObservation, reason: Reason, why: str) -> Profile:
        """Return a profile that reports a rejection and keeps the step."""
        return Profile(observation.stamp, self._faces, rejection=reason, explanation=why)

    def _contradiction(self, observation: StepObservation, position: float) -> str:
        """Return how a finite observation contradicts the step, or an empty string."""
        step = next(iter(self._estimates), None)
        if step is None or not observation.detected or self._is_passed(position):
            return ''
        place_sd, height_sd = self._deviations(observation)
        far = math.hypot(step.position_sd, place_sd)
        high = math.hypot(step.height_sd, height_sd)
        moved = position + observation.distance - step.position
        grown = observation.height - step.height
        if abs(moved) > self._sigmas * far:
            return (f'the step jumped by {1e3 * moved:.0f} mm, more than {self._sigmas:g} '
                    'deviations')
        if abs(grown) > self._sigmas * high:
            return (f'the step changed from {1e3 * step.height:.0f} to '
                    f'{1e3 * observation.height:.0f} mm, more than {self._sigmas:g} deviations')
        return ''

    def _is_passed(self, position: float) -> bool:
        """Return whether the centre is beyond the face."""
        return self._step is not None and position > self._step.position - PASSED_SLACK

    def _begin(self, observation: StepObservation, position: float, number: int) -> None:
        """Start a step with an observation."""
        self._number, self._trend = number, Trend()
        self._confirmed = self._first
        place_sd, height_sd = self._deviations(observation)
        self._step = Face(
            number, position + observation.distance, observation.height, place_sd,
            max(height_sd, self._bias_of(observation)))
        self._trend.add(observation.distance, observation.height)

    def _deviations(self, observation: StepObservation) -> Tuple[float, float]:
        """Return the standard deviations of distance and height of one observation [m]."""
        return (_combined_sd(observation.distance_sd, self._places.sd, DEFAULT_DISTANCE,
                             DISTANCE_FLOOR),
                _combined_sd(observation.height_sd, self._heights.sd, DEFAULT_HEIGHT,
                             HEIGHT_FLOOR))

    def _replace(self, observation: StepObservation, position: float) -> None:
        """Replace the step by the latest observation."""
        step, self._step = self._step, None
        if step is None or not observation.detected:
            return
        moved = abs(position + observation.distance - step.position)
        grown = abs(observation.height - step.height)
        deviation = math.hypot(step.height_sd, self._deviations(observation)[1])
        # After odometry slip by less than a radius it is the same step.
        same = moved < self._radius and grown <= self._sigmas * deviation
        self._begin(observation, position, self._number + (0 if same else 1))
        self._confirmed = True

    def _take(self, observation: StepObservation, position: float) -> None:
        """Average a detection into the step, or start another step with it."""
        self._misses = 0
        step, place = self._step, position + observation.distance
        if step is None or (self._is_passed(position) and place > step.position + NEXT_FACE):
            self._begin(observation, position, self._number + 1)
            return
        self._confirmed = True
        place_sd, height_sd = self._deviations(observation)
        place, place_sd = _average(step.position, step.position_sd, place, place_sd)
        # Earlier weights used the reported deviations; the estimated scatter may be larger.
        height, height_sd = _average(
            step.height, max(step.height_sd, self._shown), observation.height, height_sd)
        self._step = Face(
            step.number, place, height, max(place_sd, DISTANCE_FLOOR),
            max(height_sd, self._bias_of(observation)))
        self._trend.add(observation.distance, observation.height)

    def _miss(self, position: float) -> None:
        """Drop the step when it is passed, or after enough misses."""
        if self._step is None:
            return
        self._misses += 1
        visible = self._step.position - position > 1.5 * self._radius
        if self._is_passed(position) or (visible and self._misses >= self._forget_after):
            self._step = None


def _fault(observation: StepObservation, position: float) -> str:
    """Return the reason why an observation is invalid, or an empty string."""
    if not (observation.finite and math.isfinite(position)):
        return 'a number of it is not finite'
    for name in ('distance', 'distance_sd', 'height_sd'):
        if getattr(observation, name) < 0.0:
            return f'{name} is negative ({getattr(observation, name):g} m)'
    for name in ('distance', 'height', 'distance_sd', 'height_sd'):
        if abs(getattr(observation, name)) > FARTHEST:
            return f'{name} is out of range ({getattr(observation, name):g} m)'
    return ''


def _combined_sd(reported: float, scatter: float, default: float, floor: float) -> float:
    """Return the standard deviation of an observation, from the reported one and the scatter."""
    scatter = min(scatter, NOISE) if math.isfinite(scatter) else math.nan
    if reported > 0.0:
        # Written so that an unknown scatter has no effect.
        return max(scatter if scatter > TRUSTED_RATIO * reported else reported, floor)
    return max(scatter, floor) if math.isfinite(scatter) else default


def _average(first: float, first_sd: float, second: float,
             second_sd: float) -> tuple[float, float]:
    """Return mean and deviation of two values weighted by 1 / variance."""
    one, two = first_sd**-2, second_sd**-2
    return (one * first + two * second) / (one + two), (one + two)**-0.5
