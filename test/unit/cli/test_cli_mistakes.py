# SPDX-License-Identifier: Apache-2.0
"""Mistakes that would silently give a wrong result are detected and explained."""
import pytest

from ballbot_ros.bridge.hardware_file import load_hardware
from ballbot_ros.cli import main, simulate
from ballbot_ros.config.files import shipped_files
from ballbot_ros.decision import load_curve
from ballbot_ros.errors import ConfigurationError
from ballbot_ros.experiments.file import load_experiment
from ballbot_ros.physics import load_robot, load_scene

SCENE = """
robot: {robot}
duration: -1.0
terrain: [{{flat: {{lenght: 1.0}}}}]
initial: {{speed: fast, x: .nan}}
actuation: {{law: position, voltage: 3.0}}
wheels: 4
"""


def test_all_errors_of_a_file_are_reported_together(tmp_path, refusal, capsys, monkeypatch):
    (tmp_path / 'hall.yaml').write_text(SCENE.format(robot='gimball'))
    error = refusal('simulate', tmp_path / 'hall.yaml')
    assert [(item.reason, item.field) for item in error.problems] == [
        ('unknown_name', 'wheels'), ('unknown_name', 'lenght'), ('not_finite', 'x'),
        ('wrong_type', 'speed'), ('out_of_range', 'duration'), ('inconsistent', 'voltage')]
    monkeypatch.undo()
    assert main(['simulate', str(tmp_path / 'hall.yaml')]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 6 and all(
        line.startswith(f'ballbot: error: {tmp_path}/hall.yaml: ') for line in lines)


def test_all_errors_of_a_robot_are_reported_together_and_a_misspelt_key_once(tmp_path):
    (tmp_path / 'mine.yaml').write_text(
        'name: mine\nball_mas: 3.0\nball_radius: {value: 22, unit: cm}\nsurface_friction: -1\n'
        'edge_friction: 22\nmotor: {gear_ratio: 0, weight: 1}\n')
    with pytest.raises(ConfigurationError) as caught:
        load_robot(tmp_path / 'mine.yaml')
    found = {(item.reason, item.field) for item in caught.value.problems}
    assert found == {
        ('unknown_name', 'ball_mas'), ('missing', 'ball_inertia'), ('not_a_choice', 'ball_radius'),
        ('out_of_range', 'surface_friction'), ('out_of_range', 'edge_friction'),
        ('unknown_name', 'weight'), ('missing', 'gear_efficiency'), ('out_of_range', 'gear_ratio')}


@pytest.mark.parametrize('words, kind, wanted', [
    (['max-step-height', '--speed', '0.5', '--robot'], 'scenes', 'robot'),
    (['robots'], 'hardware', 'robot'), (['robots'], 'curves', 'robot'),
    (['simulate'], 'robots', 'scene'), (['simulate'], 'experiments', 'scene'),
    (['calibrate-motor', '--out', 'x.yaml', '--hardware'], 'robots', 'hardware')])
def test_a_file_of_another_kind_is_recognised(words, kind, wanted, refusal):
    for path in shipped_files(kind):
        error = refusal(*words, path)
        assert (error.reason, error.field) == ('wrong_kind', wanted)
        assert {str(path), kind.removesuffix('s'), wanted} <= set(str(error).split())


@pytest.mark.parametrize('kind, load', [
    ('robots', load_robot), ('scenes', load_scene), ('hardware', load_hardware),
    ('curves', load_curve), ('experiments', load_experiment)])
def test_every_shipped_file_is_of_its_kind(kind, load):
    for path in shipped_files(kind):
        load(path if kind == 'experiments' else str(path))


@pytest.mark.parametrize('words, reason, field, written', [
    (['max-step-height', '--speed', '0,8'], 'decimal_comma', '--speed', {'0.8', '0.0,8'}),
    (['max-step-height', '--speed', '0,2:1,2:11'], 'decimal_comma', '--speed', {'0.2:1.2:11'}),
    (['sweep', '--vary', 'speed=0,5', '--out', 'x.parquet'], 'decimal_comma', '--vary speed',
     {'0.5'}),
    (['fit-curve', '--speed', '0,2:0,8:6', '--out', 'x.yaml'], 'decimal_comma', '--speed',
     {'0.2:0.8:6'}),
    (['simulate', 'flat', '--duration', '0,5'], 'usage', '--duration', {'0.5'})])
def test_a_decimal_comma_gets_the_corrected_number(
        words, reason, field, written, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    error = refusal(*words)
    assert (error.reason, error.field) == (reason, field)
    assert written <= {word.strip(',;') for word in str(error).split()}


@pytest.mark.parametrize('files, named', [([], 'empty'), (['b.yaml', 'a.yaml'], 'empty/a.yaml')])
def test_a_folder_given_as_a_scene_is_recognised(files, named, refusal, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'empty').mkdir()
    for name in files:
        (tmp_path / 'empty' / name).touch()
    for word in ('empty', 'empty/'):
        error = refusal('simulate', word)
        assert (error.reason, error.field) == ('wrong_kind', 'scene')
        assert named in str(error).split()


def test_a_missing_folder_is_reported_before_it_is_created(tmp_path, capsys):
    words = ['simulate', 'flat', '--duration', '0.02', '--no-figures', '--quiet', '--out']
    assert main([*words, str(tmp_path / 'resluts' / 'flat')]) == 0
    note, = (line for line in capsys.readouterr().err.splitlines() if line.startswith('Note: '))
    assert f'{tmp_path}/resluts' in note.split()
    assert main([*words, str(tmp_path / 'resluts' / 'again')]) == 0
    assert 'resluts' not in capsys.readouterr().err


def test_the_real_time_factor_excludes_compilation(tmp_path, monkeypatch):
    """The clock advances only during compilation, by 100 s."""
    seconds = {'now': 0.0, 'compiling': 0.0}
    monkeypatch.setattr('ballbot_ros.jit.compile_time', lambda: seconds['compiling'])
    monkeypatch.setattr(simulate, 'perf_counter', lambda: seconds['now'])
    original = load_scene('flat').__class__.simulate

    def compiling(scene, *rest, **options):
        seconds['compiling'] += 100.0
        seconds['now'] += 100.5
        return original(scene, *rest, **options)
    monkeypatch.setattr('ballbot_ros.physics.simulation.scene.Scene.simulate', compiling)
    written = []
    monkeypatch.setattr('ballbot_ros.results.summarise',
                        lambda trajectory, wall_time: written.append(wall_time) or exit(3))
    with pytest.raises(SystemExit):
        main(['simulate', 'flat', '--duration', '0.02', '--out', str(tmp_path / 'x')])
    assert written == [pytest.approx(0.5)]
