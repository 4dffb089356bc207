# SPDX-License-Identifier: Apache-2.0
"""Templates load as written, and document every key."""
from dataclasses import fields
import re
import shlex

import numpy as np
from PIL import Image
import pytest
import yaml

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli import file_kinds
from ballbot_ros.cli.command import main, VERBS
from ballbot_ros.cli.new import KINDS
from ballbot_ros.control import ControlTuning, load_tuning
from ballbot_ros.crossing import max_step_height
from ballbot_ros.decision import DecisionTuning, load_decision_tuning
from ballbot_ros.drives import DRIVES
from ballbot_ros.floors import load_floor
from ballbot_ros.floors.floor import AREAS, LINES
from ballbot_ros.physics import load_robot, load_scene

LOADERS = {'robot': load_robot, 'scene': load_scene, 'hardware': load_hardware,
           'tuning': load_tuning, 'floor': load_floor, 'decision': load_decision_tuning}


@pytest.mark.parametrize('kind', LOADERS)
def test_a_template_loads_as_written(kind, tmp_path, capsys):
    path = tmp_path / 'mine.yaml'
    assert main(['new', kind, str(path)]) == 0
    loaded = LOADERS[kind](str(path))
    assert getattr(loaded, 'name', 'mine') == 'mine'
    assert str(path) in capsys.readouterr().out


def test_the_template_of_an_experiment_is_valid(tmp_path):
    pytest.importorskip('rclpy')
    from ballbot_ros.experiments.file import load_experiment
    path = tmp_path / 'mine.yaml'
    assert main(['new', 'experiment', str(path), '--scene', 'flat']) == 0
    plan = load_experiment(path)
    assert plan.scene == 'flat' and plan.seeds == [0, 1, 2]


def test_the_printed_command_accepts_a_path_with_spaces(tmp_path, capsys):
    path = tmp_path / 'my robot.yaml'
    main(['new', 'robot', str(path)])
    command = capsys.readouterr().out.partition(' then run: ')[2]
    assert shlex.split(command) == ['ballbot', 'robots', str(path)]


@pytest.mark.parametrize('kind, option', [
    ('scene', 'robot'), ('hardware', 'robot'), ('experiment', 'scene')])
def test_a_template_in_another_folder_refers_to_the_given_file(
        kind, option, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(['new', 'robot', 'my_robot.yaml'])
    main(['new', 'scene', 'my_scene.yaml', '--robot', 'my_robot.yaml'])
    assert main(['new', kind, 'mine/file.yaml', f'--{option}', f'my_{option}.yaml']) == 0
    monkeypatch.chdir('/')
    path = tmp_path / 'mine' / 'file.yaml'
    if kind == 'experiment':
        pytest.importorskip('rclpy')
        from ballbot_ros.experiments.file import load_experiment
        path = load_experiment(path).scene
    robot = load_robot(load_hardware(path).robot) if kind == 'hardware' \
        else load_scene(path).model.robot
    assert robot.name == 'my_robot'


@pytest.mark.parametrize('protocol', sorted(DRIVES))
def test_the_template_of_hardware_matches_its_drive(protocol, tmp_path):
    path = tmp_path / 'mine.yaml'
    assert main(['new', 'hardware', str(path), '--protocol', protocol]) == 0
    mine = load_hardware(str(path))
    assert mine.connection.protocol == protocol
    assert mine.options().torque_limit > 0.0


def test_the_help_of_the_command_lists_the_kinds_of_templates():
    _, what = VERBS['new']
    assert all(kind in what for kind in KINDS)


def test_a_template_has_the_parameters_of_its_base_robot(tmp_path):
    path = tmp_path / 'mine.yaml'
    assert main(['new', 'robot', str(path), '--robot', 'shellball']) == 0
    assert load_robot(str(path)).digest == load_robot('shellball').digest


def test_every_commented_line_is_valid_without_its_comment_mark(tmp_path):
    """Every key of the file must be valid."""
    for kind, cls in (('tuning', ControlTuning), ('decision', DecisionTuning)):
        keys = {key for part in file_kinds.KINDS[kind]('x') for key in part.keys}
        assert keys == {item.name for item in fields(cls)}
    path = tmp_path / 'mine.yaml'
    assert main(['new', 'scene', str(path)]) == 0
    text = path.read_text().replace('# solver:', 'solver:').replace('#   method', '  method')
    text = text.replace('  # friction_ramp', '  friction_ramp')
    assert yaml.safe_load(text)['solver'] == {'method': 'rk4'}
    path.write_text(text)
    assert load_scene(str(path)).model.solver.method == 'rk4'


@pytest.mark.parametrize('words, reason, field', [
    (['robot', 'mine.txt'], 'not_a_choice', 'FILE'),
    (['robot', 'mine.yaml', '--protocol', 'vesc'], 'inconsistent', '--protocol'),
    (['scene', 'mine.yaml', '--robot', 'gimbal'], 'unknown_name', 'robot'),
    (['hardware', 'mine.yaml', '--protocol', 'vsec'], 'not_a_choice', '--protocol'),
    (['robots', 'mine.yaml'], 'usage', '')])
def test_an_invalid_value_is_refused(words, reason, field, tmp_path, monkeypatch, refuses):
    monkeypatch.chdir(tmp_path)
    refuses(reason, field, 'new', *words)
    assert not list(tmp_path.iterdir())


def test_an_existing_file_is_kept(tmp_path, capsys):
    path = tmp_path / 'mine.yaml'
    path.write_text('mine')
    assert main(['new', 'robot', str(path)]) == 2 and '--overwrite' in capsys.readouterr().err
    assert path.read_text() == 'mine'
    assert main(['new', 'robot', str(path), '--overwrite']) == 0
    assert load_robot(str(path)).name == 'mine'


def test_the_scaling_rules_in_the_template_of_a_robot_give_a_similar_motion(tmp_path):
    path = tmp_path / 'mine.yaml'
    assert main(['new', 'robot', str(path)]) == 0
    head = ' '.join(path.read_text().replace('#', ' ').split())
    powers = {'lengths': 1.0, 'masses': 3.0, 'inertias': 5.0, 'contact_stiffness': 2.0,
              'contact_damping': 2.5, 'joint_friction': 4.5, 'slip_threshold': 0.5}
    for words, power in powers.items():
        assert re.search(rf'{words}( larger)? by s(\^{power:g})?[ ,.]', head), words
    robot, scale = load_robot(str(path)), 0.5
    fields = {
        'lengths': ('ball_radius', 'pendulum_length'), 'masses': ('ball_mass', 'pendulum_mass'),
        'inertias': ('ball_inertia', 'pendulum_inertia'), 'joint_friction': (
            'joint_friction', 'rolling_friction')}
    small = robot.replace(**{
        name: getattr(robot, name) * scale**power for words, power in powers.items()
        for name in fields.get(words, (words,))})
    height = max_step_height(robot, 0.6, scan=0).height
    assert max_step_height(small, 0.6 * scale**0.5, scan=0).height \
        == pytest.approx(scale * height, abs=1e-4)


def test_each_line_of_the_template_of_a_floor_is_valid(tmp_path):
    path = tmp_path / 'two_rooms.yaml'
    assert main(['new', 'floor', str(path)]) == 0
    lines = path.read_text().split('\n')
    # All features and heights together; a map would replace the walls.
    lines = [re.sub(r'^(\s*)# (?=- \{|   line|heights:|  [a-z]+: )', r'\1', line)
             for line in lines]
    Image.fromarray(np.zeros((4, 4), np.uint16)).save(tmp_path / 'heights.png')
    path.write_text('\n'.join(lines))
    floor = load_floor(path)
    assert {feature.kind for feature in floor.features} == {*LINES, *AREAS}
    assert floor.heights is not None and floor.start[:2] == (1.0, 1.0)


@pytest.mark.parametrize('kind, option', [('experiment', '--scene'), ('scene', '--robot')])
def test_a_file_that_is_not_yaml_makes_no_template(kind, option, tmp_path, refusal):
    (tmp_path / 'binary.yaml').write_bytes(b'\x00\xff')
    error = refusal('new', kind, tmp_path / 'mine.yaml', option, tmp_path / 'binary.yaml')
    assert error.reason == 'unreadable'
    assert not (tmp_path / 'mine.yaml').exists()
