# SPDX-License-Identifier: Apache-2.0
"""Cut a map of heights into gentle ground and faces."""
import math
from typing import List, NamedTuple

import numpy as np

from ballbot_ros.decision.perception.elevation import Whole
from ballbot_ros.decision.perception.kernels import line, middle, simplify
from ballbot_ros.physics.model.terrain import Array

# Steeper than this is a face, not a ramp: no ball of this kind rolls up 11 degrees.
STEEP = 0.2

# A short piece that is so much steeper than the ground on both sides is a blurred face; so long
# is a short one [m].
LEAST_GRADE, SHORT = 0.06, 0.065

# Slopes of one line differ by no more, beside what is uncertain of them.
BEND = 0.01

# The blur of a face reaches so many nodes to either side.
BLUR = 3

# Over so many neighbours heights are averaged to find faces, where they are less certain [m].
WIDTHS = (1, 0.0008), (3, 0.0025), (5, math.inf)

# A face is at least so high [m], and so many standard deviations.
LEAST_FACE, CERTAIN = 0.002, 4.0

# A polyline may leave the map by this [m], or by so many standard deviations of it.
LEAST_TOLERANCE = 0.001


class Piece(NamedTuple):
    """A part of the ground: nodes from `begin` to `end`, both included; `sign` 0 is gentle."""

    sign: int
    begin: int
    end: int


class Nodes(NamedTuple):
    """Known nodes of a map: place, height, variance, and number in the map."""

    x: Array
    z: Array
    variance: Array
    number: Whole


def pieces_of(nodes: Nodes, shared: float) -> List[Piece]:
    """Return the ground as gentle and steep pieces, from left to right."""
    own = nodes.variance / shared
    usual = middle(own)
    width = next(width for width, most in WIDTHS if usual < most**2)
    z = nodes.z if width == 1 else _smooth(nodes.z, width)
    tolerance = np.maximum(
        LEAST_TOLERANCE, CERTAIN * np.sqrt(np.minimum(own, 4.0 * usual) / width))
    keep, stack = np.zeros(len(z)), np.zeros((len(z), 2))
    simplify(nodes.x, z, tolerance, keep, stack)
    corners = np.flatnonzero(keep)
    x, z = nodes.x[corners], z[corners]
    signs = _signs(np.diff(x), np.diff(z))
    pieces: List[Piece] = []
    for sign, begin, end in zip(signs, corners.tolist(), corners[1:].tolist()):
        if sign and pieces and pieces[-1].sign == sign:
            pieces[-1] = Piece(sign, pieces[-1].begin, end)
        elif sign and len(pieces) > 1 and pieces[-1].sign == 0 and pieces[-2].sign == sign \
                and begin - pieces[-1].begin <= BLUR:
            pieces[-2:] = [Piece(sign, pieces[-2].begin, end)]
        else:
            pieces.append(Piece(sign, begin, end))
    return _joined(nodes, _without_blur(pieces))


def _signs(run: Array, rise: Array) -> List[int]:
    """Return 1 and -1 for what rises and drops like a face, 0 for what is gentle."""
    grade = rise / run
    steep = (np.abs(grade) > STEEP) & (np.abs(rise) > LEAST_FACE / 2)
    signs: List[int] = np.where(steep, np.sign(rise), 0.0).astype(int).tolist()
    # A low face that is blurred is less steep, but steeper than the ground on both sides.
    long = [(float(end), float(slope)) for end, slope in zip(
        np.cumsum(run)[run > SHORT], grade[run > SHORT])]
    begin = 0.0
    for index, (length, slope) in enumerate(zip(run.tolist(), grade.tolist())):
        if signs[index] == 0 and length <= SHORT:
            before = [other for end, other in long if end <= begin + 1e-9][-1:]
            beside = before + [other for end, other in long if end > begin + length][:1]
            least = max(LEAST_GRADE, LEAST_FACE / length)
            for sign in (1, -1):
                if beside and all(sign * (slope - other) > least for other in beside):
                    signs[index] = sign
        begin += length
    return signs


def _without_blur(pieces: List[Piece]) -> List[Piece]:
    """Give short gentle pieces between a face and the ground beside it to the face."""
    found: List[Piece] = []
    for index, piece in enumerate(pieces):
        before = found[-1] if found else None
        behind = pieces[index + 1] if index + 1 < len(pieces) else None
        if piece.sign == 0 and piece.end - piece.begin <= BLUR:
            if before and before.sign and behind and not behind.sign:
                found[-1] = Piece(before.sign, before.begin, piece.end)
                continue
            if before and not before.sign and behind and behind.sign:
                pieces[index + 1] = Piece(behind.sign, piece.begin, behind.end)
                continue
        found.append(piece)
    return found


def _joined(nodes: Nodes, pieces: List[Piece]) -> List[Piece]:
    """Join gentle pieces that lie on one line: corners are chosen among noisy nodes."""
    found = pieces[:1]
    for piece in pieces[1:]:
        last = found[-1]
        if last.sign == 0 and piece.sign == 0 and _is_one(nodes, last, piece):
            found[-1] = Piece(0, last.begin, piece.end)
        else:
            found.append(piece)
    return found


def _is_one(nodes: Nodes, one: Piece, two: Piece) -> bool:
    """Return whether two pieces are one line, as far as can be told."""
    short, long = sorted((one, two), key=lambda piece: piece.end - piece.begin)
    at = 0.5 * float(nodes.x[short.begin] + nodes.x[short.end])
    (z, slope, z_variance, slope_variance), (other_z, other, other_variance, variance) = (
        line(nodes.x, nodes.z, nodes.variance, piece.begin, piece.end + 1, at)
        for piece in (short, long))
    if not abs(z - other_z) < LEAST_TOLERANCE + 3.0 * math.sqrt(z_variance + other_variance):
        return False
    # A short piece has no slope worth comparing.
    apart = BEND + 3.0 * math.sqrt(slope_variance + variance)
    return short.end - short.begin < 12 or abs(slope - other) < apart


def _smooth(z: Array, width: int) -> Array:
    """Return means over `width` neighbours; fewer at the ends."""
    half = width // 2
    padded = np.concatenate([np.full(half, z[0]), z, np.full(half, z[-1])])
    total = np.concatenate([[0.0], np.cumsum(padded)])
    found: Array = (total[width:] - total[:-width]) / width
    return found
