# SPDX-License-Identifier: Apache-2.0
"""Fuse polylines of the ground with odometry into a profile, or reject them."""
from collections import deque
from dataclasses import dataclass, field, replace
import math
from typing import Deque, List, Optional, Tuple

import numpy as np

from ballbot_ros.decision.perception.elevation import (
    CELL, ElevationMap, Flags, Look, PLACE_SD, resample)
from ballbot_ros.decision.perception.ground import Found, ground_of, GroundSeen
from ballbot_ros.decision.perception.ground_profile import (
    SLOPE_HYSTERESIS, SLOPE_LENGTH, steep_stretches)
from ballbot_ros.decision.perception.step_tracker import Trend
from ballbot_ros.decision.tuning import DecisionTuning
from ballbot_ros.decision.values import Face, FARTHEST, Profile, Reason, TerrainObservation
from ballbot_ros.physics.model.robot import Robot
from ballbot_ros.physics.model.terrain import Array

# More points than a row of any camera are invalid.
MOST_POINTS = 5000

# A sensor with this range behind, and a smaller one ahead, is mounted backwards [m].
FAR_BEHIND = 0.6

# An offset of the floor from the bottom of the ball is subtracted as a mounting error up to this;
# beyond, it is not the floor below the ball [m].
LARGEST_OFFSET = 0.03

# Largest height of a ball over an edge, or in the air, above previously observed ground [m].
LARGEST_LIFT = 0.3


def fault(observation: TerrainObservation, frame: str) -> str:
    """
    Return the reason why an observation is invalid, or an empty string.

    Parameters
    ----------
    observation : TerrainObservation
        Unchecked, but made of floats.
    frame : str
        In which it must be.

    """
    count = len(observation.x)
    if observation.frame != frame:
        return f'it is in frame {observation.frame[:40]!r}, not in {frame!r}'
    if len(observation.z) != count or len(observation.z_sd) not in (0, count):
        return (f'{count} x have {len(observation.z)} z and {len(observation.z_sd)} standard '
                'deviations')
    if not 2 <= count <= MOST_POINTS:
        return f'it has {count} points, 2 to {MOST_POINTS} are possible'
    return _of_numbers(*arrays(observation),
                       np.array((observation.stamp, observation.x_min, observation.x_max)))


def arrays(observation: TerrainObservation) -> Tuple[Array, Array, Array]:
    """Return x, z and standard deviations, each of shape (n,); 0 for those that are unknown."""
    x, z = np.array(observation.x, dtype=float), np.array(observation.z, dtype=float)
    known = np.array(observation.z_sd, dtype=float) if observation.z_sd else np.zeros(len(x))
    return x, z, known


def _of_numbers(x: Array, z: Array, z_sd: Array, others: Array) -> str:
    """Return the reason why arrays of one length are invalid, or an empty string."""
    largest = [float(np.abs(numbers).max()) for numbers in (x, z, z_sd, others)]
    if not np.isfinite(largest).all():
        return 'a number of it is not finite'
    if max(largest[:3]) > FARTHEST or np.abs(others[1:]).max() > FARTHEST:
        return f'ground {max(largest[:3]):g} m away is out of range'
    if z_sd.min() < 0.0:
        return f'a standard deviation is negative ({z_sd.min():g} m)'
    steps = np.diff(x)
    if steps.min() < 0.0:
        where = int(np.argmin(steps >= 0.0))
        return f'x falls from {x[where]:g} to {x[where + 1]:g} m at point {where + 1}'
    if not x[0] < x[-1]:
        return 'all its points have the same x'
    low, high = max(x[0], others[1]), min(x[-1], others[2])
    if not low < high:
        return (f'it has seen from x_min {others[1]:g} to x_max {others[2]:g} m, and has points '
                f'from {x[0]:g} to {x[-1]:g} m')
    if high < -low and low < -FAR_BEHIND:
        return (f'it has seen {-low:.2f} m behind the ball and {high:.2f} m ahead: is the sensor '
                'mounted backwards?')
    return ''


def misplaced(x: Array, z: Array, radius: float, known: bool) -> str:
    """
    Return the reason why the ground is not below the ball, or an empty string.

    Parameters
    ----------
    x, z : (n,) arrays
        Ground near the ball, relative to its centre [m].
    radius : float
        [m]
    known : bool
        Whether the ground agrees with earlier observations: then the ball may be in the air.

    """
    nearest = int(np.argmin(np.abs(x)))
    if abs(x[nearest]) > radius:
        return ''  # no ground observed within reach
    below = float(z[nearest])
    if below > 0.0:
        return (f'the ground is {1e3 * below:.0f} mm above the centre of the ball: is the '
                'sensor upside down, or z not upwards?')
    clearance = float(np.hypot(x, z).min()) - radius
    highest = LARGEST_LIFT if known else LARGEST_OFFSET
    if x[0] > 0.0:
        highest += float(x[0])  # the touch position is not observed
    if not -LARGEST_OFFSET <= clearance <= highest:
        return (f'the ground is {1e3 * clearance:.0f} mm from the ball that rests on it, '
                f'{-1e3 * LARGEST_OFFSET:.0f} to {1e3 * highest:.0f} mm are possible: is the '
                'mounting of the sensor consistent with its frame?')
    return ''


# Faces of two scans within this distance are the same [m].
SAME_PLACE = 0.06

# Odometry slips by no more than this [m] beside a part of the distance rolled [1].
SLIP_MAX, SLIP_SHARE = 0.3, 0.1

# A lone point this far from its neighbours is an outlier [m], unless half of this number of latest
# observations show it at the same place.
OUTLIER_HEIGHT, OUTLIER_MEMORY = 0.03, 10

# Log-odds that a face exists: increment of a detection, decrement of a miss,
# and largest value.  A face enters the profile at one value and leaves it at 0.
SHOWN, MISSED, EXISTENCE_MAX, ENTRY = 1.0, 0.25, 6.0, 2.0

# No blur is longer [m].
BLURRED = 0.05

# Number of nodes before and behind a face for its height in one scan.
BESIDE = 6


class Existence:
    """
    The log-odds that something exists; it is `confirmed` once they have reached `ENTRY`.

    Parameters
    ----------
    certain : bool
        Whether the first observation confirms it.

    """

    def __init__(self, certain: bool):
        """Count the first observation."""
        self.log_odds = ENTRY if certain else SHOWN
        self.confirmed = certain

    def add(self, shown: bool) -> None:
        """Count a detection or a miss."""
        self.log_odds = min(self.log_odds + (SHOWN if shown else -MISSED), EXISTENCE_MAX)
        self.confirmed |= self.log_odds >= ENTRY


@dataclass
class _Known:
    """A face with its observations."""

    face: Face
    found: Found
    exists: Existence
    trend: Trend = field(default_factory=Trend)
    drift: float = 0.0  # of its position in the direction in which the ball rolls [m]

    @property
    def confirmed(self) -> bool:
        """Return whether the face is in the profile."""
        return self.exists.confirmed


@dataclass
class _Steep:
    """A stretch that is too steep to stand on."""

    begin: float
    slope: float
    exists: Existence


class TerrainTracker:
    """
    Tracks the ground around the ball.

    Parameters
    ----------
    robot : Robot
    tuning : DecisionTuning
    frame : str
        In which observations must be.

    Attributes
    ----------
    steepest : float
        Steepest slope on which the ball can be held [rad].
    offset : float
        Height error of the floor below the ball in the newest scan [m].

    """

    def __init__(self, robot: Robot, tuning: DecisionTuning, frame: str = 'base_link'):
        """Start with nothing seen."""
        self._radius, self._frame, self._tuning = robot.ball_radius, frame, tuning
        self._map = ElevationMap(tuning)
        self._number = 0
        self.steepest = math.inf
        self.reset()

    def reset(self) -> None:
        """Forget all, for a jump of time or place; the numbers of faces go on counting."""
        self._map.clear()
        self._faces: List[_Known] = []
        self._steep: List[_Steep] = []
        self._answer: Optional[Profile] = None
        self._strikes = 0
        self._slipped = self._rolled_to = self._position = 0.0
        self._outliers: Deque[Array] = deque(maxlen=OUTLIER_MEMORY)
        self.offset = 0.0

    def update(self, observation: TerrainObservation, position: float) -> Profile:
        """
        Take in one observation.

        Parameters
        ----------
        observation : TerrainObservation
        position : float
            Odometry of the ball's centre when it was made [m].

        Returns
        -------
        Profile
            With the reason of a rejection, if any; sensor data never raise an exception.

        """
        self._answer = self._judge(observation, position)
        return self._answer

    def _judge(self, observation: TerrainObservation, position: float) -> Profile:
        """Return the profile after a new observation."""
        wrong = fault(observation, self._frame)
        if not wrong and not abs(position) < FARTHEST:
            wrong = f'the odometry is at {position:g} m'
        if wrong:
            return self._reject(observation.stamp, Reason.BAD_OBSERVATION, wrong)
        x, z, z_sd = arrays(observation)
        inside = (x >= observation.x_min - 1e-9) & (x <= observation.x_max + 1e-9)
        x, z, z_sd = x[inside], z[inside], z_sd[inside]
        kept = self._without_outliers(x, z, position)
        x, z, z_sd = x[kept], z[kept], z_sd[kept]
        look = resample(x, z, z_sd, position) if len(x) > 1 else None
        if look is None:
            return self._reject(observation.stamp, Reason.BAD_OBSERVATION,
                                'it shows nothing of the ground around the ball')
        near = np.isfinite(look.z) & (np.abs(look.places - position) <= 2.0 * self._radius)
        if near.any():
            x, z = look.places[near] - position, look.z[near]
            wrong = misplaced(x, z, self._radius, self._map.looks > 0)
            if wrong:
                return self._reject(observation.stamp, Reason.BAD_OBSERVATION, wrong)
            self.offset = self._radius - float(np.hypot(x, z).min())
        contradiction, residual = self._map.add(look, position)
        if contradiction:
            slipped = self._map.slip(look)
            rolled, self._rolled_to = abs(position - self._rolled_to), position
            self._slipped = max(0.0, self._slipped - SLIP_SHARE * rolled) + CELL * abs(slipped)
            if self._slipped > SLIP_MAX:
                return self._reject(
                    observation.stamp, Reason.CONTRADICTORY,
                    f'the terrain moves along with the ball, by {self._slipped:.2f} m')
            if slipped:
                self._move(slipped)
                contradiction, residual = self._map.add(look, position)
        if contradiction:
            return self._contradicted(observation, look, position, contradiction)
        return self._fused(observation.stamp, look, residual, position)

    def _without_outliers(self, x: Array, z: Array, position: float) -> Flags:
        """Return the points to keep: all except isolated ones that earlier observations lack."""
        if len(x) < 7:
            return np.ones(len(x), dtype=bool)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(z, 2, mode='edge'), 5)
        off = z - np.partition(windows, 2, axis=1)[:, 2]
        lone: Flags = np.abs(off) > OUTLIER_HEIGHT
        if not lone.any():
            return ~lone
        found = np.stack((x[lone] + position, off[lone]))
        seen = np.concatenate([*self._outliers, np.zeros((2, 0))], axis=1)
        self._outliers.append(found)
        near = (np.abs(found[0][:, None] - seen[0]) < 1.5 * CELL) & (
            np.abs(found[1][:, None] - seen[1]) < 0.5 * OUTLIER_HEIGHT)
        kept: Flags = ~lone
        kept[lone] = 2 * near.sum(axis=1) >= OUTLIER_MEMORY
        return kept

    def _move(self, nodes: int) -> None:
        """Shift the map, after a slip of the odometry."""
        self._map.first += nodes
        for known in self._faces:
            known.found = known.found._replace(position=known.found.position + nodes * CELL)
        for stretch in self._steep:
            stretch.begin += nodes * CELL

    def _contradicted(self, observation: TerrainObservation, look: Look, position: float,
                      why: str) -> Profile:
        """Reject a contradicting observation, or accept it after repetitions."""
        self._strikes += 1
        if self._strikes < self._tuning.forget_after:
            return self._reject(observation.stamp, Reason.CONTRADICTORY, why)
        self._map.clear()
        self._faces, self._steep = [], []
        _, residual = self._map.add(look, position)
        return self._fused(observation.stamp, look, residual, position)

    def _fused(self, stamp: float, look: Look, residual: Array, position: float) -> Profile:
        """Return the profile after an accepted scan."""
        self._strikes = 0
        ground = ground_of(self._map, position,
                           [known.found for known in self._faces if known.confirmed])
        if not ground.points:
            self._faces, self._steep = [], []
            return Profile(stamp, seen_from=position, seen_to=position)
        self._name(ground, look, residual, position)
        drift = max((known.drift for known in self._faces), default=0.0)
        if drift > SLIP_MAX:
            return self._reject(
                stamp, Reason.CONTRADICTORY, f'a face has moved along with the ball, by '
                f'{drift:.2f} m')
        return self._with_steep(self._profile(stamp, ground, position))

    def _profile(self, stamp: float, ground: GroundSeen, position: float) -> Profile:
        """Return the profile of an estimated terrain."""
        return Profile(
            stamp, tuple(known.face for known in self._faces if known.confirmed
                         and known.face.position + known.face.run > position),
            tuple(ground.points), ground.seen_from, ground.seen_to, ground.slope,
            ground.slope_sd, points_sd=tuple(ground.sds))

    def _with_steep(self, profile: Profile) -> Profile:
        """Return a profile with the stretches that are too steep, which persist as faces do."""
        found = steep_stretches(profile, SLOPE_HYSTERESIS * self.steepest)
        for known in self._steep:
            same = [one for one in found if abs(one[0] - known.begin) < SLOPE_LENGTH]
            if same:
                known.begin, known.slope = min(same)
                found = [one for one in found if one not in same]
            known.exists.add(bool(same))
        self._steep = [known for known in self._steep if known.exists.log_odds > 0.0
                       and profile.seen_from <= known.begin <= profile.seen_to]
        for begin, slope in found:
            if abs(slope) > self.steepest and all(
                    abs(begin - known.begin) >= SLOPE_LENGTH for known in self._steep):
                self._steep.append(_Steep(begin, slope, Existence(self._map.looks == 1)))
        self._steep.sort(key=lambda known: known.begin)
        return replace(profile, steep=tuple(
            (known.begin, known.slope) for known in self._steep if known.exists.confirmed))

    @property
    def _bias(self) -> float:
        """Return the standard deviation that no number of looks brings down [m]."""
        return (self._tuning.height_bias_sd if self._map.reports_sd
                else max(self._tuning.height_bias_sd, self._tuning.unreported_bias_sd))

    def _reject(self, stamp: float, reason: Reason, why: str) -> Profile:
        """Return the present profile with a rejection."""
        if self._answer is None:
            return Profile(stamp, seen_to=-math.inf, rejection=reason, explanation=why)
        return replace(self._answer, stamp=stamp, rejection=reason, explanation=why)

    def _name(self, ground: GroundSeen, look: Look, residual: Array, position: float) -> None:
        """Assign numbers to the detected faces; known ones keep theirs."""
        known, self._faces = list(self._faces), []
        forward, self._position = math.copysign(1.0, position - self._position), position
        for found in ground.faces:
            same = [item for item in known if item.found.height * found.height > 0.0
                    and abs(item.found.position - found.position) < SAME_PLACE]
            if same:
                nearest = min(same, key=lambda item: abs(item.found.position - found.position))
                known.remove(nearest)
                nearest.drift += forward * (found.position - nearest.found.position)
                nearest.found = found
                nearest.exists.add(True)
            else:
                self._number += 1
                nearest = _Known(Face(self._number, 0.0, 0.0, 0.0, 0.0), found,
                                 Existence(self._map.looks == 1))
            self._note(nearest, look, residual, position)
            nearest.face = self._described(nearest, position)
            self._faces.append(nearest)
        for item in known:
            item.exists.add(False)
            # A miss of a face behind the ball does not count.
            if item.exists.log_odds > 0.0 \
                    and ground.seen_from <= item.found.position <= ground.seen_to:
                self._faces.append(item)
        self._faces.sort(key=lambda item: item.face.position)

    def _note(self, known: _Known, look: Look, residual: Array, position: float) -> None:
        """Store the height of a face in this scan alone."""
        distance = known.found.position - position
        if distance <= 0.0:
            return
        lift = []
        for begin, end in (known.found.before[1] - BESIDE, known.found.before[1]), (
                known.found.after[0], known.found.after[0] + BESIDE):
            shift = self._map.first - look.first
            beside = residual[max(0, begin + shift):max(0, end + shift)]
            beside = beside[np.isfinite(beside)]
            if len(beside) < 2:
                return
            lift.append(float(beside.mean()))
        known.trend.add(distance, known.found.height + lift[1] - lift[0])

    def _described(self, known: _Known, position: float) -> Face:
        """Return a face with all its uncertainties."""
        found, trend = known.found, known.trend
        scatter = trend.scatter / math.sqrt(trend.count) if trend.count else math.nan
        height_sd = max(found.height_sd, self._bias, scatter if scatter > 0.0 else 0.0)
        # A face with an apparent run may be vertical, blurred by missing points.
        position_sd = math.hypot(PLACE_SD, 0.3 * min(found.run, BLURRED))
        return Face(known.face.number, found.position, found.height, position_sd,
                    math.hypot(height_sd, trend.growth), found.run)
