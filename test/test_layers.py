# SPDX-License-Identifier: Apache-2.0
"""Imports point one way only, from the nodes down to the physics, and find their names."""
import ast
from collections import defaultdict
import fnmatch
from functools import cache
from pathlib import Path
import re
import sys
from textwrap import dedent

import pytest
from test_lint import project_files

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'scripts'))

from structure import (  # noqa: E402, I100, I202
    cycles, edges, imports, LATE, modules, nodes_of, tree_of)

# Each layer, bottom to top, and the layers that it may import besides itself.
LAYERS = {
    'errors': (),
    'config': ('errors',),
    'physics': ('errors', 'config'),
    'crossing': ('errors', 'config', 'physics'),
    'control': ('errors', 'config', 'physics'),
    # Lateral motion, in addition to the planar physics.
    'steering': ('errors', 'config', 'physics'),
    # Maps of the ground, and profiles extracted from them.
    'floors': ('errors', 'config', 'physics'),
    'estimation': ('errors', 'config', 'physics', 'control'),
    'plant': ('errors', 'config', 'physics', 'steering', 'floors'),
    'drives': ('errors', 'config'),
    # Inertial sensors, on lines that the layer drives opens.
    'imus': ('errors', 'config', 'drives'),
    'decision': ('errors', 'config', 'physics', 'crossing', 'control'),
    # Motor controllers in software: the drive on its line, and the plant that it actuates.
    'emulator': ('errors', 'config', 'physics', 'steering', 'plant', 'drives', 'imus'),
    'navigation': ('errors', 'config', 'physics', 'crossing', 'control', 'steering', 'floors',
                   'decision'),
    # Between commands and a real motor.
    'black_box': ('errors', 'config', 'physics', 'control', 'estimation', 'plant', 'drives',
                  'bridge', 'results'),
    'bridge': ('errors', 'config', 'physics', 'control', 'steering', 'estimation', 'plant',
               'drives', 'imus'),
}
RUNTIME = tuple(LAYERS)
# Offline: studies of the model, files and figures. No node imports them.
LAYERS['results'] = RUNTIME
LAYERS['studies'] = (*RUNTIME, 'results')
LAYERS['figures'] = (*RUNTIME, 'studies', 'results')
LAYERS['paper'] = (*RUNTIME, 'studies', 'results', 'figures')
LAYERS['ros'] = RUNTIME
LAYERS['nodes'] = (*RUNTIME, 'ros')
# The live page. Only its live source uses ROS, through the layer ros.
LAYERS['bags'] = (*RUNTIME, 'results', 'studies', 'ros')
LAYERS['view'] = (*RUNTIME, 'results', 'studies', 'figures', 'bags', 'ros')
LAYERS['experiments'] = (*LAYERS, 'demo')
LAYERS['cli'] = LAYERS['demo'] = (*LAYERS, 'cli', 'demo')

# The modules and folders directly below ballbot_ros whose name is not that of their layer.
PLACES = {'clock': 'config', 'compile_notice': 'config', 'jit': 'config', 'table': 'config'}

# Layers whose names the package itself offers, imported on use (test_python_api.py).
OFFERED = ('errors', 'physics', 'crossing', 'results')

# Inside physics, bottom to top; its __init__ is the facade above them.
FLOORS = ('model', 'mechanics', 'solvers', 'simulation')

# The layers that may import ROS. A name ending in _msgs also counts as ROS.
ROS = {'ament_index_python', 'ballbot_ros.msg', 'ballbot_ros.srv', 'builtin_interfaces',
       'diagnostic_updater', 'launch', 'launch_ros', 'rclpy', 'rcl_interfaces',
       'rosidl_runtime_py', 'simulation_interfaces', 'std_srvs', 'tf2_ros'}
ROS_LAYERS = {'ros', 'nodes', 'demo', 'bags', 'experiments'}

# Serial port and CAN bus have one owner each, which converts their exceptions.
OWNERS = {'serial': 'ballbot_ros.drives.transport', 'can': 'ballbot_ros.drives.can_transport'}


def layer_of(module):
    """Return the layer of a dotted module name, None for the package itself."""
    parts = module.split('.')
    return PLACES.get(parts[1], parts[1]) if len(parts) > 1 else None


def is_ros(name):
    """Return whether a dotted name belongs to ROS."""
    top = name.split('.')[0]
    return top.endswith('_msgs') or top in ROS or '.'.join(name.split('.')[:2]) in ROS


def floor_of(module):
    """Return the number of a module's floor in physics, None if it has no floor."""
    parts = module.split('.')
    inside = parts[1:2] == ['physics'] and len(parts) > 2
    return FLOORS.index(parts[2]) if inside and parts[2] in FLOORS else None


def without_floor(module):
    """Return whether a module of physics has no floor."""
    return module.startswith('ballbot_ros.physics.') and floor_of(module) is None


def violations(module, text, is_package=False):
    """List the forbidden imports of a module as text."""
    layer = layer_of(module)
    if layer is not None and layer not in LAYERS:
        return [f'{module}: give {layer!r} a place in LAYERS']
    found = []
    for line, name in imports(module, text, is_package):
        if (module, name) in LATE:
            continue
        where = f'{module}:{line} imports {name}'
        if is_ros(name):
            if layer not in ROS_LAYERS:
                found.append(f'{where}: ROS belongs into {", ".join(sorted(ROS_LAYERS))}')
        elif name.split('.')[0] in OWNERS:
            owner = OWNERS[name.split('.')[0]]
            if module != owner:
                found.append(f'{where}: only {owner} talks to the port')
        elif name.split('.')[0] == 'ballbot_ros':
            other = layer_of(name)
            if layer is None:
                if other not in OFFERED:
                    found.append(f'{where}: the package itself offers {", ".join(OFFERED)}')
            elif other in LAYERS and other != layer and other not in LAYERS[layer]:
                found.append(f'{where}: {layer} must not import {other}')
            elif upstairs(module, name):
                found.append(f'{where}: up, not down the floors {", ".join(FLOORS)}')
    return found


def upstairs(module, name):
    """Return whether an import inside physics is upward: a higher floor or the facade."""
    below, above = floor_of(module), floor_of(name)
    if below is None or layer_of(name) != 'physics':
        return False
    return above is None or above > below


def test_every_listed_late_import_exists():
    for module, name in LATE:
        assert name in {found for _, found in imports(module, tree_of(modules()[module]))}


def test_all_imports_point_downward():
    found = [problem for module, path in modules().items()
             for problem in violations(module, tree_of(path), path.name == '__init__.py')]
    assert not found, '\n'.join(found)


def test_only_the_live_source_of_the_page_needs_ros():
    found = [f'{module}:{line}' for module, path in modules().items()
             if layer_of(module) == 'view' and module != 'ballbot_ros.view.live'
             for line, name in imports(module, tree_of(path))
             if layer_of(name) == 'ros']
    assert not found, found


def test_each_module_of_physics_has_a_floor():
    loose = [module for module in modules() if without_floor(module)]
    assert not loose, f'not on one of {", ".join(FLOORS)}: {loose}'


def test_only_one_module_imports_internals_of_rclpy():
    internal = re.compile(r'rclpy\.(_|impl\b|experimental\b)')
    assert {module for module, path in modules().items()
            for _, name in imports(module, tree_of(path)) if internal.match(name)} == {
                'ballbot_ros.ros.rclpy_compat'}


def test_timeouts_of_the_hardware_include_suspensions_of_the_machine():
    folders = ('drives', 'bridge', 'imus', 'emulator', 'nodes/bridge', 'nodes/imu')
    sources = {path: path.read_text() for folder in folders
               for path in (ROOT / 'ballbot_ros' / folder).rglob('*.py')}
    assert any('steady_time' in text for text in sources.values())
    assert not [path for path, text in sources.items() if re.search(r'\bmonotonic\(', text)]


def test_there_are_no_import_cycles():
    assert not (found := cycles(edges())), found


def test_class_names_are_unique():
    owners = defaultdict(list)
    for module, path in modules().items():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                owners[node.name].append(module)
    shared = {name: where for name, where in owners.items() if len(where) > 1}
    assert not shared, shared


def test_a_cycle_is_found_without_modules_before_or_after_it():
    graph = {'a': ['b'], 'b': ['c'], 'c': ['b', 'd'], 'd': []}
    assert cycles(graph) == ['b', 'c']
    assert cycles({**graph, 'c': ['d']}) == []


def test_an_import_by_string_is_an_edge_to_each_module_that_it_can_name():
    found = edges()['ballbot_ros.nodes.start']
    assert found == sorted(module for module in modules() if re.fullmatch(
        r'ballbot_ros\.nodes\.\w+\.node', module))


@pytest.mark.parametrize('module, text', [
    ('ballbot_ros.physics.planted', 'from ballbot_ros.control.linear import gains'),
    ('ballbot_ros.physics.planted', 'def late():\n    from ..decision import policy'),
    ('ballbot_ros.drives.planted', 'import ballbot_ros.physics.simulation.model'),
    ('ballbot_ros.physics.model.planted', 'from ballbot_ros.physics.solvers import events'),
    ('ballbot_ros.physics.mechanics.planted', 'import ballbot_ros.physics.simulation.model'),
    ('ballbot_ros.physics.solvers.planted', 'from ballbot_ros.physics import Model'),
    ('ballbot_ros.physics.planted',
     "from importlib import import_module\nimport_module('ballbot_ros.results.files')"),
    ('ballbot_ros.ros.planted', "from_ros(f'ballbot_ros.nodes.{name}.node')"),
    ('ballbot_ros.physics.planted', "load_optional('serial', 'pyserial', 'install it')"),
    ('ballbot_ros.control.planted', 'from ballbot_ros import decision'),
    ('ballbot_ros.control.planted', 'from ballbot_ros.drives import protocol'),
    ('ballbot_ros.drives.planted', 'from ballbot_ros.emulator import emulator'),
    ('ballbot_ros.errors', 'from ballbot_ros.config.fields import quantity'),
    ('ballbot_ros.decision.planted', 'import rclpy.node'),
    ('ballbot_ros.decision.planted', 'from std_msgs.msg import Header'),
    ('ballbot_ros.results.planted', 'from ballbot_ros.msg import BallState'),
    ('ballbot_ros.cli', 'import rclpy'),
    ('ballbot_ros.ros.planted', 'from ballbot_ros.nodes import simulator'),
    ('ballbot_ros.drives.planted', 'import serial'),
    ('ballbot_ros.nodes.planted', 'from serial.tools import list_ports'),
    ('ballbot_ros.drives.transport', 'import can'),
    ('ballbot_ros.drives.vesc.can.planted', 'def late():\n    from can.message import Message'),
    ('ballbot_ros.surprise', 'import math'),
    ('ballbot_ros', 'from ballbot_ros.plant import Plant'),
])
def test_a_planted_violation_is_caught(module, text):
    assert violations(module, text)


@pytest.mark.parametrize('module, text', [
    ('ballbot_ros.physics.fine', 'import numpy\nfrom ballbot_ros.errors import SimulationError'),
    ('ballbot_ros.physics.solvers.fine', 'from ballbot_ros.physics.model import robot'),
    ('ballbot_ros.physics.solvers.fine', 'from ballbot_ros.physics.solvers import events'),
    ('ballbot_ros.physics', 'from ballbot_ros.physics.simulation.model import Model'),
    ('ballbot_ros.decision.fine', 'from ballbot_ros.control.linear import gains'),
    ('ballbot_ros.drives.transport', 'import serial'),
    ('ballbot_ros.drives.can_transport', 'def late():\n    import can'),
    ('ballbot_ros.nodes.fine', 'import rclpy\nfrom ballbot_ros.msg import BallState'),
    ('ballbot_ros.demo.fine', 'import rclpy\nfrom ballbot_ros.physics import model'),
    ('ballbot_ros.cli', 'from ballbot_ros.demo import run'),
    ('ballbot_ros.cli', 'from ballbot_ros import __version__'),
])
def test_a_downward_import_is_allowed(module, text):
    assert not violations(module, text)


def test_the_document_names_each_layer_once():
    text = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    cells = re.findall(r'^\| ((?:`\w+`(?:, )?)+) \|', text, re.M)
    assert sorted(name for cell in cells for name in re.findall(r'`(\w+)`', cell)) \
        == sorted(LAYERS)


GENERATED = ('msg', 'srv', 'action')
# Files with strings of imports that must fail.
PLANTED = ('test_layers.py', 'test_lint.py', 'test_extending.py')


@cache
def defined_in(tree):
    """Return the names that the statements of a module bind outside functions."""
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
        names = defined_in(tree_of(path))
        found |= {module, *(f'{module}.{name}' for name in names)}
    return found


def missing(module, text, names, is_package=False):
    """List (line, name) of each import of a missing name of the package in a text."""
    return [(line, name) for line, name in imports(module, text, is_package)
            if name.split('.')[0] == 'ballbot_ros' and name.removesuffix('.*') not in names
            and not ('[' in name and fnmatch.filter(names, name))]


def programs(tree):
    """Yield (line, program) of each string that imports from the package."""
    for node in nodes_of(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) \
                and 'import' in node.value and 'ballbot_ros' in node.value:
            try:
                yield node.lineno - 1, ast.parse(dedent(node.value))
            except SyntaxError:
                pass  # prose


@cache
def programs_of(folder):
    """Return the path of each program of a folder by its name."""
    return {path.stem: path for path in folder.glob('*.py')}


def missing_beside(path, tree):
    """List (line, name) of imports of missing names from other programs of the folder."""
    beside = programs_of(path.parent)
    return [(node.lineno, f'{node.module}.{alias.name}') for node in nodes_of(tree)
            if isinstance(node, ast.ImportFrom) and not node.level and node.module in beside
            for alias in node.names if alias.name not in defined_in(tree_of(beside[node.module]))]


def test_each_import_of_a_neighbouring_program_finds_its_name():
    assert not [f'{path.relative_to(ROOT)}:{line}: {name}' for path in project_files('.py')
                for line, name in missing_beside(path, tree_of(path))]


def test_each_import_of_the_package_finds_its_name():
    names = names_of_package()
    module_of = {path: module for module, path in modules().items()}
    found = []
    for path in project_files('.py'):
        tree = tree_of(path)
        parts = [(0, tree)] + (list(programs(tree)) if path.name not in PLANTED else [])
        found += [f'{path.relative_to(ROOT)}:{above + line}: {name}' for above, part in parts
                  for line, name in missing(module_of.get(path, ''), part, names,
                                            path.name == '__init__.py')]
    assert not found, '\n'.join(found)


@pytest.mark.parametrize('text, name', [
    ('import ballbot_ros.surprise', 'ballbot_ros.surprise'),
    ('def late():\n    from ballbot_ros.errors import Surprise', 'ballbot_ros.errors.Surprise'),
    ('from ballbot_ros import surprise', 'ballbot_ros.surprise'),
    ('from .robot import surprise', 'ballbot_ros.physics.model.robot.surprise'),
    ('from ballbot_ros.msg import Surprise', 'ballbot_ros.msg.Surprise'),
    ("import_module('ballbot_ros.surprise')", 'ballbot_ros.surprise'),
    ("from_ros(f'ballbot_ros.nodes.{name}.surprise')", 'ballbot_ros.nodes.[!_]*.surprise')])
def test_an_import_of_a_missing_name_is_found(text, name):
    assert missing('ballbot_ros.physics.model.planted', text, names_of_package()) \
        == [(text.count('\n') + 1, name)]


@pytest.mark.parametrize('text', [
    'import ballbot_ros.physics', 'from ballbot_ros import Model, physics, __version__',
    'from ballbot_ros.errors import *', 'from ballbot_ros.msg import BallState',
    'from .robot import Robot', 'from math import surprise'])
def test_an_import_of_a_name_that_exists_is_accepted(text):
    assert not missing('ballbot_ros.physics.model.planted', text, names_of_package())
