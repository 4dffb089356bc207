# SPDX-License-Identifier: Apache-2.0
"""Implausible values cause warnings, as do runs that write gigabytes, before they start."""
import argparse
from dataclasses import replace
import re

import pytest
from refusals import refused

from ballbot_ros.cli import main, simulate
from ballbot_ros.cli.options import read_law
from ballbot_ros.config.files import shipped_folder
from ballbot_ros.errors import ConfigurationError, PlausibilityWarning
from ballbot_ros.physics import load_robot, load_scene
from ballbot_ros.physics.model.robot import implausible
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.results.summary import scene_warnings


def warned(**sections):
    """Return the warnings of a scene of GimBall."""
    scene = read_scene({'robot': 'gimball', 'duration': 1.0, **sections}, 'a', 'a')
    return list(scene_warnings(scene))


@pytest.mark.parametrize('sections, message', [
    ({'terrain': [{'flat': {'length': 1.0}}, {'step': {'height': 31}}]}, '31 mm are 0.031'),
    ({'terrain': [{'flat': {'length': 1.0}}, {'step': {'height': 0.5}}]}, 'higher than the ball'),
    ({'initial': {'speed': 78}}, '281 km/h'),
    ({'initial': {'pendulum_angle_deg': 200}}, '-160 is the same angle'),
    ({'actuation': {'law': 'position', 'set_angle_deg': 120}}, '90 is horizontal')])
def test_implausible_values_cause_warnings(sections, message):
    question, = warned(**sections)
    assert message in question


@pytest.mark.parametrize('name', ['fig7_top', 'fig7_bottom', 'household', 'doorstep'])
def test_shipped_robots_are_plausible(name):
    assert list(scene_warnings(load_scene(name))) == []


@pytest.mark.parametrize('changes, words', [
    ({'ball_inertia': 1800.0}, ['ball_inertia is 1800 kg m2', '1800 kg cm2 would be 0.18 kg m2']),
    ({'ball_inertia': 0.5}, ['above']),
    ({'ball_mass': 1800.0}, ['above that of lead', '1800 g would be 1.8 kg']),
    ({'ball_radius': 226.0}, ['below that of air', '226 mm would be 0.226 m']),
    ({'pendulum_inertia': 350.0}, ['does not fit into the ball', 'g cm2']),
    ({'contact_stiffness': 65.0}, ['of its radius: contact_stiffness is 65 N/m', '65 N/mm']),
    ({'gravity': 9810.0}, ['9810 mm/s2 would be 9.81 m/s2'])])
def test_a_robot_that_contradicts_physics_causes_warnings_in_python(changes, words):
    with pytest.warns(PlausibilityWarning) as warned_about:
        robot = load_robot('gimball').replace(**changes)
    text = '\n'.join(str(item.message) for item in warned_about)
    assert all(word in text for word in words), text
    assert set(text.splitlines()) == set(implausible(robot))


def with_motor(**changes):
    """Return GimBall with a changed motor."""
    gimball = load_robot('gimball')
    return gimball.replace(motor=replace(gimball.motor, **changes))


@pytest.mark.parametrize('changes, words', [
    ({'torque_constant': 25.0}, ['25 mN m/A would be 0.025 N m/A']),
    ({'torque_constant': 2.5}, ['2.5 N cm/A would be 0.025 N m/A']),
    ({'speed_constant': 25.0}, ['25 mV s/rad would be 0.025 V s/rad']),
    ({'speed_constant': 2.618}, ['2.618 V/krpm would be 0.025']),
    ({'speed_constant': 382.0}, ['382 rpm/V would be 0.02499']),
    ({'torque_constant': 25.0, 'speed_constant': 25.0}, ['stall torque', '25 mN m/A']),
    ({'maximum_voltage': 12000.0}, ['2.17e+03 m/s', '12000 mV would be 12 V']),
    ({'maximum_torque': 4000.0}, ['maximum_torque', '4000 mN m would be 4 N m'])])
def test_a_motor_that_contradicts_physics_causes_one_warning_with_the_likely_unit(changes, words):
    with pytest.warns(PlausibilityWarning) as warned_about:
        with_motor(**changes)
    question, = (str(item.message) for item in warned_about)
    assert all(word in question for word in words), question


@pytest.mark.parametrize('changes', [
    {'resistance': 0.003125}, {'gear_ratio': 0.05}, {'speed_constant': 2.5e-5}])
def test_an_implausible_motor_without_a_likely_unit_causes_a_warning(changes):
    with pytest.warns(PlausibilityWarning) as warned_about:
        with_motor(**changes)
    question, = (str(item.message) for item in warned_about)
    name, = changes
    assert name in question and 'would be' not in question


@pytest.mark.parametrize('changes', [
    {'speed_constant': 0.0}, {'speed_constant': 0.0125},
    {'torque_constant': 0.01, 'speed_constant': 0.01, 'resistance': 0.05, 'gear_ratio': 30.0}])
def test_a_motor_without_back_voltage_or_of_another_convention_or_strong_is_plausible(changes):
    assert list(implausible(with_motor(**changes))) == []


@pytest.mark.parametrize('words', [
    ['max-step-height', '--speed', '0.5', '--robot'], ['robots'], ['simulate'],
    ['view', '--no-browser', '--duration', '0.1'],
    ['sweep', '--vary', 'speed=0.5', '--out', 'a.parquet', '--robot'],
    ['fit-curve', '--out', 'a.yaml', '--robot'], ['new', 'robot', 'b.yaml', '--robot'],
    ['test-bench', '--robot']])
def test_a_robot_that_contradicts_physics_causes_warnings_in_every_verb(
        words, tmp_path, monkeypatch, capsys):
    def work(*_, **__):
        raise ConfigurationError('the work begins', 'missing', '')
    for place in ('crossing.max_step_heights', 'studies.curve_fit.fit_curve',
                  'studies.sweep.load_arrow', 'physics.simulation.scene.Scene.simulate',
                  'cli.listing.print_table', 'paper.procedure.run_tests', 'view.page.Page'):
        monkeypatch.setattr(f'ballbot_ros.{place}', work)
    monkeypatch.chdir(tmp_path)
    text = (shipped_folder('config') / 'robots' / 'shellball.yaml').read_text(encoding='utf-8')
    file = 'heavy.yaml'
    (tmp_path / file).write_text(re.sub('ball_mass: {value: 1.1', 'ball_mass: {value: 1100', text))
    if words[0] in ('simulate', 'view'):
        (tmp_path / 'scene.yaml').write_text('robot: ./heavy.yaml\nduration: 0.1\n')
        file = 'scene.yaml'
    main([*words, file])
    err = capsys.readouterr().err
    assert 'Warning: the mean density of robot' in err and '1100 g would be 1.1 kg' in err


@pytest.mark.parametrize('words, message', [
    (['max-step-height', '--speed', '0.5,78'], '--speed is 78 m/s, 281 km/h'),
    (['fit-curve', '--speed', '0.2:78:6', '--out', 'a.yaml'], '--speed is 78 m/s, 281 km/h'),
    (['sweep', '--vary', 'speed=0.5,78', '--out', 'a.parquet'], 'speed is 78 m/s, 281 km/h'),
    (['sweep', '--fix', 'speed=0.5', '--vary', 'height=0.01,31', '--out', 'a.parquet'],
     'the step of 31 m to be tried is higher than the ball')])
def test_implausible_options_cause_warnings_before_the_run(
        words, message, tmp_path, monkeypatch, capsys):
    def work(*_, **__):
        raise ConfigurationError('the work begins', 'missing', '')
    for place in ('crossing.max_step_heights', 'studies.curve_fit.fit_curve',
                  'studies.sweep.load_arrow'):
        monkeypatch.setattr(f'ballbot_ros.{place}', work)
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    asked_first, refused = capsys.readouterr().err.splitlines()
    assert message in asked_first and asked_first.startswith('Warning: ')
    assert 'the work begins' in refused


def test_a_quiet_run_prints_each_warning_once(tmp_path, capsys):
    scene = tmp_path / 'scene.yaml'
    scene.write_text('robot: gimball\nrobot_changes: {ball_mass: 1800, '
                     'contact_stiffness: 3.3e+6}\nduration: 0.01\n')
    assert main(['simulate', str(scene), '--quiet', '--no-figures', '--out', str(tmp_path)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(set(lines)) and any('mean density' in line for line in lines)


def test_a_held_angle_above_horizontal_causes_a_warning():
    def law(angle):
        return read_law(argparse.Namespace(actuation='held', angle_deg=angle, voltage=None))
    with pytest.warns(PlausibilityWarning, match='120'):
        law(120.0)
    law(90.0)


def test_a_run_of_gigabytes_first_warns_and_suggests_a_coarser_step(tmp_path, monkeypatch):
    scene = load_scene('flat')
    long = replace(scene, run=replace(scene.run, duration=86400.0, output_step=0.01))
    monkeypatch.setattr(simulate, 'available_memory', lambda: 10**11)
    with pytest.warns(UserWarning, match=r'\b8\.6 .*--output-step 1 .*\b0\.086 '):
        simulate.check_size(long, tmp_path / 'new')
    simulate.check_size(scene, tmp_path / 'new')
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(simulate, 'available_memory', lambda: 10**9)
    with refused('out_of_range', '--output-step') as memory:
        simulate.check_size(long, tmp_path / 'new')
    monkeypatch.setattr(simulate.shutil, 'disk_usage',
                        lambda _: argparse.Namespace(free=10**8))
    with refused('out_of_range', '--output-step') as disk:
        simulate.check_size(long, tmp_path / 'new')
    assert '1 GB of memory' in str(memory.value) and f'0.1 GB in {tmp_path}' in str(disk.value)
