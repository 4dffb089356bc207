# SPDX-License-Identifier: Apache-2.0
"""``ballbot simulate`` keeps its results even after an interruption or an error."""
import json
import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

from ballbot_ros.cli import main
from ballbot_ros.results import read_columns

COMMAND = [sys.executable, '-m', 'ballbot_ros.cli', 'simulate']
NUMBERS = {'summary.txt', 'summary.json', 'trajectory.csv', 'trajectory.npz',
           'trajectory.parquet'}
FIGURES = {f'{name}.{kind}' for name in ('strip', 'time_series') for kind in ('png', 'svg')}


def names(folder):
    return {path.name for path in Path(folder).iterdir()}


def scene_file(tmp_path, text):
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    return str(path)


@pytest.mark.slow
def test_a_run_leaves_numbers_and_figures(tmp_path, capsys):
    assert main(['simulate', 'fig7_bottom', '--out', str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert names(tmp_path) == NUMBERS | FIGURES
    assert (tmp_path / 'summary.txt').read_text() in out + '\n'
    assert 'error' not in err


def test_without_a_folder_files_are_written_below_the_current_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['simulate', 'fig7_top', '--no-figures', '--quiet']) == 0
    assert names(tmp_path / 'ballbot_output' / 'fig7_top') == NUMBERS


def test_one_format_of_figures_can_be_chosen(tmp_path):
    assert main(['simulate', 'fig7_top', '--out', str(tmp_path), '--format', 'svg',
                 '--quiet']) == 0
    assert names(tmp_path) == NUMBERS | {'strip.svg', 'time_series.svg'}


def test_standard_output_contains_json_only(tmp_path, capsys):
    assert main(['simulate', 'fig7_top', '--out', str(tmp_path), '--no-figures',
                 '--json']) == 0
    out, err = capsys.readouterr()
    content = json.loads(out)
    assert err == ''
    assert {'name', 'robot', 'x', 'y', 'speed', 'pendulum_torque', 'faces', 'energy_residual',
            'wall_time', 'steps', 'warnings', 'files'} <= set(content)
    assert all(Path(name).is_file() for name in content['files'])
    files = content.pop('files')
    assert len(files) == len(NUMBERS)
    assert content == json.loads((tmp_path / 'summary.json').read_text())


def test_quiet_prints_nothing(tmp_path, capsys):
    assert main(['simulate', 'fig7_top', '--out', str(tmp_path), '--no-figures', '--quiet']) == 0
    assert capsys.readouterr() == ('', '')


def test_quiet_prints_warnings_on_standard_error(tmp_path, capsys):
    assert main(['simulate', 'flat', '--duration', '0.02', '--out', str(tmp_path), '--no-figures',
                 '--quiet']) == 0
    printed = capsys.readouterr()
    assert printed.out == '' and printed.err.count('Warning: ') == 1


def test_options_replace_values_of_the_scene(tmp_path, capsys):
    assert main(['simulate', 'fig7_top', '--out', str(tmp_path), '--no-figures', '--json',
                 '--duration', '0.5', '--step', '5e-4', '--method', 'semi_implicit']) == 0
    content = json.loads(capsys.readouterr().out)
    assert content['duration'] == pytest.approx(0.5) and content['steps'] == 1000
    assert read_columns(tmp_path / 'trajectory.csv')['time'][-1] == pytest.approx(0.5)


def test_a_rounded_duration_causes_a_warning(tmp_path, capsys):
    assert main(['simulate', 'fig7_top', '--out', str(tmp_path), '--no-figures', '--json',
                 '--duration', '0.95', '--output-step', '0.1']) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)['duration'] == pytest.approx(1.0)
    assert err.startswith('Warning: ') and '0.95 s' in err and '1 s' in err


@pytest.mark.parametrize('words, reason, field', [
    (['--duration', '-1'], 'out_of_range', 'duration'),
    (['--duration', 'nan'], 'not_finite', 'duration'),
    (['--step', '3e-4'], 'inconsistent', 'output_step'),
    (['--duration', '1', '--output-step', '5'], 'inconsistent', 'output_step'),
    (['--method', 'rk5'], 'not_a_choice', '--method'),
    (['--out', '/dev/null/here'], 'not_writable', '/dev/null/here/summary.txt'),
    (['--playback', '2'], 'inconsistent', '--playback'),
    (['--animate', 'film.avi'], 'usage', '--animate'),
    (['--animate', '/dev/null/film.gif'], 'not_writable', '/dev/null/film.gif'),
    (['--animate', '--duration', '100'], 'out_of_range', 'playback'),
    (['--animate', '--playback', '0'], 'out_of_range', '--playback')])
def test_an_invalid_value_is_refused_and_leaves_no_folder(
        refuses, tmp_path, words, reason, field):
    refuses(reason, field, 'simulate', 'fig7_top', '--out', tmp_path / 'out', *words)
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('text, reason, field', [
    ('robot: [', 'unreadable', None), ('robot: gimbal\nduration: 1', 'unknown_name', 'robot'),
    ('robot: gimball\nduration: 1\nintial: {}', 'unknown_name', 'intial'),
    ('robot: gimball', 'missing', 'duration'), ('- 1', 'wrong_type', None)])
def test_a_malformed_scene_is_refused(tmp_path, refuses, text, reason, field):
    file = scene_file(tmp_path, text)
    refuses(reason, str(file) if field is None else field, 'simulate', file)


@pytest.mark.slow
def test_a_failed_run_keeps_its_results_so_far(tmp_path, capsys):
    # The ball falls at 100 m/s: its shell cannot stop it.
    scene = scene_file(tmp_path, 'robot: gimball\nduration: 2\n'
                       'initial: {y: 100.0, velocity_y: -100.0}\n')
    assert main(['simulate', scene, '--out', str(tmp_path / 'out'), '--json']) == 1
    out, err = capsys.readouterr()
    assert err.startswith('ballbot: error: ') and err.count('\n') == 1
    assert not json.loads(out)['complete']
    assert names(tmp_path / 'out') == NUMBERS | FIGURES
    assert len(read_columns(tmp_path / 'out' / 'trajectory.npz')['y']) > 500


def start_long_run(folder, **options):
    # SIGINT is ignored if a shell runs the tests in the background.
    return subprocess.Popen(
        [*COMMAND, 'fig7_top', '--out', str(folder), '--duration', '2000', '--step', '1e-5',
         '--no-figures'],
        text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        **options)


@pytest.mark.slow
def test_ctrl_c_keeps_the_results_so_far(tmp_path):
    process = start_long_run(tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        assert any('Ctrl-C' in line for line in process.stderr)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert err.startswith('ballbot: error: ') and err.count('\n') == 1 and out
    assert names(tmp_path) == NUMBERS
    time = read_columns(tmp_path / 'trajectory.csv')['time']
    assert 0.4 < time[-1] < 2000.0
    summary = json.loads((tmp_path / 'summary.json').read_text())
    assert summary['samples'] == len(time) and not summary['complete']


def test_ctrl_c_while_writing_keeps_the_complete_files_and_none_of_a_replaced_run(
        tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    for name in NUMBERS | FIGURES:
        (tmp_path / name).write_text('of an older run')
    monkeypatch.setattr('ballbot_ros.results.files.np.savez_compressed', interrupted)
    words = ['simulate', 'fig7_top', '--duration', '0.05', '--out', str(tmp_path), '--overwrite']
    assert main(words) == 130
    assert names(tmp_path) == {'summary.txt', 'summary.json', 'trajectory.csv'}
    assert len(read_columns(tmp_path / 'trajectory.csv')['time']) == 51
    err = capsys.readouterr().err
    assert err.startswith('ballbot: error: ') and err.count('\n') == 1
    assert f'{tmp_path}: summary.txt, summary.json, trajectory.csv' in err


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, 'openpty'), reason='needs a terminal')
def test_a_terminal_shows_a_progress_bar(tmp_path):
    master, slave = os.openpty()
    process = start_long_run(tmp_path, stdout=subprocess.DEVNULL, stderr=slave)
    os.close(slave)
    seen = b''
    try:
        while b'of 2000 s' not in seen:
            seen += os.read(master, 4096)
    finally:
        process.kill()
        process.wait()
        os.close(master)


@pytest.mark.slow
def test_animate_writes_a_gif_with_the_other_files_or_at_a_given_path(tmp_path, capsys):
    words = ['simulate', 'fig7_top', '--duration', '0.2', '--no-figures', '--out',
             str(tmp_path / 'out')]
    assert main([*words, '--animate']) == 0
    assert names(tmp_path / 'out') == NUMBERS | {'animation.gif'}
    assert capsys.readouterr().out.endswith('trajectory.parquet, animation.gif\n')
    elsewhere = tmp_path / 'mine.gif'
    assert main([*words, '--animate', str(elsewhere), '--playback', '2', '--json',
                 '--overwrite']) == 0
    assert json.loads(capsys.readouterr().out)['files'][-1] == str(elsewhere)
    assert elsewhere.read_bytes().startswith(b'GIF89a')


def test_ctrl_c_while_animating_keeps_the_numbers_and_leaves_no_partial_file(
        tmp_path, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr('ballbot_ros.figures.animation._words', interrupted)
    assert main(['simulate', 'fig7_top', '--no-figures', '--out', str(tmp_path),
                 '--animate']) == 130
    out, err = capsys.readouterr()
    assert names(tmp_path) == NUMBERS and (tmp_path / 'summary.txt').read_text() in out
    assert err.count('ballbot: error: ') == 1 and str(tmp_path / 'animation.gif') in err
