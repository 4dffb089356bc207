# SPDX-License-Identifier: Apache-2.0
"""
Terrain from pieces: the ``terrain`` section of a scene file.

Pieces follow one another from left to right, each beginning where the last one ended::

    terrain:
      - flat: {length: 1.2}
      - step: {height: 0.031}              # down if negative
      - flat: {length: 2.0}
      - slope: {length: 1.0, angle_deg: 5}  # or rise: 0.08
      - threshold: {height: 0.02, width: 0.05, bevel: 0.01}
      - cord: {diameter: 0.008}
      - carpet: {thickness: 0.006, length: 1.0}

or the vertices themselves: ``terrain: {vertices: [[0, 0], [1, 0], [1, 0.02], [2, 0.02]]}``.
Every piece may have a ``friction`` of its surfaces and an ``edge_friction``.
"""
import math
from typing import Any, Callable, Mapping

import numpy as np

from ballbot_ros.config.fields import (
    check_value, expect_mapping, Problems, quantity, refuse_unknown)
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import Terrain

# A round piece is drawn with vertices this far apart; at 15 degrees the flats of a cord are
# within 1 % of its radius of the circle.
ARC_STEP = math.radians(15.0)

Strides = list[tuple[float, float]]  # a piece: from each vertex to the next [m]

_LENGTH = quantity('m', 'horizontal length', above=0.0, maximum=1e6)
_HEIGHT = quantity('m', 'height', above=0.0, maximum=1e6)
_SIGNED = quantity('m', 'height, negative for down', minimum=-1e6, maximum=1e6)
_ANGLE = quantity('deg', 'slope angle', minimum=-89.0, maximum=89.0)
_FRICTION = quantity('1', 'coefficient of friction', minimum=0.0, maximum=1e3)
_COMMON = {'friction': _FRICTION, 'edge_friction': _FRICTION}


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
    # A round cord seen from above: the lower half of its sides is out of reach.
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


# Piece -> (function giving its strides, the values it takes, those it may do without).
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
    Return the terrain that a scene file describes.

    Parameters
    ----------
    section : list of pieces, or mapping with the vertices
    where : str
        Place for error messages.

    Raises
    ------
    ConfigurationError
        Naming piece, field, value and range.

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
    place = f'{where} ({name})'
    given = dict(expect_mapping(values, place))
    refuse_unknown(given, {**described, **_COMMON}, place)
    missing = {key: f'{key} is missing ({item.metadata["doc"]} [{item.metadata["unit"]}])'
               for key, item in described.items() if key not in given and key not in optional}
    if missing:
        raise ConfigurationError(
            f'{place}: {"; ".join(missing.values())}', 'missing', next(iter(missing)))
    checked = {key: check_value(key, value, {**described, **_COMMON}[key].metadata, place)
               for key, value in given.items()}
    friction = checked.pop('friction', math.nan)
    edge_friction = checked.pop('edge_friction', math.nan)
    try:
        strides = make(**checked)
    except ConfigurationError as error:
        raise error.at(place) from None
    return [stride for stride in strides if stride != (0.0, 0.0)], friction, edge_friction


def _join(pieces: list[tuple[Strides, float, float]]) -> Terrain:
    """Return the terrain of pieces set end to end, with level ends where those are needed."""
    # Add a level metre at either end, unless the end segment can be infinite.
    level: tuple[Strides, float, float] = ([(1.0, 0.0)], math.nan, math.nan)
    lead = [] if len(pieces[0][0]) == 1 and pieces[0][0][0][0] > 0.0 else [level]
    tail = [] if len(pieces[-1][0]) == 1 and pieces[-1][0][0][0] > 0.0 else [level]
    strides, surfaces, edges = [], [], [math.nan]
    for piece, friction, edge_friction in [*lead, *pieces, *tail]:
        strides += piece
        surfaces += [friction] * len(piece)
        # An edge belongs to the piece that has an edge_friction of its own.
        if not math.isnan(edge_friction):
            edges[-1] = edge_friction
        edges += [edge_friction] * len(piece)
    vertices = np.vstack([[0.0, 0.0], np.cumsum(strides, axis=0)])
    vertices[:, 0] -= 1.0 if lead else 0.0
    return Terrain(vertices, surfaces, edges)
