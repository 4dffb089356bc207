# SPDX-License-Identifier: Apache-2.0
"""Imports point one way only: from the nodes down to the physics, never up."""
import ast
from pathlib import Path
import re

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / 'ballbot_ros'

# Each layer, bottom to top, and the layers that it may import. Its own modules it always may.
LAYERS = {
    'errors': (),
    'config': ('errors',),
    'physics': ('errors', 'config'),
    'crossing': ('errors', 'config', 'physics'),
    'control': ('errors', 'config', 'physics'),
    'estimation': ('errors', 'config', 'physics', 'control'),
    'plant': ('errors', 'config', 'physics'),
    'drives': ('errors', 'config'),
    'decision': ('errors', 'config', 'physics', 'crossing', 'control'),
    # Motor controllers in software: what a drive says on its line, and a plant behind it.
    'emulator': ('errors', 'config', 'physics', 'plant', 'drives'),
    # Between commands and a real motor.
    'bridge': ('errors', 'config', 'physics', 'control', 'estimation', 'plant', 'drives'),
}
RUNTIME = tuple(LAYERS)
# Offline: what runs of the model teach, its files and its pictures. No node imports them.
LAYERS['studies'] = RUNTIME
LAYERS['results'] = (*RUNTIME, 'studies')
LAYERS['figures'] = (*RUNTIME, 'studies', 'results')
LAYERS['ros'] = RUNTIME
LAYERS['nodes'] = (*RUNTIME, 'ros')
LAYERS['cli'] = LAYERS['demo'] = (*LAYERS, 'cli', 'demo')

# The modules and folders directly below ballbot_ros whose name is not that of their layer.
PLACES = {'compiled': 'config', 'renamed': 'errors'}

# Who may import ROS. A name ending in _msgs counts as ROS too.
ROS = {'ament_index_python', 'ballbot_ros.msg', 'ballbot_ros.srv', 'builtin_interfaces',
       'diagnostic_updater', 'launch', 'launch_ros', 'rclpy', 'rcl_interfaces',
       'rosidl_runtime_py', 'simulation_interfaces', 'std_srvs', 'tf2_ros'}
ROS_LAYERS = {'ros', 'nodes', 'demo'}

# The serial port has one owner, so that three exception families are converted in one place.
SERIAL_OWNER = 'ballbot_ros.drives.transport'


def layer_of(module):
    """Return the layer of a dotted module name, None for the package itself."""
    parts = module.split('.')
    return PLACES.get(parts[1], parts[1]) if len(parts) > 1 else None


def imports(module, text, is_package=False):
    """Yield (line, dotted name) of each import, at any depth, with relative ones resolved."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ''
            if node.level:
                parts = module.split('.')
                above = parts[:len(parts) - node.level + is_package]
                base = '.'.join([*above, *filter(None, [base])])
            # `from ballbot_ros import errors` names a layer only in its last part.
            names = [f'{base}.{alias.name}' for alias in node.names]
            yield from ((node.lineno, name) for name in (
                names if base == 'ballbot_ros' else [base]))


def is_ros(name):
    """Say whether a dotted name belongs to ROS."""
    top = name.split('.')[0]
    return top.endswith('_msgs') or top in ROS or '.'.join(name.split('.')[:2]) in ROS


def violations(module, text, is_package=False):
    """List what a module imports but may not, in words."""
    layer = layer_of(module)
    if layer is not None and layer not in LAYERS:
        return [f'{module}: give {layer!r} a place in LAYERS']
    found = []
    for line, name in imports(module, text, is_package):
        where = f'{module}:{line} imports {name}'
        if is_ros(name):
            if layer not in ROS_LAYERS:
                found.append(f'{where}: ROS belongs into {", ".join(sorted(ROS_LAYERS))}')
        elif name.split('.')[0] == 'serial':
            if module != SERIAL_OWNER:
                found.append(f'{where}: only {SERIAL_OWNER} talks to the port')
        elif name.split('.')[0] == 'ballbot_ros':
            other = layer_of(name)
            if layer is None:
                if other != 'errors' or name == 'ballbot_ros.errors':
                    found.append(f'{where}: the package itself imports only renamed')
            elif other in LAYERS and other != layer and other not in LAYERS[layer]:
                found.append(f'{where}: {layer} must not know {other}')
    return found


def modules():
    """Yield (dotted name, path) of each module of the package."""
    for path in sorted(PACKAGE.rglob('*.py')):
        parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
        yield '.'.join(parts[:-1] if parts[-1] == '__init__' else parts), path


def test_no_import_points_the_wrong_way():
    found = [problem for module, path in modules()
             for problem in violations(module, path.read_text(encoding='utf-8'),
                                       path.name == '__init__.py')]
    assert not found, '\n'.join(found)


@pytest.mark.parametrize('module, text', [
    ('ballbot_ros.physics.planted', 'from ballbot_ros.control.linear import gains'),
    ('ballbot_ros.physics.planted', 'def late():\n    from ..decision import policy'),
    ('ballbot_ros.drives.planted', 'import ballbot_ros.physics.simulation.model'),
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
    ('ballbot_ros.surprise', 'import math'),
    ('ballbot_ros', 'from ballbot_ros.errors import BallbotError'),
])
def test_a_planted_violation_is_caught(module, text):
    assert violations(module, text)


@pytest.mark.parametrize('module, text', [
    ('ballbot_ros.physics.fine', 'import numpy\nfrom ballbot_ros.errors import SimulationError'),
    ('ballbot_ros.decision.fine', 'from ballbot_ros.control.linear import gains'),
    ('ballbot_ros.drives.transport', 'import serial'),
    ('ballbot_ros.nodes.fine', 'import rclpy\nfrom ballbot_ros.msg import BallState'),
    ('ballbot_ros.demo.fine', 'import rclpy\nfrom ballbot_ros.physics import model'),
    ('ballbot_ros.cli', 'from ballbot_ros.demo import run'),
    ('ballbot_ros.cli', 'from ballbot_ros import __version__'),
])
def test_a_downward_import_is_allowed(module, text):
    assert not violations(module, text)


def test_the_table_of_the_document_is_the_one_above():
    text = (PACKAGE.parent / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    told = {}
    for row in re.findall(r'^\| (`.*) \|$', text, re.M):
        names, _, knows = row.split(' | ')
        above = tuple(told)
        for name in re.findall(r'`(\w+)`', names):
            listed = re.findall(r'`(\w+)`', knows)
            told[name] = (tuple(set(above) - set(listed)) if knows.startswith('all above')
                          else tuple(listed))
    together = {'cli', 'demo'}  # one row of the table
    assert {name: set(known) for name, known in told.items()} == {
        name: set(known) - together for name, known in LAYERS.items()}
