# SPDX-License-Identifier: Apache-2.0
"""The set-up says what is missing, all at once, and what to do about it."""
import ast
import importlib
from pathlib import Path
import sys

import pytest

SCRIPTS = Path(__file__).resolve().parent.parent / 'scripts'


@pytest.fixture
def host(monkeypatch):
    """Return scripts/host.py as a module, in a shell without ROS 2, on a supported machine."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.delenv('CC', raising=False)
    monkeypatch.delenv('CXX', raising=False)
    module = importlib.import_module('host')
    monkeypatch.setattr(module.platform, 'machine', lambda: 'x86_64')
    return module


def python(version, **facts):
    """Describe an interpreter that has everything but what is said otherwise."""
    return {'version': list(version), 'executable': '/usr/bin/python3', 'venv': True,
            'headers': True, 'rclpy': None, **facts}


def test_all_missing_tools_are_named_at_once_with_one_command(host, monkeypatch):
    monkeypatch.setattr(host.shutil, 'which', lambda name: None)
    with pytest.raises(host.Problem) as caught:
        host.check_tools(python((3, 12), venv=False, headers=False))
    assert str(caught.value).endswith(' install python3.12-venv python3.12-dev gcc g++ make')


def test_a_complete_machine_raises_nothing(host, monkeypatch):
    monkeypatch.setattr(host.shutil, 'which', lambda name: f'/usr/bin/{name}')
    host.check_tools(python((3, 12)))


@pytest.mark.parametrize('version', [(3, 8), (3, 14)])
def test_an_unsupported_python_gives_way_to_one_on_the_path(host, monkeypatch, version):
    monkeypatch.setattr(host, 'describe', lambda: python(version))
    monkeypatch.setattr(host.shutil, 'which', lambda name: f'/usr/bin/{name}')
    monkeypatch.setattr(host, 'describe_other', lambda path: python((3, 12))
                        if path.endswith('python3.12') else None)
    assert host.choose_python('')['version'] == [3, 12]


def test_without_any_supported_python_the_message_says_what_to_install(host, monkeypatch):
    monkeypatch.setattr(host, 'describe', lambda: python((3, 8)))
    monkeypatch.setattr(host, 'describe_other', lambda path: None)
    with pytest.raises(host.Problem, match='3.10 to 3.13 is needed.*(\n.*)*apt-get install'):
        host.choose_python('')


def test_a_sourced_ros_needs_the_python_that_imports_it(host, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    monkeypatch.setattr(host, 'describe', lambda: python((3, 11)))
    monkeypatch.setattr(host, 'describe_other', lambda path: python((3, 12), rclpy='/opt/rclpy')
                        if path == '/usr/bin/python3' else None)
    assert host.choose_python('jazzy')['rclpy'] == '/opt/rclpy'
    monkeypatch.setattr(host, 'describe_other', lambda path: None)
    with pytest.raises(host.Problem, match='jazzy is sourced'):
        host.choose_python('jazzy')


def test_a_machine_without_wheels_is_told_to_source_ros(host, monkeypatch):
    monkeypatch.setattr(host.platform, 'machine', lambda: 'aarch64')
    with pytest.raises(host.Problem, match='aarch64.*(\n.*)*source'):
        host.choose_python('')


def test_the_set_up_needs_nothing_outside_the_standard_library():
    for path in SCRIPTS.glob('*.py'):
        if path.name not in ('bootstrap.py', 'host.py', 'stages.py'):
            continue
        for node in ast.walk(ast.parse(path.read_text(), feature_version=(3, 6))):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names = [node.module] if isinstance(node, ast.ImportFrom) \
                    else [alias.name for alias in node.names]
                assert all(
                    name in ('host', 'stages') or name.split('.')[0] in sys.stdlib_module_names
                    for name in names), f'{path.name} imports {names}'
