# SPDX-License-Identifier: Apache-2.0
"""What ``ballbot view`` shows beside scenes is refused in one line where it cannot be shown."""
import pytest

pytest.importorskip('viser')


@pytest.mark.parametrize('words, says', [
    (['missing.mcap'], 'missing.mcap: is not a readable bag'),
    (['.'], 'is not a readable bag'),
    (['doorstep', '--robot', 'shellball'], '--robot requires a bag or --live'),
    (['doorstep', '--namespace', 'left'], '--namespace requires a bag or --live'),
    (['--live', '--robot', 'gimbal'], "no robot named 'gimbal'")])
def test_an_impossible_view_is_refused(error_of, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    assert says in error_of('view', *words, '--no-browser')
