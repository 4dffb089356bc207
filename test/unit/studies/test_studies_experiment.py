# SPDX-License-Identifier: Apache-2.0
"""Experiments: checks of the file, and folders that contain all inputs and repeat the run."""
import json
import math
import shlex
import shutil

from bag_of_a_run import BagOf
import pytest
from refusals import refused
import yaml

from ballbot_ros.config.files import shipped_files
from ballbot_ros.errors import RefusedError
from ballbot_ros.experiments import run as experiment
from ballbot_ros.experiments.file import freeze, load_experiment, node_parameters
from ballbot_ros.experiments.run import first_difference, run_experiment
from ballbot_ros.physics import load_scene, Solver
from ballbot_ros.plant import Plant

PLAN = {'scene': 'flat', 'duration': 0.2, 'seeds': [3, 5], 'controller': {'tuning': 'gentle'}}


def write(folder, **changes):
    """Write the file of an experiment."""
    file = folder / 'plan.yaml'
    file.write_text(yaml.safe_dump({
        name: value for name, value in {**PLAN, **changes}.items() if value is not None}))
    return file


@pytest.mark.parametrize('path', shipped_files('experiments'), ids=lambda path: path.stem)
def test_the_shipped_experiments_are_valid(path):
    assert load_experiment(path).periods > 0


@pytest.mark.parametrize('changes, reason, field', [
    ({'scnee': 'flat'}, 'unknown_name', 'scnee'),
    ({'duration': None}, 'missing', 'duration'),
    ({'duration': -1.0}, 'out_of_range', 'duration'),
    ({'duration': 0.2005}, 'inconsistent', 'duration'),
    ({'seeds': []}, 'not_a_choice', 'seeds'),
    ({'seeds': [1, 1]}, 'not_a_choice', 'seeds'),
    ({'seeds': [-1]}, 'not_a_choice', 'seeds'),
    ({'simulator': {'seed': 4}}, 'not_settable', 'seed'),
    ({'simulator': {'lockstep': False}}, 'not_settable', 'lockstep'),
    ({'simulator': {'terrain_height_sd': 3.0}}, 'out_of_range', 'terrain_height_sd'),
    ({'controller': {'tunning': 'gentle'}}, 'unknown_name', 'tunning'),
    ({'controller': {'tuning': 'none'}}, 'unknown_name', 'tuning'),
    ({'obstacle_decision': {}, 'simulator': {'terrain_rate': 50.0, 'observation_rate': 50.0}},
     'inconsistent', 'observation_rate'),
    ({'obstacle_decision': {'outcome_log': 'here'}}, 'not_settable', 'outcome_log')])
def test_an_error_in_the_file_is_reported_with_its_field(tmp_path, changes, reason, field):
    with refused(reason, field):
        freeze(load_experiment(write(tmp_path, **changes)))


def test_the_folder_contains_all_inputs_and_gives_the_same_parameters(tmp_path):
    shutil.copy(shipped_files('scenes')[0], tmp_path / 'mine.yaml')
    plan = load_experiment(write(tmp_path, scene='./mine.yaml', obstacle_decision={}))
    for name, text in freeze(plan).items():
        place = tmp_path / 'moved' / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    (tmp_path / 'mine.yaml').unlink()
    again = load_experiment(tmp_path / 'moved' / 'experiment.yaml')
    assert freeze(again) == freeze(load_experiment(tmp_path / 'moved' / 'experiment.yaml'))
    nodes = node_parameters(again, 5)
    assert nodes['simulator']['seed'] == 5 and nodes['simulator']['lockstep'] is True
    assert nodes['controller']['lockstep_set_point_period'] == 0.02
    for name in ('curve', 'tuning', 'control_tuning', 'robot'):
        assert nodes['obstacle_decision'][name].startswith(str(tmp_path / 'moved'))


def fake_runs(monkeypatch, wrong=()):
    """Replace runs by ones without nodes; seeds in `wrong` raise the error given there."""
    made = []

    def run(folder, nodes, periods, metadata, timeout):
        simulator = nodes['simulator']
        made.append(simulator['seed'])
        plant = Plant(load_scene(simulator['scene'], simulator['robot'], Solver('rk4', 1e-4)),
                      500.0)
        bag = BagOf(folder / 'bag', metadata)
        for number in range(periods + 1):
            stamp = bag.state(plant)
            torque = math.sin(0.1 * number + simulator['seed'])
            if made.count(simulator['seed']) > 1 and 'drift' in wrong:
                torque *= 1.0 if number < 50 else 1.0 + 1e-15
            bag.joints('joint_commands', stamp, ['pendulum'], effort=[torque])
            if number < periods:
                plant.advance(torque)
        if simulator['seed'] in wrong:
            raise wrong[simulator['seed']]
        bag.writer.close()
    lockstep = pytest.importorskip('ballbot_ros.experiments.lockstep')
    monkeypatch.setattr(lockstep, 'run_lockstep', run)
    monkeypatch.setattr(experiment, '_prepare', lambda plan: None)
    return made


@pytest.mark.slow
def test_a_folder_reproduces_its_numbers(tmp_path, monkeypatch, capsys):
    fake_runs(monkeypatch)
    out = tmp_path / 'my out'
    assert run_experiment(str(write(tmp_path)), out, False, 60.0)
    assert shlex.split(capsys.readouterr().out.rpartition('compare: ')[2]) == [
        'ballbot', 'run', str(out)]
    assert (out / 'results.csv').read_text().startswith('seed [1],x [m],speed [m/s],')
    assert json.loads((out / 'versions.json').read_text())['numpy']
    before = sorted(path.name for path in out.rglob('*'))
    assert run_experiment(str(out), None, False, 60.0)
    assert 'same numbers: yes' in capsys.readouterr().out
    assert sorted(path.name for path in out.rglob('*')) == before


@pytest.mark.slow
def test_a_difference_is_reported(tmp_path, monkeypatch, capsys):
    fake_runs(monkeypatch, {'drift': True})
    assert run_experiment(str(write(tmp_path, seeds=[3])), tmp_path / 'out', True, 60.0)
    assert not run_experiment(str(tmp_path / 'out'), None, False, 60.0)
    out = capsys.readouterr().out
    assert 'same numbers: no' in out and 'differs from t = 0.1' in out


@pytest.mark.parametrize('ending', [
    KeyboardInterrupt(), RefusedError('node x ended', 'failed', '')])
def test_completed_seeds_are_kept_and_the_others_run_later(
        tmp_path, monkeypatch, ending):
    file, out = str(write(tmp_path)), tmp_path / 'out'
    fake_runs(monkeypatch, {5: ending})
    with pytest.raises(type(ending)):
        run_experiment(file, out, True, 60.0)
    assert (out / 'seed_3').is_dir() and not (out / 'seed_5').exists()
    assert not list(out.glob('.*'))  # no partial results
    made = fake_runs(monkeypatch)
    assert run_experiment(file, out, True, 60.0)
    assert made == [5] and (out / 'results.csv').read_text().count('\n') == 3


def test_a_folder_of_another_experiment_is_not_changed(tmp_path, monkeypatch):
    fake_runs(monkeypatch)
    run_experiment(str(write(tmp_path)), tmp_path / 'out', True, 60.0)
    with refused('exists', '--out'):
        run_experiment(str(write(tmp_path, duration=0.3)), tmp_path / 'out', True, 60.0)
    with refused('wrong_kind', 'experiment'):
        run_experiment(str(tmp_path), None, True, 60.0)


def test_the_first_difference_is_the_earliest_of_all_topics():
    one = {'/a': {1: 'x', 5: 'y'}, '/b': {3: 'z'}}
    assert first_difference(one, one) is None
    assert first_difference(one, {'/a': {1: 'x', 5: 'n'}, '/b': {}}) == (3, '/b')


def test_a_run_advances_by_a_second_at_a_time_and_ends_with_a_message_of_each_topic():
    lockstep = pytest.importorskip('ballbot_ros.experiments.lockstep')
    topics = ['joint_states', 'joint_commands', 'odom', 'ball_state']
    found = list(lockstep.advances_of({'control_rate': 500.0}, topics, 1251))
    assert [periods for periods, _ in found] == [500, 500, 251]
    known = {'joint_states', 'odom', 'ball_state'}
    assert [stamps for _, stamps in found[:2]] == [
        dict.fromkeys(known, second * 10**9) for second in (1, 2)]
    assert found[2][1] == {
        'joint_states': 2_502_000_000, 'joint_commands': 2_502_000_000,
        'odom': 2_500_000_000, 'ball_state': 2_500_000_000}
