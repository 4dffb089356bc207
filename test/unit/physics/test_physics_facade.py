# SPDX-License-Identifier: Apache-2.0
"""What is public of physics and crossing is shown by examples that run."""
import ast
import doctest

import pytest

from ballbot_ros import crossing, physics

FACADES = (crossing, physics)


def shown(examples):
    """Return the names that examples use."""
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
    assert set(facade.__all__) <= shown(examples)
    assert all(getattr(facade, name) is not None for name in facade.__all__)
