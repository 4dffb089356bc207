# SPDX-License-Identifier: Apache-2.0
"""Copies of this process: their exit code, their output and their end."""
from functools import partial
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from ballbot_ros.demo.forked import Forked, run_detached

TIMEOUT = 20.0


@pytest.mark.parametrize('method', ['fork', 'forkserver'])
def test_the_process_has_the_exit_code_of_its_function(method):
    process = Forked(partial(sum, (1, 2)), method)
    assert process.wait(TIMEOUT) == process.poll() == 3
    process.send_signal(signal.SIGTERM)  # not to another process with a reused id


@pytest.mark.slow
def test_an_endless_process_runs_until_a_signal():
    process = Forked(lambda: time.sleep(TIMEOUT) or 0)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1.0)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert process.wait(TIMEOUT) == -signal.SIGTERM
    deaf = Forked(lambda: time.sleep(TIMEOUT) or 0)
    deaf.kill()
    assert deaf.wait(TIMEOUT) == -signal.SIGKILL


@pytest.mark.parametrize('handler, number', [
    (lambda *_: None, signal.SIGHUP), (signal.SIG_IGN, signal.SIGTERM)])
def test_a_process_has_no_handler_of_its_parent_but_ignores_the_same_signals(handler, number):
    reader, writer = os.pipe()

    def work():
        os.write(writer, b'.')
        time.sleep(TIMEOUT)
        return 0
    before = [(signal.SIGHUP, signal.signal(signal.SIGHUP, handler)),
              (signal.SIGTERM, signal.signal(signal.SIGTERM, lambda *_: None))]
    try:
        process = Forked(work)
    finally:
        for one, kept in before:
            signal.signal(one, kept)
    os.read(reader, 1)
    process.send_signal(signal.SIGHUP)
    process.send_signal(signal.SIGTERM)
    assert process.wait(TIMEOUT) == -number
    os.close(reader)
    os.close(writer)


def test_a_detached_process_has_its_own_name_arguments_environment_log_and_session(tmp_path):
    def work():
        name = Path('/proc/self/comm').read_text().strip()
        found = name, sys.argv[1:], dict(os.environ), os.getsid(0) == os.getpid()
        os.write(1, f'{found}\n'.encode())
        os.write(2, b'an error\n')
        return 0
    own = os.environ.get('COLOUR')
    process = Forked(partial(run_detached, 'node', work, ['-p', 'a:=1'], {'COLOUR': 'red'},
                             tmp_path / 'log'))
    assert process.wait(TIMEOUT) == 0
    assert (tmp_path / 'log').read_text() == (
        "('node', ['-p', 'a:=1'], {'COLOUR': 'red'}, True)\nan error\n")
    assert os.environ.get('COLOUR') == own


def test_the_garbage_collection_of_a_copy_visits_no_earlier_object():
    # In a new interpreter: a copy of this one cannot collect objects of the middleware.
    program = """
import gc, sys
from ballbot_ros.demo.forked import Forked, import_nodes
import_nodes(())
sys.exit(Forked(lambda: len(gc.get_objects()) > 1000).wait(20.0))
"""
    assert subprocess.run([sys.executable, '-c', program], timeout=60.0).returncode == 0
