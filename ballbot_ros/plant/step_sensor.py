# SPDX-License-Identifier: Apache-2.0
"""A sensor that detects the next step of the floor ahead."""
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant.sensor_faults import SensorFaults

# Minimum height [m] and slope of a detected step: 2 mm and 45 degrees.
LEAST_HEIGHT, LEAST_SLOPE = 0.002, 1.0
# A less steep segment shorter than this belongs to the step, as on a rounded edge [m].
SEGMENT_LENGTH_MIN = 0.005

# Minimum reported standard deviations [m]; 0 means unknown.
DISTANCE_RESOLUTION, HEIGHT_RESOLUTION = 0.001, 0.0005


@dataclass(frozen=True)
class Sight:
    """One observation ahead."""

    detected: bool
    # Horizontal, from the ball centre to the face; without a detection, to the end of the observed
    # clear floor [m].
    distance: float
    height: float  # of the step, negative for a drop, 0 without a detection [m]


def faces(terrain: Terrain) -> Tuple[Tuple[float, float], ...]:
    """
    Return x and height of every step of a terrain, from left to right [m].

    x is that of the foot of a step up, or of the upper edge of a drop.
    """
    found = terrain.faces(LEAST_SLOPE, LEAST_HEIGHT, SEGMENT_LENGTH_MIN)
    return tuple((float(face[0, 0]), float(face[-1, 1] - face[0, 1])) for face in found)


class Sensor:
    """
    Detects the next face ahead of the ball centre, with Gaussian noise.

    Noise and dropouts of sample number n depend only on the seed and n, so runs are
    reproducible, independent of other random numbers.  `reach` is the range, and the standard
    deviations of the parameters are the true ones [m]; those of the attributes are the reported
    ones, 0 if none are reported.  The publisher applies the latency of the faults, see `Latency`.
    """

    def __init__(self, terrain: Terrain, reach: float, distance_sd: float = 0.0,
                 height_sd: float = 0.0, seed: int = 0, faults: SensorFaults = SensorFaults()):
        self._faces = faces(terrain)
        self._reach = reach
        self._noise = distance_sd, height_sd
        self._seed = seed
        self.faults = faults
        self.distance_sd = faults.reported_sd * max(distance_sd, DISTANCE_RESOLUTION)
        self.height_sd = faults.reported_sd * max(height_sd, HEIGHT_RESOLUTION)

    def measure(self, x: float, number: int) -> Optional[Sight]:
        """
        Return an observation from an x of the ball centre [m]; None for a dropout.

        The number of this observation, from 0, determines the noise.
        """
        ahead = next((face for face in self._faces if face[0] > x), None)
        random = np.random.default_rng([self._seed, number])
        noise = random.standard_normal(2)
        if self.faults.dropout and random.random() < self.faults.dropout:
            return None
        if ahead is None or ahead[0] - x > self._reach:
            return Sight(False, self._reach, 0.0)
        distance, faults = ahead[0] - x, self.faults
        height = ahead[1] * (1.0 + faults.scale) * max(0.0, 1.0 - faults.growth * distance)
        return Sight(True, max(0.0, distance + self._noise[0] * float(noise[0])),
                     height + faults.bias + self._noise[1] * float(noise[1]))
