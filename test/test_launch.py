# SPDX-License-Identifier: Apache-2.0
"""
The processes and arguments of the launch files.

No wheel of launch_ros exists: most of the tests need an installed ROS 2.
"""
import ast
from importlib import import_module
from pathlib import Path
import runpy

import pytest
from refusals import refused

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli.run import NODES
from ballbot_ros.nodes.bridge.settings import BridgeSettings
from ballbot_ros.nodes.controller.settings import ControllerSettings
from ballbot_ros.nodes.imu.node import ImuSettings
from ballbot_ros.nodes.navigator.settings import NavigatorSettings
from ballbot_ros.nodes.obstacle_decision.settings import DecisionSettings
from ballbot_ros.nodes.simulator.settings import SimulatorSettings

ROOT = Path(__file__).resolve().parent.parent
LAUNCH_FILES = sorted(ROOT.glob('launch/*.launch.py'))


def started(path):
    """Yield (executable, names of parameters) of the nodes that a launch file starts."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and getattr(node.func, 'attr', '') == 'node':
            executable, parameters = node.args
            yield executable.value, {key.value for key in parameters.keys if key is not None}


@pytest.mark.parametrize(
    'path', [*LAUNCH_FILES, ROOT / 'ballbot_ros' / 'ros' / 'launching.py'], ids=lambda p: p.stem)
def test_launch_files_use_existing_nodes_and_parameters(path):
    known = {'bridge': BridgeSettings, 'simulator': SimulatorSettings,
             'controller': ControllerSettings, 'obstacle_decision': DecisionSettings,
             'imu': ImuSettings, 'navigator': NavigatorSettings}
    nodes = list(started(path))
    assert nodes or path.stem in ('record.launch', 'two_robots.launch')
    for executable, names in nodes:
        assert executable in NODES
        assert names <= {*known[executable].described(), 'use_sim_time'}


def process_actions(path, **arguments):
    """Return the process actions of a launch file, without executing them."""
    pytest.importorskip('launch_ros')
    from launch import LaunchContext
    from launch.actions import ExecuteProcess
    context = LaunchContext()
    context.launch_configurations.update(arguments)
    waiting, found = [runpy.run_path(str(path))['generate_launch_description']()], []
    while waiting:
        entity = waiting.pop(0)
        if isinstance(entity, ExecuteProcess):
            found.append(entity)
        else:
            waiting = [*(entity.visit(context) or []), *waiting]
    return found


@pytest.fixture
def installed(monkeypatch):
    """Return the modifiable set of packages that the launch files find installed."""
    launching = pytest.importorskip('launch_ros') and import_module('ballbot_ros.ros.launching')
    packages = {'robot_state_publisher'}

    def prefix(name):
        if name not in packages:
            raise launching.PackageNotFoundError(name)
        return '/opt'
    monkeypatch.setattr(launching, 'get_package_prefix', prefix)
    return packages


ROBOT_FILES = [path for path in LAUNCH_FILES if 'record' not in path.name]


@pytest.mark.parametrize('path', ROBOT_FILES, ids=lambda p: p.stem)
def test_launch_files_start_robot_state_publisher_and_end_with_their_nodes(path, installed):
    nodes = process_actions(path)
    assert 'robot_state_publisher' in [node.node_executable for node in nodes]
    for node in nodes:
        ends = bool(node._ExecuteLocal__on_exit)
        assert ends is (node.node_package == 'ballbot_ros')


@pytest.mark.parametrize('path', ROBOT_FILES, ids=lambda p: p.stem)
def test_a_missing_robot_state_publisher_is_reported_unless_disabled(path, installed):
    installed.clear()
    with refused('not_installed', 'robot_state_publisher'):
        process_actions(path)
    nodes = process_actions(path, robot_state_publisher='false')
    assert nodes and all(node.node_package == 'ballbot_ros' for node in nodes)
    described = [parameters['publish_description'] for node in nodes
                 for parameters in [parameters_of(node)] if 'publish_description' in parameters]
    assert described and all(described)


def parameters_of(node):
    """Return the parameters of a node without parameter files."""
    found = {}
    for mapping in node._Node__parameters:
        if isinstance(mapping, dict):
            found.update({key[0].text: value for key, value in mapping.items()})
    return found


def test_two_robots_have_two_simulators_and_six_nodes(installed):
    nodes = process_actions(ROOT / 'launch' / 'two_robots.launch.py')
    simulators = [node for node in nodes if node.node_executable == 'simulator']
    assert len(simulators) == 2 and len(nodes) == 6


def test_the_robot_is_that_of_the_scene_or_of_the_hardware_file_unless_one_is_named():
    pytest.importorskip('launch_ros')
    from ballbot_ros.ros.launching import Given
    from launch import LaunchContext
    context = LaunchContext()
    context.launch_configurations.update(
        robot='', scene='shellball_drop', hardware='gimball_odrive')
    assert Given(context).robot(real=False) == 'shellball'
    assert Given(context).robot(real=True) == 'gimball'
    context.launch_configurations['robot'] = 'mine.yaml'
    assert Given(context).robot(real=False) == 'mine.yaml'


def test_in_direct_control_the_controller_has_the_rate_of_the_hardware_file(installed):
    nodes = process_actions(ROOT / 'launch' / 'hardware.launch.py', control='direct')
    controller, = (node for node in nodes if node.node_executable == 'controller')
    assert parameters_of(controller)['rate'] == load_hardware(
        'gimball_odrive').connection.loop_rate


def test_all_topics_can_be_recorded():
    recorder, = process_actions(ROOT / 'launch' / 'record.launch.py', namespace='left')
    words = [part[0].text for part in recorder.cmd]
    assert {'/tf', '/clock', '/left/odom', '/left/markers'} <= set(words)


@pytest.mark.parametrize('name, value, reason', [
    ('rviz', 'perhaps', 'wrong_type'), ('terrain_rate', 'often', 'wrong_type'),
    ('params_file', '/nowhere.yaml', 'missing')])
def test_an_invalid_launch_argument_is_named(name, value, reason, installed):
    with refused(reason, name):
        process_actions(ROOT / 'launch' / 'sim.launch.py', **{name: value})


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda p: p.stem)
def test_launch_arguments_are_described_and_their_defaults_exist(path):
    pytest.importorskip('launch_ros')
    from launch import LaunchContext
    from launch.utilities import perform_substitutions
    description = runpy.run_path(str(path))['generate_launch_description']()
    arguments = {argument.name: argument for argument in description.get_launch_arguments()}
    assert all(argument.description for argument in arguments.values())
    for name, folder in (('robot', 'robots'), ('scene', 'scenes'), ('hardware', 'hardware'),
                         ('tuning', 'tunings'), ('floor', 'floors')):
        if name in arguments:
            default = perform_substitutions(LaunchContext(), arguments[name].default_value)
            assert name in ('robot', 'floor') and not default or (
                ROOT / 'config' / folder / f'{default}.yaml').exists()
