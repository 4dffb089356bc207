# SPDX-License-Identifier: Apache-2.0
"""Runnable examples cover the public names of physics and crossing."""
import ast
import doctest

import pytest

from ballbot_ros import crossing, physics

FACADES = (crossing, physics)


def names_in(examples):
    """Return the names that the examples use."""
    return {node.id for example in examples for node in ast.walk(ast.parse(example.source))
            if isinstance(node, ast.Name)}


@pytest.mark.slow
@pytest.mark.parametrize('facade', FACADES)
def test_the_examples_run(facade):
    found = doctest.testmod(facade)
    assert found.attempted > 0 and found.failed == 0


@pytest.mark.parametrize('facade', FACADES)
def test_every_public_name_has_an_example(facade):
    examples = doctest.DocTestParser().get_examples(facade.__doc__)
    assert set(facade.__all__) <= names_in(examples)
    assert all(getattr(facade, name) is not None for name in facade.__all__)
