# SPDX-License-Identifier: Apache-2.0
"""Simulated terrain sensors with noise, faults, outliers, reordered and frozen messages."""
from dataclasses import dataclass, replace
import heapq
import math
from typing import List, Optional, Tuple

import numpy as np

from ballbot_ros.decision import Observation, StepObservation, TerrainObservation
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.plant import Sensor, SensorFaults, TerrainSensor
from ballbot_ros.plant.terrain_sensor import endless
from ballbot_ros.studies.evaluation.terrains import Random

KINDS = ('step', 'terrain', 'camera')
FULL_REACH = 3.0              # [m]
HIGHEST_RAY = math.radians(10.0)  # of a camera, above the horizon [rad]
RESOLUTION = 0.0005           # smallest standard deviation that a camera reports [m]
NOISE_RANGE = 1.5             # distance at which the noise of a camera has doubled [m]
TERRAIN_OUTLIER = 0.3         # largest error of an outlier of a terrain sensor or camera [m]
STEP_OUTLIER = 0.15           # largest height of a phantom step [m]


@dataclass(frozen=True)
class SensorModel:
    """A sensor with its faults; without arguments, a perfect step sensor."""

    # ``step`` (the next face only), ``terrain`` (points equally spaced along the ground) or
    # ``camera`` (points on rays at equal angles from an eye).
    kind: str = 'step'
    # White noise [m]; `height_sd` of a camera is the noise along the ray, near the ball, otherwise
    # that of the heights.
    distance_sd: float = 0.0
    height_sd: float = 0.0
    distance_bias: float = 0.0  # constant error of all distances [m]
    reach: float = FULL_REACH  # range from the ball's centre [m]
    spacing: float = 0.015  # between the points of a terrain sensor [m]
    # Of a camera: height of the eye above the ball's centre [m], and its steepest ray below the
    # horizon [rad].
    eye_height: float = 0.0
    lowest_ray: float = math.radians(80.0)
    rays: int = 256  # of a camera
    outliers: float = 0.0  # probability of a gross error in a point or a reported step
    # Largest random additional delay of a message [s]; messages may overtake each other.
    reordering: float = 0.0
    # From this time on the sensor repeats its last content with advancing stamps [s].
    frozen_from: float = math.inf
    faults: SensorFaults = SensorFaults()

    @property
    def condition(self) -> str:
        """Return the most severe fault in one word."""
        if math.isfinite(self.frozen_from):
            return 'frozen'
        if self.outliers:
            return 'outliers'
        if self.reordering:
            return 'reordered'
        ideal = SensorModel(self.kind, spacing=self.spacing, eye_height=self.eye_height,
                            lowest_ray=self.lowest_ray, rays=self.rays)
        return 'ideal' if self == ideal else 'degraded'

    @property
    def description(self) -> str:
        """Return kind and faults as text."""
        faults = self.faults
        found = [f'{self.kind} sensor' if self.kind != 'camera' else
                 f'camera {self.eye_height:.2f} m above the centre, {self.rays} rays from '
                 f'{math.degrees(self.lowest_ray):.0f} degrees below the horizon']
        if self.height_sd:
            found.append(f'noise {1e3 * self.height_sd:.1f} mm in height, '
                         f'{1e3 * self.distance_sd:.0f} mm in distance, '
                         f'{faults.reported_sd:g} of it reported')
        if self.distance_bias:
            found.append(f'distance {1e3 * self.distance_bias:+.0f} mm')
        for name, unit, factor in (
                ('bias', ' mm', 1e3), ('tilt', ' mrad', 1e3), ('dropout', '', 1.0),
                ('latency', ' s', 1.0), ('holes', '', 1.0), ('growth', ' 1/m', 1.0)):
            if getattr(faults, name):
                found.append(f'{name} {factor * getattr(faults, name):.3g}{unit}')
        if self.reach < FULL_REACH:
            found.append(f'reach {self.reach:.2f} m')
        if self.outliers:
            found.append(f'{100.0 * self.outliers:.1f} % outliers')
        if self.reordering:
            found.append(f'messages reordered within {self.reordering:.2f} s')
        if math.isfinite(self.frozen_from):
            found.append(f'frozen from {self.frozen_from:.2f} s')
        return ', '.join(found)


def draw_sensor(random: Random, sensors: str, kind: Optional[str]) -> SensorModel:
    """
    Return a sensor with drawn faults, of a kind of `KINDS`, of any kind for None.

    If the kind cannot detect the obstacle according to `terrains.Shape.sensors`, it is replaced.
    """
    drawn = str(random.choice(KINDS, p=(0.4, 0.25, 0.35)))
    wanted = kind or drawn
    if sensors == 'terrain' and wanted == 'step':
        wanted = 'camera' if random.random() < 0.5 else 'terrain'
    noisy, biased, lossy, late, short, growing = (
        random.random(6) < (0.5, 0.3, 0.25, 0.4, 0.2, 0.15)).tolist()
    even = random.random(20).tolist()
    points = wanted != 'step'
    frozen, outliers, reordered = even[11] < 0.08, 0.08 <= even[11] < 0.2, 0.2 <= even[11] < 0.3
    noisy = noisy or frozen
    return SensorModel(
        kind=wanted,
        distance_sd=0.003 + 0.015 * even[0] if noisy and not points else 0.0,
        height_sd=0.0005 + 0.003 * even[1] if noisy else 0.0,
        distance_bias=0.03 * (even[2] - 0.5) if biased else 0.0,
        # A frozen sensor has noise and the obstacle in range: otherwise its output would equal
        # that of an intact sensor above a plain floor.
        reach=1.0 + 0.8 * even[3] if short and not frozen else FULL_REACH,
        spacing=0.005 + 0.015 * even[4],
        eye_height=0.4 * even[12], lowest_ray=math.radians(60.0 + 25.0 * even[13]),
        rays=128 + int(384.0 * even[14]),
        outliers=0.1 * even[15] if outliers else 0.0,
        reordering=0.04 + 0.16 * even[16] if reordered else 0.0,
        frozen_from=0.3 + 2.7 * even[17] if frozen else math.inf,
        faults=SensorFaults(
            reported_sd=(1.0, 0.0, 0.5)[int(3.0 * even[5])] if noisy else 1.0,
            bias=0.004 * (even[6] - 0.5) if biased else 0.0,
            tilt=0.008 * (even[7] - 0.5) if biased and points else 0.0,
            growth=0.02 + 0.13 * even[8] if growing and wanted != 'camera' else 0.0,
            dropout=0.5 * even[9] if lossy else 0.0,
            holes=0.3 * even[9] if lossy and points else 0.0,
            latency=0.02 * round(25.0 * even[10]) if late else 0.0))


class Camera:
    """
    Rays at equal angles from an eye above the ball's centre, like those of a depth camera.

    Points become sparse with distance; edges occlude the ground behind them, and the camera does
    not observe the ground behind its steepest ray.  Noise acts along the ray and grows with the
    square of the distance.
    """

    def __init__(self, terrain: Terrain, model: SensorModel, seed: int):
        self._vertices = endless(terrain)
        self._model, self._seed = model, seed
        angles = np.linspace(-model.lowest_ray, HIGHEST_RAY, model.rays)
        self._rays = np.column_stack([np.cos(angles), np.sin(angles)])

    def sample(self, x: float, y: float, number: int) -> Optional[Tuple[Array, Array, Array]]:
        """Return x, z and reported standard deviations of points relative to the centre [m]."""
        model, faults = self._model, self._model.faults
        random = np.random.default_rng([self._seed, number])
        if random.random() < faults.dropout:
            return None
        distance = self._distances(np.array([x, y + model.eye_height]))
        noise = random.standard_normal(model.rays)
        kept = (distance * self._rays[:, 0] <= model.reach) & (
            random.random(model.rays) >= faults.holes)
        if np.count_nonzero(kept) < 2:
            return None
        distance, rays = distance[kept], self._rays[kept]
        deviation = model.height_sd * (1.0 + (distance / NOISE_RANGE) ** 2)
        distance = distance + deviation * noise[kept]
        # A driver publishes points in the order of the rays, whose x must not decrease.
        ahead = np.maximum.accumulate(distance * rays[:, 0])
        up = distance * rays[:, 1] + model.eye_height + math.tan(faults.tilt) * ahead
        reported = faults.reported_sd * np.maximum(deviation * np.abs(rays[:, 1]), RESOLUTION)
        return ahead, up, reported

    def _distances(self, eye: Array) -> Array:
        """Return the distance along each ray to the ground [m], infinite if there is none."""
        xs = self._vertices[:, 0]
        first = max(0, int(np.searchsorted(xs, eye[0])) - 1)
        behind = int(np.searchsorted(xs, eye[0] + self._model.reach, side='right'))
        corners = self._vertices[first:behind + 1]
        begin, along = corners[:-1] - eye, np.diff(corners, axis=0)
        across = (self._rays[:, :1] * along[:, 1] - self._rays[:, 1:] * along[:, 0])
        with np.errstate(divide='ignore', invalid='ignore'):
            distance = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0]) / across
            share = (begin[:, 0] * self._rays[:, 1:] - begin[:, 1] * self._rays[:, :1]) / across
        hit = (distance > 0.0) & (share >= -1e-12) & (share <= 1.0 + 1e-12)
        found: Array = np.where(hit, distance, np.inf).min(axis=1)
        return found


class SimulatedSensor:
    """Samples the terrain and delivers the observations when they arrive."""

    def __init__(self, terrain: Terrain, model: SensorModel, seed: int):
        self._model, self._seed = model, seed
        self._queue: List[Tuple[float, int, Observation]] = []
        self._last: Optional[Observation] = None
        self._step = Sensor(terrain, model.reach, model.distance_sd, model.height_sd, seed,
                            model.faults)
        self._points = TerrainSensor(terrain, model.reach, model.height_sd, seed, model.faults,
                                     spacing=model.spacing)
        self._camera = Camera(terrain, model, seed)

    def sample(self, number: int, stamp: float, x: float, y: float) -> None:
        """Take sample `number`, counted from 0, from the ball's centre [m] at a time [s]."""
        model = self._model
        if stamp < model.frozen_from:
            self._last = self._observe(number, stamp, x, y)
        if self._last is None:
            return
        arrival = stamp + model.faults.latency
        if model.reordering:
            random = np.random.default_rng([self._seed, number, 1])
            arrival += model.reordering * float(random.random())
        heapq.heappush(self._queue, (arrival, number, replace(self._last, stamp=stamp)))

    def _observe(self, number: int, stamp: float, x: float, y: float) -> Optional[Observation]:
        model = self._model
        # Creating a generator takes longer than all its draws.
        random = np.random.default_rng([self._seed, number, 2]) if model.outliers else None
        if model.kind == 'step':
            sight = self._step.measure(x, number)
            if sight is None:
                return None
            if random is not None and random.random() < model.outliers:
                return StepObservation(
                    stamp, True, float(random.uniform(0.05, model.reach)),
                    float(random.uniform(-STEP_OUTLIER, STEP_OUTLIER)),
                    self._step.distance_sd, self._step.height_sd)
            if not sight.detected:
                return StepObservation(stamp, False)
            return StepObservation(
                stamp, True, max(0.0, sight.distance + model.distance_bias), sight.height,
                self._step.distance_sd, self._step.height_sd)
        seen = (self._camera if model.kind == 'camera' else self._points).sample(x, y, number)
        if seen is None:
            return None
        ahead, up, deviation = seen
        if random is not None:
            wrong = random.random(len(up)) < model.outliers
            up = up + wrong * random.uniform(-TERRAIN_OUTLIER, TERRAIN_OUTLIER, len(up))
        ahead = ahead + model.distance_bias
        return TerrainObservation(stamp, tuple(ahead.tolist()), tuple(up.tolist()),
                                  tuple(deviation.tolist()), float(ahead[0]), float(ahead[-1]))

    def arrived(self, now: float) -> List[Observation]:
        """Return the observations that have arrived by now [s], in the order of arrival."""
        found = []
        while self._queue and self._queue[0][0] <= now + 1e-9:
            found.append(heapq.heappop(self._queue)[2])
        return found
