# SPDX-License-Identifier: Apache-2.0
"""Track edges by a sensor that detects the next step."""
from collections import deque
import math
from statistics import median
from typing import Deque, Optional

from ballbot_ros.decision.perception.edge_map import (
    EdgeEstimate, EdgeMap, Rejection, TrackedEdge)
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, POSITION_MAX, Reason, StepObservation

# Number of differences in the estimate of the scatter.
DIFFERENCES_MAX, DIFFERENCES_MIN = 25, 10


class Scatter:
    """
    Scatter of repeated observations, from the median of their successive differences.

    The median ignores a single jump.
    """

    def __init__(self) -> None:
        self._last = math.nan
        self._steps: Deque[float] = deque(maxlen=DIFFERENCES_MAX)

    def add(self, value: float) -> None:
        """Add an observation [m]."""
        if not math.isnan(self._last):
            self._steps.append(abs(value - self._last))
        self._last = value

    @property
    def sd(self) -> float:
        """Return the standard deviation of an observation [m]; NaN for too few of them."""
        if len(self._steps) < DIFFERENCES_MIN:
            return math.nan
        # Of Gaussian values, half of the differences are within 0.6745 sqrt(2) deviations.
        return median(self._steps) / 0.9539


# Minimum standard deviations: odometry and observation are never exactly simultaneous, and
# odometry drifts during the approach.
POSITION_SD_MIN = 0.010   # [m]
HEIGHT_SD_MIN = 0.0001    # [m]
# Default standard deviations where the sensor reports none, before an estimate exists [m].
DEFAULT_POSITION_SD, DEFAULT_HEIGHT_SD = 0.020, 0.005
# Largest number of observations in an average of heights.
AVERAGED_OBSERVATIONS = 50
# Maximum scatter of observations; above it they contradict each other [m].
SCATTER_MAX = 0.010
# Maximum ratio of observed scatter to reported deviation; above it the scatter counts.
SCATTER_RATIO_MAX = 1.5
# A step that the ball has passed may appear up to this far ahead of the centre.
PASSED_MARGIN = 0.02      # [m]
# A detection at least this far beyond a passed edge is the next edge.  A nearer one is the same
# edge, displaced by odometry slip; treads are longer.
NEXT_EDGE_GAP_MIN = 0.1          # [m]


class StepTracker:
    """
    Fuses the observations of a step sensor into an edge map.

    Observations of one edge are averaged with weights 1 / variance at a fixed position on the
    odometry axis.  A standard deviation of 0 means unknown; the scatter of the observations
    replaces it.  The deviation of the average has a constant error as lower bound, without effect
    on the weights.  The average follows a trend of the height with distance, which adds its
    expected remaining change to the uncertainty.

    A detection within a radius of an edge that contradicts it by more than `contradiction_sigma`
    deviations is reported, not averaged in; after `forget_after` consecutive contradictions the
    newest replaces the average.  A detection elsewhere is another edge; one before a confirmed
    edge starts with a miss, because the sensor has detected the farther one.  An observation of
    the ground beyond an edge, but not of the edge, is a miss, except within 1.5 radii of the ball,
    where a sensor may look over it.  Without a reported range, the observed ground ends at the
    largest distance at which the sensor has detected an edge.
    """

    def __init__(self, radius: float, tuning: DecisionTuning, edges: EdgeMap):
        self._radius, self.tuning, self._edges = radius, tuning, edges
        self.reset()

    def reset(self) -> None:
        """Discard the scatter and the range of the sensor."""
        self._first, self._range = True, 0.0
        self.seen_to = math.inf  # end of the floor, observed or assumed by `unseen_room` [m]
        self._heights, self._positions = Scatter(), Scatter()

    def update(self, observation: StepObservation, position: float) -> Rejection:
        """Fuse one observation, made at a position of the ball's centre [m]."""
        fault = _fault(observation, position)
        if fault:
            return Reason.BAD_OBSERVATION, fault
        if not observation.detected:
            if observation.height != 0.0:
                return Reason.CONTRADICTORY, ('no step is detected, but its height is '
                                              f'{1e3 * observation.height:.0f} mm')
            limited = observation.distance > 0.0
            self._accept(position + (observation.distance or self._range), position, None,
                         position + observation.distance if limited else math.inf)
            return None, ''
        # Rejected observations count for the scatter, too.
        self._heights.add(observation.height)
        self._positions.add(position + observation.distance)
        shown = Face(0, position + observation.distance, observation.height,
                     _combined_sd(observation.distance_sd, self._positions.sd, DEFAULT_POSITION_SD,
                                  POSITION_SD_MIN),
                     _combined_sd(observation.height_sd, self._heights.sd, DEFAULT_HEIGHT_SD,
                                  HEIGHT_SD_MIN))
        edges, sigmas = self._edges, self.tuning.contradiction_sigma
        edge = edges.associate([shown], [
            one for one in edges.edges if one.step is not None
            and not _is_passed(one, position)], self._radius).get(0)
        if edge is not None and edge.step is not None:
            known, gap = edge.step.face(edge.number), ''
            moved, grown = shown.position - known.position, shown.height - known.height
            other = abs(grown) > sigmas * math.hypot(known.height_sd, shown.height_sd)
            if abs(moved) > sigmas * math.hypot(known.position_sd, shown.position_sd):
                gap = f'the step jumped by {1e3 * moved:.0f} mm'
            elif other:
                gap = (f'the step changed from {1e3 * known.height:.0f} to '
                       f'{1e3 * shown.height:.0f} mm')
            if gap:
                edge.contradictions += 1
                if edge.exists.confirmed and edge.contradictions < self.tuning.forget_after:
                    return Reason.CONTRADICTORY, f'{gap}, more than {sigmas:g} deviations'
                edge.step = None
                edge.number = edges.next_number() if other else edge.number
            edge.exists.add(not gap)
        else:
            # Odometry slip displaces an edge that is passed; treads are longer.
            edge = edges.associate([shown], [
                one for one in edges.edges if one.step is not None and _is_passed(one, position)
                and shown.position <= one.step.mean.position + NEXT_EDGE_GAP_MIN],
                math.inf).get(0) or edges.associate(
                    [shown], [one for one in edges.edges if one.step is None]).get(0)
            if edge is None:
                edge = edges.start(self._first)
                if any(one.exists.confirmed and one.step is not None
                       and one.step.mean.position > shown.position for one in edges.edges):
                    # The sensor detects the next edge only, and has not detected this one.
                    edge.exists.add(False)
            else:
                edge.exists.add(True)
        self._average(edge, shown, observation)
        if edge.exists.confirmed:
            self._range = max(self._range, observation.distance)
        self._accept(shown.position, position, edge, math.inf)
        return None, ''

    def _average(self, edge: TrackedEdge, shown: Face, observation: StepObservation) -> None:
        """Average a detection into an edge."""
        edge.contradictions = 0
        if edge.step is None:
            edge.step = EdgeEstimate(shown, self.tuning.height_bias(observation.height_sd > 0.0))
        else:
            known, trend = edge.step.mean, edge.step.trend
            position, position_sd = _average(
                known.position, known.position_sd, shown.position, shown.position_sd)
            expected = known.height + trend.slope * (observation.distance - trend.latest)
            # Earlier weights used the reported deviations; the scatter, NaN while it is unknown,
            # may be larger.
            expected_sd = max(
                known.height_sd, shown.height_sd / math.sqrt(AVERAGED_OBSERVATIONS),
                self._heights.sd / math.sqrt(trend.count))
            height, height_sd = _average(
                expected, expected_sd, shown.height, shown.height_sd)
            edge.step.mean = Face(
                0, position, height, max(position_sd, POSITION_SD_MIN), height_sd)
        edge.step.trend.add(observation.distance, observation.height)

    def _accept(self, clear_to: float, position: float, shown: Optional[TrackedEdge],
                seen_to: float) -> None:
        """Count a miss of the edges before `clear_to`, and drop the estimates of passed ones."""
        self._first = False
        for edge in self._edges.edges:
            if edge is shown or edge.step is None:
                continue
            if _is_passed(edge, position):
                edge.step = None
            elif not edge.exists.confirmed or \
                    position + 1.5 * self._radius < edge.step.mean.position <= clear_to:
                edge.exists.add(False)
        self._edges.update()
        # The sensor does not observe the ground behind the next edge, which the ball may pass
        # before the next observation.
        self.seen_to = min([seen_to] + [
            self._edges.face(edge).position + self.tuning.unseen_room
            for edge in self._edges.edges if edge.step is not None and edge.exists.confirmed])


def _is_passed(edge: TrackedEdge, position: float) -> bool:
    """Return whether the centre is beyond an edge that the step sensor has detected."""
    return edge.step is not None and position > edge.step.mean.position - PASSED_MARGIN


def _fault(observation: StepObservation, position: float) -> str:
    """Return the reason why an observation is invalid, or an empty string."""
    if not all(map(math.isfinite, (*vars(observation).values(), position))):
        return 'it contains a value that is not finite'
    for name in ('distance', 'distance_sd', 'height_sd'):
        if getattr(observation, name) < 0.0:
            return f'{name} is negative ({getattr(observation, name):g} m)'
    for name in ('distance', 'height', 'distance_sd', 'height_sd'):
        if abs(getattr(observation, name)) > POSITION_MAX:
            return f'{name} is out of range ({getattr(observation, name):g} m)'
    return ''


def _combined_sd(reported: float, scatter: float, default: float, floor: float) -> float:
    """Return the standard deviation of an observation, from the reported one and the scatter."""
    scatter = min(scatter, SCATTER_MAX) if math.isfinite(scatter) else math.nan
    if reported > 0.0:
        # Written so that an unknown scatter has no effect.
        return max(scatter if scatter > SCATTER_RATIO_MAX * reported else reported, floor)
    return max(scatter, floor) if math.isfinite(scatter) else default


def _average(first: float, first_sd: float, second: float,
             second_sd: float) -> tuple[float, float]:
    """Return mean and deviation of two values weighted by 1 / variance."""
    one, two = first_sd**-2, second_sd**-2
    return (one * first + two * second) / (one + two), (one + two)**-0.5
