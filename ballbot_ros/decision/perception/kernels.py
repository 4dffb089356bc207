# SPDX-License-Identifier: Apache-2.0
"""Kernels of the perception: simplify a polyline, fit lines to pieces of it, medians."""
import math

import numpy as np

from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import Array


@compiled
def simplify(x: Array, z: Array, tolerance: Array, keep: Array, stack: Array) -> int:
    """
    Mark the points that keep a polyline within its tolerance, and return their number.

    The Douglas-Peucker algorithm, with a tolerance at each point.

    Parameters
    ----------
    x, z, tolerance : (n,) arrays
        Coordinates, x ascending, and tolerances of z [m].
    keep : (n,) array
        Set to 1 where a point is kept, to 0 elsewhere.
    stack : (n, 2) array
        Work array.

    """
    last = len(x) - 1
    for index in range(len(x)):
        keep[index] = 0.0
    keep[0] = keep[last] = 1.0
    kept, depth = 2, 1
    stack[0, 0], stack[0, 1] = 0.0, last
    while depth > 0:
        depth -= 1
        begin, end = int(stack[depth, 0]), int(stack[depth, 1])
        grade = (z[end] - z[begin]) / max(x[end] - x[begin], 1e-9)
        worst, where = 1.0, -1
        for index in range(begin + 1, end):
            off = abs(z[index] - z[begin] - grade * (x[index] - x[begin])) / tolerance[index]
            if off > worst:
                worst, where = off, index
        if where >= 0:
            keep[where] = 1.0
            kept += 1
            stack[depth, 0], stack[depth, 1] = begin, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, end
            depth += 2
    return kept


@compiled
def line(x: Array, z: Array, variance: Array, begin: int, end: int,
         at: float) -> tuple[float, float, float, float]:
    """
    Return height and slope of the line fitted to some points, and their variances.

    Parameters
    ----------
    x, z, variance : (n,) arrays
        Coordinates [m], and variances of z [m2].
    begin, end : int
        Range of the points, `end` excluded; for fewer than 6, the slope is 0, its variance inf.
    at : float
        Position of the requested height [m].

    """
    weights = mean_x = mean_z = 0.0
    for index in range(begin, end):
        weight = 1.0 / variance[index]
        weights += weight
        mean_x += weight * x[index]
        mean_z += weight * z[index]
    mean_x /= weights
    mean_z /= weights
    if end - begin < 6:
        return mean_z, 0.0, 1.0 / weights, math.inf
    spread = product = 0.0
    for index in range(begin, end):
        weight = 1.0 / variance[index]
        spread += weight * (x[index] - mean_x) ** 2
        product += weight * (x[index] - mean_x) * (z[index] - mean_z)
    slope = product / spread
    return (mean_z + slope * (at - mean_x), slope,
            1.0 / weights + (at - mean_x) ** 2 / spread, 1.0 / spread)


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
