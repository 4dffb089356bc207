# SPDX-License-Identifier: Apache-2.0
"""
Floors: an occupancy map with steps, thresholds, cords, carpets, drops and keep-out areas.

The occupancy map is either a map of Nav2's map_server (YAML and image) or a list of walls in the
floor file.  Coordinates are those of the frame ``map`` [m].
"""
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
import math
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, TypeVar, Union

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.config.fields import (
    Checked, Problems, quantity, refuse_missing, section, text)
from ballbot_ros.config.files import find_config, read_config, read_yaml
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics.model.terrain import friction_coefficient

Point = Tuple[float, float]
Read = TypeVar('Read')

# Larger maps are refused: route planning uses about 100 bytes per cell.
MOST_CELLS = 16_000_000
# Largest range of the heights of a floor [m].
HEIGHT_SPAN_MAX = 20.0
# Meaning of the cells of an occupancy map.
FREE, UNKNOWN, OCCUPIED = 0, 1, 2
# Kinds of features: lines that the ball crosses, or areas.
LINES = ('step', 'threshold', 'cord', 'drop')
AREAS = ('carpet', 'level', 'ramp', 'friction', 'keep_out', 'stairs')


@dataclass(frozen=True)
class Feature(Checked):
    """
    A feature of a floor: a step, threshold, cord or drop along a line, or an area.

    ``step``: the floor on the left of the line, seen from its first point to its last, is higher
    by `height`.  ``threshold``: a bar of `height` and `width`, centred on the line.  ``cord``: a
    flexible threshold.  ``drop``: the floor on the right of the line is lower by `height`, and no
    route crosses it.  ``carpet`` and ``level``: an area that is higher by `height`; a level with a
    negative height is lower.  ``ramp``: an area that rises by `height` along its line, from the
    foot to the top; routes use it if the ball can stand on it.  ``friction``: an area with a
    coefficient of friction; if that is below the range of the robot, no run-up crosses the area.
    ``keep_out`` and ``stairs``: areas that no route enters; routes keep the stopping distance
    from stairs.
    """

    kind: str = text('kind of the feature', choices=(*LINES, *AREAS))
    name: str = text('name for explanations', default='')
    line: Any = section('points of a line [m]', default=())  # or of a ramp, at least two
    polygon: Any = section('corners of an area [m]', default=())  # at least three
    height: float = quantity('m', 'height of the step, bar, area or drop', default=0.0,
                             minimum=-1.0, maximum=1.0)
    height_sd: float = quantity('m', 'standard deviation of the height', default=0.001,
                                minimum=0.0, maximum=0.1)
    width: float = quantity('m', 'width of a threshold or cord', default=0.05, above=0.0,
                            maximum=2.0)
    friction: Optional[float] = friction_coefficient(
        'coefficient of friction of an area of friction', optional=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        problems, wanted = Problems(), ['line' if self.kind in LINES else 'polygon']
        if self.kind == 'ramp':
            wanted.append('line')
        for field in ('line', 'polygon'):
            with problems.collected():
                if field in wanted:
                    object.__setattr__(self, field, _points(
                        getattr(self, field), field, 2 if field == 'line' else 3))
                elif getattr(self, field):
                    raise ConfigurationError(
                        f'{field} must not be given for a {self.kind}; give {wanted[0]}',
                        'inconsistent', field)
                else:
                    object.__setattr__(self, field, ())
        with problems.collected():
            if self.polygon and _intersects_itself(self.segments):
                raise ConfigurationError(
                    f'polygon must not intersect itself, got {self.polygon}; list its corners in '
                    'the order of the outline', 'inconsistent', 'polygon')
        with problems.collected():
            if self.kind == 'ramp' and self.line and self.line[0] == self.line[-1]:
                raise ConfigurationError(
                    f'line of a ramp must lead from its foot to its top, got {self.line}',
                    'inconsistent', 'line')
        with problems.collected():
            if (self.friction is None) == (self.kind == 'friction'):
                raise ConfigurationError(
                    'friction must be given for an area of kind friction and no other, got '
                    f'{self.friction!r} for kind {self.kind}', 'inconsistent', 'friction')
        with problems.collected():
            allowed, bound = self.height >= 0.0, 'at least'
            if self.kind == 'level':
                allowed, bound = self.height != 0.0, 'different from'
            elif self.kind in ('step', 'threshold', 'cord', 'carpet', 'ramp'):
                allowed, bound = self.height > 0.0, 'more than'
            if not allowed:
                raise ConfigurationError(
                    f'height of a {self.kind} must be {bound} 0 m, got {self.height:g}',
                    'out_of_range', 'height')
        problems.refuse()

    @property
    def label(self) -> str:
        """Return the name, or the kind with the height if it is not 0 [mm]."""
        return self.name or self.kind + f' of {1e3 * self.height:.0f} mm' * bool(self.height)

    @property
    def segments(self) -> Tuple[Tuple[Point, Point], ...]:
        """Return the segments of the line, or of the outline of the area."""
        points = (*self.polygon, self.polygon[0]) if self.polygon else self.line
        return tuple(zip(points, points[1:]))

    @property
    def rise(self) -> float:
        """Return the rise of the floor to the left of the segments, 0 for a bar or ramp [m]."""
        if self.kind in ('carpet', 'level'):
            return math.copysign(self.height, self.height * signed_area(self.polygon))
        return self.height if self.kind in ('step', 'drop') else 0.0


@dataclass(frozen=True, eq=False)
class Heights:
    """
    Heights of the ground on a grid, interpolated bilinearly.

    Raises `ConfigurationError` if a height is not finite, or if the range of heights is too large.
    """

    # (rows, columns): finite, of the centres of the cells; row 0 has the least y [m].
    values: NDArray[np.float64]
    resolution: float  # [m]
    origin: Point  # corner of cell (0, 0) [m]

    def __post_init__(self) -> None:
        bad = np.argwhere(~np.isfinite(self.values))
        if len(bad):
            raise ConfigurationError(
                f'{len(bad)} of {self.values.size} heights are not finite, the first in row '
                f'{bad[0, 0]}, column {bad[0, 1]}; fill holes first', 'not_finite', 'heights')
        span = float(np.ptp(self.values))
        if span > HEIGHT_SPAN_MAX:
            raise ConfigurationError(
                f'heights span {span:g} m, more than {HEIGHT_SPAN_MAX:g} m; if the unit is '
                'millimetres, set the scale', 'out_of_range', 'heights')

    def at(self, x: Any, y: Any) -> Any:
        """Return the height at positions, clamped to the grid [m]; arrays broadcast."""
        rows, columns = self.values.shape
        column = np.clip((x - self.origin[0]) / self.resolution - 0.5, 0.0, columns - 1.0)
        row = np.clip((y - self.origin[1]) / self.resolution - 0.5, 0.0, rows - 1.0)
        left, low = (np.minimum(np.floor(part).astype(int), max(count - 2, 0))
                     for part, count in ((column, columns), (row, rows)))
        right, top = np.minimum(left + 1, columns - 1), np.minimum(low + 1, rows - 1)
        across, up = column - left, row - low
        values = self.values
        return ((1.0 - up) * ((1.0 - across) * values[low, left] + across * values[low, right])
                + up * ((1.0 - across) * values[top, left] + across * values[top, right]))


@dataclass(frozen=True, eq=False)
class Floor:
    """An occupancy map with features."""

    name: str
    # (rows, columns): `FREE`, `UNKNOWN` or `OCCUPIED`; row 0 has the least y.
    cells: NDArray[np.uint8]
    resolution: float  # [m]
    origin: Point  # x and y of the corner of cell (0, 0) [m]
    features: Tuple[Feature, ...]
    start: Tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y and heading of a robot [m], [rad]
    heights: Optional[Heights] = None  # under the features; None for a level floor

    def cell_of(self, point: Sequence[float]) -> Tuple[int, int]:
        """Return row and column of a point [m], which may lie outside the map."""
        return (math.floor((point[1] - self.origin[1]) / self.resolution),
                math.floor((point[0] - self.origin[0]) / self.resolution))

    def center_of(self, row: int, column: int) -> Point:
        """Return the centre of a cell [m]."""
        return (self.origin[0] + (column + 0.5) * self.resolution,
                self.origin[1] + (row + 0.5) * self.resolution)

    @property
    def centers(self) -> Tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x of the columns, shape (1, columns), and y of the rows, shape (rows, 1) [m]."""
        rows, columns = self.cells.shape
        column, row = (np.arange(count, dtype=np.float64) for count in (columns, rows))
        return (self.origin[0] + (column[None, :] + 0.5) * self.resolution,
                self.origin[1] + (row[:, None] + 0.5) * self.resolution)

    def contains(self, point: Sequence[float]) -> bool:
        """Return whether a point is on the map."""
        row, column = self.cell_of(point)
        return 0 <= row < self.cells.shape[0] and 0 <= column < self.cells.shape[1]

    @cached_property
    def walls(self) -> NDArray[np.float64]:
        """
        Return rectangles that cover the occupied cells, an (n, 4) array.

        Columns: x and y of the centre, half the width and half the height [m].
        """
        return rectangles(self.cells == OCCUPIED, self.resolution, self.origin)

    @property
    def extent(self) -> Tuple[float, float, float, float]:
        """Return the least and largest x, and the least and largest y [m]."""
        rows, columns = self.cells.shape
        return (self.origin[0], self.origin[0] + columns * self.resolution,
                self.origin[1], self.origin[1] + rows * self.resolution)

    def has_map_of(self, other: 'Floor') -> bool:
        """Return whether cells, features and heights equal those of another floor."""
        def content(floor: 'Floor') -> Tuple[object, ...]:
            grids: List[Tuple[NDArray[Any], float, Point]] = [
                (floor.cells, floor.resolution, floor.origin)]
            if floor.heights is not None:
                grids.append((floor.heights.values, floor.heights.resolution,
                              floor.heights.origin))
            return floor.features, [
                (values.shape, values.tobytes(), *place) for values, *place in grids]
        return content(self) == content(other)

    def nearest_wall(self, place: Sequence[float]) -> Tuple[float, Point]:
        """Return the distance and the vector to the nearest wall, 0 inside a wall [m]."""
        if not len(self.walls):
            return math.inf, (math.inf, 0.0)
        ways, halves = self.walls[:, :2] - place, self.walls[:, 2:]
        ways -= np.minimum(np.maximum(ways, -halves), halves)  # np.clip takes longer for so few
        away = np.hypot(ways[:, 0], ways[:, 1])
        nearest = away.argmin()
        return float(away[nearest]), (float(ways[nearest, 0]), float(ways[nearest, 1]))


def rectangles(mask: NDArray[np.bool_], resolution: float, origin: Point
               ) -> NDArray[np.float64]:
    """Return rectangles that cover the cells of a mask, with columns as in `Floor.walls`."""
    found: List[Tuple[int, int, int, int]] = []
    started: Dict[Tuple[int, int], int] = {}  # row in which a run of columns begins
    padded = np.pad(mask, 1)
    for row in range(len(mask) + 1):
        change = np.flatnonzero(np.diff(padded[row + 1].astype(np.int8))).tolist()
        runs = set(zip(change[::2], change[1::2]))
        for run in [run for run in started if run not in runs]:
            found.append((*run, started.pop(run), row))
        for run in runs - started.keys():
            started[run] = row
    left, right, bottom, top = np.array(sorted(found), float).reshape(-1, 4).T
    return resolution * 0.5 * np.column_stack([
        left + right, bottom + top, right - left, top - bottom]) + (*origin, 0.0, 0.0)


def start_on(floor: Floor, text: str) -> Tuple[float, float, float]:
    """Parse a pose 'x, y, heading' [m], [rad]; return the start of the floor for no text."""
    if not text:
        return floor.start
    try:
        x, y, heading = map(float, text.split(','))
    except ValueError as error:
        raise ConfigurationError(
            f'start must be x, y [m] and heading [rad], separated by commas, got {text!r}',
            'wrong_type', 'start') from error
    return x, y, heading


def load_floor(name_or_path: Union[str, Path]) -> Floor:
    """Read a floor by name or path; raise `ConfigurationError` with all errors in the file."""
    path, content = read_config('floors', name_or_path)
    where, problems = str(path), Problems()
    with problems.collected():
        refuse_missing([(_FloorFile, content, where)])
    features: Dict[int, Feature] = {}
    entries = [] if content.get('features') is None else content['features']
    with problems.collected():
        if not isinstance(entries, list):
            raise ConfigurationError(
                f'{where}: features must be a list, got {entries!r}', 'wrong_type', 'features')
        for number, entry in enumerate(entries):
            with problems.collected():
                features[number] = Feature.from_mapping(entry, f'{where}: features[{number}]')
    heights: Optional[Heights] = None
    with problems.collected():
        if content.get('heights') is not None:
            file = _HeightsFile.from_mapping(content['heights'], f'{where}: heights')
            heights = _located(lambda: file.read(path.parent), f'{where}: heights')
    start = content.get('start')
    with problems.collected():
        if start is not None and not (isinstance(start, list) and len(start) == 3 and all(
                isinstance(item, (int, float)) and math.isfinite(item) for item in start)):
            start = None
            raise ConfigurationError(
                f'{where}: start must be x, y [m] and heading [degrees], got '
                f'{content["start"]!r}', 'wrong_type', 'start')
    with problems.collected():
        if ('map' in content) == ('walls' in content):
            raise ConfigurationError(
                f'{where}: give either map, the YAML file of a map_server map, or walls',
                'inconsistent', 'map')
        if 'map' in content:
            given = Path(str(content['map'])).expanduser()
            ground = read_map(given if given.is_absolute() else path.parent / given)
        else:
            walls = _Walls.from_mapping(content['walls'], f'{where}: walls')
            ground = _located(walls.cells, f'{where}: walls')
        floor = Floor(path.stem, *ground, tuple(features.values()), heights=heights)
        left, right, bottom, top = floor.extent
        for name, field, points in [
                *((f'features[{number}]', 'line', (*feature.line, *feature.polygon))
                  for number, feature in features.items()),
                *((f'walls: lines[{number}]', f'lines[{number}]', line)
                  for number, line in enumerate(content.get('walls', {}).get('lines', ()))),
                *([('start', 'start', (tuple(start[:2]),))] if start else [])]:
            off = [point for point in points if not (
                left <= point[0] <= right and bottom <= point[1] <= top)]
            with problems.collected():
                if off:
                    raise ConfigurationError(
                        f'{where}: {name}: {", ".join(map(str, off))} must lie on the map, which '
                        f'covers x {left:g} to {right:g} m, y {bottom:g} to {top:g} m; is the '
                        'unit metres?', 'out_of_range', field)
    problems.refuse()
    if start is None:
        from scipy import ndimage
        # The point farthest from all walls.
        clear = ndimage.distance_transform_edt(np.pad(floor.cells == FREE, 1))[1:-1, 1:-1]
        start = [*floor.center_of(*divmod(int(np.argmax(clear)), floor.cells.shape[1])), 0.0]
    return replace(floor, start=(float(start[0]), float(start[1]), math.radians(start[2])))


def _located(read: Callable[[], Read], where: str) -> Read:
    """Return the result of `read`; its errors state the location."""
    try:
        return read()
    except ConfigurationError as error:
        raise error.at(where) from None


def read_map(path: Path) -> Tuple[NDArray[np.uint8], float, Point]:
    """
    Read a map as Nav2's map_server does, in its modes ``trinary`` and ``scale``.

    The YAML file has image, resolution, origin, negate, occupied_thresh and free_thresh.  A map
    with a rotated origin is resampled along the axes.  Return cells, resolution and origin as in
    `Floor` [m].  Raise `ConfigurationError` for values out of range and for an image that cannot
    be read or is too large.
    """
    content = dict(read_yaml(find_config('maps', path)))
    where = str(path)
    problems = Problems()
    origin = content.pop('origin', [0.0, 0.0, 0.0])
    with problems.collected():
        if not (isinstance(origin, list) and len(origin) == 3
                and all(isinstance(item, (int, float)) and math.isfinite(item)
                        for item in origin)):
            raise ConfigurationError(
                f'{where}: origin must be [x, y, yaw] in m and rad, got {origin!r}',
                'wrong_type', 'origin')
    content = {key: value for key, value in content.items() if value is not None}
    content['negate'] = int(content.get('negate', 0))
    values = None
    with problems.collected():
        values = _MapFile.from_mapping(content, where)
    problems.refuse()
    assert values is not None
    shades = _located(lambda: _shades(path.parent / Path(values.image).expanduser()), where)
    occupancy = shades / 255.0 if values.negate else (255.0 - shades) / 255.0
    cells = np.full(shades.shape, UNKNOWN, np.uint8)
    cells[occupancy > values.occupied_thresh] = OCCUPIED
    cells[occupancy < values.free_thresh] = FREE
    if origin[2]:
        return _rotated(cells, values.resolution, origin, where)
    return cells, values.resolution, (float(origin[0]), float(origin[1]))


def _rotated(cells: NDArray[np.uint8], resolution: float, origin: Sequence[float], where: str
             ) -> Tuple[NDArray[np.uint8], float, Point]:
    """Return a rotated map resampled along the axes at the cell centres."""
    rows, columns = cells.shape
    cosine, sine = math.cos(origin[2]), math.sin(origin[2])
    corners = [(resolution * (column * cosine - row * sine),
                resolution * (column * sine + row * cosine))
               for row in (0, rows) for column in (0, columns)]
    left, bottom = (min(corner[axis] for corner in corners) for axis in (0, 1))
    wide, high = (math.ceil((max(corner[axis] for corner in corners) - least) / resolution)
                  for axis, least in ((0, left), (1, bottom)))
    _check_size(high, wide, f'{where}: image')
    x = left / resolution + np.arange(wide)[None, :] + 0.5
    y = bottom / resolution + np.arange(high)[:, None] + 0.5
    column, row = (np.floor(part).astype(int) for part in (
        cosine * x + sine * y, cosine * y - sine * x))
    on_map = (0 <= row) & (row < rows) & (0 <= column) & (column < columns)
    found = np.full((high, wide), UNKNOWN, np.uint8)
    found[on_map] = cells[row[on_map], column[on_map]]
    return found, resolution, (float(origin[0]) + left, float(origin[1]) + bottom)


@dataclass(frozen=True)
class _FloorFile(Checked):
    map: Any = section('YAML file of a map_server map', default=None)
    walls: Any = section('walls instead of a map', default=None)
    features: Any = section('steps, drops, areas', default=())
    heights: Any = section('16-bit PNG of the heights of the ground', default=None)
    start: Any = section('x, y [m] and heading [degrees] of a robot', default=None)


@dataclass(frozen=True)
class _HeightsFile(Checked):
    """Heights in an image of 16 bits: the height is offset + scale * value."""

    image: str = text('PNG file of 16 bits')
    resolution: float = quantity('m', 'size of a cell', minimum=0.002, maximum=1.0)
    scale: float = quantity('m', 'height of one step of the image; 0.001 for millimetres',
                            above=0.0, maximum=1.0)
    offset: float = quantity('m', 'height of the value 0', default=0.0)
    origin: Any = section('x and y of the lower left corner [m]', default=(0.0, 0.0))

    def read(self, folder: Path) -> Heights:
        origin, = _points([self.origin], 'origin', 1)
        values = _shades(folder / Path(self.image).expanduser(), deep=True)
        return Heights(self.offset + self.scale * values, self.resolution, origin)


def _shades(image: Path, deep: bool = False) -> NDArray[np.float64]:
    """Return the grey values of an image of 8 bits, or 16 if `deep`, with the last row first."""
    from PIL import Image, UnidentifiedImageError
    Image.MAX_IMAGE_PIXELS = None  # the size is checked here, before the pixels are read
    try:
        with Image.open(image) as picture:
            _check_size(picture.height, picture.width, 'image')
            if deep and not picture.mode.startswith('I'):
                raise ConfigurationError(
                    f'image {image} must have 16 bits of grey, got mode {picture.mode}',
                    'wrong_type', 'image')
            return np.asarray(picture if deep else picture.convert('L'), dtype=float)[::-1]
    except (OSError, UnidentifiedImageError) as error:
        raise ConfigurationError(
            f'image {image} cannot be read: {error}', 'unreadable', 'image') from error


@dataclass(frozen=True)
class _MapFile(Checked):
    image: str = text('PGM or PNG file')
    resolution: float = quantity('m', 'size of a cell', minimum=0.005, maximum=1.0)
    mode: str = text('meaning of the shades', default='trinary', choices=('trinary', 'scale'))
    negate: float = quantity('1', '1: white is occupied', default=0.0, minimum=0.0, maximum=1.0)
    occupied_thresh: float = quantity('1', 'occupied above', default=0.65, minimum=0.0,
                                      maximum=1.0)
    free_thresh: float = quantity('1', 'free below', default=0.25, minimum=0.0, maximum=1.0)


@dataclass(frozen=True)
class _Walls(Checked):
    size: Any = section('width and height of the map [m]')
    lines: Any = section('polylines of walls [m]')
    resolution: float = quantity('m', 'size of a cell', default=0.05, minimum=0.005, maximum=1.0)
    thickness: float = quantity('m', 'thickness of the walls', default=0.1, above=0.0, maximum=1.0)

    def cells(self) -> Tuple[NDArray[np.uint8], float, Point]:
        """Return the map with these walls; its outline is a wall, too."""
        problems, drawn = Problems(), []
        with problems.collected():
            (width, height), = _points([self.size], 'size', 1)
            if not (width > 0.0 and height > 0.0):
                raise ConfigurationError(
                    f'size must be more than 0 m, got {self.size!r}', 'out_of_range', 'size')
        with problems.collected():
            if not isinstance(self.lines, list):
                raise ConfigurationError(
                    f'lines must be a list of polylines, got {self.lines!r}', 'wrong_type',
                    'lines')
            for number, line in enumerate(self.lines):
                with problems.collected():
                    drawn.append(_points(line, f'lines[{number}]', 2))
        problems.refuse()
        rows, columns = (max(1, math.ceil(length / self.resolution - 1e-6))
                         for length in (height, width))
        _check_size(rows, columns, 'size')
        y, x = (np.arange(rows)[:, None] + 0.5) * self.resolution, \
            (np.arange(columns)[None, :] + 0.5) * self.resolution
        cells = np.zeros((rows, columns), np.uint8)
        # A wall thinner than a cell would have gaps.
        reach = 0.5 * max(self.thickness, self.resolution) + 1e-9
        outline = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height), (0.0, 0.0))
        for points in (outline, *drawn):
            for begin, end in zip(points, points[1:]):
                near = distance_to_segment(x, y, begin, end) <= reach
                cells[near] = OCCUPIED
        return cells, self.resolution, (0.0, 0.0)


def distance_to_segment(x: Any, y: Any, begin: Point, end: Point) -> Any:
    """Return the distance of points to a segment; all in m, arrays broadcast."""
    dx, dy = end[0] - begin[0], end[1] - begin[1]
    along = np.clip(((x - begin[0]) * dx + (y - begin[1]) * dy)
                    / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    return np.hypot(x - begin[0] - along * dx, y - begin[1] - along * dy)


def inside(x: Any, y: Any, polygon: Sequence[Point]) -> Any:
    """Return whether points are inside a polygon (crossing number); arrays broadcast."""
    result = np.zeros(np.broadcast(x, y).shape, bool)
    for (x0, y0), (x1, y1) in zip(polygon, (*polygon[1:], polygon[0])):
        if y0 != y1:
            spans = (y0 <= y) != (y1 <= y)
            result ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return result


def signed_area(polygon: Sequence[Point]) -> float:
    """Return the area of a polygon [m2], positive if its interior is on the left of its edges."""
    return 0.5 * sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(
        polygon, (*polygon[1:], polygon[0])))


def _points(given: Any, field: str, least: int) -> Tuple[Point, ...]:
    """Return a list of [x, y] as tuples of finite numbers."""
    if not isinstance(given, (list, tuple)) or len(given) < least or not all(
            isinstance(point, (list, tuple)) and len(point) == 2 and all(
                isinstance(item, (int, float)) and not isinstance(item, bool)
                and math.isfinite(item) for item in point) for point in given) \
            or len(set(map(tuple, given))) < least:
        raise ConfigurationError(
            f'{field} must be at least {least} different points [x, y] of finite numbers in m, '
            f'got {given!r}', 'wrong_type', field)
    return tuple((float(x), float(y)) for x, y in given)


def _intersects_itself(outline: Sequence[Tuple[Point, Point]]) -> bool:
    """Return whether two segments of an outline cross each other."""
    def side(line: Tuple[Point, Point], point: Point) -> float:
        (x0, y0), (x1, y1) = line
        return (x1 - x0) * (point[1] - y0) - (y1 - y0) * (point[0] - x0)
    return any(
        side(one, two[0]) * side(one, two[1]) < 0.0 > side(two, one[0]) * side(two, one[1])
        for one, two in combinations(outline, 2))


def _check_size(rows: int, columns: int, where: str) -> None:
    if rows * columns > MOST_CELLS:
        raise ConfigurationError(
            f'{where}: {columns} x {rows} cells are more than {MOST_CELLS}; use a coarser '
            'resolution or a part of the map', 'out_of_range', 'image')
