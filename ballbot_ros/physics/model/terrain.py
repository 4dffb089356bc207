# SPDX-License-Identifier: Apache-2.0
"""
The ground: a polyline with the solid below it.

Floors, steps, slopes, thresholds, cords and carpets are all profiles; see
`ballbot_ros.physics.model.terrain_file` for building one from such pieces.
"""
from dataclasses import dataclass
from functools import cached_property
from typing import Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot_ros.errors import ConfigurationError

Array = NDArray[np.float64]


# Columns of a profile, the one array in which the compiled kernels read a terrain; a row per
# vertex.  (One array, because counting references to seven costs more than the mechanics.)
# Tangents and surface friction are those of the segment that starts at the vertex.
VERTEX_X, VERTEX_Y, TANGENT_X, TANGENT_Y, TURN, SURFACE_FRICTION, EDGE_FRICTION = range(7)


@dataclass(frozen=True, eq=False)
class Terrain:
    """
    A ground profile.

    The polyline runs towards +x and may have vertical faces but no overhangs.  Its first
    and last segments are infinite.

    Parameters
    ----------
    vertices : (n, 2) array_like
        x and y of the vertices [m], n >= 2, x never decreasing.
    surface_friction : (n - 1,) array_like, optional
        Coefficient per segment; NaN takes that of the robot.
    edge_friction : (n,) array_like, optional
        Coefficient per vertex; NaN takes that of the robot.

    Raises
    ------
    ConfigurationError
        If the polyline runs backwards, repeats a vertex, starts or ends with a vertical
        face, is not finite, or the arrays do not fit together.

    """

    vertices: Array
    surface_friction: Array
    edge_friction: Array

    def __init__(self, vertices: ArrayLike, surface_friction: Optional[ArrayLike] = None,
                 edge_friction: Optional[ArrayLike] = None):
        """Check and freeze the arrays."""
        points = _frozen('vertices', vertices)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ConfigurationError(
                'terrain: vertices must be a list of at least two [x, y] pairs, got an array '
                f'of shape {points.shape}')
        if not np.isfinite(points).all():
            row = int(np.argwhere(~np.isfinite(points))[0, 0])
            raise ConfigurationError(
                f'terrain: vertex {row} is {points[row].tolist()}; all must be finite')
        _check_course(points)
        object.__setattr__(self, 'vertices', points)
        for name, given, length in (
                ('surface_friction', surface_friction, len(points) - 1),
                ('edge_friction', edge_friction, len(points))):
            values = np.full(length, np.nan) if given is None else given
            object.__setattr__(self, name, _friction(name, values, length))

    def __reduce__(self) -> tuple[type['Terrain'], tuple[Array, Array, Array]]:
        """Copy and unpickle by construction: the arrays stay read-only."""
        return type(self), (self.vertices, self.surface_friction, self.edge_friction)

    @classmethod
    def flat(cls) -> 'Terrain':
        """Return a level floor at y = 0."""
        return cls([[0.0, 0.0], [1.0, 0.0]])

    @classmethod
    def step(cls, height: float, at: float = 0.0) -> 'Terrain':
        """Return a level floor at y = 0 with one vertical step (down if negative) [m]."""
        if height == 0.0:
            return cls.flat()
        return cls([[at - 1.0, 0.0], [at, 0.0], [at, height], [at + 1.0, height]])

    @classmethod
    def slope(cls, angle: float) -> 'Terrain':
        """Return an endless slope through the origin that rises towards +x [rad]."""
        if not -np.pi / 2 < angle < np.pi / 2:
            raise ConfigurationError(
                f'terrain: slope angle must be between -pi/2 and pi/2 rad, got {angle!r}')
        return cls([[0.0, 0.0], [np.cos(angle), np.sin(angle)]])

    def profile(self, surface_friction: float, edge_friction: float) -> Array:
        """
        Return the terrain as the kernels read it, an (n, 7) array.

        Its TURN is the sine of the turn at a vertex: positive where the ground is concave.

        Parameters
        ----------
        surface_friction, edge_friction : float
            The robot's coefficients, for all that has none of its own.

        """
        profile = np.zeros((len(self.vertices), 7))
        profile[:, [VERTEX_X, VERTEX_Y]] = self.vertices
        step = np.diff(self.vertices, axis=0)
        tangent = step / np.linalg.norm(step, axis=1)[:, None]
        profile[:-1, [TANGENT_X, TANGENT_Y]] = tangent
        profile[1:-1, TURN] = (
            tangent[:-1, 0] * tangent[1:, 1] - tangent[:-1, 1] * tangent[1:, 0])
        profile[:-1, SURFACE_FRICTION] = np.where(
            np.isnan(self.surface_friction), surface_friction, self.surface_friction)
        profile[:, EDGE_FRICTION] = np.where(
            np.isnan(self.edge_friction), edge_friction, self.edge_friction)
        return profile

    @cached_property
    def _end_slopes(self) -> Array:
        step = np.diff(self.vertices[[0, 1, -2, -1]], axis=0)[[0, 2]]
        return step[:, 1] / step[:, 0]

    def faces(self, least_slope: float, least_height: float, short: float = 0.0,
              endless: bool = True) -> list[Array]:
        """
        Return the vertices of each face that rises or drops, from left to right.

        A face is steep from its foot to its edge, or for most of its height, as a rounded edge is.

        Parameters
        ----------
        least_slope : float
            Rise over run; a less steep segment is a ramp.
        least_height : float
            [m]; a lower one is an unevenness.
        short : float
            A less steep segment within a face that is shorter belongs to it [m].
        endless : bool
            Whether the infinite end segments may be faces.

        """
        run, rise = np.diff(self.vertices, axis=0).T
        found = {}
        for sign in (1.0, -1.0):
            climb = sign * rise
            steep = climb > least_slope * run
            belongs = (climb > 0.0) & (steep | (np.hypot(run, rise) < short))
            if not endless:
                belongs[[0, -1]] = False
            ends = np.flatnonzero(np.diff(np.concatenate([[0], belongs.astype(int), [0]])))
            for begin, end in zip(ends[::2], ends[1::2]):
                face = self.vertices[begin:end + 1]
                width, height = (face[-1] - face[0]) * (1.0, sign)
                # A quarter of a circle is as high as it is wide, and less so on a slope.
                mostly = np.sum(climb[begin:end][steep[begin:end]]) > 0.5 * height
                if height >= least_height and (mostly or height >= least_slope * width):
                    found[begin] = face
        return [found[begin] for begin in sorted(found)]

    def height(self, x: ArrayLike) -> Array:
        """Return the height of the ground at `x` [m]; the upper one at a vertical face."""
        where = np.asarray(x, dtype=float)
        xs, ys = self.vertices.T
        inside = np.interp(where, xs, ys)
        # np.interp gives the first of several vertices at the same x: take the highest.
        for face in np.flatnonzero(np.diff(xs) == 0.0):
            inside = np.where(where == xs[face],
                              np.maximum(inside, max(ys[face], ys[face + 1])), inside)
        before, behind = self._end_slopes
        inside = np.where(where < xs[0], ys[0] + before * (where - xs[0]), inside)
        return np.where(where > xs[-1], ys[-1] + behind * (where - xs[-1]), inside)


def _frozen(name: str, values: ArrayLike) -> Array:
    """Return a read-only float copy of `values`."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f'terrain: {name} must hold numbers, got {values!r}') from error
    array.setflags(write=False)
    return array


def _check_course(points: Array) -> None:
    """Refuse a polyline that no ball could roll along."""
    step = np.diff(points, axis=0)
    for index, (dx, dy) in enumerate(step):
        if dx < 0.0:
            raise ConfigurationError(
                f'terrain: vertex {index + 1} lies {-dx:g} m behind vertex {index}; x must '
                'never decrease (no overhangs)')
        if dx == 0.0 and dy == 0.0:
            raise ConfigurationError(
                f'terrain: vertices {index} and {index + 1} are the same point '
                f'{points[index].tolist()}; remove one')
        if dx == 0.0 and index in (0, len(step) - 1):
            raise ConfigurationError(
                'terrain: the first and the last segment extend to infinity and so cannot be '
                f'vertical; segment {index} is, add a vertex beside it')


def _friction(name: str, values: ArrayLike, length: int) -> Array:
    """Return checked coefficients of friction, NaN where there is none of its own."""
    array = _frozen(name, values)
    if array.shape != (length,):
        raise ConfigurationError(
            f'terrain: {name} must have {length} entries, got shape {array.shape}')
    if np.isinf(array).any() or (array < 0.0).any():
        raise ConfigurationError(
            f'terrain: {name} must be at least 0 and finite, got {array.tolist()}')
    return array
