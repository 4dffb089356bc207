# SPDX-License-Identifier: Apache-2.0
"""A log of outcomes survives a kill of its writer, and refuses implausible content."""
from dataclasses import replace
import math
import shlex
import sqlite3
import subprocess
import sys

import pytest

from ballbot_ros.cli import main
from ballbot_ros.decision.learning import outcome_log
from ballbot_ros.decision.learning.outcome_log import OutcomeLog, read_outcomes
from ballbot_ros.decision.learning.outcomes import Outcome
from ballbot_ros.decision.values import After, Plan, Strategy
from ballbot_ros.physics import load_robot

DIGEST = load_robot('gimball').digest
PLAN = Plan(Strategy.SWING, 0.2, 0.9, 1.1, 1.5, 1.4, After.STOP, 2.0)
OUTCOME = Outcome(
    stamp=10.0, result='over', face=1, position=1.4, height=0.031, height_sd=0.001,
    touch_speed=0.85, touch_angle=0.3, held_angle=0.7, passed_speed=0.4, slope=0.01, distance=1.1,
    probability=0.93, robot=DIGEST, plan=PLAN)
OUTCOMES = tuple(replace(OUTCOME, stamp=10.0 * number, plan=plan) for number, plan in (
    (1, PLAN), (2, None), (3, Plan(Strategy.CRUISE, speed=0.5))))


def kept(path, outcomes, robot=DIGEST):
    """Append outcomes, wait for the disk, and return the log."""
    log = OutcomeLog(path, robot)
    for outcome in outcomes:
        log.append(outcome)
    log.close()
    return log


@pytest.fixture(name='path')
def path_of(tmp_path):
    """Return the path of a log with all outcomes."""
    path = tmp_path / 'log'
    kept(path, OUTCOMES)
    return path


def changed(path, statement, *values):
    """Change the database of a log directly."""
    with sqlite3.connect(path) as database:
        database.execute(statement, values)
    database.close()


def test_a_log_is_read_back(tmp_path):
    path = tmp_path / 'log'
    assert kept(path, OUTCOMES[:2]).problem == ''
    assert kept(path, OUTCOMES[2:]).reading.outcomes == OUTCOMES[:2]
    assert read_outcomes(path, DIGEST).outcomes == OUTCOMES


@pytest.mark.slow
def test_outcomes_survive_a_kill_of_their_writer(path):
    script = f"""
import os, signal
from pathlib import Path
from test_decision_outcome_log import OUTCOME, OutcomeLog, DIGEST, replace
log = OutcomeLog(Path({str(path)!r}), DIGEST)
log.append(replace(OUTCOME, stamp=99.0))
log._writer.submit(int).result()
os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, '-c', script], cwd=__file__.rpartition('/')[0], check=False)
    assert [item.stamp for item in read_outcomes(path, DIGEST).outcomes] == [10, 20, 30, 99]


@pytest.mark.parametrize('column, value', [
    ('touch_speed', math.inf), ('touch_speed', 40.0), ('height', 1e9), ('height_sd', -1.0),
    ('probability', 1.5), ('result', 'flew'), ('stamp', 'now'), ('robot', '0123456789abcdef'),
    ('plan', '{"strategy": "cruise"}'), ('plan', '[1]'), ('plan', '{')])
def test_implausible_content_is_refused_and_nothing_is_added(path, column, value):
    changed(path, f'UPDATE outcomes SET {column} = ? WHERE number = 2', value)
    content = path.read_bytes()
    log = kept(path, [replace(OUTCOME, stamp=80.0)])
    assert log.reading.outcomes == () and log.reading.refusal in log.problem
    assert path.read_bytes() == content


@pytest.mark.parametrize('content', [b'not a database\n' * 100, b'\0' * 5000])
def test_another_file_is_refused_and_left_alone(tmp_path, content):
    path = tmp_path / 'log'
    path.write_bytes(content)
    assert kept(path, OUTCOMES).reading.refusal
    assert path.read_bytes() == content


def test_a_truncated_file_and_another_format_are_refused(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:len(whole) - 3000])
    assert read_outcomes(path, DIGEST).refusal
    path.write_bytes(whole)
    changed(path, 'PRAGMA user_version = 77')
    assert 'format 77' in read_outcomes(path, DIGEST).refusal
    path.write_bytes(b'')
    assert 'format' not in read_outcomes(path, DIGEST).refusal != ''


def test_a_burst_of_outcomes_is_refused(tmp_path):
    path = tmp_path / 'log'
    log = kept(path, [replace(OUTCOME, stamp=1.0 + 1e-4 * number) for number in range(9)])
    assert 'implausible' in log.problem
    assert len(read_outcomes(path, DIGEST).outcomes) == outcome_log.BURST_MAX
    # The same stamp in other runs is plausible: a simulation repeats itself.
    kept(path, [OUTCOME])
    assert len(kept(path, [OUTCOME]).reading.outcomes) == outcome_log.BURST_MAX + 1
    changed(path, 'UPDATE outcomes SET run = "a", stamp = 1.0')
    assert 'implausible' in read_outcomes(path, DIGEST).refusal


def test_only_the_latest_outcomes_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(outcome_log, 'OUTCOMES_MAX', 2)
    path = tmp_path / 'log'
    kept(path, OUTCOMES)
    assert read_outcomes(path, DIGEST).outcomes == OUTCOMES[1:]


def test_a_failed_write_is_reported_and_retried(tmp_path):
    path = tmp_path / 'folder' / 'log'
    log = kept(path, OUTCOMES[:1])
    assert 'is not kept' in log.problem
    log = OutcomeLog(path, DIGEST)
    log.append(OUTCOMES[0])
    log._writer.submit(int).result()
    path.parent.mkdir()
    log.append(OUTCOMES[1])
    log.close()
    assert log.problem == '' and read_outcomes(path, DIGEST).outcomes == OUTCOMES[1:2]


@pytest.mark.slow
def test_two_processes_do_not_write_to_one_log(path, capsys):
    first = OutcomeLog(path, DIGEST)
    first.append(replace(OUTCOME, stamp=50.0))
    first._writer.submit(int).result()
    second = kept(path, [replace(OUTCOME, stamp=60.0)])
    assert 'locked' in second.problem
    assert main(['outcomes', 'reset', str(path)]) == 2 and path.exists()
    first.close()
    assert read_outcomes(path, DIGEST).outcomes[-1].stamp == 50.0
    assert main(['outcomes', 'reset', str(path)]) == 0 and not path.exists()
    assert read_outcomes(path.with_name('log.1'), DIGEST).outcomes[:3] == OUTCOMES


def test_a_log_that_is_refused_can_be_reset(tmp_path, capsys):
    path = tmp_path / 'my log'
    path.write_text('not a database')
    assert main(['outcomes', 'list', str(path)]) == 2
    _, *hint = shlex.split(capsys.readouterr().err.split('"')[1])
    assert main([*hint, '--quiet']) == 0
    assert path.with_name('my log.1').read_text() == 'not a database'


def test_outcomes_are_listed_and_exported(path, tmp_path, capsys):
    assert main(['outcomes', 'list', str(path)]) == 0
    assert '3 outcomes, of which 3 crossed' in capsys.readouterr().out
    out = tmp_path / 'out.csv'
    assert main(['outcomes', 'export', str(path), '--out', str(out)]) == 0
    assert out.read_text().splitlines()[1].startswith('10.0,over,1,1.4,')
    again = tmp_path / 'new' / 'OUT.CSV'
    assert main(['outcomes', 'export', str(path), '--out', str(again)]) == 0
    assert again.read_text() == out.read_text()


def test_an_export_that_fails_keeps_the_older_file(path, tmp_path, refuses, monkeypatch):
    def fail(_):
        raise OSError(28, 'No space left on device')

    out = tmp_path / 'out.csv'
    out.write_text('older')
    monkeypatch.setattr('os.fsync', fail)
    refuses('not_writable', str(out), 'outcomes', 'export', path, '--out', out, '--overwrite')
    assert out.read_text() == 'older'
