# SPDX-License-Identifier: Apache-2.0
"""The meshes of a floor: rooms at their levels, walls and features."""
import math
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from trimesh import creation, Trimesh
from trimesh.convex import convex_hull
from trimesh.util import concatenate

from ballbot_ros.figures.canvas import BLUE, GREEN, GREY, INK, ORANGE, SKY, VERMILION
from ballbot_ros.floors.floor import Feature, Floor, inside, OCCUPIED, Point, rectangles
from ballbot_ros.floors.levels import levels
from ballbot_ros.floors.profile import added_height, area_height, depth, polygons
from ballbot_ros.physics.model.terrain import Array

# Walls are cut at this height, so that the rooms are visible [m].
WALL_HEIGHT = 0.5
# Thickness of the floor, and of flat markings on it [m].
SLAB_DEPTH, PAINT_DEPTH = 0.05, 0.003
# Largest number of grid cells of uneven ground along the longer side.
CELLS_MAX = 300
COLOURS = {'step': BLUE, 'threshold': BLUE, 'cord': VERMILION, 'carpet': GREEN, 'level': SKY,
           'ramp': SKY, 'friction': ORANGE, 'keep_out': GREY, 'stairs': INK, 'drop': VERMILION}
GROUND, WALLS = '#EAE6DF', '#B9B2A6'

Mesh = Any  # a Trimesh; some functions of trimesh declare its base class


class Part(NamedTuple):
    """A mesh with its colour, and a label at a position [m]."""

    name: str
    mesh: Mesh
    colour: str
    opacity: Optional[float] = None
    label: str = ''
    place: Tuple[float, float, float] = (0.0, 0.0, 0.0)


def floor_parts(floor: Floor) -> Iterator[Part]:
    """Yield the parts of a floor, in the frame of its map [m]."""
    height = levels(floor)
    if floor.heights is None:
        grounds = []
        for value in np.unique(height[floor.cells != OCCUPIED]):
            mask = (height == value) & (floor.cells != OCCUPIED)
            for feature in floor.features:
                if feature.kind == 'stairs' or (feature.kind == 'level' and feature.height < 0.0):
                    mask &= ~inside(*floor.centers, feature.polygon)
            grounds += boxes(rectangles(mask, floor.resolution, floor.origin),
                             value - SLAB_DEPTH, value)
        yield Part('ground', concatenate(grounds), GROUND)
    else:
        yield Part('ground', _uneven(floor), GROUND)
    if len(floor.walls):
        yield Part('walls', concatenate(boxes(floor.walls, -SLAB_DEPTH, WALL_HEIGHT)), WALLS)
    counts: Dict[str, int] = {}
    for feature in floor.features:
        number = counts[feature.kind] = counts.get(feature.kind, 0) + 1
        mesh = _feature(floor, feature)
        points = np.array(feature.polygon or feature.line)
        x, y = points.mean(axis=0) if feature.polygon else points[[0, -1]].mean(axis=0)
        yield Part(f'{feature.kind}_{number}', mesh, COLOURS[feature.kind],
                   0.6 if feature.kind in ('friction', 'keep_out') else None,
                   _label(feature), (float(x), float(y), float(mesh.vertices[:, 2].max()) + 0.1))


def boxes(areas: Array, low: float, high: float) -> List[Mesh]:
    """Return a box between two heights for each row of `Floor.walls` or `rectangles` [m]."""
    return [creation.box(bounds=[[x - wide, y - deep, low], [x + wide, y + deep, high]])
            for x, y, wide, deep in areas.tolist()]


def prism(outline: Sequence[Point], low: Array, high: Array) -> Mesh:
    """Return a prism on a convex outline, with a lower and an upper height per corner [m]."""
    return convex_hull(np.vstack([np.column_stack([outline, low]),
                                  np.column_stack([outline, high])]))


def _feature(floor: Floor, feature: Feature) -> Mesh:
    if not polygons(feature):  # a step or drop: its face
        size = depth(feature)
        faces = []
        for start, end in feature.segments:
            length = math.dist(start, end) or 1.0
            right = (0.01 * (end[1] - start[1]) / length, -0.01 * (end[0] - start[0]) / length)
            low = base_level(floor, (0.5 * (start[0] + end[0]) + 4.0 * right[0],
                                     0.5 * (start[1] + end[1]) + 4.0 * right[1]))
            faces.append(prism([start, end, (end[0] + right[0], end[1] + right[1]),
                                (start[0] + right[0], start[1] + right[1])],
                               np.full(4, low - SLAB_DEPTH), np.full(4, low + size + PAINT_DEPTH)))
        return concatenate(faces)
    parts = []
    for outline in polygons(feature):
        middle = np.mean(outline, axis=0)
        base = base_level(floor, (float(middle[0]), float(middle[1])))
        added = np.array([added_height(feature, *corner) for corner in outline])
        if feature.kind != 'ramp' and added[0] >= 0.0:
            added = np.maximum(added, PAINT_DEPTH)  # a flat area is visible
        parts.append(prism(outline, base + np.minimum(added, 0.0) - SLAB_DEPTH, base + added))
    return concatenate(parts)


def base_level(floor: Floor, place: Point) -> float:
    """Return the level of the cell at a position; if occupied, of a free cell nearby [m]."""
    row, column = floor.cell_of(place)
    rows, columns = floor.cells.shape
    row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
    near = (slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3))
    if floor.cells[row, column] != OCCUPIED:
        return float(levels(floor)[row, column])
    free = levels(floor)[near][floor.cells[near] != OCCUPIED]
    return float(free.min()) if len(free) else 0.0


def _uneven(floor: Floor) -> Mesh:
    """Return the surface of a floor with heights."""
    left, right, bottom, top = floor.extent
    step = max(right - left, top - bottom) / CELLS_MAX
    x, y = np.arange(left, right + step, step), np.arange(bottom, top + step, step)
    points = np.array([(one, other, area_height(floor, (float(one), float(other))))
                       for other in y for one in x])
    number = np.arange(len(points)).reshape(len(y), len(x))
    here, beside = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    above, across = number[1:, :-1].ravel(), number[1:, 1:].ravel()
    return Trimesh(points, np.vstack([np.column_stack([here, beside, across]),
                                      np.column_stack([here, across, above])]), process=False)


def _label(feature: Feature) -> str:
    words = feature.name or feature.kind.replace('_', ' ')
    if feature.kind == 'friction':
        return f'{words}, friction {feature.friction:g}'
    return f'{words}, {1e3 * feature.height:.0f} mm' if feature.height else words
