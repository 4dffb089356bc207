# SPDX-License-Identifier: Apache-2.0
"""A look at the ground, brought onto the nodes of a map."""
import math
from typing import NamedTuple, Optional

import numpy as np

from ballbot_ros.decision.perception.kernels import middle
from ballbot_ros.physics.model.terrain import Array

CELL = 0.01          # [m] between the nodes of the map
BEHIND, AHEAD = 1.0, 5.0  # [m] kept, and looked at

# A point whose place on the axis is known to this [m]: stamps of odometry and look differ.
PLACE_SD = 0.01

# Points farther apart than this, that fall as a line of sight does, hide what is between [m].
SHADOW = 0.03
# A line over an edge, from one point to the next seen, is so steep at least, over the line of
# sight: points do not lie on the edge, nor where the line of sight meets the ground.
STEEPNESS = 0.35

# More points than this are no vertices but samples: where they are so many times as far apart
# as usual, nothing was seen between them.
SAMPLED, LOST = 50, 3.5

# What is seen may end with a face; it is one if it is so high [m].
WALL = 0.02


class Look(NamedTuple):
    """
    A look on the nodes of the map.

    Attributes
    ----------
    first : int
        Node of the first element; node k is at k CELL on the odometry axis.
    z : (n,) array
        Relative to the centre of the ball [m], NaN where nothing was seen.
    steep : (n,) array
        By how much it changes within `PLACE_SD` [m].
    told_sd, roughness : float
        Standard deviation of a point as it was told, 0 for not told, and as neighbours show [m].
    spacing : float
        Of the points that were seen [m].

    """

    first: int
    z: Array
    steep: Array
    told_sd: Array
    roughness: float
    spacing: float

    @property
    def places(self) -> Array:
        """Return the positions of the nodes along the odometry axis [m]."""
        found: Array = np.arange(self.first, self.first + len(self.z), dtype=float) * CELL
        return found


def resample(x: Array, z: Array, z_sd: Array, position: float) -> Optional[Look]:
    """
    Return a look on the nodes, None if it reaches none.

    Parameters
    ----------
    x, z, z_sd : (n,) arrays
        Relative to the centre of the ball; x never falls [m].
    position : float
        Of the centre [m].

    """
    first = math.ceil(max(x[0], -BEHIND) / CELL + position / CELL - 1e-9)
    last = math.floor(min(x[-1], AHEAD) / CELL + position / CELL + 1e-9)
    if np.ptp(z[x > x[-1] - CELL]) > WALL:
        last += 1  # what is seen ends at a wall, which the last node would miss
    if last - first < 2:
        return None
    places = np.arange(first, last + 1) * CELL - position
    heights = np.interp(places, x, z)
    run, rise = np.diff(x), np.diff(z)
    # Seen from the centre, what is behind an edge is hidden up to a line through the edge.
    hidden = (run > SHADOW) & (x[:-1] > 0.0) & (
        rise * np.maximum(x[:-1], CELL) < STEEPNESS * np.minimum(z[:-1], 0.0) * run)
    usual = middle(run)
    if len(x) > SAMPLED:
        hidden |= run > max(LOST * usual, SHADOW)
    for index in np.flatnonzero(hidden):
        heights[(places > x[index] + 1e-9) & (places < x[index + 1] - 1e-9)] = np.nan
    if np.count_nonzero(np.isfinite(heights)) < 3:
        return None
    steep = np.zeros(len(heights))
    steep[1:-1] = 0.5 * PLACE_SD / CELL * np.abs(heights[2:] - heights[:-2])
    steep[np.isnan(steep)] = 0.0
    bend = np.abs(rise[1:] * run[:-1] - rise[:-1] * run[1:]) / np.maximum(
        np.maximum(run[1:], run[:-1]), 1e-9)
    roughness = 1.4826 * middle(bend) / math.sqrt(6.0) if len(bend) > 20 else 0.0
    return Look(first, heights, steep, np.interp(places, x, z_sd), roughness,
                usual)
