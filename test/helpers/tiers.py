# SPDX-License-Identifier: Apache-2.0
"""Which cases of a test are left to the full tier."""
import pytest


def slow(*cases):
    """Return cases of the full tier alone; a tuple holds one value per parameter."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
            for case in cases]


def pairs(first, second):
    """Return all pairs; the quick tier has each element of the longer sequence once."""
    few = min(len(first), len(second))
    return [pytest.param(one, two, marks=[pytest.mark.slow] if (row - column) % few else [])
            for row, one in enumerate(first) for column, two in enumerate(second)]
