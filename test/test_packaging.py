# SPDX-License-Identifier: Apache-2.0
"""The package installs as a ROS 2 user expects, in an actual build with colcon."""
import ast
import importlib.util
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree

import pytest

ROOT = Path(__file__).resolve().parent.parent
MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()
BUILT = ('.git', '.venv', '.venv-old', 'build', 'install', 'log', '__pycache__')

CONSUMER = {
    'CMakeLists.txt': """
        cmake_minimum_required(VERSION 3.20)
        project(consumer CXX)
        find_package(ballbot_ros REQUIRED)
        message(STATUS "found in ${ballbot_ros_DIR}")
        add_executable(consumer main.cpp)
        target_link_libraries(consumer ballbot_ros::ballbot_ros__rosidl_generator_cpp)
    """,
    'main.cpp': """
        #include <ballbot_ros/msg/step_decision.hpp>
        #include <iostream>
        int main() {
          ballbot_ros::msg::StepDecision decision;
          decision.decision = ballbot_ros::msg::StepDecision::DECISION_CROSS;
          std::cout << to_yaml(decision);
        }
    """,
}

NODES = {path.parent.name for path in ROOT.glob('ballbot_ros/nodes/*/node.py')}

# Command prefix: source the workspace in the current folder, as a user does.
SOURCED = ('bash', '-c', '. install/local_setup.sh && exec "$@"', 'bash')


def run(*command, **more):
    """Run a command and return its output; fail with the output if it fails."""
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, **more)
    assert done.returncode == 0, done.stdout[-6000:]
    return done.stdout


def copy_project(target):
    """Copy the files of a fresh clone, including uncommitted changes."""
    shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*BUILT, '*.egg-info', '.*_cache'))
    return target


def files_below(folder):
    """List the files below a folder, relative to it."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob('*')
                  if path.is_file() and '__pycache__' not in path.parts)


# --- Declarations ---------------------------------------------------------------------------

def test_the_version_is_the_same_everywhere():
    text = (ROOT / 'ballbot_ros' / '__init__.py').read_text()
    assert re.search(r"__version__ = '(.*)'", text).group(1) == MANIFEST.findtext('version')


def test_catkin_pkg_accepts_the_manifest():
    package = pytest.importorskip('catkin_pkg.package')
    warnings = []
    parsed = package.parse_package(str(ROOT), warnings=warnings)
    assert not warnings
    assert parsed.get_build_type() == 'ament_python'
    assert 'rosidl_interface_packages' in [group.name for group in parsed.member_of_groups]


def test_a_workspace_contains_one_package_and_none_of_interfaces():
    packages = pytest.importorskip('catkin_pkg.packages')
    assert len(list(ROOT.glob('interfaces/*/package.xml'))) == 2
    assert packages.find_package_paths(str(ROOT)) == ['.']  # as rosdep looks for them


def test_each_ros_package_that_is_imported_is_declared():
    declared = {element.text for element in MANIFEST if element.tag in ('depend', 'exec_depend')}
    used = set()
    for folder in ('ballbot_ros', 'launch'):
        for path in (ROOT / folder).rglob('*.py'):
            for node in ast.walk(ast.parse(path.read_text())):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) \
                    else [node.module or ''] if isinstance(node, ast.ImportFrom) else []
                used.update(name.split('.')[0] for name in names)
    ros = {name for name in used if name.endswith(('_msgs', '_srvs', '_interfaces')) or name in (
        'ament_index_python', 'diagnostic_updater', 'launch', 'launch_ros', 'rclpy', 'rosbag2_py',
        'tf2_ros')}
    assert ros <= declared, f'add to package.xml: {ros - declared}'


def test_bloom_accepts_all_run_time_dependencies():
    keys = [element.text for element in MANIFEST if element.tag != 'test_depend']
    assert not [key for key in keys if key.endswith('-pip')]


def test_colcon_test_detects_pytest():
    pytest.importorskip('colcon_python_setup_py')
    from colcon_core.task.python.test import has_test_dependency
    from colcon_python_setup_py.package_identification.python_setup_py import (
        get_setup_information)
    assert has_test_dependency(get_setup_information(ROOT / 'setup.py'), 'pytest')


def test_the_lists_of_python_dependencies_agree():
    setup = (ROOT / 'setup.py').read_text()
    required = ast.literal_eval(re.search(r'install_requires=(\[.*?\])', setup, re.S).group(1))
    listed = (ROOT / 'requirements' / 'run.in').read_text().lower().split('\n')
    locked = (ROOT / 'requirements' / 'run.txt').read_text()
    for name in map(str.lower, required):
        assert name in listed
        assert re.search(rf'^{name}==', locked, re.M), f'{name} has no pin in run.txt'


# --- Build with colcon ----------------------------------------------------------------------

@pytest.fixture(scope='module')
def sources(tmp_path_factory):
    """Return a workspace with the sources only."""
    for module in ('colcon_core', 'rclpy', 'rosidl_generator_py'):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f'{module} is needed to build the messages')
    folder = tmp_path_factory.mktemp('workspace')
    copy_project(folder / 'src' / 'ballbot_ros')
    return folder


def keep_the_messages_only(folder):
    """Remove the build results of a workspace except the messages, which suit both modes."""
    messages = folder / 'build' / 'ballbot_ros' / 'build' / 'messages'
    if messages.exists():
        messages.rename(folder / 'messages')
        for built in ('build', 'install', 'log'):
            shutil.rmtree(folder / built, ignore_errors=True)
        messages.parent.mkdir(parents=True)
        (folder / 'messages').rename(messages)


@pytest.fixture(scope='module', params=['plain', 'symlink'])
def workspace(request, sources):
    """Build the package in a separate workspace; return (mode, workspace, environment)."""
    # The second mode finds the messages built. From nothing, `make setup` has built them so.
    keep_the_messages_only(sources)
    # Without optimization the compiler takes a quarter less time.
    environment = dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST',
                       CMAKE_BUILD_TYPE='None')
    # No setup file announces the prefix of the wheels; a sourced ROS 2 is already announced.
    for name, place in (('AMENT_PREFIX_PATH', sys.prefix), ('CMAKE_PREFIX_PATH', sys.prefix),
                        ('PATH', Path(sys.prefix, 'bin'))):
        environment[name] = os.pathsep.join(filter(None, [environment.get(name), str(place)][::(
            -1 if name == 'PATH' else 1)]))
    command = [sys.executable, '-c',
               'import sys; from colcon_core.command import main; sys.exit(main())', 'build',
               '--event-handlers', 'console_direct+']
    if request.param == 'symlink':
        command.append('--symlink-install')
    if importlib.util.find_spec('colcon_override_check'):
        command += ['--allow-overriding', 'ballbot_ros']
    run(*command, cwd=sources, env=environment)
    return request.param, sources, environment


def sourced(workspace, *command):
    """Run a command in the sourced workspace."""
    _, folder, environment = workspace
    return run(*SOURCED, *command, cwd=folder, env=environment)


def prefix(workspace):
    """Return the install prefix of the package."""
    return workspace[1] / 'install' / 'ballbot_ros'


@pytest.mark.slow
def test_ros2_run_finds_all_executables(workspace):
    places = {path.name: path for path in (prefix(workspace) / 'lib' / 'ballbot_ros').iterdir()}
    assert NODES | {'ballbot'} <= set(places)
    assert all(os.access(path, os.X_OK) for path in places.values())


@pytest.mark.slow
def test_ballbot_is_a_plain_command_once_sourced(workspace):
    found = sourced(workspace, 'bash', '-c', 'command -v ballbot').strip()
    assert found == str(prefix(workspace) / 'bin' / 'ballbot')
    assert 'usage' in sourced(workspace, 'ballbot', '--help').lower()


@pytest.mark.slow
def test_each_node_starts_and_stops(workspace, tmp_path):
    # All in parallel, each in its own domain. Interpreted, because the first compilation in a
    # new workspace takes half a minute and is not tested here.
    _, folder, environment = workspace
    started = {}

    def said(name):
        return (tmp_path / name).read_text()
    try:
        for i, name in enumerate(sorted(NODES)):
            with (tmp_path / name).open('w') as log:
                started[name] = subprocess.Popen(
                    [*SOURCED, prefix(workspace) / 'lib' / 'ballbot_ros' / name], cwd=folder,
                    stdout=log, stderr=subprocess.STDOUT,
                    env={**environment, 'ROS_DOMAIN_ID': str(60 + i), 'BALLBOT_UNCOMPILED': '1'})
        end = time.monotonic() + 60.0  # two seconds on an idle machine
        for name, node in started.items():
            while 'running with' not in said(name):
                assert node.poll() is None and time.monotonic() < end, said(name)
                time.sleep(0.02)
        time.sleep(1.0)  # the exit code reports errors of the first periods
        for name, node in started.items():
            assert node.poll() is None, said(name)
            node.send_signal(signal.SIGINT)  # as Ctrl-C does
        for name, node in started.items():
            assert node.wait(30.0) == 0, said(name)
    finally:
        for node in started.values():
            node.kill()
            node.wait()


@pytest.mark.slow
@pytest.mark.parametrize('folder', ['config', 'launch', 'rviz', 'foxglove', 'plotjuggler'])
def test_config_and_launch_files_keep_their_folders(workspace, folder):
    installed = prefix(workspace) / 'share' / 'ballbot_ros' / folder
    assert files_below(installed) == files_below(ROOT / folder)


@pytest.mark.slow
def test_the_messages_import_and_serialise(workspace):
    said = sourced(workspace, sys.executable, '-c', (
        'import ballbot_ros.action, ballbot_ros.msg, ballbot_ros.srv\n'
        'from ballbot_ros.msg import BallState, Contact\n'
        'from rclpy.serialization import deserialize_message, serialize_message\n'
        'sent = BallState(x=1.5, contacts=[Contact(kind=Contact.KIND_EDGE)])\n'
        'got = deserialize_message(serialize_message(sent), BallState)\n'
        'assert got == sent\n'
        'print(ballbot_ros.msg.__file__)'))
    assert said.strip().startswith(str(prefix(workspace)))


@pytest.mark.slow
def test_the_interface_files_are_where_ros2_interface_reads_them(workspace):
    for source in [*ROOT.glob('msg/*.msg'), *ROOT.glob('srv/*.srv'),
                   *ROOT.glob('action/*.action')]:
        installed = prefix(workspace) / 'share' / 'ballbot_ros' / source.relative_to(ROOT)
        assert installed.read_text() == source.read_text()


@pytest.mark.slow
def test_only_a_symlink_install_runs_the_sources_themselves(workspace):
    mode, folder, _ = workspace
    said = sourced(workspace, sys.executable, '-c', (
        'import os, ballbot_ros; print(os.path.realpath(ballbot_ros.__file__))'))
    home = folder / 'src' if mode == 'symlink' else prefix(workspace)
    assert said.strip().startswith(str(home))


@pytest.mark.slow
def test_the_build_does_not_change_the_sources(workspace):
    built = files_below(workspace[1] / 'src' / 'ballbot_ros')
    assert not [name for name in built if not (ROOT / name).exists()]


@pytest.mark.slow
def test_a_cpp_package_finds_and_uses_the_messages(workspace, tmp_path):
    for name, text in CONSUMER.items():
        (tmp_path / name).write_text(text)
    said = sourced(workspace, 'cmake', '-S', tmp_path, '-B', tmp_path / 'build')
    assert f'found in {prefix(workspace)}' in said
    run('cmake', '--build', tmp_path / 'build', env=workspace[2])
    assert 'decision: 2' in sourced(workspace, tmp_path / 'build' / 'consumer')


@pytest.mark.slow
def test_without_ros_pip_installs_everything_except_the_messages(tmp_path):
    for module in ('pip', 'setuptools', 'wheel'):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f'{module} is not installed')
    source = copy_project(tmp_path / 'source')
    environment = {name: text for name, text in os.environ.items()
                   if name not in ('AMENT_PREFIX_PATH', 'CMAKE_PREFIX_PATH')}
    # pip never installs nodes on the path: rclpy may be missing, and a command named "bridge"
    # is ambiguous.
    target = tmp_path / 'prefix'
    run(sys.executable, '-m', 'pip', 'install', '--no-deps', '--no-build-isolation',
        '--no-index', '--ignore-installed', '--prefix', target, source, env=environment)
    assert files_below(target / 'share' / 'ballbot_ros' / 'config') == files_below(ROOT / 'config')
    (package,) = target.glob('lib/python*/site-packages/ballbot_ros')
    assert not (package / 'msg').exists()
    assert files_below(package) == files_below(ROOT / 'ballbot_ros')
    assert [path.name for path in (target / 'bin').iterdir()] == ['ballbot']
    assert os.access(target / 'bin' / 'ballbot', os.X_OK)
