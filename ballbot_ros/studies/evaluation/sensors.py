# SPDX-License-Identifier: Apache-2.0
"""Sensors that look ahead, and all that is wrong with them."""
from dataclasses import dataclass
from typing import List, Union

import numpy as np

from ballbot_ros.decision.values import StepObservation, TerrainObservation
from ballbot_ros.physics.model.terrain import Terrain
from ballbot_ros.plant import Latency, Sensor, SensorFaults, TerrainSensor

Observation = Union[StepObservation, TerrainObservation]
Random = np.random.Generator

FULL_REACH = 3.0  # [m]


@dataclass(frozen=True)
class Flaws:
    """
    A sensor with what is wrong with it; as made, nothing is.

    Attributes
    ----------
    kind : str
        ``step`` (sees the next face) or ``terrain`` (sees a polyline).
    distance_sd, height_sd : float
        White noise [m]; of a terrain sensor that of the heights alone.
    distance_bias : float
        Constant error of all distances [m].
    reach : float
        How far it sees from the centre of the ball [m].
    spacing : float
        Between the points of a terrain sensor [m].
    faults : SensorFaults

    """

    kind: str = 'step'
    distance_sd: float = 0.0
    height_sd: float = 0.0
    distance_bias: float = 0.0
    reach: float = FULL_REACH
    spacing: float = 0.015
    faults: SensorFaults = SensorFaults()

    @property
    def words(self) -> str:
        """Return what is wrong, for people."""
        faults = self.faults
        found = [f'{self.kind} sensor']
        if self.height_sd:
            found.append(f'noise {1e3 * self.height_sd:.1f} mm in height, '
                         f'{1e3 * self.distance_sd:.0f} mm in distance, told {faults.told:g}')
        if self.distance_bias:
            found.append(f'distance {1e3 * self.distance_bias:+.0f} mm')
        for name, unit, factor in (
                ('bias', ' mm', 1e3), ('tilt', ' mrad', 1e3), ('dropout', '', 1.0),
                ('latency', ' s', 1.0), ('holes', '', 1.0), ('growth', ' 1/m', 1.0)):
            if getattr(faults, name):
                found.append(f'{name} {factor * getattr(faults, name):.3g}{unit}')
        if self.reach < FULL_REACH:
            found.append(f'reach {self.reach:.2f} m')
        return ', '.join(found)


def draw_flaws(random: Random, kinds: str) -> Flaws:
    """Return a sensor with some flaws; `kinds` as in `grounds.Shape.sensors`."""
    kind = 'terrain' if kinds == 'terrain' or random.random() < 0.6 else 'step'
    noisy, biased, lossy, late, short, growing = (
        random.random(6) < (0.5, 0.3, 0.25, 0.4, 0.2, 0.15)).tolist()
    even = random.random(11).tolist()
    polyline = kind == 'terrain'
    return Flaws(
        kind=kind,
        distance_sd=0.003 + 0.015 * even[0] if noisy and not polyline else 0.0,
        height_sd=0.0005 + 0.003 * even[1] if noisy else 0.0,
        distance_bias=0.03 * (even[2] - 0.5) if biased else 0.0,
        reach=1.0 + 0.8 * even[3] if short else FULL_REACH,
        spacing=0.005 + 0.015 * even[4],
        faults=SensorFaults(
            told=(1.0, 0.0, 0.5)[int(3.0 * even[5])] if noisy else 1.0,
            bias=0.004 * (even[6] - 0.5) if biased else 0.0,
            tilt=0.008 * (even[7] - 0.5) if biased and polyline else 0.0,
            growth=0.02 + 0.13 * even[8] if growing else 0.0,
            dropout=0.5 * even[9] if lossy else 0.0,
            holes=0.3 * even[9] if lossy and polyline else 0.0,
            latency=0.02 * round(25.0 * even[10]) if late else 0.0))


class Looks:
    """
    What a sensor says on the way, look by look, each when it arrives.

    Parameters
    ----------
    terrain : Terrain
    flaws : Flaws
    seed : int

    """

    def __init__(self, terrain: Terrain, flaws: Flaws, seed: int):
        """Look at nothing yet."""
        self._flaws = flaws
        self._late: Latency[Observation] = Latency(flaws.faults.latency)
        self._step = Sensor(terrain, flaws.reach, flaws.distance_sd, flaws.height_sd, seed,
                            flaws.faults)
        self._polyline = TerrainSensor(terrain, flaws.reach, flaws.height_sd, seed, flaws.faults,
                                       spacing=flaws.spacing)

    def look(self, number: int, stamp: float, x: float, y: float) -> None:
        """Look from the ball's centre [m] at a time [s]; number counts from 0."""
        off = self._flaws.distance_bias
        if self._flaws.kind == 'step':
            sight = self._step.look(x, number)
            if sight is not None and sight.detected:
                self._late.put(stamp, StepObservation(
                    stamp, True, max(0.0, sight.distance + off), sight.height,
                    self._step.distance_sd, self._step.height_sd))
            elif sight is not None:
                self._late.put(stamp, StepObservation(stamp, False))
            return
        seen = self._polyline.look(x, y, number)
        if seen is not None:
            self._late.put(stamp, TerrainObservation(
                stamp, tuple(place + off for place in seen.x), seen.z, seen.z_sd,
                seen.x_min + off, seen.x_max + off))

    def arrived(self, now: float) -> List[Observation]:
        """Return what has arrived by now [s], oldest first."""
        return self._late.due(now)
