# SPDX-License-Identifier: Apache-2.0
"""The next step ahead of the ball, and changes of its height."""
from typing import NamedTuple, Optional

import numpy as np

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Array, Terrain
from ballbot_ros.results.faces import faces_of, LEAST_HEIGHT

# Without a step ahead, a new one is placed at this distance from the centre of the ball [m].
NEW_STEP_DISTANCE = 1.0


class StepAhead(NamedTuple):
    """The next face ahead that rises or drops."""

    x: float  # of its foot, or of the edge of a drop [m]
    height: float  # [m]; negative for a drop


def step_ahead(terrain: Terrain, x: float, radius: float) -> Optional[StepAhead]:
    """
    Return the first face beyond `x` [m], None if there is none.

    Segments that are short relative to the radius of the ball [m] are not slopes.
    """
    for face in faces_of(terrain, radius, endless=False):
        if face[0, 0] > x:
            return StepAhead(float(face[0, 0]), float(face[-1, 1] - face[0, 1]))
    return None


def with_step(terrain: Terrain, x: float, radius: float, height: float) -> Terrain:
    """
    Return the ground with a new height of the next step ahead of a ball at `x` [m].

    The ground behind the step is lifted with it.  If there is no step ahead, one is created
    `NEW_STEP_DISTANCE` ahead of the ball; a step below `LEAST_HEIGHT` is removed.

    Raises `ConfigurationError` if the ball is already at the step: the ground below the ball must
    not move.
    """
    faces = [face for face in faces_of(terrain, radius, endless=False) if face[-1, 0] > x]
    if not faces:
        return (_new_step(terrain, x + NEW_STEP_DISTANCE, height)
                if abs(height) >= LEAST_HEIGHT else terrain)
    face = faces[0]
    if face[0, 0] - x <= 1.01 * radius:
        raise ConfigurationError(
            f'step_height cannot change while the ball is at the step: its centre is '
            f'{max(face[0, 0] - x, 0.0):.2f} m before it; more than {radius:.2f} m is required',
            'inconsistent', 'step_height')
    height = 0.0 if abs(height) < LEAST_HEIGHT else height
    points = terrain.vertices.copy()
    first = int(np.flatnonzero((points == face[0]).all(axis=1))[0])
    last = first + len(face) - 1
    foot, old = face[0, 1], face[-1, 1] - face[0, 1]
    points[first:last + 1, 1] = foot + (points[first:last + 1, 1] - foot) * height / old
    points[last + 1:, 1] += height - old
    return _without_duplicates(points, terrain.surface_friction, terrain.edge_friction)


def _new_step(terrain: Terrain, x: float, height: float) -> Terrain:
    points, surface, edge = terrain.vertices, terrain.surface_friction, terrain.edge_friction
    # The end segments extend to infinity: an additional vertex on them has no effect.
    if x <= points[0, 0]:
        end = [[x - 1.0, float(terrain.height(x - 1.0))]]
        points, surface, edge = (np.vstack([end, points]), np.append(surface[:1], surface),
                                 np.append(edge[:1], edge))
    if x >= points[-1, 0]:
        end = [[x + 1.0, float(terrain.height(x + 1.0))]]
        points, surface, edge = (np.vstack([points, end]), np.append(surface, surface[-1:]),
                                 np.append(edge, edge[-1:]))
    foot = float(terrain.height(x))
    cut = int(np.searchsorted(points[:, 0], x, side='right'))
    behind = points[cut:] + [0.0, height]
    points = np.vstack([points[:cut], [[x, foot], [x, foot + height]], behind])
    # The face has the friction of the robot; the segment that it divides keeps its own.
    surface = np.concatenate([surface[:cut], [np.nan], surface[cut - 1:]])
    edge = np.concatenate([edge[:cut], [np.nan, np.nan], edge[cut:]])
    return _without_duplicates(points, surface, edge)


def _without_duplicates(points: Array, surface: Array, edge: Array) -> Terrain:
    kept = np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))
    return Terrain(points[kept], surface[kept[1:]], edge[kept])
