# SPDX-License-Identifier: Apache-2.0
"""Results are replaced only on request."""
from pathlib import Path
import types

import pytest
from refusals import refused

from ballbot_ros.cli import main
from ballbot_ros.cli.output import check_new_file, empty_folders_removed, result_folder

FLAT = ['simulate', 'flat', '--duration', '0.02', '--no-figures', '--quiet']


def test_each_run_gets_a_new_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(3):
        assert main(FLAT) == 0
    assert sorted(path.name for path in Path('ballbot_output').iterdir()) == [
        'flat', 'flat_2', 'flat_3']
    assert main([*FLAT, '--overwrite']) == 0
    assert len(list(Path('ballbot_output').iterdir())) == 3


def test_a_folder_with_results_is_refused_before_the_run_unless_overwritten(
        tmp_path, monkeypatch, refuses, capsys):
    out = ['--out', str(tmp_path / 'mine')]
    assert main([*FLAT, *out]) == 0
    before = (tmp_path / 'mine' / 'trajectory.csv').read_text()
    refuses('exists', '--out', 'simulate', 'flat', '--duration', '0.04', '--no-figures', *out)
    assert (tmp_path / 'mine' / 'trajectory.csv').read_text() == before
    (tmp_path / 'mine' / 'strip.png').write_text('of the run that is replaced')
    (tmp_path / 'mine' / 'notes.txt').write_text('mine')
    assert main([*FLAT, *out, '--duration', '0.04', '--overwrite']) == 0
    assert (tmp_path / 'mine' / 'trajectory.csv').read_text() != before
    # Pictures of the replaced run are removed; files that are not results remain.
    assert not (tmp_path / 'mine' / 'strip.png').exists()
    assert (tmp_path / 'mine' / 'notes.txt').exists()


def test_a_folder_with_other_files_is_accepted(tmp_path):
    (tmp_path / 'notes.txt').write_text('mine')
    assert main([*FLAT, '--out', str(tmp_path)]) == 0


def test_three_demos_leave_three_folders(tmp_path, monkeypatch, replace_demo):
    monkeypatch.chdir(tmp_path)
    folders = []

    def run_demo(out, **_):
        folders.append(out)
        (out / 'doorstep' / 'bag').mkdir(parents=True)
        return 0

    case = types.SimpleNamespace(scene='doorstep')
    replace_demo(
        run_demo=run_demo, run_hardware_demo=None, run_house_demo=None,
        demo_cases=lambda *_: [case], page_beside=None)
    for _ in range(3):
        assert main(['demo', '--quiet']) == 0
    assert [folder.name for folder in folders] == ['demo', 'demo_2', 'demo_3']


def test_simultaneous_runs_get_separate_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with empty_folders_removed():
        folders = [result_folder(None, 'a', ('x',), False) for _ in range(3)]
    assert [folder.name for folder in folders] == ['a', 'a_2', 'a_3']


def test_abandoned_runs_leave_no_empty_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('given').mkdir()
    with empty_folders_removed():
        assert result_folder(None, 'a', ('x',), False).is_dir()
        assert result_folder(Path('given', 'b', 'c'), 'a', ('x',), False).is_dir()
    assert list(tmp_path.rglob('*')) == [tmp_path / 'given']


def test_a_folder_that_cannot_be_created_is_refused_before_the_run():
    with refused('not_writable', '/proc/none/x'):
        result_folder(Path('/proc/none'), 'a', ('x',), False)


def test_an_existing_file_is_refused_unless_overwritten(tmp_path):
    check_new_file(tmp_path / 'new', False)
    (tmp_path / 'old').touch()
    with refused('exists', '--log'):
        check_new_file(tmp_path / 'old', False, '--log')
    check_new_file(tmp_path / 'old', True)


def test_a_recording_refuses_an_existing_folder_before_it_joins_the_graph(
        tmp_path, monkeypatch, refuses):
    def join(*_):
        pytest.fail('the command joined the graph before the refusal')
    monkeypatch.setattr('ballbot_ros.cli.graph.from_ros', join)
    refuses('exists', '-o', 'record', '-a', '-o', str(tmp_path))


@pytest.mark.parametrize('verb', [
    'simulate', 'demo', 'figures', 'test-bench', 'identify', 'fit-curve', 'sweep', 'replay',
    'emulate-motor', 'outcomes'])
def test_every_verb_that_writes_has_an_option_to_replace(verb, capsys):
    assert main([verb, '--help']) == 0
    assert '--overwrite' in capsys.readouterr().out
