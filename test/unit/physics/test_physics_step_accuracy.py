# SPDX-License-Identifier: Apache-2.0
"""The accuracy of maximum step heights; bench/step_accuracy.py tries 1,000 random robots."""
from crossing_accuracy import shares
import pytest

ACCURACIES = (1e-3, 5e-5, 1e-5)


@pytest.mark.parametrize('seed', range(8))
def test_the_maximum_step_height_of_any_robot_has_the_requested_accuracy(seed):
    found, rest = shares(seed, ACCURACIES)
    assert found is not None, rest
    assert max(found) <= 1.0
