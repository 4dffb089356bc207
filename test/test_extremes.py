# SPDX-License-Identifier: Apache-2.0
"""`make extremes` reports its progress, and Ctrl-C keeps the completed cases."""
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import pytest

RUN = Path(__file__).resolve().parents[1] / 'extremes' / 'run.py'
ENOUGH = 4000  # number of cases that takes far longer than the test


def begin(*words, **options):
    """Start the program in a separate process group."""
    # A background shell ignores SIGINT, and children inherit that.
    return subprocess.Popen(
        [sys.executable, str(RUN), *words], stdout=subprocess.PIPE, text=True,
        start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **{'stderr': subprocess.PIPE, **options})


def test_ctrl_c_keeps_completed_cases_and_the_exit_code_reports_it(tmp_path):
    found = tmp_path / 'found.json'
    words = ['--class', 'slope', '--cases', str(ENOUGH), '--jobs', '1', '--json', str(found)]
    with begin(*words) as process:
        first = process.stderr.readline()
        # As from a terminal: every process of the group receives the signal.
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert re.fullmatch(rf'\d+ of {ENOUGH} cases, 0 wrong, \d+ s\n', first)
    assert process.returncode == 130
    verdicts = json.loads(found.read_text())
    assert 0 < len(verdicts) < ENOUGH
    assert {item['name'] for item in verdicts} == {'slope'}
    assert out.splitlines()[-1].split()[:2] == ['all', str(len(verdicts))]
    assert f'ended after {len(verdicts)} of {ENOUGH} cases' in err
    assert 'Traceback' not in err


def test_each_tenth_prints_a_line_of_progress_and_completed_cases_have_verdicts(tmp_path):
    found = tmp_path / 'found.json'
    with begin('--class', 'slope', '--cases', '30', '--jobs', '1', '--json',
               str(found)) as process:
        out, err = process.communicate(timeout=60)
    assert [line.split(',')[0] for line in err.splitlines()] == [
        f'{done} of 30 cases' for done in range(3, 31, 3)]
    verdicts = json.loads(found.read_text())
    assert len(verdicts) == 30 and {item['seed'] for item in verdicts} == set(range(30))
    assert process.returncode == int(any(item['verdict'] == 'WRONG' for item in verdicts))
    assert out.splitlines()[-1].split()[:2] == ['all', '30']


def test_recorded_cases_are_not_repeated(tmp_path):
    kept = tmp_path / 'kept'
    words = ['--class', 'slope', '--jobs', '1', '--resume', str(kept)]
    with begin(*words, '--cases', '3') as process:
        process.communicate(timeout=60)
    first = kept.read_text()
    kept.write_text(first + '{"name": "slo')  # as if killed while writing
    with begin(*words, '--cases', '5') as process:
        out, err = process.communicate(timeout=60)
    added = kept.read_text().removeprefix(first)
    assert sorted(json.loads(line)['seed'] for line in added.splitlines()[-2:]) == [3, 4]
    assert out.splitlines()[-1].split()[:2] == ['all', '5'] and process.returncode == 0


def test_a_terminal_shows_progress_on_one_line():
    pty = pytest.importorskip('pty')
    ours, theirs = pty.openpty()
    with begin('--class', 'slope', '--cases', '4', '--jobs', '1', stderr=theirs) as process:
        os.close(theirs)
        process.communicate(timeout=60)
    said = os.read(ours, 10_000).decode()
    os.close(ours)
    assert '\r4 of 4 cases, 0 wrong' in said and said.count('\n') == 1


def test_one_case_can_be_repeated_by_its_name():
    with begin('--only', 'slope:17') as process:
        out, _ = process.communicate(timeout=60)
    assert out.startswith('slope:17  good') and process.returncode == 0


def test_an_unknown_case_is_refused():
    with begin('--only', 'slop:1') as process:
        _, err = process.communicate(timeout=60)
    assert '--only takes CLASS:SEED' in err and process.returncode == 2
