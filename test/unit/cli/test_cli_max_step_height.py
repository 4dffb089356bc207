# SPDX-License-Identifier: Apache-2.0
"""``ballbot max-step-height`` prints heights with errors as a table or as JSON."""
import json
import math

import pytest

from ballbot_ros.cli import main
from ballbot_ros.config.files import find_config
from ballbot_ros.crossing import held_at, max_step_height, rolling, Rules, Site
from ballbot_ros.physics import Actuation, load_robot

GIMBALL = load_robot('gimball')


def answer(capsys, *words):
    """Return the parsed output of --json."""
    assert main(['max-step-height', '--json', *words]) == 0
    out, err = capsys.readouterr()
    assert err == ''
    return json.loads(out)


def test_json_is_a_list_of_speed_height_and_error_in_si(capsys):
    found = answer(capsys, '--speed', '0.4:0.6:3', '1.2', '--robot', 'gimball')
    assert [item['speed'] for item in found] == [0.4, 0.5, 0.6, 1.2]
    for item in found:
        assert item['max_height'] == max_step_height(GIMBALL, item['speed']).height
        assert 0.0 < item['error'] <= 5e-5 and item['monotone'] is True


@pytest.mark.parametrize('words, actuation, rest', [
    (['--actuation', 'held', '--angle-deg', '90'], held_at(math.pi / 2), {}),
    (['--actuation', 'held'], held_at(0.0), {}),
    (['--actuation', 'velocity', '--attempts', 'any'], rolling(GIMBALL)(0.3),
     {'rules': Rules('any')}),
    (['--over', 'clear', '--clearance', '0.5', '--slope-behind-deg', '3'], Actuation(),
     {'site': Site(0.0, math.radians(3.0)), 'rules': Rules(over='clear', clearance=0.5)}),
    (['--actuation', 'velocity', '--slope-before-deg', '-5', '--slope-behind-deg', '3'],
     rolling(GIMBALL)(0.3), {'site': Site(math.radians(-5.0), math.radians(3.0))}),
    (['--actuation', 'velocity', '--friction-before', '0.4', '--friction-edge', '0.3',
      '--friction-behind', '0.2'], rolling(GIMBALL)(0.3),
     {'site': Site(0.0, 0.0, 0.4, 0.3, 0.2)})])
def test_the_options_are_passed_to_the_search(capsys, words, actuation, rest):
    found, = answer(capsys, '--speed', '0.3', '--scan', '0', '--accuracy', '1e-5', *words)
    assert found['max_height'] == max_step_height(
        GIMBALL, 0.3, actuation, accuracy=1e-5, **rest).height


def test_a_robot_may_be_a_file(capsys, tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text(find_config('robots', 'gimball').read_text())
    assert answer(capsys, '--robot', str(path), '--speed', '0.6') \
        == answer(capsys, '--speed', '0.6')


def test_the_table_is_in_millimetres_and_shows_the_uncertainty(capsys):
    words = ['--robot', 'shellball', '--attempts', 'any', '--speed', '3']
    assert main(['max-step-height', *words]) == 0
    out, _ = capsys.readouterr()
    assert 'mm' in out and 'not monotone' in out
    assert main(['max-step-height', '--speed', '0.6']) == 0
    out, _ = capsys.readouterr()
    assert '20.0' in out and 'not monotone' not in out


@pytest.mark.parametrize('words, reason, field', [
    (['--speed', 'fast'], 'wrong_type', '--speed'), (['--speed', 'nan'], 'wrong_type', '--speed'),
    (['--speed', '0.1:0.2'], 'missing', '--speed'),
    (['--speed', '1:0.5:6'], 'inconsistent', '--speed'),
    (['--speed', '0.2:1.2:0.05'], 'out_of_range', '--speed'),
    (['--speed', '-1'], 'out_of_range', 'speed'),
    (['--speed', '1', '--angle-deg', '5'], 'inconsistent', '--angle-deg'),
    (['--speed', '1', '--actuation', 'held', '--angle-deg', '190'], 'out_of_range',
     '--angle-deg'),
    (['--speed', '1', '--voltage', '5'], 'inconsistent', '--voltage'),
    (['--speed', '1', '--slope-before-deg', '85'], 'out_of_range', '--slope-before-deg'),
    (['--speed', '1', '--friction-edge', '-1'], 'out_of_range', 'friction_edge'),
    (['--speed', '1', '--accuracy', '0'], 'out_of_range', 'accuracy'),
    (['--speed', '1', '--clearance', '0.5'], 'inconsistent', '--clearance'),
    (['--speed', '1', '--over', 'clear', '--clearance', '0'], 'out_of_range', 'clearance'),
    (['--speed', '1', '--robot', 'gimbal'], 'unknown_name', 'robot'),
    (['--speed', '1', '--robot', 'shellball', '--actuation', 'held'], 'missing', 'law'),
    (['--speed', '3', '--actuation', 'voltage'], 'out_of_range', 'voltage'),
    ([], 'usage', '--speed')])
def test_an_invalid_option_is_refused(refuses, words, reason, field):
    refuses(reason, field, 'max-step-height', *words)


def test_a_failed_simulation_has_exit_code_1(capsys):
    assert main(['max-step-height', '--speed', '100', '--scan', '0']) == 1
    assert 'ballbot: error: simulation stopped' in capsys.readouterr().err
