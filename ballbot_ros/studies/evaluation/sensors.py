# SPDX-License-Identifier: Apache-2.0
"""Sensors that look ahead, and all that is wrong with them."""
from dataclasses import dataclass
import math
from typing import List, Optional, Tuple, Union

import numpy as np

from ballbot_ros.decision.observations import StepObservation, TerrainObservation
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant.step_sensor import faces

Observation = Union[StepObservation, TerrainObservation]
Random = np.random.Generator

FULL_REACH = 3.0  # [m]
BEHIND = 0.4  # of the floor below and behind the ball that a terrain sensor sees [m]


@dataclass(frozen=True)
class Flaws:
    """
    A sensor with what is wrong with it; as made, nothing is.

    Attributes
    ----------
    kind : str
        ``step`` (sees the next face) or ``terrain`` (sees a polyline).
    distance_sd, height_sd : float
        White noise [m].
    told : float
        What part of it the sensor announces; 0: it says that it does not know.
    distance_bias, height_bias : float
        Constant errors [m]; of a terrain sensor, that of the height is one per metre ahead.
    dropout : float
        Part of the looks that give no message.
    blind : float
        Part of the looks that see nothing where there is something.
    latency : float
        From look to message [s].
    reach : float
        How far it sees from the centre of the ball [m].
    growth : float
        By which part a height looks lower at full reach than it is; it grows on approach.
    spacing : float
        Between the points of a terrain sensor [m].

    """

    kind: str = 'step'
    distance_sd: float = 0.0
    height_sd: float = 0.0
    told: float = 1.0
    distance_bias: float = 0.0
    height_bias: float = 0.0
    dropout: float = 0.0
    blind: float = 0.0
    latency: float = 0.0
    reach: float = FULL_REACH
    growth: float = 0.0
    spacing: float = 0.02

    @property
    def words(self) -> str:
        """Return what is wrong, for people."""
        found = [f'{self.kind} sensor']
        if self.height_sd:
            found.append(f'noise {1e3 * self.height_sd:.1f}/{1e3 * self.distance_sd:.0f} mm '
                         f'told {self.told:g}')
        if self.height_bias:
            found.append(f'bias {1e3 * self.height_bias:+.1f}/{1e3 * self.distance_bias:+.0f} mm')
        for name, unit in (('dropout', ''), ('blind', ''), ('latency', ' s'), ('growth', '')):
            if getattr(self, name):
                found.append(f'{name} {getattr(self, name):.2f}{unit}')
        if self.reach < FULL_REACH:
            found.append(f'reach {self.reach:.2f} m')
        return ', '.join(found)


def draw_flaws(random: Random, kinds: str) -> Flaws:
    """Return a sensor with some flaws; `kinds` as in `grounds.Shape.sensors`."""
    kind = 'terrain' if kinds == 'terrain' or random.random() < 0.6 else 'step'
    has = random.random(7) < np.array([0.5, 0.3, 0.2, 0.15, 0.4, 0.2, 0.15])
    even = random.random(10)
    return Flaws(
        kind=kind,
        distance_sd=0.003 + 0.015 * even[0] if has[0] else 0.0,
        height_sd=0.0005 + 0.003 * even[1] if has[0] else 0.0,
        told=(1.0, 0.0, 0.5)[int(3.0 * even[2])] if has[0] else 0.0,
        distance_bias=0.03 * (even[3] - 0.5) if has[1] else 0.0,
        height_bias=0.004 * (even[4] - 0.5) if has[1] else 0.0,
        dropout=0.5 * even[5] if has[2] else 0.0,
        blind=0.2 * even[6] if has[3] else 0.0,
        latency=0.02 * round(25.0 * even[7]) if has[4] else 0.0,
        reach=1.0 + 0.8 * even[8] if has[5] else FULL_REACH,
        growth=0.4 * even[9] if has[6] else 0.0,
        spacing=float(random.choice([0.005, 0.01, 0.02])))


class Looks:
    """
    What a sensor says on the way, look by look, each when it arrives.

    Parameters
    ----------
    terrain : Terrain
    slope : float
        Of its floor [rad].
    flaws : Flaws
    seed : tuple of int
        Noise of look number n is a function of the seed and n alone.

    """

    def __init__(self, terrain: Terrain, slope: float, flaws: Flaws, seed: Tuple[int, ...]):
        """Find the faces."""
        self._terrain, self._slope, self._flaws, self._seed = terrain, slope, flaws, seed
        self._faces = faces(terrain)
        self._on_the_way: List[Tuple[float, Observation]] = []

    def look(self, number: int, stamp: float, x: float, y: float) -> None:
        """Look from the ball's centre [m] at a time [s]; number counts from 0."""
        random = np.random.default_rng([*self._seed, number])
        if random.random() < self._flaws.dropout:
            return
        blind = random.random() < self._flaws.blind
        make = self._step if self._flaws.kind == 'step' else self._polyline
        seen = make(stamp, x, y, blind, random)
        if seen is not None:
            self._on_the_way.append((stamp + self._flaws.latency, seen))

    def arrived(self, now: float) -> List[Observation]:
        """Return what has arrived by now [s], oldest first."""
        ready = [seen for when, seen in self._on_the_way if when <= now + 1e-9]
        self._on_the_way = [item for item in self._on_the_way if item[0] > now + 1e-9]
        return ready

    def _growth(self, distance: float) -> float:
        """Return by what a height at a distance [m] is multiplied."""
        return 1.0 - self._flaws.growth * min(max(distance / FULL_REACH, 0.0), 1.0)

    def _step(self, stamp: float, x: float, y: float, blind: bool,
              random: Random) -> Optional[StepObservation]:
        flaws = self._flaws
        ahead = next((face for face in self._faces if face[0] > x), None)
        if ahead is None or ahead[0] - x > flaws.reach or blind:
            return StepObservation(stamp, False)
        distance, noise = ahead[0] - x, random.standard_normal(2)
        height = ahead[1] * self._growth(distance)
        return StepObservation(
            stamp, True,
            max(0.0, distance + flaws.distance_bias + flaws.distance_sd * float(noise[0])),
            height + flaws.height_bias + flaws.height_sd * float(noise[1]),
            flaws.told * flaws.distance_sd, flaws.told * flaws.height_sd)

    def _polyline(self, stamp: float, x: float, y: float, blind: bool,
                  random: Random) -> Optional[TerrainObservation]:
        flaws = self._flaws
        reach = 0.5 if blind else flaws.reach
        ahead = np.arange(-BEHIND, reach, flaws.spacing)
        height = self._terrain.height(x + ahead)
        plane = float(self._terrain.height(x)) + math.tan(self._slope) * ahead
        height = plane + (height - plane) * (
            1.0 - flaws.growth * np.clip(ahead / FULL_REACH, 0.0, 1.0))
        # A constant error of all heights would not be seen: it is mounted askew.
        height = height + flaws.height_bias * ahead + flaws.height_sd * random.standard_normal(
            len(ahead))
        told = flaws.told * flaws.height_sd
        return TerrainObservation(
            stamp, tuple((ahead + flaws.distance_bias).tolist()), tuple((height - y).tolist()),
            (told,) * len(ahead) if told else (), float(ahead[0]), float(ahead[-1]))
