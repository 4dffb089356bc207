# SPDX-License-Identifier: Apache-2.0
"""Kernels have typed parameters."""
import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[3] / 'ballbot_ros'
MARKS = {'compiled', 'outlined', 'unlocked'}


def kernels(text):
    """Yield each kernel of a module."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and MARKS & {
                getattr(mark, 'id', '') for mark in node.decorator_list}:
            yield node


def faults(kernel):
    """Yield the type annotation errors of a kernel."""
    if kernel.args.vararg or kernel.args.kwonlyargs:
        yield 'parameters that numba does not take'
    kinds = {item.arg: item.annotation for item in kernel.args.args} | {'return': kernel.returns}
    for name, kind in kinds.items():
        said = ast.unparse(kind) if kind is not None else ''
        if not said or 'Any' in said or said == 'tuple':
            yield f'{name}: {said or "no type"}'


@pytest.mark.slow
def test_each_kernel_is_typed():
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
    ('def f(*a: int) -> None:\n    pass', 'parameters'),
])
def test_a_kernel_that_breaks_a_rule_is_caught(text, wrong):
    kernel, = kernels('@compiled\n' + text)
    assert any(fault.startswith(wrong) for fault in faults(kernel))
