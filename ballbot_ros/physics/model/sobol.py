# SPDX-License-Identifier: Apache-2.0
"""
Points that fill a cube evenly: Sobol's sequence, scrambled.

The very points of ``scipy.stats.qmc.Sobol``; but to import that takes most of a second, in each
start of a node that decides.
"""
from typing import Tuple

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.physics.model.terrain import Array

# Joe and Kuo 2008, Constructing Sobol sequences with better two-dimensional projections: the
# primitive polynomial of each dimension, as the bits of a number, and its first directions.
DIRECTIONS: Tuple[Tuple[int, Tuple[int, ...]], ...] = (
    (1, (1,)), (3, (1,)), (7, (1, 3)), (11, (1, 3, 1)), (13, (1, 1, 1)), (19, (1, 1, 3, 3)),
    (25, (1, 3, 5, 13)), (37, (1, 1, 5, 5, 17)), (41, (1, 1, 5, 5, 5)), (47, (1, 1, 7, 11, 19)),
    (55, (1, 1, 5, 1, 1)), (59, (1, 1, 1, 3, 11)), (61, (1, 3, 5, 5, 31)),
    (67, (1, 3, 3, 9, 7, 49)), (91, (1, 1, 1, 15, 21, 21)), (97, (1, 3, 1, 13, 27, 49)),
    (103, (1, 1, 1, 15, 7, 5)), (109, (1, 3, 1, 15, 13, 25)), (115, (1, 1, 5, 5, 19, 61)),
    (131, (1, 3, 7, 11, 23, 15, 103)), (137, (1, 3, 7, 13, 13, 15, 69)),
    (143, (1, 1, 3, 13, 7, 35, 63)), (145, (1, 3, 5, 9, 1, 25, 53)),
    (157, (1, 3, 1, 13, 9, 35, 107)))
DIMENSIONS = len(DIRECTIONS)
BITS = 30
Bits = NDArray[np.int64]


def sobol(dimensions: int, power: int, seed: int) -> Array:
    """
    Return (2^power, dimensions) points of the unit cube.

    Parameters
    ----------
    dimensions : int
        At most `DIMENSIONS`.
    power : int
        Below 30.
    seed : int
        Of the scrambling: a random linear map of the bits, and a shift (Matousek 1998).

    """
    random = np.random.default_rng(seed)
    highest_first = 1 << np.arange(BITS - 1, -1, -1)
    shift = random.integers(0, 2, (dimensions, BITS), np.uint32) @ highest_first[::-1]
    maps = np.tril(random.integers(0, 2, (dimensions, BITS, BITS), np.uint32)).astype(np.int64)
    maps[:, np.arange(BITS), np.arange(BITS)] = 1
    # Directions as bits: (dimensions, number of the direction, bit), the highest bit first.
    bits = np.array([_directions(*DIRECTIONS[number]) for number in range(dimensions)])
    bits = (bits[..., None] & highest_first) != 0
    directions = np.einsum('drc,dnc->dnr', maps, bits) % 2 @ highest_first
    points = np.empty((2 ** power, dimensions))
    points[0] = point = shift
    for number in range(1, len(points)):
        # Antonov and Saleev 1979: one direction more, that of the lowest bit that is 0.
        lowest = (~(number - 1) & number).bit_length() - 1
        points[number] = point = point ^ directions[:, lowest]
    return points / 2 ** BITS


def _directions(polynomial: int, first: Tuple[int, ...]) -> Bits:
    """Return the directions of a dimension, each shifted to the left of `BITS` bits."""
    degree = polynomial.bit_length() - 1
    found = list(first) if degree else [1] * BITS
    while len(found) < BITS:
        new = found[-degree]
        for back in range(1, degree + 1):
            if polynomial >> degree - back & 1:
                new ^= found[-back] << back
        found.append(new)
    return np.array([value << BITS - 1 - place for place, value in enumerate(found)])
