# SPDX-License-Identifier: Apache-2.0
"""Kernels have few parameters, with their types."""
import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[3] / 'ballbot_ros'
MARKS = {'compiled', 'outlined', 'unlocked'}
MOST_PARAMETERS = 8


def kernels(text):
    """Yield each kernel of a module."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and MARKS & {
                getattr(mark, 'id', '') for mark in node.decorator_list}:
            yield node


def faults(kernel):
    """Yield what is wrong with a kernel."""
    parameters = kernel.args.args
    if len(parameters) > MOST_PARAMETERS or kernel.args.vararg or kernel.args.kwonlyargs:
        yield f'{len(parameters)} parameters'
    kinds = {item.arg: item.annotation for item in parameters} | {'return': kernel.returns}
    for name, kind in kinds.items():
        said = ast.unparse(kind) if kind is not None else ''
        if not said or 'Any' in said or said == 'tuple':
            yield f'{name}: {said or "no type"}'


@pytest.mark.slow
def test_no_kernel_takes_many_parameters_or_is_untyped():
    found, count = [], 0
    for path in sorted(PACKAGE.rglob('*.py')):
        for kernel in kernels(path.read_text(encoding='utf-8')):
            count += 1
            found += [f'{path.name}: {kernel.name}: {fault}' for fault in faults(kernel)]
    assert not found, '\n'.join(found)
    assert count > 50


@pytest.mark.parametrize('text, wrong', [
    ('def f(a: int, b: Any) -> int:\n    return a', 'b: Any'),
    ('def f(a: int) -> tuple:\n    return a', 'return: tuple'),
    ('def f(a):\n    return a', 'a: no type'),
    (f'def f({", ".join(f"a{i}: int" for i in range(9))}) -> None:\n    pass', '9 parameters'),
])
def test_a_kernel_that_breaks_a_rule_is_caught(text, wrong):
    kernel, = kernels('@compiled\n' + text)
    assert any(fault.startswith(wrong) for fault in faults(kernel))
