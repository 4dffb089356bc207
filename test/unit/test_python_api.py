# SPDX-License-Identifier: Apache-2.0
"""The package as a Python library: names, copies, process pools, tables, types."""
from concurrent.futures import ProcessPoolExecutor
import copy
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
import pickle
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from refusals import refused

import ballbot_ros
from ballbot_ros import load_robot, load_scene, Model, Robot, Scene, Terrain, Trajectory
from ballbot_ros.crossing import held_at, try_step
from ballbot_ros.errors import ConfigurationError

ROOT = Path(__file__).resolve().parents[2]
COPIES = {'pickle': lambda value: pickle.loads(pickle.dumps(value)), 'copy': copy.copy,
          'deepcopy': copy.deepcopy}


@pytest.fixture(scope='module')
def run():
    return load_scene('fig7_top').simulate(0.6)


def test_every_public_name_is_there_and_nothing_heavy_is_imported_before():
    assert {name for name in ballbot_ros.__all__ if hasattr(ballbot_ros, name)} \
        == set(ballbot_ros.__all__) <= set(dir(ballbot_ros))
    with pytest.raises(AttributeError):
        _ = ballbot_ros.load_robots
    code = ('import sys, ballbot_ros; '
            'assert not {"numpy", "numba", "yaml", "matplotlib"} & set(sys.modules)')
    subprocess.run([sys.executable, '-c', code], check=True, timeout=60)


@pytest.mark.parametrize('way', COPIES)
def test_values_can_be_copied_and_pickled(way, run):
    scene = load_scene('fig7_top')
    _ = scene.model.parameters, run.columns  # cached values
    again = COPIES[way](scene)
    assert isinstance(again, Scene) and isinstance(again.model, Model)
    assert again.model.robot == scene.model.robot == COPIES[way](scene.model.robot)
    assert again.model.robot.provenance == scene.model.robot.provenance
    ground = again.model.terrain
    assert isinstance(ground, Terrain) and not ground.vertices.flags.writeable
    assert np.array_equal(ground.vertices, scene.model.terrain.vertices)
    same = COPIES[way](run)
    assert np.array_equal(same.rows, run.rows) and same.scene.name == 'fig7_top'


def end_of(scene):
    return scene.simulate(0.05)


def test_scenes_and_runs_go_through_a_process_pool():
    scenes = [load_scene('fig7_top'), load_scene('fig7_bottom')]
    with ProcessPoolExecutor(1, mp_context=get_context('fork')) as pool:
        runs = list(pool.map(end_of, scenes))
    for scene, run in zip(scenes, runs):
        assert isinstance(run, Trajectory)
        assert np.array_equal(run.rows, scene.simulate(0.05).rows)


def test_a_robot_with_other_parameters_is_checked_and_loses_their_provenance():
    robot = load_robot('gimball')
    other = robot.replace(ball_mass=4.0)
    assert isinstance(other, Robot) and other.ball_mass == 4.0 and other.motor == robot.motor
    assert 'ball_mass' in robot.provenance and 'ball_mass' not in other.provenance
    assert 'ball_inertia' in other.provenance
    assert robot.replace(motor=None).motor is None
    for changes, reason, field in (
            ({'ball_mass': -1.0}, 'out_of_range', 'ball_mass'),
            ({'ball_mas': 1.0}, 'unknown_name', 'ball_mas'),
            ({'provenance': 3}, 'unknown_name', 'provenance'),
            ({'ball_mass': '4'}, 'wrong_type', 'ball_mass'),
            ({'motor': 3.0}, 'wrong_type', 'motor')):
        with refused(reason, field):
            robot.replace(**changes)


def test_a_scene_runs_with_another_accuracy_and_output_step():
    scene = load_scene('fig7_top')
    run = scene.simulate(0.5, accuracy=1e-4, output_step=0.05)
    assert len(run) == 11 and run.assurance.accuracy == 1e-4
    assert run.scene.run.accuracy == 1e-4 and scene.run.accuracy != 1e-4
    with refused('out_of_range', 'accuracy'):
        scene.simulate(accuracy=10.0)
    with refused('inconsistent', 'output_step'):
        scene.simulate(0.5, output_step=1.0)


@pytest.mark.parametrize('name, crossed', [('fig7_bottom', True), ('flat', None)])
def test_a_run_reports_whether_it_crossed(name, crossed):
    run = load_scene(name).simulate()
    assert run.crossed is crossed and run.summary().name == name
    if crossed:
        assert replace(run, rows=run.rows[:100]).crossed is False


def test_a_run_is_a_mapping_of_columns_with_units(run):
    assert list(run) == list(run.keys()) == list(run.units) and 'x' in run and 'z' not in run
    assert dict(run)['x'] is run['x'] and len(list(run.values())) == len(list(run.items()))
    assert run.units['pendulum_torque'] == 'N m'
    table = run.to_pandas()
    assert table.attrs['units'] == dict(run.units) and list(table) == list(run)


def test_the_arrays_of_a_run_are_read_only(run):
    for values in (run.rows, *run.values(), pickle.loads(pickle.dumps(run)).rows):
        with pytest.raises(ValueError):
            values[0] = 1.0


def test_numbers_may_be_scalars_of_numpy():
    assert load_robot('gimball').replace(ball_mass=np.float32(4.0)).total_mass == 5.6
    held = held_at(np.float64(0.5))
    assert try_step('gimball', np.float32(0.5), np.float32(0.0625), held) == try_step(
        'gimball', 0.5, 0.0625, held)
    for angle in (np.float32(90.0), np.float64(np.nan), 'level'):
        with pytest.raises(ConfigurationError) as error:
            try_step('gimball', 0.5, 0.01, pendulum_angle=angle)
        assert error.value.field == 'pendulum_angle'


def test_a_run_becomes_an_xarray_dataset(run, monkeypatch):
    made = SimpleNamespace(
        Dataset=lambda data, coordinates, attrs: SimpleNamespace(
            data=data, coordinates=coordinates, attrs=attrs))
    monkeypatch.setitem(sys.modules, 'xarray', made)
    table = run.to_xarray()
    assert table.data['x'][0] == 'time' and table.data['x'][2] == {'units': 'm'}
    assert table.coordinates['time'][2] == {'units': 's'}
    assert len(table.data) == len(run.keys()) - 1
    assert table.attrs == {'robot': 'gimball', 'scene': 'fig7_top'}
    monkeypatch.setitem(sys.modules, 'xarray', None)
    with refused('not_installed', 'xarray'):
        run.to_xarray()


def test_a_plot_names_scene_and_robot(run):
    words = ' '.join(text.get_text() for text in [
        *run.plot().texts, *(axes.title for axes in run.plot().axes)])
    assert 'fig7_top' in words and 'gimball' in words


@pytest.mark.slow
def test_a_type_checker_passes_a_script_of_a_user(tmp_path):
    api = pytest.importorskip('mypy.api')
    assert isinstance(api, ModuleType)
    script = ROOT / 'examples' / 'python_api.py'
    assert len(script.read_text(encoding='utf-8').splitlines()) <= 31
    assert (ROOT / 'ballbot_ros' / 'py.typed').is_file()
    wrong = tmp_path / 'wrong.py'
    wrong.write_text('from ballbot_ros import load_robot\nload_robot("gimball").replace(3, 4)\n')
    done = subprocess.run(
        [sys.executable, '-m', 'mypy', '--strict', '--follow-imports=silent', str(script),
         str(wrong)], cwd=ROOT, capture_output=True, text=True)
    errors = [line for line in done.stdout.splitlines() if ': error:' in line]
    assert done.returncode == 1 and 'replace' in done.stdout
    assert errors and all('wrong.py:' in line for line in errors), done.stdout
