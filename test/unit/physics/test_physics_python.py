# SPDX-License-Identifier: Apache-2.0
"""Interactive use: accepted arguments, representations, and refused mistakes."""
import copy
import math
from pathlib import Path
import pickle
import sys

import pytest
from refusals import refused

from ballbot_ros.config.files import find_config
from ballbot_ros.crossing import held_at, max_step_height, max_step_heights
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.physics import Actuation, load_robot, load_scene, Model, Solver, Terrain
from ballbot_ros.physics.simulation.scene import read_scene
from ballbot_ros.physics.simulation.trajectory import UNITS
from ballbot_ros.results import write_trajectory

GIMBALL = load_robot('gimball')
SCENE, ROBOT = (Path(find_config(kind, name)) for kind, name in (
    ('scenes', 'fig7_top'), ('robots', 'gimball')))


@pytest.fixture(scope='module')
def trajectory():
    return load_scene('flat').simulate(duration=0.02)


def test_names_paths_and_loaded_objects_are_accepted():
    assert load_robot(ROBOT) == load_robot(str(ROBOT)) == load_robot(GIMBALL) == GIMBALL
    scene = load_scene(SCENE, ROBOT)
    assert load_scene(scene) is scene and scene.model.robot == GIMBALL
    assert load_scene('fig7_top', GIMBALL).model.robot == GIMBALL
    assert load_scene(scene, 'shellball').model.robot.name == 'shellball'
    assert Model('gimball', Terrain.flat()).robot == Model(ROBOT, Terrain.flat()).robot == GIMBALL
    for wrong in (5, None):
        with refused('wrong_type', 'robot'):
            load_robot(wrong)


def test_equal_scenes_and_terrains_compare_equal():
    scene = load_scene(SCENE)
    for other in (load_scene('fig7_top'), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other == scene and hash(other) == hash(scene)
    plain, rough = Terrain.step(0.01), Terrain.step(0.01, at=0.5)
    icy = Terrain(plain.vertices, edge_friction=[0.0, 0.0, 0.0, 0.0])
    assert plain != rough and plain != icy and plain != 'step'


def test_max_step_height_accepts_the_name_of_a_robot():
    assert max_step_height('gimball', 0.5) == max_step_height(GIMBALL, 0.5)


@pytest.mark.parametrize('find', [
    lambda: max_step_height('gimball', 0.5, 'held'),
    lambda: max_step_heights('gimball', [0.5], 'held')])
def test_an_actuation_of_the_wrong_type_is_refused(find):
    with refused('wrong_type', 'actuation'):
        find()


@pytest.mark.parametrize('name', ['site', 'rules', 'options'])
@pytest.mark.parametrize('value', ['any', 3, None])
def test_site_rules_or_options_of_the_wrong_class_are_refused(name, value):
    with refused('wrong_type', name):
        max_step_height(GIMBALL, 0.5, **{name: value})


@pytest.mark.parametrize('make', [
    lambda: held_at(90), lambda: Actuation('position', set_angle=90),
    lambda: held_at(-45.0), lambda: max_step_height('gimball', 0.5, pendulum_angle=90)])
def test_degrees_in_place_of_radians_are_refused(make):
    with refused('out_of_range'):
        make()


def test_angles_of_plus_and_minus_pi_are_accepted():
    assert held_at(math.pi).set_angle == math.pi and held_at(-math.pi).set_angle == -math.pi


@pytest.mark.parametrize('values, named', [
    ({'voltage': 5.0}, "write Actuation('voltage', voltage=5)"),
    ({'torque': -0.4}, "write Actuation('torque', torque=-0.4)"),
    ({'set_angle': 1.0}, "write Actuation('position', set_angle=1)"),
    ({'set_rate': 2.0}, "write Actuation('velocity', set_rate=2)")])
def test_a_value_without_its_law_is_refused(values, named):
    with pytest.raises(ConfigurationError) as refused:
        Actuation(**values)
    assert named in str(refused.value)


def test_a_scene_with_a_value_of_another_law_is_refused():
    for section in ({'voltage': 5.0}, {'law': 'position', 'voltage': 5.0},
                    {'law': 'voltage', 'set_angle_deg': 3.0}):
        with refused('inconsistent'):
            read_scene({'robot': 'gimball', 'actuation': section, 'duration': 1.0}, 'a', 'a')


def test_representations_are_short(trajectory):
    scene = load_scene('fig7_bottom')
    for thing in (GIMBALL, scene, scene.model, trajectory, Actuation('position', set_angle=1.0),
                  Solver('adaptive')):
        assert len(repr(thing)) < 200 and '\n' not in repr(thing)
    assert repr(Actuation('position', set_angle=1.0)) == "Actuation(law='position', set_angle=1.0)"
    assert 'gimball' in repr(GIMBALL) and '21 samples' in repr(trajectory)


def test_a_run_is_written_in_the_format_of_the_file_extension(trajectory, tmp_path):
    for ending in ('csv', 'npz', 'parquet'):
        write_trajectory(trajectory, tmp_path / f'run.{ending}')
        assert (tmp_path / f'run.{ending}').stat().st_size > 1000
    with refused('not_a_choice', 'path'):
        write_trajectory(trajectory, tmp_path / 'run.xlsx')


def test_to_pandas_gives_units_or_reports_that_pandas_is_missing(trajectory, monkeypatch):
    if 'pandas' in sys.modules or __import__('importlib.util').util.find_spec('pandas'):
        table = trajectory.to_pandas()
        assert len(table) == len(trajectory) and table.attrs['units']['x'] == 'm'
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with refused('not_installed', 'pandas'):
        trajectory.to_pandas()


def test_a_duration_suffices_and_an_unknown_column_is_refused_with_the_known_ones():
    run = load_scene('flat').simulate(0.01)
    assert run['x'][-1] == run.columns['x'][-1] and run['time'][-1] == pytest.approx(0.01)
    with pytest.raises(KeyError, match='pendulum_angle'):
        run['pendulum_angel']
    with pytest.raises(KeyError, match=', '.join(UNITS)):
        run['%']
