# SPDX-License-Identifier: Apache-2.0
"""Mounting of a sensor: all 24 orientations, and no others."""
from itertools import permutations, product

import numpy as np
import pytest
from refusals import refused

from ballbot_ros.errors import ConfigurationError
from ballbot_ros.imus.source import Axes

ALL = [' '.join(sign + name for sign, name in zip(signs, names))
       for names in permutations('xyz') for signs in product(('', '-'), repeat=3)]


def test_a_sensor_has_24_orientations_and_each_is_a_rotation():
    mountable = []
    for words in ALL:
        try:
            axes = Axes(words)
        except ConfigurationError as error:
            assert (error.reason, error.field) == ('inconsistent', 'axes')
            continue
        mountable.append(words)
        matrix = np.array([axes.turned(tuple(column)) for column in np.eye(3).tolist()]).T
        assert np.linalg.det(matrix) == pytest.approx(1.0)
        assert matrix @ matrix.T == pytest.approx(np.eye(3))
    assert len(mountable) == 24


def test_the_axes_are_forward_left_and_up():
    assert Axes('x y z').turned((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)
    # The sensor's y axis points backward, its x axis to the left.
    assert Axes('-y x z').turned((1.0, 2.0, 3.0)) == (-2.0, 1.0, 3.0)
    assert Axes('+x -y -z').turned((1.0, 2.0, 3.0)) == (1.0, -2.0, -3.0)


@pytest.mark.parametrize(
    'words', ('', 'x', 'x y', 'x y y', 'x y z z', 'a b c', '1 2 3', '--- x y'))
def test_a_malformed_mounting_is_refused(words):
    with refused('not_a_choice', 'axes'):
        Axes(words)
