# SPDX-License-Identifier: Apache-2.0
"""The accuracy of maximum step heights; bench/step_accuracy.py tries 1,000 random robots."""
from crossing_accuracy import shares
import pytest

ACCURACIES = (1e-3, 5e-5, 1e-5)


@pytest.mark.parametrize('seed', range(8))
def test_a_highest_step_of_any_robot_is_within_the_accuracy_that_was_asked_for(seed):
    found, rest = shares(seed, ACCURACIES)
    assert found is not None, rest
    assert max(found) <= 1.0
