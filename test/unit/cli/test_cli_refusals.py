# SPDX-License-Identifier: Apache-2.0
"""Impossible requests are refused before any work, in one line and without side effects."""
import ctypes
import os
import signal
import subprocess
import sys
from threading import Event
import types

import pytest

from ballbot_ros.cli import command, main
from ballbot_ros.paper.figures import FIGURES


@pytest.mark.parametrize('words', [
    ['simulate', 'flat', '--out', '{}/x'], ['figures', 'fig7', '--out', '{}'],
    ['sweep', '--vary', 'speed=0.5', '--out', '{}/x.parquet'],
    ['test-bench', '--out', '{}/x'], ['fit-curve', '--out', '{}/x.yaml'],
    ['demo', '--out', '{}/x'], ['demo', '--hardware', '--out', '{}'],
    ['demo', '--house', '--out', '{}'],
    ['emulate-motor', '--protocol', 'vesc', '--log', '{}/x.csv'],
    ['calibrate-motor', '--out', '{}/x.yaml', '--port', '/dev/there_is_none']])
def test_a_file_in_place_of_a_folder_is_refused_before_the_run(
        words, tmp_path, refusal, monkeypatch, replace_demo):
    def work(*_, **__):
        pytest.fail('the work started before the refusal')

    replace_demo(run_demo=work, run_hardware_demo=work, run_house_demo=work, demo_cases=work,
                 page_beside=work)
    monkeypatch.setattr('ballbot_ros.physics.simulation.scene.Scene.simulate', work)
    monkeypatch.setattr('ballbot_ros.paper.procedure.run_tests', work)
    monkeypatch.setattr('ballbot_ros.studies.curve_fit.fit_curve', work)
    monkeypatch.setitem(FIGURES, 'fig7', work)
    monkeypatch.setattr('ballbot_ros.studies.sweep.run_sweep', work)
    (tmp_path / 'file').write_text('mine')
    error = refusal(*(word.format(tmp_path / 'file') for word in words))
    assert error.reason == 'not_writable' and f'{tmp_path}/file' in str(error)
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_a_file_that_is_not_a_curve_is_not_overwritten(tmp_path, refuses):
    (tmp_path / 'mine.yaml').write_text('mine: 1')
    words = 'fit-curve', '--out', str(tmp_path / 'mine.yaml')
    refuses('exists', '--out', *words)
    refuses('inconsistent', '--out', *words, '--overwrite')
    assert [path.read_text() for path in tmp_path.iterdir()] == ['mine: 1']


@pytest.mark.parametrize('words, reason, field', [
    (['test-bench', '--driven', '--slope-deg', '5'], 'inconsistent', '--slope-deg'),
    (['test-bench', '--run-up', '1'], 'inconsistent', '--run-up'),
    (['demo', '--protocol', 'vesc'], 'inconsistent', '--protocol'),
    (['demo', '--house', '--hardware'], 'inconsistent', '--house'),
    (['demo', '--house', '--scene', 'flat'], 'inconsistent', '--scene'),
    (['demo', '--goal', '1', '1'], 'inconsistent', '--goal'),
    (['demo', '--firmware', '0.6'], 'not_a_choice', '--firmware'),
    (['demo', '--hardware', '--protocol', 'roboclaw', '--firmware', '0.6'], 'not_a_choice',
     '--firmware'),
    (['demo', '--hardware', '--firmware', '0.4'], 'not_a_choice', '--firmware'),
    (['simulate', 'flat', '--method', 'foo'], 'not_a_choice', '--method'),
    (['simulate', 'flat', '--tolerance', '1e-6', '--method', 'rk4'], 'inconsistent',
     '--tolerance'),
    (['simulate', 'flat', '--models', 'full', '--method', 'rk4'], 'inconsistent', '--models'),
    (['simulate', 'flat', '--method', 'adaptive', '--step', '1e-3'], 'inconsistent', '--step'),
    (['simulate', 'flat', '--accuracy', '1e-4', '--method', 'paper'], 'inconsistent', '--method'),
    (['simulate', 'flat', '--no-figures', '--format', 'png'], 'usage', '--format'),
    (['robots', '--urdf'], 'missing', 'NAME'),
    (['outcomes', 'list'], 'missing', 'FILE'),
    (['outcomes', 'list', 'nowhere.db', '--out', 'x.csv'], 'inconsistent', '--out'),
    (['outcomes', 'show-learning', '--overwrite'], 'inconsistent', '--overwrite'),
    (['sweep', '--vary', 'speed=1', '--cases', '5', '--out', 'x.parquet'], 'inconsistent',
     '--cases'),
    (['outcomes', 'list', 'nowhere.db'], 'missing', 'FILE'),
    (['outcomes', 'list', '.'], 'wrong_kind', 'FILE'),
    (['simulate', './'], 'wrong_kind', 'scene'),
    (['simulate', '/dev/null'], 'wrong_kind', 'scene'),
    (['simulate', './nowhere.yaml'], 'missing', 'scene'),
    (['evaluate-decision', '--kind', 'foo'], 'not_a_choice', 'kind'),
    (['evaluate-decision', '--planners', 'foo'], 'not_a_choice', 'planner'),
    (['evaluate-decision', '--only', '3', '--every', '0'], 'out_of_range', '--every'),
    (['evaluate-decision', '--only', '3', '--every', 'nan'], 'not_finite', '--every'),
    (['run', 'brige'], 'unknown_name', 'brige'),
    (['run', 'start'], 'unknown_name', 'start'),
    (['emulate-motor', '--protocol', 'vesc', '--baud', '0'], 'out_of_range', '--baud'),
    (['emulate-motor', '--protocol', 'vesc', '--scene', 'flatt'], 'unknown_name', 'scene'),
    (['emulate-motor', '--protocol', 'vesc', '--robot', 'gimbal'], 'unknown_name', 'robot'),
    (['emulate-motor', '--protocol', 'roboclaw', '--firmware', '0.6'], 'not_a_choice',
     'firmware'),
    (['emulate-motor', '--protocol', 'odrive', '--firmware', '0.7'], 'not_a_choice',
     'firmware'),
    (['emulate-motor', '--protocol', 'vesc', '--quirk', 'kill_swich'], 'unknown_name',
     'kill_swich'),
    (['emulate-motor', '--protocol', 'vesc', '--link', '/proc/nowhere/x'], 'not_writable',
     '--link'),
    (['evaluate-navigation', '--goals', '0'], 'out_of_range', '--goals'),
    (['evaluate-navigation', '--planners', 'walls'], 'not_a_choice', 'planner'),
    (['evaluate-navigation', '--seed', '-1'], 'out_of_range', '--seed'),
    (['compare-models', '--robot', 'gimbal'], 'unknown_name', 'robot'),
    (['compare-models', '--angle-deg', 'nan'], 'not_finite', '--angle-deg'),
    (['compare-models', '--robot', 'shellball', '--actuation', 'held'], 'missing', 'law'),
    (['compare-models', '--angle-deg', '30'], 'inconsistent', '--angle-deg'),
    (['compare-models', '--angle-deg', '0'], 'inconsistent', '--angle-deg'),
    (['max-step-height', '--speed', '0.5', '--voltage', '0'], 'inconsistent', '--voltage'),
    (['max-step-height', '--speed', '0.5', '--clearance', '0'], 'inconsistent', '--clearance'),
    (['test-bench', '--slope-deg', '-3'], 'out_of_range', '--slope-deg'),
    (['test-bench', '--slope-deg', 'nan'], 'not_finite', '--slope-deg')])
def test_an_impossible_option_is_named(words, reason, field, refuses):
    refuses(reason, field, *words)


def test_a_file_is_not_replaced_by_a_socket(tmp_path, refuses):
    (tmp_path / 'mine.txt').write_text('mine')
    refuses('exists', '--control', 'emulate-motor', '--protocol', 'vesc', '--control',
            tmp_path / 'mine.txt')
    assert (tmp_path / 'mine.txt').read_text() == 'mine'


@pytest.fixture
def sigint(request):
    """Make SIGINT raise KeyboardInterrupt, which background processes of a shell ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))


@pytest.fixture
def verb_of(monkeypatch):
    """Return a function that adds or replaces a verb, given its function `run`."""
    def add(name, run):
        monkeypatch.setitem(sys.modules, 'ballbot_ros.cli.other', types.SimpleNamespace(
            add_arguments=lambda parser: None, run=run))
        monkeypatch.setitem(command.VERBS, name, ('other', 'do something else'))
    return add


@pytest.mark.parametrize('pressed', [True, False])
def test_ctrl_c_is_detected_even_if_an_extension_suppresses_its_exception(
        pressed, sigint, verb_of, capsys):
    def run(_):
        try:
            if pressed:
                os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            pass
        raise RuntimeError('no compiled object yet')

    verb_of('compile', run)
    if pressed:
        assert main(['compile']) == command.INTERRUPTED
        assert capsys.readouterr().err.count('\n') == 1
    else:
        with pytest.raises(RuntimeError):
            main(['compile'])
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_within_a_callback_of_c_code_ends_the_run_quietly(sigint, verb_of, capsys):
    @ctypes.CFUNCTYPE(None)
    def callback():
        os.kill(os.getpid(), signal.SIGINT)

    def run(_):
        callback()
        Event().wait(60.0)
        return 0

    hook = sys.unraisablehook
    verb_of('compile', run)
    assert main(['compile']) == command.INTERRUPTED
    assert capsys.readouterr().err.count('\n') == 1
    assert sys.unraisablehook is hook


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_during_the_write_of_a_file_leaves_no_draft(number, tmp_path):
    # In a separate process, which the signal ends immediately if it is not handled.
    program = (
        'import os, signal, sys\n'
        'from ballbot_ros.cli import main\n'
        'from ballbot_ros.results import files\n'
        f'signal.signal({int(number)}, signal.SIG_DFL)\n'  # under nohup, SIGHUP is ignored
        f'files.os.fsync = lambda _: os.kill(os.getpid(), {int(number)})\n'
        "sys.exit(main(['new', 'robot', 'mine.yaml']))\n")
    ended = subprocess.run([sys.executable, '-c', program], cwd=tmp_path, timeout=60.0)
    assert ended.returncode == 128 + number
    assert list(tmp_path.iterdir()) == []


def test_an_ignored_hangup_stays_ignored(verb_of):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    verb_of('compile', lambda _: os.kill(os.getpid(), signal.SIGHUP) or 0)
    try:
        assert main(['compile']) == 0
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize('verb, code', [
    (verb, 0) for verb in sorted(command.UNTIL_CTRL_C)] + [('topics', 130)])
def test_ctrl_c_is_the_normal_end_of_a_verb_without_another_end(verb, code, verb_of, capsys):
    def run(_):
        raise KeyboardInterrupt

    verb_of(verb, run)
    assert main([verb]) == code
    assert capsys.readouterr().err.count('\n') == (code != 0)


def test_ctrl_c_during_the_imports_of_a_node_is_its_normal_end(monkeypatch, capsys, tmp_path):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr('ballbot_ros.cli.run.from_ros', interrupted)
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bridge').mkdir()  # the name of a node has precedence over a folder
    assert main(['run', 'bridge']) == main(['run', 'simulator', 'controller']) == 0
    assert capsys.readouterr().err == ''


def test_ctrl_c_during_the_imports_of_the_command_leaves_no_traceback():
    program = ('import signal, sys\n'
               'class Interrupt:\n'
               '    def find_spec(self, name, *_):\n'
               '        if name == "ballbot_ros.cli.output": signal.raise_signal(signal.SIGINT)\n'
               'sys.meta_path.insert(0, Interrupt())\n'
               'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
               'from ballbot_ros.cli import main\n')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, '')
