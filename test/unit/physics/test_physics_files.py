# SPDX-License-Identifier: Apache-2.0
"""Errors about malformed robot and scene files name the location, value and allowed values."""
import math
from pathlib import Path
import re

import numpy as np
import pytest
from refusals import refused
import yaml

from ballbot_ros.config.fields import SOURCES
from ballbot_ros.config.files import shipped_files, shipped_folder
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import (
    Actuation, ContactOptions, load_robot, load_scene, Robot, Solver, Terrain)
from ballbot_ros.physics.model.terrain import PIECES, read_terrain

ROBOT = (shipped_folder('config') / 'robots' / 'gimball.yaml').read_text(encoding='utf-8')
SCENE = """\
robot: gimball
terrain:
  - flat: {length: 1.0}
  - step: {height: 0.03}
initial: {x: 0.2, speed: 0.5}
actuation: {law: voltage, voltage: 5.0}
duration: 1.0
"""


def write(folder, text, name='mine.yaml'):
    """Write a file and return its path as text."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def message_of(load, path):
    """Return the error message for a file that must be refused; it must name the file."""
    with pytest.raises(ConfigurationError) as caught:
        load(path)
    assert path in str(caught.value)
    return str(caught.value)


def with_line(name, line):
    """Return the text of the robot file with the entry of a field replaced."""
    text, count = re.subn(rf'(?ms)^{name}:.*?(?=^\S|\Z)', line + '\n', ROBOT)
    assert count == 1, name
    return text


@pytest.mark.parametrize('name, line, words', [
    ('ball_mass', 'ball_mas: 3.8', ["'ball_mas'", "did you mean 'ball_mass'"]),
    ('ball_mass', 'weight: 3.8', ["'weight'", 'known names: ', 'ball_inertia', 'slip_threshold']),
    ('motor', 'motr: {gear_ratio: 50}', ["'motr'", "did you mean 'motor'"]),
    ('motor', 'motor: {gear_ratio: 50}', ['motor: gear_efficiency is missing (torque out',
                                          'maximum_torque is missing']),
    ('ball_mass', '', ['ball_mass is missing', 'mass of the ball', 'more than 0 kg']),
    ('ball_mass', 'ball_mass: -3.8', ['ball_mass', 'more than 0 kg', '-3.8']),
    ('ball_mass', 'ball_mass: 0', ['ball_mass', 'more than 0 kg', 'got 0']),
    ('ball_mass', 'ball_mass: .nan', ['ball_mass', 'more than 0 kg', 'nan']),
    ('ball_mass', 'ball_mass: .inf', ['ball_mass', 'more than 0 kg', 'inf']),
    ('ball_mass', "ball_mass: '3.8'", ['ball_mass', 'must be a number', "'3.8'"]),
    ('ball_mass', 'ball_mass: true', ['ball_mass', 'must be a number', 'True']),
    ('ball_mass', 'ball_mass: [3.8]', ['ball_mass', 'must be a number', '[3.8]']),
    ('ball_mass', 'ball_mass:', ['ball_mass', 'must be a number', 'None']),
    ('ball_mass', 'ball_mass: {value: -1, unit: kg}', ['ball_mass', 'more than 0 kg', '-1']),
    ('ball_mass', 'ball_mass: {value: 3.8, unit: g}', ['ball_mass', "'kg'", "'g'", 'convert']),
    ('ball_mass', 'ball_mass: {unit: kg}', ['ball_mass', 'value is missing', 'mass of the ball']),
    ('ball_mass', 'ball_mass: {value: 3.8, uni: kg}', ["'uni'", "did you mean 'unit'"]),
    ('ball_mass', 'ball_mass: {value: 3.8, source: guessed}',
     ['ball_mass', 'source', "'guessed'", *SOURCES]),
    ('ball_mass', 'ball_mass: {value: 3.8, range: [4, 5]}',
     ['ball_mass', '3.8', 'outside its own range', '[4, 5]']),
    ('ball_mass', 'ball_mass: {value: 3.8, range: [3]}', ['ball_mass', 'range', 'two numbers']),
    ('ball_mass', 'ball_mass: {value: 3.8, range: 4}', ['ball_mass', 'range', 'two numbers']),
    ('ball_mass', 'ball_mass: {value: 3.8, range: [a, 5]}', ['ball_mass', 'range', "'a'"]),
    ('ball_mass', 'ball_mass: {value: 3.8, range: [-1, 5]}', ['ball_mass', 'range', '-1']),
    ('ball_mass', 'ball_mass: 3.8\nball_mass: 3.9', ["'ball_mass' is given twice", 'line']),
    ('surface_friction', 'surface_friction: -0.1', ['surface_friction', 'at least 0', '-0.1']),
    ('slip_threshold', 'slip_threshold: 0', ['slip_threshold', 'more than 0 m/s', 'got 0']),
    ('contact_stiffness', 'contact_stiffness: 0', ['contact_stiffness', 'more than 0 N/m']),
    ('gravity', 'gravity: -9.81', ['gravity', 'at least 0 m/s2', '-9.81']),
    ('pendulum_mass', 'pendulum_mass: 0', ['pendulum_inertia', 'must be 0', 'without a pendulum']),
    ('pendulum_length', 'pendulum_length: 0.3', ['pendulum_length', 'at most', '0.226', '0.3']),
    ('motor', 'motor: 3', ['motor', 'mapping', 'got 3']),
    ('name', 'name: 3', ['name', 'must be text', 'got 3']),
])
def test_malformed_robots_are_refused(tmp_path, name, line, words):
    message = message_of(load_robot, write(tmp_path, with_line(name, line)))
    for word in words:
        assert word in message, message


def test_all_missing_fields_of_a_scene_are_reported_together(tmp_path):
    message = message_of(load_scene, write(tmp_path, 'output_step: 0.01'))
    assert 'duration is missing' in message and 'robot is missing' in message


def test_errors_of_several_terrain_pieces_are_reported_together(tmp_path):
    message = message_of(load_scene, write(
        tmp_path, 'robot: gimball\nduration: 1\nterrain: [step: {}, flat: {length: 1}, cord: {}]'))
    assert 'piece 1 (step): height is missing' in message
    assert 'piece 3 (cord): diameter is missing' in message


@pytest.mark.parametrize('text, words', [
    ('', ['mapping', 'nothing']),
    ('- a\n- b\n', ['mapping', "['a', 'b']"]),
    ('3\n', ['mapping', 'got 3']),
    ('1: 2\n', ['mapping', '{1: 2}']),
    ('{', ['not valid YAML']),
    ('a: b: c', ['not valid YAML']),
    (b'name: \xff\xfe\n', ['cannot be read', 'UTF-8']),
    ('a: !!python/object:os.system {}\n', ['not valid YAML']),
])
@pytest.mark.parametrize('load', [load_robot, load_scene])
def test_files_without_a_valid_mapping_are_refused(tmp_path, load, text, words):
    message = message_of(load, write(tmp_path, text))
    for word in words:
        assert word in message, message


@pytest.mark.parametrize('old, new, words', [
    ('robot: gimball', '', ['robot is missing', 'name or file of a robot']),
    ('robot: gimball', 'robot: 3', ['robot', 'name or the file', 'got 3']),
    ('robot: gimball', 'robot: gimbal', ["'gimbal'", "did you mean 'gimball'", 'ballbot robots']),
    ('robot: gimball', 'robot: gimball\nrobot_changes: {ball_mass: -1}',
     ['robot_changes', 'ball_mass', 'more than 0 kg', '-1']),
    ('robot: gimball', 'robot: gimball\nrobot_changes: {bal_mass: 1}',
     ['robot_changes', "'bal_mass'", "did you mean 'ball_mass'"]),
    ('robot: gimball', 'robot: gimball\nrobot_changes: [1]', ['robot_changes', 'mapping', '[1]']),
    ('robot: gimball', 'robot: shellball', ['actuation', "'voltage'", "'shellball'", "'free'"]),
    ('duration: 1.0', '', ['duration is missing', 'simulated time', 'more than 0']),
    ('duration: 1.0', 'duration: 0', ['duration', 'more than 0', 'got 0']),
    ('duration: 1.0', 'duration: -2', ['duration', 'more than 0', '-2']),
    ('duration: 1.0', 'duration: .inf', ['duration', 'at most 86400 s', 'inf']),
    ('duration: 1.0', 'duration: 1.0 s', ['duration', 'must be a number', "'1.0 s'"]),
    ('duration: 1.0', 'durations: 1.0', ["'durations'", "did you mean 'duration'"]),
    ('duration: 1.0', 'duration: 1.0\noutput_step: 0', ['output_step', 'more than 0 s']),
    ('duration: 1.0', 'duration: 1.0\nsolver: {method: euler}',
     ['solver', 'method', "'euler'", 'rk4', 'semi_implicit']),
    ('duration: 1.0', 'duration: 1.0\nsolver: {step: 1}', ['solver', 'step', 'at most 0.1 s']),
    ('duration: 1.0', 'duration: 1.0\naccuracy: 1.0e-4\nsolver: {method: rk4}',
     ['solver', 'no effect with an accuracy', '0.0001 m']),
    ('duration: 1.0', 'duration: 1.0\nsolver: {step: 0}', ['solver', 'step', 'more than 0']),
    ('duration: 1.0', 'duration: 1.0\ncontact: {pulling: 1}',
     ['contact', 'pulling', 'true or false', 'got 1']),
    ('duration: 1.0', 'duration: 1.0\ncontact: {friction_ramp: cubic}',
     ['contact', 'friction_ramp', 'linear, smooth', "'cubic'"]),
    ('x: 0.2', 'x: far', ['initial', 'x', 'any finite number in m', "'far'"]),
    ('x: 0.2', 'y: .nan', ['initial', 'y', 'any finite number in m', 'nan']),
    ('x: 0.2', 'xx: 0.2', ['initial', "'xx'"]),
    ('voltage: 5.0', 'voltage: 13', ['.yaml: actuation: voltage', '+-12 V', 'got 13']),
    ('voltage: 5.0', 'voltag: 5', ['actuation', "'voltag'", "did you mean 'voltage'"]),
    ('law: voltage, voltage: 5.0', 'law: pd',
     ['actuation', 'law', "'pd'", 'free, position, velocity, voltage, torque']),
    ('law: voltage, voltage: 5.0', 'law: position, set_angle: 90',
     ['actuation', 'set_angle_deg']),
    ('law: voltage, voltage: 5.0', 'law: position, set_angle_deg: level',
     ['actuation', 'set_angle_deg', 'deg', "'level'"]),
    ('law: voltage, voltage: 5.0', 'law: position, set_angle_deg: .nan',
     ['actuation', 'set_angle_deg', 'any finite number in deg', 'nan']),
    ('law: voltage, voltage: 5.0', 'law: velocity, set_speed: 1.0, set_rate: 4.0',
     ['actuation', 'set_speed', 'set_rate', 'not both']),
    ('law: voltage, voltage: 5.0', 'law: velocity, velocity_kp: -1',
     ['actuation', 'velocity_kp', 'at least 0', '-1']),
    ('flat: {length: 1.0}', 'flat: {length: -1.0}',
     ['terrain', 'piece 1 (flat)', 'length', 'more than 0', '-1']),
    ('flat: {length: 1.0}', 'flat: {}', ['terrain', 'piece 1 (flat)', 'length is missing']),
    ('step: {height: 0.03}', 'threshold: {}',
     ['piece 2 (threshold): height is missing', '; width is missing']),
    ('flat: {length: 1.0}', 'flat: {length: 1.0, widht: 2}', ['piece 1 (flat)', "'widht'"]),
    ('flat: {length: 1.0}', 'flt: {length: 1.0}', ['piece 1', "'flt'", "did you mean 'flat'"]),
    ('flat: {length: 1.0}', 'lake: {length: 1.0}', ['piece 1', "'lake'", *PIECES]),
    ('flat: {length: 1.0}', 'flat', ['piece 1', 'mapping', "'flat'"]),
    ('step: {height: 0.03}', 'step: {height: 0}', ['piece 2 (step)', 'height', 'not be 0']),
    ('step: {height: 0.03}', 'slope: {length: 1, rise: 0.1, angle_deg: 3}',
     ['piece 2 (slope)', 'either rise or angle_deg']),
    ('step: {height: 0.03}', 'slope: {length: 1}', ['piece 2 (slope)', 'either rise or angle']),
    ('step: {height: 0.03}', 'slope: {length: 1, angle_deg: 90}',
     ['piece 2 (slope)', 'angle_deg', 'at most 89', '90']),
    ('step: {height: 0.03}', 'threshold: {height: 0.01, width: 0.02, bevel: 0.01}',
     ['piece 2 (threshold)', 'bevel', '0.02', '0.01']),
    ('step: {height: 0.03}', 'carpet: {thickness: 0.6, length: 1}',
     ['piece 2 (carpet)', 'length', '1.2', 'got 1']),
    ('step: {height: 0.03}', 'flat: {length: 1, friction: -1}', ['friction', 'at least 0', '-1']),
])
def test_malformed_scenes_are_refused(tmp_path, old, new, words):
    assert old in SCENE
    message = message_of(load_scene, write(tmp_path, SCENE.replace(old, new)))
    for word in words:
        assert word in message, message


@pytest.mark.parametrize('vertices, words', [
    ([[0, 0], [1, 0], [0.5, 0]], ['vertex 2', '0.5 m behind vertex 1', 'no overhangs']),
    ([[0, 0], [0, 1], [1, 1]], ['first and the last segment', 'vertical', 'segment 0']),
    ([[0, 0], [1, 0], [1, 1]], ['first and the last segment', 'vertical', 'segment 1']),
    ([[0, 0], [1, 0], [1, 0], [2, 0]], ['vertices 1 and 2', 'same point', '[1.0, 0.0]']),
    ([[0, 0]], ['at least two', '(1, 2)']),
    ([0, 1], ['at least two', '(2,)']),
    ([[0, 0], [1, math.nan]], ['vertex 1', 'nan', 'finite']),
    ([[0, 0], [math.inf, 0]], ['vertex 1', 'inf', 'finite']),
    ([[0, 0], [1]], ['vertices must hold numbers']),
    ([[0, 0], ['a', 0]], ['vertices must hold numbers', 'a']),
])
def test_malformed_profiles_are_refused(vertices, words):
    for make in (Terrain, lambda points: read_terrain({'vertices': points}, 'here: terrain')):
        with pytest.raises(ConfigurationError) as caught:
            make(vertices)
        for word in ['terrain', *words]:
            assert word in str(caught.value)


@pytest.mark.parametrize('name, values, words', [
    ('surface_friction', [0.1], ['2 entries', '(1,)']),
    ('edge_friction', [0.1, 0.2], ['3 entries', '(2,)']),
    ('surface_friction', [0.1, -0.2], ['at least 0', '-0.2']),
    ('edge_friction', [0.1, math.inf, 0.1], ['finite', 'inf']),
    ('edge_friction', [0.1, 11.0, 0.1], ['at most 10', '11'])])
def test_malformed_frictions_of_a_profile_are_refused(name, values, words):
    with pytest.raises(ConfigurationError) as caught:
        Terrain([[0, 0], [1, 0], [2, 0]], **{name: values})
    for word in [name, *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize('section, reason, field', [
    ({}, 'missing', 'vertices'), ([], 'wrong_type', 'terrain'), (None, 'wrong_type', 'terrain'),
    ({'vertexes': []}, 'unknown_name', 'vertexes'),
    ([{'flat': {'length': 1}, 'step': {'height': 1}}], 'wrong_type', 'terrain')])
def test_malformed_terrain_sections_are_refused(section, reason, field):
    with refused(reason, field):
        read_terrain(section, 'here: terrain')


def test_an_output_step_that_is_not_a_multiple_is_refused(tmp_path):
    path = write(tmp_path, SCENE + 'output_step: 2.5e-4\nsolver: {method: rk4}\n')
    with refused('inconsistent', 'output_step'):
        load_scene(path).simulate()


def test_names_and_paths_that_do_not_exist_are_distinguished(tmp_path):
    with refused('unknown_name', 'scene'):
        load_scene('nowhere')
    with refused('missing', 'scene'):
        load_scene(str(tmp_path / 'nowhere.yaml'))
    with refused('missing', 'robot'):
        load_robot('./gimball')


# What is accepted -------------------------------------------------------------------------

def test_all_fields_of_a_robot_file_are_read(gimball, shellball):
    plain = yaml.safe_load(ROBOT)
    for name, entry in plain.items():
        if isinstance(entry, dict) and 'value' in entry:
            assert getattr(gimball, name) == entry['value']
            assert gimball.provenance[name].source == entry['source']
    assert gimball.total_mass == pytest.approx(5.4, rel=1e-15)
    assert gimball.motor.maximum_voltage == 12.0
    assert gimball.provenance['motor.resistance'].source == 'assumed'
    assert shellball.motor is None and not shellball.has_pendulum


def test_no_parameter_of_the_empty_ball_is_derived_or_assumed(shellball):
    assert {item.source for item in shellball.provenance.values()} == {'published', 'repaired'}


@pytest.mark.parametrize('robot', ['gimball', 'shellball'])
def test_each_parameter_has_a_source_and_each_uncertain_one_a_range(robot):
    robot = load_robot(robot)
    described = {name for name, item in Robot.__dataclass_fields__.items()
                 if item.metadata.get('kind') is float}
    assert described <= set(robot.provenance)
    for name, item in robot.provenance.items():
        assert item.source in SOURCES
        if item.source in ('derived', 'assumed'):
            assert item.low is not None and item.low < item.high, name


def test_plain_numbers_and_exponents_without_a_dot_are_read(tmp_path):
    robot = load_robot(write(tmp_path, with_line('slip_threshold', 'slip_threshold: 1e-3')))
    assert robot.slip_threshold == 1e-3


def test_a_scene_may_change_its_robot(tmp_path):
    text = SCENE.replace('robot: gimball', 'robot: gimball\nrobot_changes: {ball_mass: 4.0}')
    scene = load_scene(write(tmp_path, text))
    assert scene.model.robot.ball_mass == 4.0
    assert 'ball_mass' not in scene.model.robot.provenance
    assert scene.model.robot.motor == load_robot('gimball').motor


def test_actuation_inputs_are_converted_to_si_units(tmp_path):
    text = SCENE.replace('law: voltage, voltage: 5.0', 'law: position, set_angle_deg: 90')
    assert load_scene(write(tmp_path, text)).actuation.set_angle == math.pi / 2
    text = SCENE.replace('law: voltage, voltage: 5.0', 'law: velocity, set_speed: 0.452')
    assert load_scene(write(tmp_path, text)).actuation.set_rate == pytest.approx(2.0, rel=1e-15)


@pytest.mark.parametrize('path', shipped_files('scenes'),
                         ids=lambda path: path.stem)
def test_each_scene_of_the_package_loads_by_name_and_by_path(path):
    by_name, by_path = load_scene(path.stem), load_scene(str(path))
    assert by_name.name == by_path.name == path.stem
    assert by_name.start == by_path.start
    assert by_name.actuation == by_path.actuation


def test_terrain_pieces_are_joined_end_to_end():
    terrain = read_terrain([
        {'flat': {'length': 1.0}}, {'step': {'height': 0.03}},
        {'slope': {'length': 2.0, 'rise': 0.1}}, {'flat': {'length': 0.5, 'friction': 0.5}}], 't')
    assert terrain.vertices.tolist() == [
        [0.0, 0.0], [1.0, 0.0], [1.0, 0.03], [3.0, 0.13], [3.5, 0.13]]
    assert terrain.surface_friction[-1] == 0.5 and np.isnan(terrain.surface_friction[:-1]).all()
    assert terrain.height([0.5, 1.0, 2.0, 9.0]).tolist() == pytest.approx(
        [0.0, 0.03, 0.08, 0.13], rel=1e-12)


def test_round_pieces_have_the_given_height_and_width():
    for piece, width, height in (({'cord': {'diameter': 0.008}}, 0.008, 0.008),
                                 ({'carpet': {'thickness': 0.006, 'length': 1.0}}, 1.0, 0.006)):
        inner = read_terrain([piece], 't').vertices[1:-1]
        assert np.ptp(inner[:, 0]) == pytest.approx(width, rel=1e-12)
        assert inner[:, 1].max() == pytest.approx(height, rel=1e-12)
        assert inner[-1, 1] == pytest.approx(0.0, abs=1e-15)


def test_constructor_arguments_of_checked_classes_are_checked():
    for make, reason, field in (
            (lambda: Solver(step=-1.0), 'out_of_range', 'step'),
            (lambda: Actuation(law='x'), 'not_a_choice', 'law'),
            (lambda: ContactOptions(slip_lever='R'), 'not_a_choice', 'slip_lever'),
            (lambda: Actuation(torque=math.nan), 'not_finite', 'torque')):
        with refused(reason, field):
            make()


def test_the_templates_of_this_file_are_valid(tmp_path):
    # All malformed files above are variations of these two.
    assert load_robot(write(tmp_path, ROBOT)) == load_robot('gimball')
    assert load_scene(write(tmp_path, SCENE)).name == 'mine'
    assert Path(write(tmp_path, SCENE)).is_file()
