# SPDX-License-Identifier: Apache-2.0
"""Convert a map of heights to a polyline and faces."""
import math
from typing import List, NamedTuple, Sequence, Tuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ballbot_ros.crossing.rules import sink_depth, touch_distance
from ballbot_ros.decision.perception.edge_map import HEIGHT_ENTRY, HEIGHT_EXIT
from ballbot_ros.decision.perception.elevation import (
    CELL, ElevationMap, Flags, middle, POSITION_SD, Whole)
from ballbot_ros.decision.perception.ground_profile import simplify
from ballbot_ros.decision.values import Face, Profile
from ballbot_ros.jit import compiled
from ballbot_ros.physics.model.terrain import Array

# A steeper segment is a face, not a ramp: no ball of this kind rolls up 11 degrees.
FACE_GRADE_MIN = 0.2
# The grade of a face exceeds those on both sides by this; a piece that is not as steep as
# `FACE_GRADE_MIN` is a blurred face up to this length [m].
BLURRED_GRADE_MIN, BLURRED_LENGTH_MAX = 0.06, 0.065
# Maximum slope difference within one line, in addition to its uncertainty.
LINE_BEND_MAX = 0.01
# Blur of a face to either side [m].
BLUR_LENGTH = 3.0 * CELL + 1e-6
# Averaging width in nodes for face detection, up to this standard deviation [m].
SMOOTHING_WIDTHS = (1, 0.0008), (3, 0.0025), (5, math.inf)
# Minimum height of a face, in metres and in standard deviations.
FACE_HEIGHT_MIN, FACE_SIGMAS = 0.002, 4.0
# Nodes on each side of a gap that show the slope of the ground in it.
SLOPE_NODES = 20
# Positions that differ by less are the same [m].
POSITION_TOLERANCE = 1e-6
# Minimum tolerance of the polyline simplification [m].
TOLERANCE_MIN = 0.001


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


class Piece(NamedTuple):
    """Ground from node `begin` to `end`, inclusive; `sign`: 1 rises, -1 falls, 0 is gentle."""

    sign: int
    begin: int
    end: int


class Nodes(NamedTuple):
    """Known nodes of a map: position, height, variance; `jumps` are inserted behind edges."""

    x: Array
    z: Array
    variance: Array
    jumps: List[int]


def pieces_of(nodes: Nodes, shared: float, edges: Sequence[Piece]) -> List[Piece]:
    """Return the ground as gentle and steep pieces, from left to right; `edges` are steep."""
    own = nodes.variance / shared
    usual = middle(own)
    width = next(width for width, most in SMOOTHING_WIDTHS if usual < most**2)
    z = nodes.z if width == 1 else np.concatenate([
        _smooth(part, width) for part in np.split(
            nodes.z, [index for jump in nodes.jumps for index in (jump, jump + 1)])])
    edges = [*edges, *(Piece(int(np.sign(nodes.z[jump] - nodes.z[jump - 1])), jump - 1, jump)
                       for jump in nodes.jumps)]
    tolerance = np.maximum(
        TOLERANCE_MIN, FACE_SIGMAS * np.sqrt(np.minimum(own, 4.0 * usual) / width))
    keep, stack = np.zeros(len(z)), np.zeros((len(z), 2))
    simplify(nodes.x, z, tolerance, keep, stack)
    for _, begin, end in edges:
        keep[begin:end + 1] = 0.0
        keep[[begin, end]] = 1.0
    keep[[0, -1]] = 1.0
    corners = np.flatnonzero(keep)
    x, z = nodes.x[corners], z[corners]
    signs = _signs(np.diff(x), np.diff(z))
    for sign, begin, _ in edges:
        if begin in corners[:-1]:
            signs[int(np.searchsorted(corners, begin))] = sign
    pieces: List[Piece] = []
    for sign, begin, end in zip(signs, corners.tolist(), corners[1:].tolist()):
        if sign and pieces and pieces[-1].sign == sign:
            pieces[-1] = Piece(sign, pieces[-1].begin, end)
        elif sign and len(pieces) > 1 and pieces[-1].sign == 0 and pieces[-2].sign == sign \
                and nodes.x[begin] - nodes.x[pieces[-1].begin] <= BLUR_LENGTH:
            pieces[-2:] = [Piece(sign, pieces[-2].begin, end)]
        else:
            pieces.append(Piece(sign, begin, end))
    return _joined(nodes, _without_blur(nodes, pieces))


def _signs(run: Array, rise: Array) -> List[int]:
    """Return 1 and -1 for rises and drops as steep as a face, 0 for gentle ground."""
    grade = rise / run
    steep = (np.abs(grade) > FACE_GRADE_MIN) & (np.abs(rise) > FACE_HEIGHT_MIN / 2)
    signs: List[int] = np.where(steep, np.sign(rise), 0.0).astype(int).tolist()
    # A low face that is blurred is less steep, but steeper than the ground on both sides.
    long = [(float(end), float(slope)) for end, slope in zip(
        np.cumsum(run)[run > BLURRED_LENGTH_MAX], grade[run > BLURRED_LENGTH_MAX])]
    begin = 0.0
    for index, (length, slope) in enumerate(zip(run.tolist(), grade.tolist())):
        if signs[index] == 0 and length <= BLURRED_LENGTH_MAX:
            before = [other for end, other in long if end <= begin + 1e-9][-1:]
            beside = before + [other for end, other in long if end > begin + length][:1]
            least = max(BLURRED_GRADE_MIN, FACE_HEIGHT_MIN / length)
            for sign in (1, -1):
                if beside and all(sign * (slope - other) > least for other in beside):
                    signs[index] = sign
        begin += length
    return signs


def _without_blur(nodes: Nodes, pieces: List[Piece]) -> List[Piece]:
    """Merge short gentle pieces between a face and the ground beside it with the face."""
    found: List[Piece] = []
    for index, piece in enumerate(pieces):
        before = found[-1] if found else None
        behind = pieces[index + 1] if index + 1 < len(pieces) else None
        if piece.sign == 0 and nodes.x[piece.end] - nodes.x[piece.begin] <= BLUR_LENGTH:
            if before and before.sign and behind and not behind.sign:
                found[-1] = Piece(before.sign, before.begin, piece.end)
                continue
            if before and not before.sign and behind and behind.sign:
                pieces[index + 1] = Piece(behind.sign, piece.begin, behind.end)
                continue
        found.append(piece)
    return found


def _joined(nodes: Nodes, pieces: List[Piece]) -> List[Piece]:
    """
    Join gentle pieces that lie on one line, and a gap with the ground behind it.

    The nodes are noisy, so that corners may split a line.
    """
    found = pieces[:1]
    for piece in pieces[1:]:
        last = found[-1]
        gap = last.begin in nodes.jumps \
            and nodes.x[last.end] - nodes.x[last.begin + 1] <= BLUR_LENGTH
        if last.sign == 0 and piece.sign == 0 and (gap or _is_one(nodes, last, piece)):
            found[-1] = Piece(0, last.begin, piece.end)
        else:
            found.append(piece)
    return found


def _is_one(nodes: Nodes, one: Piece, two: Piece) -> bool:
    """Return whether two pieces form one line within their uncertainty."""
    short, long = sorted((one, two), key=lambda piece: piece.end - piece.begin)
    at = 0.5 * float(nodes.x[short.begin] + nodes.x[short.end])
    (z, slope, z_variance, slope_variance), (other_z, other, other_variance, variance) = (
        line(nodes.x, nodes.z, nodes.variance, piece.begin, piece.end + 1, at)
        for piece in (short, long))
    if not abs(z - other_z) < TOLERANCE_MIN + 3.0 * math.sqrt(z_variance + other_variance):
        return False
    # The slope of a short piece is not significant.
    bend_max = LINE_BEND_MAX + 3.0 * math.sqrt(slope_variance + variance)
    return short.end - short.begin < 12 or abs(slope - other) < bend_max


def _smooth(z: Array, width: int) -> Array:
    """Return means over `width` neighbours; fewer at the ends."""
    half = width // 2
    padded = np.concatenate([np.full(half, z[0]), z, np.full(half, z[-1])])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    found: Array = (total[width:] - total[:-width]) / width
    return found


# Terrain length before and behind a face for its height [m], and to either side of the ball for
# the slope [m].
BESIDE_LENGTH, SLOPE_HALF_LENGTH = 0.2, 0.1
# Minimum standard deviation of a slope, from the sensor mounting [rad].
SLOPE_SD_MIN = 0.003
# Standard deviation of a face height whose upper end is not observed [m].
UNSEEN_END_SD = 0.05
# Longest apparent run of a vertical face [m].
BLURRED_RUN_MAX = 0.05


def ground_of(found: ElevationMap, stamp: float, position: float, radius: float,
              edges: Sequence[Face]) -> Profile:
    """
    Return the ground of a map around a ball, its faces without numbers; may be empty.

    The stamp is that of the latest scan [s].  The `edges` are known faces: they are measured at
    their positions, and remain faces above `HEIGHT_EXIT` and `BLURRED_GRADE_MIN`.
    """
    known = np.flatnonzero(found.known & ~spanned(found, radius))
    # Neighbouring nodes are interpolated between the same points.
    shared = min(max(1.5 * found.spacing / CELL, 1.0), 20.0)
    nodes = _bridged(found, known, shared, position, radius, edges)
    if len(nodes.x) < 3:
        return Profile(stamp, seen_from=position, seen_to=position)
    known_edges = _edges_in(nodes, edges)
    pieces = pieces_of(nodes, shared, known_edges)
    datum, slope, slope_variance = _below(nodes, pieces, position)
    points, sds, faces = _assemble(nodes, pieces, known_edges, datum)
    return Profile(stamp, tuple(faces), tuple(points), float(nodes.x[0]), float(nodes.x[-1]),
                   math.atan(slope), math.sqrt(slope_variance + SLOPE_SD_MIN**2),
                   points_sd=tuple(sds))


def spanned(found: ElevationMap, radius: float) -> Flags:
    """
    Return which known nodes lie in a groove that the ball spans, (n,).

    The ball sinks by less than `HEIGHT_ENTRY` between two edges of a smaller distance than
    `width`.  A morphological closing fills these grooves up to their lower edge.
    """
    width = int(2.0 * touch_distance(radius, HEIGHT_ENTRY) / CELL)
    height = np.where(found.known, found.height, -np.inf)
    padded = np.pad(height, width - 1, constant_values=-np.inf)
    highest = sliding_window_view(padded, len(padded) - width + 1).max(axis=0)
    closed = sliding_window_view(highest, len(height)).min(axis=0)
    # The uncertain position of an edge makes the heights beside it uncertain, but not lower.
    usual = middle(found.variance[found.known])
    sd = np.sqrt(np.minimum(np.where(found.known, found.variance, 0.0), 4.0 * usual))
    below: Flags = closed > height + np.maximum(HEIGHT_ENTRY, FACE_SIGMAS * sd)
    return below


def _edges_in(nodes: Nodes, edges: Sequence[Face]) -> List[Piece]:
    """Return the nodes between which known faces lie."""
    found = []
    for edge in edges:
        begin = int(np.searchsorted(nodes.x, edge.position + POSITION_TOLERANCE)) - 1
        end = int(np.searchsorted(nodes.x, edge.position + edge.run + POSITION_TOLERANCE))
        if begin >= 0 and end < len(nodes.x):
            found.append(Piece(1 if edge.height > 0.0 else -1, begin, end))
    return found


def _bridged(found: ElevationMap, known: Whole, shared: float, position: float,
             radius: float, edges: Sequence[Face]) -> Nodes:
    """
    Return the known nodes, with edges at gaps between them.

    Ground behind a falling edge is occluded: the fall is at the near end of the gap.  A rise is at
    its nearest possible position.  Without a fall, the gap may be a trench: if the ball could sink
    below the ground behind it, the observed ground ends at the gap.
    """
    x: Array = (known + found.first).astype(float) * CELL
    z = found.height[known]
    # The texture of the floor is the same in each scan.
    variance = shared * np.maximum(found.variance[known], found.texture**2)
    run, rise = np.diff(x), np.diff(z)
    jumps, levels, variances = [], [], []
    for gap in np.flatnonzero(np.diff(known) > 1).tolist():
        beside = slice(max(gap - SLOPE_NODES, 0), gap + SLOPE_NODES + 1)
        slope = middle(rise[beside] / run[beside])
        behind = slice(gap + 1, int(np.searchsorted(x, x[gap + 1] + BLUR_LENGTH)))
        level = z[behind] - slope * (x[behind] - x[gap]) - z[gap]
        # The slope, a median of 2 SLOPE_NODES differences, is uncertain over the gap, too.
        level_variance = float(variance[gap] + variance[gap + 1]) + math.pi * middle(
            variance[beside]) * (run[gap] / CELL)**2 / (2 * SLOPE_NODES)
        is_known = any(x[gap] - POSITION_TOLERANCE < edge.position < x[gap + 1] for edge in edges)
        certain = 0.0 if is_known else FACE_SIGMAS * math.sqrt(level_variance / shared)
        if x[gap] > position and level.max() > -max(HEIGHT_ENTRY, certain) \
                and sink_depth(radius, float(run[gap])) > max(HEIGHT_ENTRY, -level[0]):
            x, z, variance = x[:gap + 1], z[:gap + 1], variance[:gap + 1]
            break
        if abs(level[0]) > max(FACE_HEIGHT_MIN, certain):
            jumps.append(gap)
            levels.append(z[gap] + level[0])
            variances.append(level_variance)
    after = np.array(jumps, dtype=int) + 1
    if jumps:
        x, z, variance = np.insert((x, z, variance), after, (
            x[after - 1] + 1e-4, levels, variances), axis=1)
    return Nodes(x, z, variance, (after + np.arange(len(after))).tolist())


def _below(nodes: Nodes, pieces: List[Piece], position: float) -> Tuple[float, float, float]:
    """Return height and slope of the ground below the ball without faces, and slope variance."""
    x, width = nodes.x, round(2.0 * SLOPE_HALF_LENGTH / CELL)
    gaps = [max(x[piece.begin] - position, position - x[piece.end], 0.0)
            if piece.sign == 0 else math.inf for piece in pieces]
    nearest = int(np.argmin(gaps))
    if gaps[nearest] < SLOPE_HALF_LENGTH:
        first, behind = _inside(nodes, pieces, nearest)
        left = int(np.searchsorted(x, position - SLOPE_HALF_LENGTH))
        begin = max(first, min(left, behind - width))
        end = min(begin + width, behind)
        if end - begin >= 6:
            z, slope, _, variance = line(x, nodes.z, nodes.variance, begin, end, position)
            return z, slope, variance
    return float(nodes.z[int(np.argmin(np.abs(x - position)))]), math.nan, math.nan


def _assemble(nodes: Nodes, pieces: List[Piece], edges: Sequence[Piece], datum: float
              ) -> Tuple[List[Tuple[float, float]], List[float], List[Face]]:
    """Return the polyline, the standard deviations of its heights, and the faces."""
    points: List[Tuple[float, float]] = []
    sds: List[float] = []
    faces: List[Face] = []

    def put(x: float, z: float, variance: float) -> None:
        # The blurs of adjacent faces overlap.
        points.append((max(x, points[-1][0]) if points else x, z - datum))
        sds.append(math.sqrt(variance))

    for number, piece in enumerate(pieces):
        if piece.sign:
            face, excess, low, high = _face(nodes, pieces, number)
            put(face.position, *low)
            put(face.position + face.run, *high)
            known = any(edge.sign == piece.sign and piece.begin <= edge.begin
                        and edge.end <= piece.end for edge in edges)
            least = HEIGHT_EXIT if known else max(
                HEIGHT_ENTRY, FACE_SIGMAS * math.sqrt(low[1] + high[1]))
            if piece.sign * excess > max(least, BLURRED_GRADE_MIN * face.run):
                faces.append(face)
            continue
        if number == 0:
            put(float(nodes.x[piece.begin]), *_end(nodes, pieces, number, piece.begin))
        if number == len(pieces) - 1:
            put(float(nodes.x[piece.end]), *_end(nodes, pieces, number, piece.end))
        elif pieces[number + 1].sign == 0:
            put(*_bend(nodes, pieces, number))
    return points, sds, faces


def _inside(nodes: Nodes, pieces: List[Piece], number: int) -> Tuple[int, int]:
    """Return the observed nodes of a gentle piece that no face blurs, the end not included."""
    piece = pieces[number]
    begin, end = piece.begin + (piece.begin in nodes.jumps), piece.end + 1
    spare = end - begin - 6
    if number > 0 and pieces[number - 1].sign and spare > 0:
        begin += min(2, spare)
    if number + 1 < len(pieces) and pieces[number + 1].sign and spare > 2:
        end -= min(2, spare - 2)
    return begin, end


def _end(nodes: Nodes, pieces: List[Piece], number: int, node: int) -> Tuple[float, float]:
    """Return height and variance of a gentle piece at one of its nodes."""
    begin, end = _inside(nodes, pieces, number)
    z, _, variance, _ = line(nodes.x, nodes.z, nodes.variance, begin, end, float(nodes.x[node]))
    return z, variance


def _bend(nodes: Nodes, pieces: List[Piece], number: int) -> Tuple[float, float, float]:
    """Return position, height and variance of the bend behind a gentle piece."""
    x = float(nodes.x[pieces[number].end])
    (one, slope, one_variance, _), (two, behind, two_variance, _) = (
        line(nodes.x, nodes.z, nodes.variance, *_inside(nodes, pieces, piece), x)
        for piece in (number, number + 1))
    reach = 0.5 * min(nodes.x[piece.end] - nodes.x[piece.begin]
                      for piece in pieces[number:number + 2])
    change = behind - slope
    shift = min(max((one - two) / change, -reach), reach) if change else 0.0
    return (x + shift, 0.5 * (one + two + shift * (slope + behind)),
            max(one_variance, two_variance))


class _Side(NamedTuple):
    """Ground beside a face: height, variance and slope, NaN without ground, at a position."""

    z: float
    variance: float
    slope: float


def _aside(nodes: Nodes, pieces: List[Piece], number: int, at: float, ahead: bool) -> _Side:
    """Return the ground before or behind a face, evaluated at a position."""
    other = number + (1 if ahead else -1)
    face = pieces[number]
    if not 0 <= other < len(pieces) or pieces[other].sign:
        node = face.end if ahead else face.begin
        return _Side(float(nodes.z[node]), float(nodes.variance[node]), math.nan)
    begin, end = _inside(nodes, pieces, other)
    if end - begin > BESIDE_LENGTH / CELL:
        if ahead:
            end = begin + round(BESIDE_LENGTH / CELL)
        else:
            begin = end - round(BESIDE_LENGTH / CELL)
    z, slope, variance, _ = line(nodes.x, nodes.z, nodes.variance, begin, end, at)
    if end - begin < 4:
        # A cord or a groove: its mean would underestimate the observed height.
        extreme = np.max if (face.sign > 0) == ahead else np.min
        z = float(extreme(nodes.z[begin:end]))
    return _Side(z, variance, slope)


def _face(nodes: Nodes, pieces: List[Piece], number: int
          ) -> Tuple[Face, float, Tuple[float, float], Tuple[float, float]]:
    """
    Return a face, its excess height, and height and variance of the ground on both sides.

    The excess height is the height minus the rise of the adjacent ground over the same run [m].
    """
    piece = pieces[number]
    x = nodes.x[piece.begin:piece.end + 1]
    begin, end = float(x[0]), float(x[-1])
    low = _aside(nodes, pieces, number, begin, ahead=False)
    high = _aside(nodes, pieces, number, end, ahead=True)
    part = (nodes.z[piece.begin:piece.end + 1] - low.z) / ((high.z - low.z) or 1.0)
    foot, centre, top = np.interp([0.2, 0.5, 0.8], np.maximum.accumulate(part), x).tolist()
    # A step between two nodes, observed from different positions, appears one cell wide.
    run = (top - foot) / 0.6 - CELL
    run = 0.0 if run < 1.5 * CELL else run + CELL
    position = min(max(centre - 0.5 * run, begin), end)
    run = min(run, end - position)
    low = _aside(nodes, pieces, number, position, ahead=False)
    high = _aside(nodes, pieces, number, position + run, ahead=True)
    variance = low.variance + high.variance
    if pieces[-1].end - piece.end < 2:
        variance += UNSEEN_END_SD**2
    slopes = [side.slope for side in (low, high) if math.isfinite(side.slope)]
    excess = high.z - low.z - run * sum(slopes) / max(len(slopes), 1)
    # A face with an apparent run may be vertical, blurred by missing points.
    position_sd = math.hypot(POSITION_SD, 0.3 * min(run, BLURRED_RUN_MAX))
    return (Face(0, position, high.z - low.z, position_sd, math.sqrt(variance), run), excess,
            (low.z, low.variance), (high.z, high.variance))
