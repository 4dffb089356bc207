# SPDX-License-Identifier: Apache-2.0
"""The edges of the ground, each with the evidence of all sensors."""
from dataclasses import dataclass, field, replace
import math
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

from ballbot_ros.decision.values import Face, Reason

# Reason of the rejection of an observation, if any, and its explanation.
Rejection = Tuple[Optional[Reason], str]

# Minimum number of observations for estimating the scatter.
SCATTER_COUNT_MIN = 5
# Numbers of standard deviations: of the slope, by which a trend is reduced, and of the observed
# distances, over which it is extrapolated.
TREND_SIGMAS = 4.0
# Log-odds that an edge exists: increment of a detection, decrement of a miss, and largest value.
# An edge is confirmed at one value, and removed at 0.
DETECTION, MISS, EXISTENCE_MAX, CONFIRMED = 1.0, 0.25, 6.0, 2.0
# A confirmed edge enters the profile above the first height, and leaves it below the second [m]:
# lower edges are an uneven floor, which is crossed at any speed.
HEIGHT_ENTRY, HEIGHT_EXIT = 0.0045, 0.003


class Trend:
    """Recursive linear regression of heights on distances."""

    def __init__(self) -> None:
        self.count, self.latest = 0, 0.0  # number of observations, distance of the latest one [m]
        self._distance = self._height = 0.0
        self._dd = self._dh = self._hh = 0.0

    def add(self, distance: float, height: float) -> None:
        """Add an observation: distance [m] and height [m]."""
        self.count += 1
        self.latest = distance
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
        if self.count < SCATTER_COUNT_MIN:
            return math.nan
        explained = self._dh**2 / self._dd if self._dd > 0.0 else 0.0
        return math.sqrt(max(0.0, self._hh - explained) / (self.count - 2))

    @property
    def mean_sd(self) -> float:
        """Return the standard deviation of the mean height from the scatter [m], 0 if unknown."""
        scatter = self.scatter
        return scatter / math.sqrt(self.count) if scatter > 0.0 else 0.0

    @property
    def slope(self) -> float:
        """Return the change of height with distance, reduced by its uncertainty [1]."""
        scatter = self.scatter
        if not (scatter >= 0.0 and self._dd > 0.0):
            return 0.0
        slope = self._dh / self._dd
        certain = max(0.0, abs(slope) - TREND_SIGMAS * scatter / math.sqrt(self._dd))
        return math.copysign(certain, slope)

    @property
    def growth(self) -> float:
        """
        Return the extrapolated height at distance 0 minus the mean observed height [m].

        Continuous in the observations: the height is extrapolated with `slope`, and no farther
        than the observed distances justify; negative if the height decreases on approach.
        """
        if self.count == 0:
            return 0.0
        return -self.slope * min(
            self._distance, TREND_SIGMAS * math.sqrt(self._dd / self.count))


class Existence:
    """The log-odds that something exists; it is `confirmed` once they have reached `CONFIRMED`."""

    def __init__(self, certain: bool):
        """Count the first observation; a `certain` one confirms the existence."""
        self.log_odds = CONFIRMED if certain else DETECTION
        self.confirmed = certain

    def add(self, detected: bool) -> None:
        """Count a detection or a miss."""
        self.log_odds = min(self.log_odds + (DETECTION if detected else -MISS), EXISTENCE_MAX)
        self.confirmed |= self.log_odds >= CONFIRMED


@dataclass
class EdgeEstimate:
    """An edge as one sensor detects it."""

    mean: Face  # with the standard deviation of the random error of its height
    bias: float  # standard deviation of the constant error of its height [m]
    # Trend of the height over the observation distance.
    trend: Trend = field(default_factory=Trend)

    def face(self, number: int) -> Face:
        """Return the edge with all uncertainties and its number."""
        return replace(self.mean, number=number, height_sd=math.hypot(
            max(self.mean.height_sd, self.trend.mean_sd, self.bias), self.trend.growth))


@dataclass(eq=False)
class TrackedEdge:
    """An edge with the evidence of all sensors."""

    number: int
    exists: Existence
    step: Optional[EdgeEstimate] = None  # from a step sensor
    ground: Optional[EdgeEstimate] = None  # from a terrain sensor
    contradictions: int = 0  # consecutive observations of the step sensor that contradict `step`
    drift: float = 0.0  # displacement in the rolling direction of the ball [m]
    entered: bool = False  # whether it is in the profile


class EdgeMap:
    """
    The edges around the ball; each keeps its number while it is tracked.

    Two positions or heights contradict if they differ by `sigmas` standard deviations.
    """

    def __init__(self, sigmas: float):
        self._sigmas, self._number = sigmas, 0
        self.clear()

    def clear(self) -> None:
        """Remove all edges; their numbers are not used again."""
        self.edges: List[TrackedEdge] = []
        # The edges of the profile at the last `update`, from near to far.
        self.faces: Tuple[Face, ...] = ()

    def start(self, certain: bool) -> TrackedEdge:
        """Add an edge without measurements; one that is `certain` is confirmed."""
        edge = TrackedEdge(self.next_number(), Existence(certain))
        self.edges.append(edge)
        return edge

    def next_number(self) -> int:
        """Return an unused edge number."""
        self._number += 1
        return self._number

    def associate(self, faces: Sequence[Face], candidates: Iterable[TrackedEdge],
                  reach: float = 0.0) -> Dict[int, TrackedEdge]:
        """
        Assign simultaneous detections to edges; return the edges by index of the detection.

        Nearest pairs first; both have the same sign, and lie within the gate or `reach` [m].
        """
        pairs = sorted(((self._gap(known, face, reach), index, edge)
                        for edge, known in [(edge, self.face(edge)) for edge in candidates]
                        for index, face in enumerate(faces)), key=lambda pair: pair[0])
        found: Dict[int, TrackedEdge] = {}
        for gap, index, edge in pairs:
            if math.isfinite(gap) and index not in found and edge not in found.values():
                found[index] = edge
        return found

    def _gap(self, known: Face, face: Face, reach: float) -> float:
        """Return the distance of a detection from an edge [m]; infinite outside its gate."""
        gate = max(reach, self._sigmas * math.hypot(known.position_sd, face.position_sd))
        gap = abs(known.position - face.position)
        return gap if known.height * face.height > 0.0 and gap < gate else math.inf

    def update(self) -> None:
        """Remove edges that no sensor detects any more, and select the `faces` of the profile."""
        found = sorted(((self.face(edge), edge) for edge in self.edges
                        if edge.exists.log_odds > 0.0 and (edge.step or edge.ground)),
                       key=lambda item: item[0].position)
        self.edges = [edge for _, edge in found]
        for face, edge in found:
            edge.entered = edge.exists.confirmed and abs(face.height) > (
                HEIGHT_EXIT if edge.entered else HEIGHT_ENTRY)
        self.faces = tuple(face for face, edge in found if edge.entered)

    def move(self, distance: float) -> None:
        """Shift all edges by a distance [m], after odometry slip."""
        for edge in self.edges:
            for known in filter(None, (edge.step, edge.ground)):
                known.mean = replace(known.mean, position=known.mean.position + distance)

    def face(self, edge: TrackedEdge) -> Face:
        """Return the fused estimate of an edge; the larger height if the sensors contradict."""
        one, *others = (known.face(edge.number)
                        for known in filter(None, (edge.ground, edge.step)))
        if not others:
            return one
        other = others[0]
        change, change_sd = other.height - one.height, math.hypot(one.height_sd, other.height_sd)
        if abs(change) > self._sigmas * change_sd:
            return replace(one, height=max(one.height, other.height, key=abs),
                           height_sd=max(one.height_sd, other.height_sd, 0.5 * abs(change)))
        weight = one.height_sd**2 / change_sd**2
        # Averaging does not reduce constant errors.
        sd = max(one.height_sd * other.height_sd / change_sd,
                 min(one.height_sd, other.height_sd) / math.sqrt(2.0))
        return replace(one, height=one.height + weight * change, height_sd=sd)
