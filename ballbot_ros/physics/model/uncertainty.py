# SPDX-License-Identifier: Apache-2.0
"""
Random robots: parameters drawn from the ranges that a robot file gives for them.

Parameters are drawn uniformly and independently, with one exception: if the masses of ball and
pendulum are both uncertain, their sum is kept, because a scale measures the sum (and the paper
prints it), but not the split.

The points equal those of ``scipy.stats.qmc.Sobol``, scrambled, whose import would take most of a
second at each start of a decision node.
"""
from typing import Any, Dict, List, Mapping, Tuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballbot_ros.physics.model.robot import Robot, with_parameters
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

    There are at most `DIMENSIONS` dimensions, and the power is below 30; the seed is that of the
    scrambling: a random linear map of the bits, and a shift (Matousek 1998).
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
        # Antonov and Saleev 1979: add the direction of the lowest bit that is 0.
        lowest = (~(number - 1) & number).bit_length() - 1
        points[number] = point = point ^ directions[:, lowest]
    return points / 2 ** BITS


def _directions(polynomial: int, first: Tuple[int, ...]) -> Bits:
    """Return the directions of a dimension, each left-aligned in `BITS` bits."""
    degree = polynomial.bit_length() - 1
    found = list(first) if degree else [1] * BITS
    while len(found) < BITS:
        new = found[-degree]
        for back in range(1, degree + 1):
            if polynomial >> degree - back & 1:
                new ^= found[-back] << back
        found.append(new)
    return np.array([value << BITS - 1 - place for place, value in enumerate(found)])


MASSES = ('pendulum_mass', 'ball_mass')
Ends = TypeVar('Ends')


def ranges(robot: Robot) -> Dict[str, Tuple[float, float]]:
    """Return the low and high ends of the parameters that have a range, by field name, SI."""
    return {name: (item.low, item.high) for name, item in robot.provenance.items()
            if item.low is not None and item.high is not None}


def uncertain(robot: Robot) -> Dict[str, Tuple[float, float]]:
    """Return the `ranges` of derived parameters, see `Provenance`, not of motor and steering."""
    return {name: (low, high) for name, (low, high) in ranges(robot).items()
            if robot.provenance[name].source == 'derived' and '.' not in name and low < high}


def independent(found: Mapping[str, Ends]) -> Dict[str, Ends]:
    """Return uncertain parameters without the ball mass, if the pendulum mass determines both."""
    return {name: ends for name, ends in found.items()
            if name != 'ball_mass' or 'pendulum_mass' not in found}


def changed(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """
    Return a robot with other parameters, or with columns, see `with_parameters`.

    If both masses are uncertain and one is changed, the other is changed to keep their sum.
    """
    change = dict(values)
    given = [name for name in MASSES if name in values]
    if len(given) == 1 and set(MASSES) <= set(ranges(robot)):
        other, = set(MASSES) - set(given)
        change[other] = robot.total_mass - values[given[0]]
    return with_parameters(robot, change)


def spread_points(dimensions: int, count: int, seed: int) -> Array:
    """Return (count, dimensions) points of the unit cube; Sobol's sequence, scrambled."""
    # A power of two keeps the sequence balanced; surplus points are discarded.
    power = max(0, int(np.ceil(np.log2(count))))
    return sobol(dimensions, power, seed)[:count]


def draw(robot: Robot, count: int, seed: int = 0) -> List[Robot]:
    """
    Draw robots from the ranges of the uncertain parameters; Sobol's sequence, scrambled.

    Raises `ConfigurationError` if drawn parameters contradict each other.
    """
    free = independent(uncertain(robot))
    if not free:
        return [robot] * count
    low, high = np.array(list(free.values())).T
    values = low + spread_points(len(free), count, seed) * (high - low)
    return [changed(robot, dict(zip(free, row))) for row in values.tolist()]
