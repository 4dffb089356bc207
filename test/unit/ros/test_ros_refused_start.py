# SPDX-License-Identifier: Apache-2.0
"""Parameters, files and command lines with which a node does not start."""
import math
import signal

import pytest
from refusals import refused

from ballbot_ros.config.files import find_config
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.nodes.controller.node import Controller
from ballbot_ros.nodes.obstacle_decision.node import ObstacleDecision
from ballbot_ros.nodes.simulator.node import Simulator
from ballbot_ros.ros.run import EXIT_REFUSED, run, run_together, STRAY_ARGUMENT

FILES = {
    'scene.yaml': 'robot: gimball\nterrain:\n  - step: {hight: 0.03}\nduration: 1.0\n',
    'curve.yaml': 'name: broken\nrobot: gimball\nactuation: none\nsource: none\n'
                  'lowest_speed: 0.2\nhighest_speed: 1.2\nresidual: 0.001\n'
                  'coefficients: [0.0, 0.1]\n',
    'tuning.yaml': 'position_kp: 40.0\nposition_kq: 10.0\n',
    'not_yaml.yaml': 'robot: [gimball\n',
    'boldness.yaml': 'highest_speed: -1.1\n',
}


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Write the malformed files, and change to their folder."""
    gimball = find_config('robots', 'gimball').read_text()
    for name, content in {
            **FILES, 'heavier.yaml': gimball.replace('value: 3.8,', 'value: 3.9,'),
            'negative.yaml': gimball.replace('value: 3.8,', 'value: -3.8,')}.items():
        (tmp_path / name).write_text(content)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize('cls, parameters, reason, field', [
    (Simulator, {'clock_rte': 100.0}, 'unknown_name', 'clock_rte'),
    (Controller, {'tunings': 'gentle'}, 'unknown_name', 'tunings'),
    (ObstacleDecision, {'zzz': 1}, 'unknown_name', 'zzz'),
    (Simulator, {'lockstep': 1}, 'wrong_type', 'lockstep'),
    (Controller, {'rate': 'fast'}, 'wrong_type', 'rate'),
    (ObstacleDecision, {'curve': 5}, 'wrong_type', 'curve'),
    (Simulator, {'clock_rate': 3e4}, 'out_of_range', 'clock_rate'),
    (Controller, {'delay': 11}, 'out_of_range', 'delay'),
    (Simulator, {'physics_step': math.nan}, 'not_finite', 'physics_step'),
    (Controller, {'torque_limit': math.inf}, 'not_finite', 'torque_limit'),
    (Simulator, {'method': 'rk5'}, 'not_a_choice', 'method'),
    (ObstacleDecision, {'robot': 'gimbal'}, 'unknown_name', 'robot'),
    (ObstacleDecision, {'tuning': 'bold'}, 'unknown_name', 'tuning'),
    (ObstacleDecision, {'tuning': './none.yaml'}, 'missing', 'tuning'),
    (Controller, {'rate': 100}, 'unstable', 'rate'),
    (Controller, {'robot': 'shellball'}, 'inconsistent', 'pendulum_mass'),
    (ObstacleDecision, {'curve': 'shellball_free'}, 'inconsistent', 'curve'),
    (ObstacleDecision, {'robot': 'heavier.yaml'}, 'inconsistent', 'curve'),
    (Simulator, {'odom_rate': 300.0}, 'inconsistent', 'odom_rate'),
    (Simulator, {'control': 'onboard', 'lockstep': True}, 'inconsistent', 'control'),
    (Simulator, {'control': 'onboard', 'joint_state_rate': 300.0}, 'inconsistent',
     'joint_state_rate'),
    (Simulator, {'scene': 'scene.yaml'}, 'unknown_name', 'hight'),
    (Simulator, {'scene': 'not_yaml.yaml'}, 'unreadable', 'not_yaml.yaml'),
    (Controller, {'tuning': 'tuning.yaml'}, 'unknown_name', 'position_kq'),
    (Controller, {'robot': 'negative.yaml'}, 'out_of_range', 'ball_mass'),
    (ObstacleDecision, {'curve': 'curve.yaml'}, 'wrong_type', 'coefficients'),
    (ObstacleDecision, {'tuning': 'boldness.yaml'}, 'out_of_range', 'highest_speed')])
def test_invalid_parameters_and_files_are_refused(
        make_node, files, cls, parameters, reason, field):
    with refused(reason, field):
        make_node(cls, **parameters)


@pytest.fixture
def handlers_restored():
    """Restore the signal handlers that `run` replaces."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize('words, stray', [
    (['--ros-args', '-p', 'rate'], False),
    (['--ros-args', '--params-file', 'none.yaml'], False),
    (['--ros-args', '--params-file', 'not_yaml.yaml'], False),
    (['--ros-args', '--colour', 'red'], True),
    (['robot:=gimball'], True),
    (['--ros-args', '-r', '__node:=x', '--', '--rate', '5'], True),
    (['-p', 'robot:=gimball'], True),
    (['--ros-args', '-p', 'robot:=gimball', 'rate'], True)])
def test_a_malformed_command_line_is_refused_before_a_node_is_made(
        files, handlers_restored, capsys, words, stray):
    assert run(lambda: pytest.fail('the node was made'), words) == EXIT_REFUSED
    last = capsys.readouterr().err.splitlines()[-1]  # rcl logs its own lines first
    assert last.startswith('cannot start: ') and words[-1] in last
    assert (STRAY_ARGUMENT in last) is stray


def test_a_parameter_without_a_value_is_refused_with_the_remedy(handlers_restored, capsys):
    assert run(lambda: pytest.fail('the node was made'),
               ['--ros-args', '-p', 'frame_prefix:=']) == EXIT_REFUSED
    printed = capsys.readouterr().err
    assert 'frame_prefix:=' in printed and 'an empty text is given' in printed


@pytest.mark.parametrize('nodes, word, hinted', [
    (2, 'scene:=doorstep', True), (2, 'controller:scene:=doorstep', False),
    (1, 'scene:=doorstep', False)])
def test_a_parameter_given_to_several_nodes_and_unknown_to_one_is_refused_with_the_remedy(
        handlers_restored, capfd, nodes, word, hinted):
    def refusing():
        raise ConfigurationError('not a parameter', 'unknown_name', 'scene')
    assert run_together([refusing] * nodes, ['--ros-args', '-p', word]) == EXIT_REFUSED
    assert ('-p NODE:scene:=VALUE' in capfd.readouterr().err) is hinted
