# SPDX-License-Identifier: Apache-2.0
"""The set-up names all missing tools and their remedy, and repeats no finished stage."""
import ast
import importlib
from pathlib import Path
import re
import sys
import sysconfig
import threading
from types import SimpleNamespace

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
    """Describe a complete interpreter, with changes."""
    return {'version': list(version), 'executable': '/usr/bin/python3', 'venv': True,
            'headers': True, 'rclpy': None, **facts}


def test_all_missing_tools_are_named_together_with_one_command(host, monkeypatch):
    monkeypatch.setattr(host.shutil, 'which', lambda name: None)
    with pytest.raises(host.Problem) as caught:
        host.check_tools(python((3, 12), venv=False, headers=False))
    assert str(caught.value).endswith(' install python3.12-venv python3.12-dev gcc g++ make')


def test_a_complete_machine_raises_nothing(host, monkeypatch):
    monkeypatch.setattr(host.shutil, 'which', lambda name: f'/usr/bin/{name}')
    host.check_tools(python((3, 12)))


@pytest.mark.parametrize('version', [(3, 8), (3, 14)])
def test_an_unsupported_python_is_replaced_by_one_on_the_path(host, monkeypatch, version):
    monkeypatch.setattr(host, 'describe', lambda: python(version))
    monkeypatch.setattr(host.shutil, 'which', lambda name: f'/usr/bin/{name}')
    monkeypatch.setattr(host, 'describe_other', lambda path: python((3, 12))
                        if path.endswith('python3.12') else None)
    assert host.choose_python('')['version'] == [3, 12]


def test_without_a_supported_python_the_message_names_one_to_install(host, monkeypatch):
    monkeypatch.setattr(host, 'describe', lambda: python((3, 8)))
    monkeypatch.setattr(host, 'describe_other', lambda path: None)
    with pytest.raises(host.Problem) as caught:
        host.choose_python('')
    assert '3.10' in str(caught.value) and 'apt-get install' in str(caught.value)


def test_a_sourced_ros_needs_the_python_that_imports_it(host, monkeypatch):
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    monkeypatch.setattr(host, 'describe', lambda: python((3, 11)))
    monkeypatch.setattr(host, 'describe_other', lambda path: python((3, 12), rclpy='/opt/rclpy')
                        if path == '/usr/bin/python3' else None)
    assert host.choose_python('jazzy')['rclpy'] == '/opt/rclpy'
    monkeypatch.setattr(host, 'describe_other', lambda path: None)
    with pytest.raises(host.Problem, match='jazzy'):
        host.choose_python('jazzy')


def test_a_machine_without_wheels_gets_the_advice_to_source_ros(host, monkeypatch):
    monkeypatch.setattr(host.platform, 'machine', lambda: 'aarch64')
    with pytest.raises(host.Problem, match='aarch64'):
        host.choose_python('')


@pytest.fixture
def stages(monkeypatch, tmp_path, host):
    """Return scripts/stages.py as a module, with stamps and logs in an empty folder."""
    module = importlib.import_module('stages')
    monkeypatch.setattr(module, 'VENV', tmp_path)
    monkeypatch.setattr(module, 'STAMPS', tmp_path / 'stamps')
    return module


def test_a_finished_stage_runs_again_only_after_a_change_of_its_inputs(stages):
    ran = []
    for key in ('a', 'a', 'b'):
        stages.run_together(stages.Stage('name', '', key, lambda stage: ran.append(stage.key)))
    assert ran == ['a', 'b']


def test_a_failed_stage_shows_the_end_of_its_log_and_does_not_count_as_finished(stages, host):
    def work(stage):
        stage.command(sys.executable, '-c', 'print("no space left"); raise SystemExit(3)',
                      hint='make space')
    stage, other = (stages.Stage('name', '', 'a', work),
                    stages.Stage('other', '', 'a', lambda stage: None))
    with pytest.raises(host.Problem, match='no space left\nmake space'):
        stages.run_together(stage, other)
    assert not stage.done and other.done


def test_stages_of_one_step_run_at_the_same_time(stages):
    meeting = threading.Barrier(2, timeout=60.0)
    stages.run_together(*(stages.Stage(name, '', 'a', lambda stage: meeting.wait())
                          for name in ('left', 'right')))


def test_a_build_finds_a_complete_mark_of_the_install_layout(host, monkeypatch, tmp_path):
    """Two builds run at the same time, and colcon writes the mark in place."""
    bootstrap, found = importlib.import_module('bootstrap'), []
    monkeypatch.setattr(bootstrap, 'VENV', tmp_path)
    stage = SimpleNamespace(name='messages', command=lambda *words, **_: found.append(
        (tmp_path / '.colcon_install_layout').read_text()))
    bootstrap.colcon(stage, '', tmp_path / 'build')
    bootstrap.colcon(stage, '', tmp_path / 'build')
    assert found == ['merged\n', 'merged\n']
    assert [path.name for path in tmp_path.iterdir()] == ['.colcon_install_layout']


def test_the_settings_of_pip_are_read_and_its_environment_comes_first(host, monkeypatch):
    bootstrap = importlib.import_module('bootstrap')
    monkeypatch.setattr(bootstrap, 'PYTHON', sys.executable)
    monkeypatch.setattr(bootstrap.subprocess, 'check_output', lambda command: (
        b":env:.index-url='https://a/simple'\n"
        b"global.extra-index-url='\\nhttps://b\\nhttps://c'\nglobal.index-url='https://d'\n"))
    settings = bootstrap.pip_settings()
    assert settings['index-url'] == 'https://a/simple'
    assert settings['extra-index-url'].split() == ['https://b', 'https://c']


def test_the_accelerated_parser_of_interfaces_returns_the_same_trees(host):
    rosidl_parser, lark = (pytest.importorskip(name) for name in ('rosidl_parser', 'lark'))
    earley = lalr = Path(rosidl_parser.__file__).with_name('grammar.lark').read_text()
    for old, new in importlib.import_module('bootstrap').LALR_GRAMMAR:
        assert (old in earley) != (new in earley.replace(old, ''))
        earley = earley if old in earley else earley.replace(new, old)
        lalr = lalr.replace(old, new)

    def plain(item):
        if isinstance(item, str):
            return str(item)
        children = [plain(child) for child in item.children]
        return item.data, ''.join(children) if item.data == 'decimal_literal' else children

    def trees(grammar, **options):
        parser = lark.Lark(grammar, start='specification', maybe_placeholders=False, **options)
        return [plain(parser.parse(path.read_text())) for path in paths]
    share = Path(sysconfig.get_path('data')) / 'share'
    paths = [share / name for name in (
        'ballbot_ros/msg/StepDecision.idl', 'ballbot_ros/action/CrossStep.idl',
        'ballbot_ros/srv/Step.idl', 'tf2_msgs/msg/TFMessage.idl')]
    assert trees(earley) == trees(lalr, parser='lalr')


def test_a_package_has_one_pin_in_all_groups_and_each_required_one_has_a_pin():
    pins = {}
    for name in ('run.txt', 'test.txt', 'bench.txt', 'fuzz.txt'):
        for line in lines(name):
            package = re.match(r'[\w.-]+', line).group().lower()
            assert '==' in line and package not in pins, f'{name}: {line}'
            pins[package] = line
    for name in ('run.in', 'build.in', 'ros.in', 'test.in'):
        for line in lines(name):
            package = re.match(r'[\w.-]+', line).group().lower()
            assert {package, package.replace('_', '-')} & set(pins), f'{name}: {line}'


def lines(name):
    """Return the lines of a file of requirements/ that name a package."""
    text = (SCRIPTS.parent / 'requirements' / name).read_text()
    return [line for line in text.splitlines() if line[:1].isalnum()]


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
