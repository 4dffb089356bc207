# SPDX-License-Identifier: Apache-2.0
"""What a sensor said of the ground ahead, as it said it: nothing is checked yet."""
from dataclasses import astuple, dataclass
import math
from typing import Tuple


@dataclass(frozen=True)
class StepObservation:
    """
    One look at the floor ahead by a sensor that sees the next step only.

    Attributes
    ----------
    stamp : float
        When it was made [s].
    detected : bool
        Whether there is a step; if not, distance and height are 0.
    distance : float
        Horizontally from the ball's centre to the face of the step [m].
    height : float
        Of the step [m], negative for a drop.
    distance_sd, height_sd : float
        Standard deviations [m], 0 if unknown.

    """

    stamp: float
    detected: bool
    distance: float = 0.0
    height: float = 0.0
    distance_sd: float = 0.0
    height_sd: float = 0.0

    @property
    def finite(self) -> bool:
        """Return whether all its numbers are finite."""
        return all(math.isfinite(number) for number in astuple(self))


@dataclass(frozen=True)
class TerrainObservation:
    """
    One look at the ground ahead by a depth camera or a scanning range sensor.

    In the level, non-rolling frame at the centre of the ball.

    Attributes
    ----------
    stamp : float
        When it was made [s].
    x, z : tuple of float
        Points of the polyline [m], x rising; a vertical face has two of the same x.  The floor
        below the ball is at z = -radius.
    z_sd : tuple of float
        Standard deviations of z [m], 0 if unknown; none at all if all are unknown.
    x_min, x_max : float
        Between these the ground was seen [m].
    frame : str
        That the message names.

    """

    stamp: float
    x: Tuple[float, ...]
    z: Tuple[float, ...]
    z_sd: Tuple[float, ...] = ()
    x_min: float = 0.0
    x_max: float = 0.0
    frame: str = 'base_link'
