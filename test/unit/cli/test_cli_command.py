# SPDX-License-Identifier: Apache-2.0
"""The command line prints help, and reports an error in one line."""
import argparse
import contextlib
import logging
import re
import subprocess
import sys
import time

import pytest

from ballbot_ros import __version__
from ballbot_ros.cli import listing, main, simulate
from ballbot_ros.cli.command import load_verb, VERBS
from ballbot_ros.cli.listing import describe
from ballbot_ros.config.files import shipped_files

COMMAND = [sys.executable, '-m', 'ballbot_ros.cli']


def called(capsys, *words):
    """Return the exit code, standard output and standard error of a call."""
    code = main(words)
    return (code, *capsys.readouterr())


def test_help_names_every_verb(capsys):
    code, out, err = called(capsys, '--help')
    assert code == 0 and err == ''
    # A long name is alone on its line.
    assert all(re.search(rf'^    {verb}\s', out, re.M) for verb in VERBS)


@pytest.mark.parametrize('verb', sorted(VERBS))
def test_every_verb_has_help(capsys, verb):
    code, out, _ = called(capsys, verb, '--help')
    assert code == 0 and out.startswith(f'usage: ballbot {verb}')


@pytest.mark.parametrize('verb', sorted(VERBS))
def test_options_in_degrees_have_the_unit_in_their_names_and_each_help_is_complete(verb):
    """A user may read only one line of the help: "of the robot" would be incomplete."""
    parser = argparse.ArgumentParser()
    load_verb(verb).add_arguments(parser)
    for action in parser._actions:
        words = (action.help or '').split()
        assert len(words) > 1, action.dest
        assert words[0] not in ('of', 'for', 'by', 'on', 'with', 'that', 'from', 'about', 'in',
                                'at', 'as', 'before', 'after', 'so'), action.help
        assert action.choices or action.nargs in (0, argparse.REMAINDER) or action.metavar, (
            f'{verb}: what does {action.option_strings} take?')
        assert {'--angle', '--slope', '--slopes'}.isdisjoint(action.option_strings)
        assert action.metavar != 'DEGREES' or action.option_strings[-1].endswith('-deg')


@pytest.mark.parametrize('options, said', [([], 1), (['--quiet'], 0)])
def test_quiet_also_silences_the_log_of_a_run(monkeypatch, caplog, options, said):
    monkeypatch.setattr(
        simulate, 'run', lambda _: logging.getLogger('ballbot_ros.jit').warning('wait') or 0)
    assert main(['simulate', 'flat', *options]) == 0
    assert len(caplog.records) == said
    logging.getLogger('ballbot_ros.jit').warning('after it')
    assert len(caplog.records) == said + 1


def test_help_imports_nothing_heavy():
    code = ('import sys; from ballbot_ros.cli import main; main(["simulate", "--help"]); '
            'heavy = {"numpy", "numba", "matplotlib", "yaml", "rich"} & set(sys.modules); '
            'sys.exit(str(heavy) if heavy else 0)')
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert time.perf_counter() - begin < 3.0  # 0.1 s on an idle machine


def test_the_version_is_that_of_the_package(capsys):
    assert called(capsys, '--version') == (0, f'ballbot {__version__}\n', '')


def test_a_call_without_a_verb_prints_help_and_fails(capsys):
    code, out, _ = called(capsys)
    assert code == 2 and 'simulate' in out


@pytest.mark.parametrize('words, field, kind, nearest', [
    (['simulat', 'fig7_top'], 'simulat', None, 'simulate'),
    (['help', 'simulte'], 'simulte', None, 'simulate'),
    (['robots', 'gimbal'], 'robot', 'robots', 'gimball'),
    (['simulate', 'fig7_botom'], 'scene', 'scenes', 'fig7_bottom')])
def test_a_misspelt_name_gets_a_suggestion(words, field, kind, nearest, refusal):
    error = refusal(*words)
    assert (error.reason, error.field) == ('unknown_name', field)
    known = set(VERBS) if kind is None else {path.stem for path in shipped_files(kind)}
    assert known.intersection(re.findall(r'[\w-]+', str(error))) == {nearest}


@pytest.mark.parametrize('words, misspelt, nearest', [
    (['simulate', 'flat', '--durration', '3'], '--durration', {'--duration'}),
    (['max-step-height', '--sped', '0.5'], '--sped', {'--speed'}),
    (['max-step-height', '--speed', '1', '--angle', '5'], '--angle', {'--angle-deg'}),
    (['simulate', 'flat', '--acuracy=1e-5'], '--acuracy', {'--accuracy'}),
    (['simulate', 'flat', '--version'], '--version', set()),
    (['simulate', 'flat', '--held'], '--held', set())])
def test_a_misspelt_option_gets_a_suggestion_if_any(words, misspelt, nearest, refusal):
    error = refusal(*words)
    assert error.reason == 'usage'
    # The message ends with the command that lists all options.
    assert set(re.findall(r'--[\w-]+', str(error))) == {misspelt, *nearest, '--help'}


@pytest.mark.parametrize('words, field', [
    (['simulate', 'fig7_top', '--durtion', '3'], '--durtion'),
    (['simulate', 'fig7_top', '--duration', 'long'], '--duration'), (['simulate'], 'SCENE')])
def test_an_unknown_malformed_or_missing_argument_is_named(words, field, refuses):
    refuses('usage', field, *words)


def test_scenes_lists_each_with_a_description(capsys):
    code, out, _ = called(capsys, 'scenes')
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == [
        path.stem for path in shipped_files('scenes')]
    assert all(len(line.split()) > 3 for line in out.splitlines())


def test_a_description_is_the_first_sentence_of_the_leading_comment(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('# SPDX-License-Identifier: X\n# Fig. 7 of a 2.5 m\n# run.  More.\nrobot: a\n')
    assert describe(path) == 'Fig. 7 of a 2.5 m run'


def test_robots_lists_the_robots(capsys):
    _, out, _ = called(capsys, 'robots')
    assert [line.split()[0] for line in out.splitlines()] == ['gimball', 'shellball']


def test_robot_table_gives_unit_source_range_and_note(capsys):
    code, out, _ = called(capsys, 'robots', 'gimball')
    assert code == 0
    line = next(line for line in out.splitlines() if line.startswith('ball_mass '))
    assert line.split()[1:7] == ['3.8', 'kg', 'derived', '3.3', 'to', '4.15']
    assert 'published, its split' in line
    assert 'motor.gear_ratio' in out and 'restitution' in out
    assert 'contact law: kelvin_voigt' in out
    assert all(len(line) < 130 for line in out.splitlines())


def test_a_robot_whose_restitution_depends_on_the_speed_has_none_in_its_table(capsys, tmp_path):
    path = tmp_path / 'mine.yaml'
    gimball = next(file for file in shipped_files('robots') if file.stem == 'gimball')
    path.write_text(gimball.read_text() + 'contact_law: hunt_crossley\n')
    _, out, _ = called(capsys, 'robots', str(path))
    assert 'slope_limit' in out and 'restitution' not in out and 'damping_ratio' not in out
    assert 'contact law: hunt_crossley' in out


def test_demo_passes_its_options_on(replace_demo, tmp_path):
    import types
    given, case = {}, types.SimpleNamespace(scene='doorstep')

    def run_demo(**options):
        given.update(options)
        return 7

    def run_hardware_demo(**options):
        given.update(options)
        return 8

    def run_house_demo(**options):
        given.update(options)
        return 9

    replace_demo(
        run_demo=run_demo, run_hardware_demo=run_hardware_demo, run_house_demo=run_house_demo,
        demo_cases=lambda *names: [case, names][:1],
        page_beside=lambda quiet: contextlib.nullcontext())
    assert main(['demo', '--out', str(tmp_path), '--real-time', '--timeout', '9']) == 7
    assert given == {'out': tmp_path, 'real_time': True, 'quiet': False, 'timeout': 9.0,
                     'cases': [case], 'watched': False}
    given.clear()
    assert main(['demo', '--out', str(tmp_path), '--view']) == 7
    assert given['watched'] and not given['real_time']
    given.clear()
    (tmp_path / 'bag').mkdir()  # of an earlier run, which this one replaces
    assert main(['demo', '--hardware', '--protocol', 'vesc', '--out', str(tmp_path),
                 '--overwrite']) == 8
    assert given == {'out': tmp_path, 'protocol': 'vesc', 'firmware': '', 'quiet': False,
                     'timeout': 60.0, 'serial_imu': False}
    given.clear()
    assert main(['demo', '--house', '--out', str(tmp_path / 'flat'), '--duration', '5']) == 9
    house = {'out': tmp_path / 'flat', 'real_time': False, 'quiet': False, 'timeout': 60.0,
             'longest': 5.0, 'watched': False, 'robot': None, 'curve': None, 'goals': []}
    assert given == house
    assert main(['demo', '--house', '--out', str(tmp_path / 'flat'), '--duration', '5', '--robot',
                 'gimball', '--goal', '5', '2']) == 9
    assert given == {**house, 'robot': 'gimball', 'goals': [[5.0, 2.0]]}


def test_demo_without_ros_is_refused(refuses, monkeypatch):
    monkeypatch.setitem(sys.modules, 'ballbot_ros.demo.demo', None)
    refuses('not_installed', 'ROS', 'demo')


@pytest.mark.parametrize('seconds, reason', [
    ('0', 'out_of_range'), ('-1', 'out_of_range'), ('inf', 'not_finite'), ('nan', 'not_finite')])
def test_demo_refuses_an_impossible_timeout(refuses, seconds, reason):
    refuses(reason, '--timeout', 'demo', f'--timeout={seconds}')


def test_a_number_out_of_range_is_named_by_its_option(refusal, tmp_path):
    error = refusal('fit-curve', '--out', tmp_path / 'a.yaml', '--accuracy', '0')
    assert error.reason == 'out_of_range' and str(error).startswith('--accuracy ')


def test_an_error_of_the_file_system_is_one_line(monkeypatch, capsys):
    def fail(_):
        raise OSError(28, 'No space left on device', '/full/place')
    monkeypatch.setattr(listing, 'ROBOTS', listing.ROBOTS._replace(run=fail))
    assert main(['robots']) == 1
    assert capsys.readouterr().err == 'ballbot: error: /full/place: No space left on device\n'


def test_a_closed_pipe_is_not_an_error():
    reader = subprocess.Popen([*COMMAND, 'scenes'], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True)
    reader.stdout.close()
    assert reader.stderr.read() == ''
    assert reader.wait(timeout=60) == 141


def test_full_storage_for_the_output_is_an_error_of_one_line():
    with open('/dev/full', 'w') as full:
        ended = subprocess.run([*COMMAND, 'scenes'], stdout=full, stderr=subprocess.PIPE,
                               text=True, timeout=60)
    assert ended.stderr == 'ballbot: error: No space left on device\n'
    assert ended.returncode == 1


@pytest.mark.parametrize('closed', ['>&-', '2>&-', '<&-', '<&- >&- 2>&-'])
def test_a_closed_stream_does_not_change_the_exit_code(closed):
    words = [*COMMAND, 'scenes']
    ended = subprocess.run(['sh', '-c', f'"$@" {closed}', 'sh', *words],
                           capture_output=True, text=True, timeout=60)
    assert (ended.stderr, ended.returncode) == ('', 0)
