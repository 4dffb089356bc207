# SPDX-License-Identifier: Apache-2.0
"""The verb ``view`` serves and ends, and refuses invalid input before it starts."""
import socket
import sys

import pytest

from ballbot_ros.cli import main


@pytest.mark.parametrize('words, reason, field', [
    (['--port', '70000'], 'out_of_range', '--port'),
    (['--duration', '0'], 'out_of_range', '--duration'),
    (['doorstepp'], 'unknown_name', 'scene'), (['--live', 'flat'], 'usage', '--live'),
    (['flat', '--live'], 'usage', '--live'), (['--duration', 'inf'], 'not_finite', '--duration')])
def test_a_wrong_value_is_refused(refuses, words, reason, field):
    refuses(reason, field, 'view', *words)


@pytest.mark.parametrize('words, reason, field', [
    (['missing.mcap'], 'unreadable', 'missing.mcap'), (['.'], 'unreadable', '.'),
    (['doorstep', '--robot', 'shellball'], 'inconsistent', '--robot'),
    (['doorstep', '--namespace', 'left'], 'inconsistent', '--namespace'),
    (['--live', '--robot', 'gimbal'], 'unknown_name', 'robot')])
def test_an_impossible_view_is_refused(refuses, tmp_path, monkeypatch, words, reason, field):
    pytest.importorskip('viser')
    monkeypatch.chdir(tmp_path)
    refuses(reason, field, 'view', *words, '--no-browser')


def test_a_missing_viser_is_refused(refuses, monkeypatch):
    monkeypatch.setitem(sys.modules, 'viser', None)
    refuses('not_installed', 'viser', 'view', 'flat')


def test_a_taken_port_is_refused(refusal):
    pytest.importorskip('viser')
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert f'port {port}' in str(refusal('view', 'flat', '--no-browser', '--quiet', '--port',
                                             port, '--duration', '0.1'))


def test_view_prints_its_address_and_ends_by_itself(capsys):
    pytest.importorskip('viser')
    assert main(['view', 'flat', '--no-browser', '--port', '0', '--duration', '0.2']) == 0
    out, err = capsys.readouterr()
    assert out.startswith('http://127.0.0.1:') and out.count('\n') == 1 and 'Traceback' not in err


def test_a_public_address_causes_a_warning(capsys):
    pytest.importorskip('viser')
    assert main(['view', 'flat', '--no-browser', '--quiet', '--host', '0.0.0.0', '--port', '0',
                 '--duration', '0.1']) == 0
    assert '0.0.0.0' in capsys.readouterr().err.split()
