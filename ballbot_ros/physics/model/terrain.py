# SPDX-License-Identifier: Apache-2.0
"""
The ground: a polyline with the solid below it, and the ``terrain`` section of a scene file.

Floors, steps, slopes, thresholds, cords and carpets are all profiles.  A scene file lists pieces
from left to right, each of which starts where the previous one ends::

    terrain:
      - flat: {length: 1.2}
      - step: {height: 0.031}              # down if negative
      - flat: {length: 2.0}
      - slope: {length: 1.0, angle_deg: 5}  # or rise: 0.08
      - threshold: {height: 0.02, width: 0.05, bevel: 0.01}
      - cord: {diameter: 0.008}
      - carpet: {thickness: 0.006, length: 1.0}

or gives the vertices: ``terrain: {vertices: [[0, 0], [1, 0], [1, 0.02], [2, 0.02]]}``.
Every piece may have a ``friction`` of its surfaces and an ``edge_friction``.
"""
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any, Callable, Mapping, Optional

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot_ros.config.fields import (
    check_value, expect_mapping, Problems, quantity, refuse_unknown)
from ballbot_ros.errors import ConfigurationError

Array = NDArray[np.float64]


def friction_coefficient(doc: str, *, optional: bool = False) -> Any:
    """Declare a coefficient of friction, in the range for which the solvers are tested."""
    return quantity('1', doc, minimum=0.0, maximum=10.0, optional=optional)


FRICTION = friction_coefficient('coefficient of friction')


# Columns of a profile, the array from which the compiled kernels read a terrain; a row per vertex.
# (A single array, because counting references to seven costs more than the mechanics.)
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
        face, is not finite, or the arrays have inconsistent lengths.

    """

    vertices: Array
    surface_friction: Array
    edge_friction: Array

    def __init__(self, vertices: ArrayLike, surface_friction: Optional[ArrayLike] = None,
                 edge_friction: Optional[ArrayLike] = None):
        points = _frozen('vertices', vertices)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise ConfigurationError(
                'terrain: vertices must be a list of at least two [x, y] pairs, got an array '
                f'of shape {points.shape}', 'wrong_type', 'vertices')
        if not np.isfinite(points).all():
            row = int(np.argwhere(~np.isfinite(points))[0, 0])
            raise ConfigurationError(
                f'terrain: vertex {row} is {points[row].tolist()}; all must be finite',
                'not_finite', 'vertices')
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

    def __eq__(self, other: object) -> bool:
        """Return whether vertices and coefficients are equal, NaN included."""
        if not isinstance(other, Terrain):
            return NotImplemented
        return all(np.array_equal(own, given, equal_nan=True) for own, given in zip(
            self.__reduce__()[1], other.__reduce__()[1]))

    def __hash__(self) -> int:
        return hash(tuple(self.vertices.ravel().tolist()))

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
        """Return an infinite slope through the origin that rises towards +x [rad]."""
        if not -np.pi / 2 < angle < np.pi / 2:
            raise ConfigurationError(
                f'terrain: slope angle must be between -pi/2 and pi/2 rad, got {angle!r}',
                'out_of_range', 'angle')
        return cls([[0.0, 0.0], [np.cos(angle), np.sin(angle)]])

    def profile(self, surface_friction: float, edge_friction: float) -> Array:
        """
        Return the terrain as the kernels read it, an (n, 7) array.

        Its TURN is the sine of the turn at a vertex: positive where the ground is concave.  The
        frictions are the robot's coefficients, for pieces without their own.
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

        A face is steep from its foot to its edge, or over most of its height, like a rounded edge.

        Parameters
        ----------
        least_slope : float
            Rise over run; a less steep segment is a ramp.
        least_height : float
            [m]; a lower face counts as unevenness.
        short : float
            Less steep segments shorter than this belong to the face [m].
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
                # A quarter circle is as high as it is wide; on a slope it is less high.
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
        raise ConfigurationError(f'terrain: {name} must hold numbers, got {values!r}',
                                 'wrong_type', name) from error
    array.setflags(write=False)
    return array


def _check_course(points: Array) -> None:
    """Refuse a polyline with overhangs, repeated vertices or vertical ends."""
    step = np.diff(points, axis=0)
    for index, (dx, dy) in enumerate(step):
        if dx < 0.0:
            raise ConfigurationError(
                f'terrain: vertex {index + 1} is {-dx:g} m behind vertex {index}; x must '
                'never decrease (no overhangs)', 'inconsistent', 'vertices')
        if dx == 0.0 and dy == 0.0:
            raise ConfigurationError(
                f'terrain: vertices {index} and {index + 1} are the same point '
                f'{points[index].tolist()}; remove one', 'inconsistent', 'vertices')
        if dx == 0.0 and index in (0, len(step) - 1):
            raise ConfigurationError(
                'terrain: the first and the last segment extend to infinity and so cannot be '
                f'vertical; segment {index} is vertical: add a vertex next to it',
                'inconsistent', 'vertices')


def _friction(name: str, values: ArrayLike, length: int) -> Array:
    """Return checked coefficients of friction, NaN where a piece has none."""
    array = _frozen(name, values)
    if array.shape != (length,):
        raise ConfigurationError(
            f'terrain: {name} must have {length} entries, got shape {array.shape}',
            'wrong_type', name)
    for value in array[~np.isnan(array)].tolist():
        check_value(name, value, FRICTION.metadata, 'terrain')
    return array


# Angle between the vertices of a round piece; at 15 degrees the segments of a cord deviate from
# the circle by less than 1 % of its radius.
ARC_STEP = math.radians(15.0)

Strides = list[tuple[float, float]]  # a piece: offsets from each vertex to the next [m]

_LENGTH = quantity('m', 'horizontal length', above=0.0, maximum=1e6)
_HEIGHT = quantity('m', 'height', above=0.0, maximum=1e6)
_SIGNED = quantity('m', 'height, negative for down', minimum=-1e6, maximum=1e6)
_ANGLE = quantity('deg', 'slope angle', minimum=-89.0, maximum=89.0)
_COMMON = {'friction': FRICTION, 'edge_friction': FRICTION}


def _flat(length: float) -> Strides:
    return [(length, 0.0)]


def _step(height: float) -> Strides:
    if height == 0.0:
        raise ConfigurationError('height must not be 0; use a flat', 'out_of_range', 'height')
    return [(0.0, height)]


def _slope(length: float, rise: float = math.nan, angle_deg: float = math.nan) -> Strides:
    if math.isnan(rise) == math.isnan(angle_deg):
        raise ConfigurationError('give either rise or angle_deg', 'inconsistent', 'angle_deg')
    return [(length, length * math.tan(math.radians(angle_deg)) if math.isnan(rise) else rise)]


def _threshold(height: float, width: float, bevel: float = 0.0) -> Strides:
    if 2.0 * bevel >= width:
        raise ConfigurationError(
            f'bevel must be less than half the width of {width:g} m, got {bevel:g} m',
            'inconsistent', 'bevel')
    return [(bevel, height), (width - 2.0 * bevel, 0.0), (bevel, -height)]


def _arc(radius: float, begin: float, end: float) -> Strides:
    """Return the strides along a circular arc, angles from +x, turning clockwise."""
    angles = np.linspace(begin, end, 1 + math.ceil(abs(end - begin) / ARC_STEP))
    return list(zip(radius * np.diff(np.cos(angles)), radius * np.diff(np.sin(angles))))


def _cord(diameter: float) -> Strides:
    # The ball cannot reach the lower half of a round cord.
    radius = 0.5 * diameter
    return [(0.0, radius), *_arc(radius, math.pi, 0.0), (0.0, -radius)]


def _carpet(thickness: float, length: float) -> Strides:
    if 2.0 * thickness >= length:
        raise ConfigurationError(
            f'length must be more than two thicknesses, {2.0 * thickness:g} m, got {length:g} m',
            'inconsistent', 'length')
    quarter = 0.5 * math.pi
    return [*_arc(thickness, math.pi, quarter), (length - 2.0 * thickness, 0.0),
            *_arc(thickness, quarter, 0.0)]


# Piece -> (function that returns its strides, its values, its optional values).
PIECES: Mapping[str, tuple[Callable[..., Strides], Mapping[str, Any], tuple[str, ...]]] = {
    'flat': (_flat, {'length': _LENGTH}, ()),
    'step': (_step, {'height': _SIGNED}, ()),
    'slope': (_slope, {'length': _LENGTH, 'rise': _SIGNED, 'angle_deg': _ANGLE},
              ('rise', 'angle_deg')),
    'threshold': (_threshold, {'height': _HEIGHT, 'width': _LENGTH,
                               'bevel': quantity('m', 'bevel', minimum=0.0)}, ('bevel',)),
    'cord': (_cord, {'diameter': _HEIGHT}, ()),
    'carpet': (_carpet, {'thickness': _HEIGHT, 'length': _LENGTH}, ()),
}


def read_terrain(section: Any, where: str) -> Terrain:
    """
    Return the terrain that a scene file describes, by pieces or by a mapping with the vertices.

    `where` is the location for error messages.  Raises a `ConfigurationError` that names piece,
    field, value and range.
    """
    try:
        if isinstance(section, dict):
            names = ('vertices', 'surface_friction', 'edge_friction')
            refuse_unknown(section, names, where)
            if 'vertices' not in section:
                raise ConfigurationError(
                    'vertices is missing: a list of [x, y] pairs [m]', 'missing', 'vertices')
            return Terrain(section['vertices'], *(section.get(name) for name in names[1:]))
        if not isinstance(section, list) or not section:
            raise ConfigurationError(
                f'expected a list of pieces or a mapping with vertices, got {section!r}',
                'wrong_type', 'terrain')
        return _join(_read_pieces(section, where))
    except ConfigurationError as error:
        raise error if str(error).startswith(where) else error.at(where) from None


def _read_pieces(section: list[Any], where: str) -> list[tuple[Strides, float, float]]:
    """Return all pieces; the errors of all of them are reported together."""
    pieces, problems = [], Problems()
    for number, piece in enumerate(section, 1):
        with problems.collected():
            pieces.append(_read_piece(piece, f'{where}: piece {number}'))
    problems.refuse()
    return pieces


def _read_piece(piece: Any, where: str) -> tuple[Strides, float, float]:
    """Return the strides of a piece, its surface friction and its edge friction."""
    expect_mapping(piece, where)
    if len(piece) != 1:
        raise ConfigurationError(
            f'{where}: expected one name with its values, got {piece!r}', 'wrong_type', 'terrain')
    (name, values), = piece.items()
    refuse_unknown({name: None}, PIECES, where)
    make, described, optional = PIECES[name]
    known = {**described, **_COMMON}
    place = f'{where} ({name})'
    given = dict(expect_mapping(values, place))
    refuse_unknown(given, known, place)
    missing = {key: f'{key} is missing ({item.metadata["doc"]} [{item.metadata["unit"]}])'
               for key, item in described.items() if key not in given and key not in optional}
    if missing:
        raise ConfigurationError(
            f'{place}: {"; ".join(missing.values())}', 'missing', next(iter(missing)))
    checked = {key: check_value(key, value, known[key].metadata, place)
               for key, value in given.items()}
    friction = checked.pop('friction', math.nan)
    edge_friction = checked.pop('edge_friction', math.nan)
    try:
        strides = make(**checked)
    except ConfigurationError as error:
        raise error.at(place) from None
    return [stride for stride in strides if stride != (0.0, 0.0)], friction, edge_friction


def _join(pieces: list[tuple[Strides, float, float]]) -> Terrain:
    """Return the terrain of pieces joined end to end, with level ends where needed."""
    # Add a level metre at either end, unless the end segment can be infinite.
    level: tuple[Strides, float, float] = ([(1.0, 0.0)], math.nan, math.nan)
    lead = [] if len(pieces[0][0]) == 1 and pieces[0][0][0][0] > 0.0 else [level]
    tail = [] if len(pieces[-1][0]) == 1 and pieces[-1][0][0][0] > 0.0 else [level]
    strides, surfaces, edges = [], [], [math.nan]
    for piece, friction, edge_friction in [*lead, *pieces, *tail]:
        strides += piece
        surfaces += [friction] * len(piece)
        # An edge belongs to the piece with its own edge_friction.
        if not math.isnan(edge_friction):
            edges[-1] = edge_friction
        edges += [edge_friction] * len(piece)
    vertices = np.vstack([[0.0, 0.0], np.cumsum(strides, axis=0)])
    vertices[:, 0] -= 1.0 if lead else 0.0
    return Terrain(vertices, surfaces, edges)
