# SPDX-License-Identifier: Apache-2.0
"""Each import of the package, also inside functions and programs in strings, finds its name."""
import ast
from functools import cache
from pathlib import Path
import sys
from textwrap import dedent

import pytest
from test_lint import project_files

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from structure import imports, modules  # noqa: E402, I100, I202

GENERATED = ('msg', 'srv', 'action')
# Files whose strings plant imports that must fail.
PLANTED = ('test_imports.py', 'test_layers.py', 'test_lint.py', 'test_extending.py')


def defined_in(tree):
    """Return the names that the statements of a module bind, those inside functions left out."""
    names, pending = set(), list(tree.body)
    while pending:
        node = pending.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            names |= {(alias.asname or alias.name).split('.')[0] for alias in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        else:
            pending += ast.iter_child_nodes(node)
    return names


@cache
def names_of_package():
    """Return the dotted names of all modules, of what they define, and of generated messages."""
    found = {f'ballbot_ros.{kind}' for kind in GENERATED}
    found |= {f'ballbot_ros.{kind}.{path.stem}' for kind in GENERATED
              for path in (ROOT / kind).glob(f'*.{kind}')}
    for module, path in modules().items():
        names = defined_in(ast.parse(path.read_text(encoding='utf-8')))
        found |= {module, *(f'{module}.{name}' for name in names)}
    return found


def missing(module, text, names, is_package=False):
    """List (line, name) of each import of the package in a text that finds nothing."""
    return [(line, name) for line, name in imports(module, text, is_package)
            if name.split('.')[0] == 'ballbot_ros' and name.removesuffix('.*') not in names]


def programs(tree):
    """Yield (line, program) of each string that imports from the package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) \
                and 'import' in node.value and 'ballbot_ros' in node.value:
            try:
                ast.parse(text := dedent(node.value))
            except SyntaxError:
                continue
            yield node.lineno - 1, text


def test_each_import_of_the_package_finds_its_name():
    names = names_of_package()
    module_of = {path: module for module, path in modules().items()}
    found = []
    for path in project_files('.py'):
        text = path.read_text(encoding='utf-8')
        if 'ballbot_ros' not in text and path not in module_of:
            continue
        texts = [(0, text)]
        if path.name not in PLANTED:
            texts += programs(ast.parse(text))
        found += [f'{path.relative_to(ROOT)}:{above + line}: {name}' for above, part in texts
                  for line, name in missing(module_of.get(path, ''), part, names,
                                            path.name == '__init__.py')]
    assert not found, '\n'.join(found)


@pytest.mark.parametrize('text, name', [
    ('import ballbot_ros.surprise', 'ballbot_ros.surprise'),
    ('def late():\n    from ballbot_ros.errors import Surprise', 'ballbot_ros.errors.Surprise'),
    ('from ballbot_ros import surprise', 'ballbot_ros.surprise'),
    ('from .robot import surprise', 'ballbot_ros.physics.model.robot.surprise'),
    ('from ballbot_ros.msg import Surprise', 'ballbot_ros.msg.Surprise'),
    ("import_module('ballbot_ros.surprise')", 'ballbot_ros.surprise')])
def test_an_import_without_its_name_is_found(text, name):
    assert missing('ballbot_ros.physics.model.planted', text, names_of_package()) \
        == [(text.count('\n') + 1, name)]


@pytest.mark.parametrize('text', [
    'import ballbot_ros.physics', 'from ballbot_ros import Model, physics, __version__',
    'from ballbot_ros.errors import *', 'from ballbot_ros.msg import BallState',
    'from .robot import Robot', 'from math import surprise'])
def test_an_import_of_a_name_that_exists_is_accepted(text):
    assert not missing('ballbot_ros.physics.model.planted', text, names_of_package())
