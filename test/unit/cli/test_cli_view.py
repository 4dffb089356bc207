# SPDX-License-Identifier: Apache-2.0
"""The verb ``view`` serves and ends, and refuses what it cannot serve before the work."""
import socket
import sys

import pytest

from ballbot_ros.cli import main


@pytest.mark.parametrize('words, message', [
    (['--port', '70000'], 'at most 65535'), (['--duration', '0'], 'more than 0 s'),
    (['doorstepp'], "did you mean 'doorstep'"), (['--duration', 'inf'], 'finite')])
def test_a_wrong_value_is_refused(error_of, words, message):
    assert message in error_of('view', *words)


def test_a_missing_viser_is_refused(refuses, monkeypatch):
    monkeypatch.setitem(sys.modules, 'viser', None)
    refuses('not_installed', 'viser', 'view', 'flat')


def test_a_taken_port_is_refused(error_of):
    pytest.importorskip('viser')
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert f'port {port}' in error_of('view', 'flat', '--no-browser', '--quiet', '--port',
                                          str(port), '--duration', '0.1')


def test_it_serves_says_where_and_ends_by_itself(capsys):
    pytest.importorskip('viser')
    assert main(['view', 'flat', '--no-browser', '--port', '0', '--duration', '0.2']) == 0
    out, err = capsys.readouterr()
    assert out.startswith('http://127.0.0.1:') and out.count('\n') == 1 and 'Traceback' not in err


def test_to_listen_beyond_this_machine_warns(capsys):
    pytest.importorskip('viser')
    assert main(['view', 'flat', '--no-browser', '--quiet', '--host', '0.0.0.0', '--port', '0',
                 '--duration', '0.1']) == 0
    assert 'no password' in capsys.readouterr().err
