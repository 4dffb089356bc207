# SPDX-License-Identifier: Apache-2.0
"""Test cases that run in the full tier only."""
import pytest


def slow(*cases):
    """Return cases of the full tier only; a tuple holds one value per parameter."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
            for case in cases]


def pairs(first, second):
    """Return all pairs; the quick tier runs each element of the longer sequence once."""
    few = min(len(first), len(second))
    return [pytest.param(one, two, marks=[pytest.mark.slow] if (row - column) % few else [])
            for row, one in enumerate(first) for column, two in enumerate(second)]
