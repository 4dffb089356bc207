# SPDX-License-Identifier: Apache-2.0
"""Orientation of a sensor in the shell, as one word for each axis."""
from typing import Tuple

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.imus.contract import Vector

NAMES = {'x': 0, 'y': 1, 'z': 2}
EXAMPLE = "three of x, y, z and their opposites, such as 'x y z' or '-y x z'"


class Axes:
    """
    Turns what a sensor measures into the axes of the shell: forward, left, up.

    Parameters
    ----------
    words : str
        Which axis of the sensor points forward, which to the left, which up: ``'-y x z'`` where
        its y axis points backward and its x axis to the left.

    Raises
    ------
    ConfigurationError
        If an axis is missing or given twice, or they would be left-handed.

    """

    def __init__(self, words: str):
        pairs = [(word.lstrip('+-'), -1.0 if word.startswith('-') else 1.0)
                 for word in words.split()]
        if sorted(name for name, _ in pairs) != sorted(NAMES):
            raise ConfigurationError(
                f'axes must be {EXAMPLE}, got {words!r}', 'not_a_choice', 'axes')
        self._from = tuple(NAMES[name] for name, _ in pairs)
        self._signs = tuple(sign for _, sign in pairs)
        first, second, third = self._from
        even = (first, second, third) in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        handed = self._signs[0] * self._signs[1] * self._signs[2] * (1.0 if even else -1.0)
        if handed < 0.0:
            raise ConfigurationError(
                f'axes {words!r} are left-handed, which no mounting gives: change the sign of one',
                'inconsistent', 'axes')

    def turned(self, vector: Vector) -> Tuple[float, float, float]:
        """Return a vector of the sensor as forward, left, up."""
        (i, j, k), (a, b, c) = self._from, self._signs
        return a * vector[i], b * vector[j], c * vector[k]
