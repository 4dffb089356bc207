# SPDX-License-Identifier: Apache-2.0
"""What ``ballbot view`` shows beside scenes is refused in one line where it cannot be shown."""
import pytest

pytest.importorskip('viser')


@pytest.mark.parametrize('words, reason, field', [
    (['missing.mcap'], 'unreadable', 'missing.mcap'), (['.'], 'unreadable', '.'),
    (['doorstep', '--robot', 'shellball'], 'inconsistent', '--robot'),
    (['doorstep', '--namespace', 'left'], 'inconsistent', '--namespace'),
    (['--live', '--robot', 'gimbal'], 'unknown_name', 'robot')])
def test_an_impossible_view_is_refused(refuses, tmp_path, monkeypatch, words, reason, field):
    monkeypatch.chdir(tmp_path)
    refuses(reason, field, 'view', *words, '--no-browser')
