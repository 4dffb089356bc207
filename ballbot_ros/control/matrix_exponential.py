# SPDX-License-Identifier: Apache-2.0
"""
The exponential of a small matrix.

SciPy has the same method; importing it takes a third of a second at each start of a node.
"""
import math

import numpy as np

from ballbot_ros.control.rolling_model import Array

# Higham 2005, The scaling and squaring method for the matrix exponential revisited: coefficients
# of the diagonal Pade approximant of degree 13, and the norm up to which it is exact to rounding.
PADE = (64764752532480000.0, 32382376266240000.0, 7771770303897600.0, 1187353796428800.0,
        129060195264000.0, 10559470521600.0, 670442572800.0, 33522128640.0, 1323241920.0,
        40840800.0, 960960.0, 16380.0, 182.0, 1.0)
LARGEST = 5.371920351148152


def expm(matrix: Array) -> Array:
    """
    Return the exponential of a matrix, by scaling and squaring.

    Parameters
    ----------
    matrix : (n, n) array
        Finite.

    """
    norm = float(np.linalg.norm(matrix, 1))
    squarings = max(0, math.ceil(math.log2(norm / LARGEST))) if norm > 0.0 else 0
    one = np.eye(len(matrix))
    scaled = matrix / 2.0 ** squarings
    second = scaled @ scaled
    fourth = second @ second
    powers = one, second, fourth, second @ fourth

    def half(first: int) -> Array:
        """Return every other term of the polynomial, in even powers."""
        low = sum((PADE[first + 2 * n] * power for n, power in enumerate(powers)), 0.0 * one)
        high = sum((PADE[first + 6 + 2 * n] * power
                    for n, power in enumerate(powers) if n), 0.0 * one)
        return low + powers[3] @ high

    odd, even = scaled @ half(1), half(0)
    result: Array = np.asarray(np.linalg.solve(even - odd, even + odd), np.float64)
    for _ in range(squarings):
        result = result @ result
    return result
