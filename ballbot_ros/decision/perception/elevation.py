# SPDX-License-Identifier: Apache-2.0
"""A map of heights along the odometry axis, to which each scan is aligned and added."""
import math
from typing import List, NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import Array

Whole = NDArray[np.intp]
Flags = NDArray[np.bool_]

CELL = 0.01          # [m] between the nodes of the map
MAP_BEHIND, MAP_AHEAD = 1.0, 5.0  # extent of the map and of scans [m]
# Position uncertainty of a point on the axis [m]: stamps of odometry and scan differ.
POSITION_SD = 0.01
# The ground between points farther apart than the first value [m] is not observed if it is
# occluded, or if the polyline has more points than the second value: samples, not corners.
GAP_MIN, SAMPLES_MIN = 0.03, 50
# Minimum slope between the points before and behind an occluded interval, relative to the line of
# sight: the points lie neither at the edge nor where the line of sight meets the ground.
OCCLUSION_SLOPE_MIN = 0.35
# Maximum slope of a floor [1].
SLOPE_MAX = 0.3
# Minimum height of a face at the end of the observed terrain [m].
WALL_HEIGHT_MIN = 0.02


class Scan(NamedTuple):
    """A scan resampled to n nodes of the map; the arrays are (n,)."""

    first: int  # node of the first element; node k is at k * CELL on the odometry axis
    z: Array  # height relative to the centre of the ball [m], NaN where not observed
    steep: Array  # change of height within `POSITION_SD` [m]
    share: Array  # variance of a node over that of its adjacent points
    reported_sd: Array  # standard deviation of the points, 0 if unknown [m]
    bend: Array  # deviation of the points from the line between their neighbours [m]
    spacing: float  # median spacing of the observed points [m]

    @property
    def places(self) -> Array:
        """Return the positions of the nodes along the odometry axis [m]."""
        found: Array = np.arange(self.first, self.first + len(self.z), dtype=float) * CELL
        return found


@compiled
def write_medians(values: Array, window: Array, found: Array) -> None:
    """Write the (2, n) result of `medians`; `window` is a work array, (7,)."""
    last = len(values) - 1
    for index in range(len(values)):
        for row in range(2):
            for side in range(7):
                place = index + side - 3
                place = last - abs(last - abs(place)) if last > 2 else min(max(place, 0), last)
                value = values[place] if row == 0 else abs(values[place] - found[0, index])
                rank = side
                while rank > 0 and window[rank - 1] > value:
                    window[rank] = window[rank - 1]
                    rank -= 1
                window[rank] = value
            found[row, index] = window[3]


def medians(values: Array) -> Array:
    """
    Return the medians of each value and its neighbours, and of their deviations from it, (2, n).

    Three neighbours on each side.  At the ends they count twice: a last point beyond a gap is not
    its own median.
    """
    found = np.empty((2, len(values)))
    write_medians(values, np.empty(7), found)
    return found


def middle(values: Array) -> float:
    """Return the upper median of a non-empty array; `numpy.median` takes eight times as long."""
    half, found = len(values) // 2, values.copy()
    found.partition(half)
    return float(found[half])


def deviation(bends: Array) -> float:
    """Return the standard deviation of heights with such bends [m], 0 for too few."""
    return 1.4826 * middle(bends) / math.sqrt(6.0) if len(bends) > 20 else 0.0


def means_around(counted: Flags, *items: Array) -> List[Array]:
    """Return means over `NOISE_NODES` nodes, shrunk towards the total mean where few count."""
    places, half = np.arange(len(counted)), NOISE_NODES // 2
    begin, end = np.maximum(places - half, 0), np.minimum(places + half + 1, len(counted))

    sums = np.zeros((1 + len(items), 1 + len(counted)))
    np.cumsum(np.where(counted, (np.ones(len(counted)), *items), 0.0), axis=1, out=sums[:, 1:])
    count, *totals = (sums[:, end] - sums[:, begin]
                      + OVERLAP_MIN * sums[:, -1:] / np.count_nonzero(counted))
    return [total / count for total in totals]


def resample(x: Array, z: Array, z_sd: Array, kept: Flags, position: float) -> Optional[Scan]:
    """
    Return the polyline resampled to the nodes, None if it covers fewer than three.

    Parameters
    ----------
    x, z, z_sd : (n,) arrays
        Relative to the centre of the ball; x does not decrease [m].
    kept : (n,) array of bool
        False for outliers; the ground at an outlier is not observed.
    position : float
        Position of the centre [m].

    """
    lost = np.diff(np.flatnonzero(kept)) > 1
    x, z, z_sd = x[kept], z[kept], z_sd[kept]
    if len(x) < 2:
        return None
    first = math.ceil(max(x[0], -MAP_BEHIND) / CELL + position / CELL - 1e-9)
    last = math.floor(min(x[-1], MAP_AHEAD) / CELL + position / CELL + 1e-9)
    if np.ptp(z[x > x[-1] - CELL]) > WALL_HEIGHT_MIN:
        last += 1  # the scan ends at a wall beyond the last node
    if last - first < 2:
        return None
    places = np.arange(first, last + 1) * CELL - position
    heights = np.interp(places, x, z)
    run, rise = np.diff(x), np.diff(z)
    # As seen from the centre, the ground behind an edge is occluded up to a line through the edge.
    # On sloping ground, rises and the height of the centre are taken relative to the local slope,
    # which reduces the criterion to that of a level floor.
    grade = np.clip(medians(rise / np.maximum(run, 1e-9))[0], -SLOPE_MAX, SLOPE_MAX)
    excess, below = rise - run * grade, np.minimum(z[:-1] - grade * x[:-1], 0.0)
    far = run > GAP_MIN
    hidden = lost | far & (x[:-1] > 0.0) & (
        excess * np.maximum(x[:-1], CELL) < OCCLUSION_SLOPE_MIN * below * run)
    # A face may lie anywhere between two distant points.
    wide = far & (len(x) > SAMPLES_MIN)
    interval = np.clip(np.searchsorted(x, places, side='right') - 1, 0, len(run) - 1)
    beside = np.where(hidden, 1e-9, CELL)[interval]
    heights[(hidden | wide)[interval] & (places > x[interval] + beside)
            & (places < x[interval + 1] - beside)] = np.nan
    if np.count_nonzero(np.isfinite(heights)) < 3:
        return None
    steep = np.zeros(len(heights))
    steep[1:-1] = 0.5 * POSITION_SD / CELL * np.abs(heights[2:] - heights[:-2])
    steep[np.isnan(steep)] = 0.0
    part = np.clip((places - x[interval]) / np.maximum(run[interval], 1e-9), 0.0, 1.0)
    slack = np.where(wide, CELL * np.abs(excess) / np.maximum(run, CELL), 0.0)
    np.maximum(steep, slack[interval], out=steep)
    bend = np.abs(rise[1:] * run[:-1] - rise[:-1] * run[1:]) / np.maximum(
        np.maximum(run[1:], run[:-1]), 1e-9)
    return Scan(first, heights, steep, part**2 + (1.0 - part)**2, np.interp(places, x, z_sd),
                np.interp(places, x[1:-1], bend) if len(x) > 2 else np.zeros(len(places)),
                middle(run))


NODES = round((MAP_BEHIND + MAP_AHEAD) / CELL) + 40  # of the map, with a margin
# Default noise of a sensor that reports none [m], and number of scans for estimating it.
DEFAULT_NOISE_SD, SCANS_MIN = 0.005, 5
NOISE_SD_MIN = 1e-4      # [m]
# Number of scans in the running means of heights, noise and tilt; of nodes in that of the noise.
AVERAGED_SCANS, NOISE_NODES = 20, 41
# Factor on the variance per scan with which a Kalman filter averages `AVERAGED_SCANS` scans.
FADING = AVERAGED_SCANS / (AVERAGED_SCANS - 1)
# Minimum overlap for aligning a scan and for detecting a slip, in nodes; minimum length for
# estimating the tilt of a scan [m].
OVERLAP_MIN, SLIP_OVERLAP_MIN, TILT_LENGTH_MIN = 5, 20, 0.5
# Maximum fraction of contradicting nodes; some one percent of camera points are outliers.
OUTLIER_FRACTION_MAX = 0.15
# Maximum odometry slip between scans, in nodes.
SLIP_NODES_MAX = 25


class ElevationMap:
    """
    Heights of the ground at nodes `CELL` apart, each with its variance.

    Each node has a Kalman filter, which averages scans with weights 1 / variance.  As z is
    relative to the centre of a ball that moves up and down, a scan is first shifted and tilted to
    fit its overlap with the map.  After the first scan, a node becomes known when two consecutive
    scans agree within the uncertainty of the more precise one: in occluded ground there are
    outliers only, which no later scan would correct.
    """

    def __init__(self, tuning: DecisionTuning):
        self._sigmas, self._forget_after = tuning.contradiction_sigma, tuning.forget_after
        self.clear()

    def clear(self) -> None:
        self.first, self.scans = 0, 0  # node of the first element, number of scans in the map
        self.height = np.zeros(NODES)  # [m]
        # Variance of the average of the scans, without the texture; infinite if unobserved [m2].
        self.variance = np.full(NODES, np.inf)
        self.known = np.zeros(NODES, bool)
        self._strikes = np.zeros(NODES)
        # Estimated variance of a point as a function of its distance from the ball [m2].
        self._noise = np.zeros(NODES)
        self.spacing = CELL  # of the observed points [m]
        self.reports_sd = True  # whether the sensor reports its standard deviations

    def add(self, scan: Scan, position: float) -> str:
        """
        Add a scan made at a position of the ball [m], unless it contradicts the map.

        Returns the contradiction, an empty string if there is none.
        """
        self._follow(position)
        inside = slice(scan.first - self.first, scan.first - self.first + len(scan.z))
        old, variance = self.height[inside], self.variance[inside]
        self.reports_sd, self.spacing = bool(scan.reported_sd.max() > 0.0), scan.spacing
        begin = max(0, scan.first - math.ceil((position - MAP_BEHIND) / CELL - 1e-9))
        noise = self._noise[begin:begin + len(scan.z)]
        new_variance = scan.steep**2 + scan.share * np.maximum(
            self._expected(scan)**2, np.where(noise > 0.0, noise, noise.max()))
        seen = np.isfinite(scan.z)
        common = seen & self.known[inside]
        places = scan.places - position
        if np.count_nonzero(common) < OVERLAP_MIN:
            self._begin(inside, scan, new_variance, places)
            return ''
        together = variance + new_variance
        shift, tilt, aligned = _alignment(places, old - scan.z, together, common)
        residual = scan.z + shift + tilt * places - old
        # A vague height would confirm an outlier, too.
        agreeing = np.where(
            self.known[inside], together, 2.0 * np.minimum(variance, new_variance))
        contradicted = seen & (residual**2 > self._sigmas**2 * agreeing)
        outside = common & contradicted
        if np.count_nonzero(outside) > max(5, OUTLIER_FRACTION_MAX * np.count_nonzero(common)):
            worst = int(np.argmax(np.where(common, residual**2 / together, -1.0)))
            return (f'the ground changed by {1e3 * residual[worst]:.0f} mm at '
                    f'{places[worst]:.2f} m, and by more than {self._sigmas:g} deviations at '
                    f'{np.count_nonzero(outside)} of {np.count_nonzero(common)} places')
        new_variance += aligned
        self._learn(noise, residual / np.sqrt(scan.share), (variance + aligned) / scan.share,
                    common & ~outside & (scan.steep < 0.001))
        # Scans are relative to gravity: the map uses their mean tilt, so that it does not drift.
        part = tilt / min(self.scans, AVERAGED_SCANS)
        self.height -= part * ((np.arange(NODES) + self.first) * CELL - position)
        self._fuse(inside, scan.z + shift + (tilt - part) * places, new_variance, residual, seen,
                   contradicted)
        return ''

    def slip(self, scan: Scan) -> int:
        """
        Return the offset in nodes of a contradicting scan relative to the map, or 0.

        The odometry slips while the ball climbs, or spins at the foot of a step: the terrain has
        not moved, but the odometry is ahead or behind.
        """
        fits = []
        for nodes in range(-SLIP_NODES_MAX, SLIP_NODES_MAX + 1):
            begin = scan.first - nodes - self.first
            if begin < 0 or begin + len(scan.z) > NODES:
                continue
            inside = slice(begin, begin + len(scan.z))
            known = self.known[inside] & np.isfinite(scan.z)
            if np.count_nonzero(known) >= SLIP_OVERLAP_MIN:
                apart = self.height[inside][known] - scan.z[known]
                apart -= middle(apart)
                together = (self.variance[inside][known] + scan.steep[known]**2
                            + DEFAULT_NOISE_SD**2 / 4.0)
                outside = np.count_nonzero(apart**2 > self._sigmas**2 * together)
                fits.append((outside / len(apart), abs(nodes), nodes))
        best = min(fits, default=(1.0, 0, 0))
        return best[2] if best[0] <= OUTLIER_FRACTION_MAX / 3.0 else 0

    @property
    def texture(self) -> float:
        """Return the roughness of the map [m]: of the floor, and of the averaged noise."""
        lag = max(1, math.ceil(self.spacing / CELL))
        known = np.where(self.known, self.height, np.nan)
        bend = np.abs(known[2 * lag:] - 2.0 * known[lag:-lag] + known[:-2 * lag])
        return deviation(bend[np.isfinite(bend)])

    def _expected(self, scan: Scan) -> Array:
        """Return the reported or default standard deviations of the points of a scan [m]."""
        least: Array = np.full(
            len(scan.z), NOISE_SD_MIN if self.scans >= SCANS_MIN else DEFAULT_NOISE_SD)
        if self.scans < SCANS_MIN and self.reports_sd:
            # Bends at faces are outliers.
            bend = np.minimum(scan.bend, 3.0 * math.sqrt(6.0) * deviation(scan.bend))
            roughness, = means_around(np.ones(len(bend), bool), math.sqrt(math.pi / 12.0) * bend)
            least = np.clip(roughness, NOISE_SD_MIN, DEFAULT_NOISE_SD)
        found: Array = np.maximum(scan.reported_sd, least)
        return found

    def _begin(self, inside: slice, scan: Scan, variance: Array, places: Array) -> None:
        """Initialize the map with a scan; the floor below the ball is at 0."""
        self.variance[:] = np.inf
        self.known[:] = False
        self._strikes[:] = 0.0
        seen = self.known[inside] = np.isfinite(scan.z)
        below = scan.z[seen & (np.abs(places) < 0.1)]
        datum = middle(below) if len(below) else float(scan.z[seen][0])
        self.height[inside] = np.where(seen, scan.z - datum, 0.0)
        self.variance[inside] = np.where(seen, variance, np.inf)
        self.scans = 1

    def _learn(self, noise: Array, residual: Array, variance: Array, even: Flags) -> None:
        """Estimate the noise from the residuals, as a function of the distance from the ball."""
        self.scans += 1
        if np.count_nonzero(even) < OVERLAP_MIN:
            return
        off, known = means_around(even, np.abs(residual), variance)
        # The mean absolute deviation of a normal distribution is 0.8 standard deviations.
        total = 0.5 * math.pi * off**2
        # The average in the map is at least as accurate as one scan.
        own = np.maximum(total - known, 0.5 * total) + NOISE_SD_MIN**2
        noise += np.where(noise > 0.0, 1.0 / min(self.scans - 1, AVERAGED_SCANS), 1.0) \
            * (own - noise)

    def _fuse(self, inside: slice, new: Array, new_variance: Array, residual: Array,
              seen: Flags, contradicted: Flags) -> None:
        """Fuse an aligned scan; replace nodes that are unknown, or contradicted repeatedly."""
        old, variance, strikes = self.height[inside], self.variance[inside], self._strikes[inside]
        known = self.known[inside]
        strikes[:] = np.where(contradicted, strikes + 1.0, np.where(seen, 0.0, strikes))
        fresh = seen & np.isinf(variance) | contradicted & (
            ~known | (strikes >= self._forget_after))
        fused = seen & ~contradicted & ~fresh
        known |= fused
        faded = np.where(fused, FADING * variance, 0.0)
        gain = faded / (faded + new_variance)
        gain[fresh] = 1.0
        # A contradicting point is not averaged, but increases the variance.
        variance[:] = np.where(contradicted, variance + 0.04 * residual**2, variance)
        strikes[fresh] = 0.0
        old[:] = np.where(seen, old + gain * np.where(fused, residual, new - old), old)
        variance[:] = np.where(fused, (1.0 - gain) * faded, variance)
        variance[fresh] = new_variance[fresh]
        variance[~known & ~seen] = np.inf

    def _follow(self, position: float) -> None:
        """Move the map with the ball."""
        wanted = math.floor((position - MAP_BEHIND) / CELL) - 4
        by = wanted - self.first
        if -4 <= by <= 4:
            return
        self.first = wanted
        gained = slice(-by, None) if by > 0 else slice(None, -by)
        for array, blank in ((self.height, 0.0), (self.variance, np.inf), (self.known, False),
                             (self._strikes, 0.0)):
            array[:] = np.roll(array, -by)
            array[gained] = blank


def _alignment(places: Array, difference: Array, variance: Array,
               common: Flags) -> Tuple[float, float, Array]:
    """Return the shift [m] and tilt of a robust fit of map minus scan, and its variance."""
    x, d, weight = places[common], difference[common], 1.0 / variance[common]
    shift, tilt, tilt_variance = middle(d), 0.0, 0.0
    long = x[-1] - x[0] > TILT_LENGTH_MIN
    for _ in range(2):
        off = np.abs(d - shift - tilt * x)
        limit = max(3.0 * 1.4826 * middle(off), 0.0005)
        kept = np.where(off <= limit, weight, 0.0)
        total = kept.sum()
        mean_x, mean_d = (kept * x).sum() / total, (kept * d).sum() / total
        spread = (kept * (x - mean_x)**2).sum()
        if long and spread > 0.0:
            tilt = float((kept * (x - mean_x) * (d - mean_d)).sum() / spread)
            tilt_variance = 1.0 / spread
        shift = float(mean_d - tilt * mean_x)
    return shift, tilt, 1.0 / total + tilt_variance * (places - mean_x)**2
