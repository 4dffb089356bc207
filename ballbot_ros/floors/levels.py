# SPDX-License-Identifier: Apache-2.0
"""Levels of the rooms of a floor: sums of its steps and drops from cell to cell."""
from collections import deque
from functools import lru_cache
import math
from typing import Dict, List, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.floors.floor import Floor, OCCUPIED, Point
from ballbot_ros.floors.profile import depth


def level(floor: Floor, place: Point) -> float:
    """Return the height of the floor at a position that results from steps and drops [m]."""
    row, column = floor.cell_of(place)
    rows, columns = floor.cells.shape
    return float(levels(floor)[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)])


@lru_cache(maxsize=2)
def levels(floor: Floor) -> NDArray[np.float64]:
    """
    Return the level of each cell, 0 in the largest area without a step, a (rows, columns) array.

    Where cells connect around the end of a step, the shortest path determines the level.
    """
    lines = [(segment, depth(feature)) for feature in floor.features
             if feature.kind in ('step', 'drop') for segment in feature.segments]
    if not lines:
        return np.zeros(floor.cells.shape)
    rows, columns = map(int, floor.cells.shape)
    numbers = np.arange(rows * columns).reshape(rows, columns)
    links, rises = [], []
    for down, right in ((0, 1), (1, 0)):
        one, two = (slice(0, rows - down), slice(0, columns - right)), \
            (slice(down, rows), slice(right, columns))
        rise = np.zeros((rows - down, columns - right))
        for segment, height in lines:
            _raise(floor, rise, (down, right), segment, height)
        free = (floor.cells[one] != OCCUPIED) & (floor.cells[two] != OCCUPIED)
        links.append(np.column_stack([numbers[one][free], numbers[two][free]]))
        rises.append(rise[free])
    pairs, rise = np.concatenate(links), np.concatenate(rises)
    even = pairs[rise == 0.0]
    from scipy import sparse
    from scipy.sparse import csgraph
    _, labels = csgraph.connected_components(sparse.coo_matrix(
        (np.ones(len(even), bool), even.T), shape=(numbers.size, numbers.size)), directed=False)
    neighbours: Dict[int, List[Tuple[int, float]]] = {}
    for (one_cell, two_cell), up in zip(pairs[rise != 0.0].tolist(), rise[rise != 0.0].tolist()):
        a, b = int(labels[one_cell]), int(labels[two_cell])
        neighbours.setdefault(a, []).append((b, up))
        neighbours.setdefault(b, []).append((a, -up))
    sizes = np.bincount(labels, weights=(floor.cells != OCCUPIED).ravel())
    heights = np.zeros(len(sizes))
    known = np.zeros(len(sizes), bool)
    for first in sorted(neighbours, key=lambda label: -sizes[label]):
        queue = deque([] if known[first] else [first])
        known[first] = True
        while queue:
            here = queue.popleft()
            for there, up in neighbours[here]:
                if not known[there]:
                    known[there], heights[there] = True, heights[here] + up
                    queue.append(there)
    found: NDArray[np.float64] = heights[labels].reshape(rows, columns)
    return found


def _raise(floor: Floor, rise: NDArray[np.float64], way: Tuple[int, int],
           segment: Tuple[Point, Point], height: float) -> None:
    """Add a step, higher on its left, to the rises from cells to those at the offset `way`."""
    (x0, y0), (x1, y1) = segment
    first = floor.cell_of((min(x0, x1), min(y0, y1)))
    last = floor.cell_of((max(x0, x1), max(y0, y1)))
    rows, columns = (slice(max(0, low - 1), max(0, high + 2)) for low, high in zip(first, last))
    row, column = np.ogrid[:rise.shape[0], :rise.shape[1]]
    x, y = (origin + (number + 0.5) * floor.resolution for origin, number in zip(
        floor.origin, (column[:, columns], row[rows])))
    dy, dx = (count * floor.resolution for count in way)
    turn = (x1 - x0) * dy - (y1 - y0) * dx
    before = (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0)
    ends = [dx * (end_y - y) - dy * (end_x - x) >= 0.0 for end_x, end_y in segment]
    crossed = ((before > 0.0) != (before + turn > 0.0)) & (ends[0] != ends[1])
    rise[rows, columns] += np.where(crossed, math.copysign(height, turn), 0.0)
