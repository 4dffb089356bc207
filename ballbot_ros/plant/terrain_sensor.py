# SPDX-License-Identifier: Apache-2.0
"""A sensor that observes the terrain ahead as a polyline, like a depth camera."""
from dataclasses import dataclass
import math
from typing import Optional, Tuple

import numpy as np

from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.plant.sensor_faults import SensorFaults
from ballbot_ros.plant.step_sensor import faces, HEIGHT_RESOLUTION

# Terrain ahead closer to the sensor than this does not occlude [m]: it is below the ball.
BELOW = 0.02
BEHIND = 0.3  # range behind the centre [m]

ENDLESS = 1e4  # [m]: length of the infinite end segments of a terrain


def endless(terrain: Terrain) -> Array:
    """Return the vertices of a terrain with both ends `ENDLESS` farther out, (n + 2, 2) [m]."""
    ends = np.array([[-ENDLESS], [ENDLESS]]) + terrain.vertices[[0, -1], 0][:, None]
    return np.vstack([
        np.column_stack([ends[:1], terrain.height(ends[0])]), terrain.vertices,
        np.column_stack([ends[1:], terrain.height(ends[1])])])


@dataclass(frozen=True)
class TerrainSight:
    """One observation, in the level frame at the centre of the ball [m]."""

    x: Tuple[float, ...]  # of points from behind to ahead
    z: Tuple[float, ...]
    z_sd: Tuple[float, ...]  # reported standard deviations of z, 0 for unknown
    x_min: float  # limits of the observed terrain
    x_max: float


class TerrainSensor:
    """
    Samples points at equal distances along the terrain, with Gaussian noise of their height.

    Like the pixels of a camera, the points do not coincide with the vertices; a vertical face has
    several points.  The sensor is at the height of the ball centre, and terrain occludes the
    points behind it: the face of a drop, the floor right behind it, and anything behind a wall.
    Terrain below and behind the ball is always included, because it was observed before.

    Noise and dropouts of sample number n depend only on the seed and n.  `reach` is the range
    ahead of the centre; `height_sd` is the true standard deviation of a point's height, and
    `spacing` the distance between points, all in m.  The publisher applies the latency of the
    faults, see `Latency`.
    """

    def __init__(self, terrain: Terrain, reach: float, height_sd: float = 0.0, seed: int = 0,
                 faults: SensorFaults = SensorFaults(), spacing: float = 0.015):
        ground = endless(terrain)
        self._x, self._y = np.ascontiguousarray(ground.T)
        self._course = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ground, axis=0).T))])
        self._faces = np.array([face[0] for face in faces(terrain)])
        self._reach, self._spacing = reach, spacing
        self._noise, self._seed = height_sd, seed
        self.faults = faults

    def measure(self, x: float, y: float, number: int) -> Optional[TerrainSight]:
        """
        Return an observation from a position of the ball centre [m]; None without any.

        There is none at a dropout, or without ground in sight.  The number of this observation,
        from 0, determines the noise.
        """
        found = self.sample(x, y, number)
        if found is None:
            return None
        ahead, up, deviation = (tuple(numbers.tolist()) for numbers in found)
        return TerrainSight(ahead, up, deviation, ahead[0], ahead[-1])

    def sample(self, x: float, y: float, number: int) -> Optional[Tuple[Array, Array, Array]]:
        """Return x, z and z_sd of an observation as (n,) arrays [m], see `measure`."""
        faults = self.faults
        random = np.random.default_rng([self._seed, number])
        phase, lost = random.random(2)
        if lost < faults.dropout:
            return None
        first, last = np.interp([x - BEHIND, x + self._reach], self._x, self._course)
        course = np.arange(first + phase * self._spacing, last, self._spacing)
        if not len(course):  # beyond the ends of the profile
            return None
        ahead = np.interp(course, self._course, self._x) - x
        up = np.interp(course, self._course, self._y) - y
        noise = random.standard_normal(len(course))
        # An edge occludes points behind it even without a point on the edge.
        seen = _elevation(ahead, up) >= self._horizon(x, y, course) - 1e-12
        if faults.holes:
            seen = seen & (random.random(len(course)) >= faults.holes)
        ahead, up, noise = ahead[seen], up[seen], noise[seen]
        if not len(ahead):
            return None
        floor = float(np.interp(x, self._x, self._y)) - y
        up = self._distorted(x, ahead, up, floor) + self._noise * noise
        reported_sd = faults.reported_sd * max(self._noise, HEIGHT_RESOLUTION)
        return ahead, up, np.full(len(ahead), reported_sd)

    def _horizon(self, x: float, y: float, course: Array) -> Array:
        """Return the maximum elevation of the vertices up to each point of the course."""
        inside = slice(*np.searchsorted(self._course, course[[0, -1]]))
        elevation = _elevation(self._x[inside] - x, self._y[inside] - y)
        highest = np.concatenate([[-np.inf], np.maximum.accumulate(elevation)])
        found: Array = highest[np.searchsorted(self._course[inside], course)]
        return found

    def _distorted(self, x: float, ahead: Array, up: Array, floor: float) -> Array:
        """Return heights with all faults but noise; `floor` is the height below the ball."""
        faults = self.faults
        seen = floor + (up - floor) * (1.0 + faults.scale) * np.clip(
            1.0 - faults.growth * ahead, 0.0, 1.0)
        if faults.bias:
            passed = np.searchsorted(self._faces, [x])[0]
            # A point on a face counts as beyond it.
            met = np.searchsorted(self._faces, ahead + x, side='right') - passed
            seen += faults.bias * np.maximum(0, met)
        return seen + faults.offset + math.tan(faults.tilt) * ahead


def _elevation(ahead: Array, up: Array) -> Array:
    """Return rise over run from the ball centre to points, -inf for points that do not occlude."""
    front = ahead > BELOW
    found: Array = np.where(front, up / np.where(front, ahead, 1.0), -np.inf)
    return found
