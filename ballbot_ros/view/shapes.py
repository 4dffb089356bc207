# SPDX-License-Identifier: Apache-2.0
"""
Meshes of the scene, as vertices and triangles.

The plane of the model is drawn upright: x to the right, y of the model upwards (z of the page),
and the page's own y away from whoever looks.
"""
import math
from typing import Iterable, List, NamedTuple, Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.physics.model.terrain import Array

Triangles = NDArray[np.int64]


class Mesh(NamedTuple):
    """Triangles over points."""

    points: Array  # (n, 3) [m]
    triangles: Triangles  # (m, 3)


def turned(angle: float) -> Tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of an angle of the model, counter-clockwise [rad]."""
    return math.cos(0.5 * angle), 0.0, -math.sin(0.5 * angle), 0.0


def joined(parts: Iterable[Mesh]) -> Mesh:
    """Return several meshes as one."""
    points: List[Array] = []
    triangles: List[Triangles] = []
    count = 0
    for part in parts:
        points.append(part.points)
        triangles.append(part.triangles + count)
        count += len(part.points)
    return Mesh(np.vstack(points), np.vstack(triangles))


def tube(radius: float, thickness: float, begin: float = 0.0, end: float = 2.0 * math.pi,
         depth: float = 0.0) -> Mesh:
    """
    Return a part of a ring about the axis of the ball.

    Parameters
    ----------
    radius, thickness : float
        Of the ring, and of its tube [m].
    begin, end : float
        Counter-clockwise from straight down, as the angles of the model [rad].
    depth : float
        Along the axis [m].

    """
    along, around = max(2, math.ceil(32 * (end - begin) / math.pi)), 10
    turn = np.linspace(begin, end, along + 1)[:, None]
    roll = np.linspace(0.0, 2.0 * math.pi, around, endpoint=False)[None, :]
    reach = radius + thickness * np.cos(roll)
    points = np.stack([
        reach * np.sin(turn), depth + thickness * np.sin(roll) + 0.0 * turn,
        -reach * np.cos(turn)], axis=-1).reshape(-1, 3)
    return Mesh(points, _grid(along + 1, around))


def rod(length: float, thickness: float) -> Mesh:
    """Return a rod that hangs down from the origin [m]."""
    around = 14
    roll = np.linspace(0.0, 2.0 * math.pi, around, endpoint=False)
    ring = np.column_stack([thickness * np.cos(roll), thickness * np.sin(roll),
                            np.zeros(around)])
    return Mesh(np.vstack([ring, ring - [0.0, 0.0, length]]), _grid(2, around))


def bob(radius: float, width: float, length: float) -> Mesh:
    """Return a disk about the axis of the ball, `length` below the origin [m]."""
    around = 36
    roll = np.linspace(0.0, 2.0 * math.pi, around, endpoint=False)
    rim = np.column_stack([radius * np.cos(roll), np.zeros(around),
                           radius * np.sin(roll) - length])
    front, back = rim - [0.0, 0.5 * width, 0.0], rim + [0.0, 0.5 * width, 0.0]
    middles = np.array([[0.0, -0.5 * width, -length], [0.0, 0.5 * width, -length]])
    fans = []
    for index in range(around):
        other = (index + 1) % around
        fans += [[2 * around, index, other], [2 * around + 1, around + other, around + index]]
    return Mesh(np.vstack([front, back, middles]),
                np.vstack([_grid(2, around), np.array(fans)]))


def _grid(rows: int, columns: int) -> Triangles:
    """Return triangles between rings of points."""
    found = []
    for row in range(rows - 1):
        for column in range(columns):
            here, there = row * columns + column, row * columns + (column + 1) % columns
            found += [[here, there, here + columns], [there, there + columns, here + columns]]
    return np.array(found)


def ground_top(line: Array, half_width: float) -> Mesh:
    """Return the surface of the ground along a line of (x, y), to both sides of the plane [m]."""
    near = np.column_stack([line[:, 0], np.full(len(line), -half_width), line[:, 1]])
    far = near * [1.0, -1.0, 1.0]
    return Mesh(np.vstack([near, far]), _strip(len(line)))


def ground_front(line: Array, half_width: float, bottom: float) -> Mesh:
    """Return the cut through the ground that faces whoever looks, down to `bottom` [m]."""
    above = np.column_stack([line[:, 0], np.full(len(line), -half_width), line[:, 1]])
    below = above.copy()
    below[:, 2] = bottom
    return Mesh(np.vstack([below, above]), _strip(len(line)))


def _strip(count: int) -> Triangles:
    """Return triangles between two lines of as many points."""
    index = np.arange(count - 1)
    return np.vstack([
        np.column_stack([index, index + 1, index + count]),
        np.column_stack([index + 1, index + count + 1, index + count])])
