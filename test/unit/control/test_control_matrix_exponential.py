# SPDX-License-Identifier: Apache-2.0
"""The matrix exponential of the package agrees with that of SciPy."""
import numpy as np
import pytest
from scipy.linalg import expm as reference

from ballbot_ros.control.sampled import expm


@pytest.mark.parametrize('size', [1, 2, 5, 8])
@pytest.mark.parametrize('scale', [1e-9, 1e-3, 1.0, 10.0])
def test_the_matrix_exponential_agrees_with_scipy(size, scale):
    matrix = scale * np.random.default_rng(size).standard_normal((size, size))
    expected = reference(matrix)
    np.testing.assert_allclose(expm(matrix), expected, rtol=0.0,
                               atol=1e-11 * np.abs(expected).max())


def test_the_exponential_of_zero_is_the_identity_and_the_argument_is_unchanged():
    matrix = np.zeros((3, 3))
    np.testing.assert_allclose(expm(matrix), np.eye(3), rtol=1e-15, atol=0.0)
    assert not matrix.any()
